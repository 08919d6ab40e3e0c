#version 300 es
vec3 pow(vec3 v, float e) { return pow(v, vec3(e)); } int mod(int a, int b) { return a - b * (a / b); } float round(float x) { return floor(x + 0.5); }
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
c = pow(vec3(p, 0.5), 2.0) + mod(p.x * 4.0, 1.0) + float(mod(int(I.x), 3)) + round(p.y) + round(p.xyy);
    O = vec4(c, 1.0);
}
