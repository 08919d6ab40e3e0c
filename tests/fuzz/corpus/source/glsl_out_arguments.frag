#version 300 es
void both(vec2 q, out float a, inout float b) { a = q.x; b += q.y; }
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
float a, b = 0.5; both(p, a, b); c = vec3(a, b, 0);
    O = vec4(c, 1.0);
}
