#version 300 es
float pick(float a[3], int i) { return a[i]; } float[2] two(float x) { return float[2](x, 1.0 - x); }
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
int k = int(I.x) % 3; c = vec3(float[3](0.1, 0.5, 0.9)[k], pick(float[](p.x, 0.2, p.y), k), two(p.x)[1]); c += vec3[](vec3(1, 0, 0), vec3(0, 1, 0), vec3(0, 0, 1))[k];
    O = vec4(c, 1.0);
}
