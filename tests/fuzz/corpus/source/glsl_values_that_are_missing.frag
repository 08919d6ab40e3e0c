#version 300 es
float f(float a) { float r; if (a > 0.5) r = a; return r; } float g(float a) { if (a > 0.5) return 1.0; }
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
vec2 v; v.x = p.x; c = vec3(f(p.x), g(p.y), v.y);
    O = vec4(c, 1.0);
}
