#version 300 es
const int k[2] = int[2](0xFFFFFFFE, 0x80000000);
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
int i = 0xfefd4986; c = vec3(k[0] + 3, k[1] >> 31, i >> 24);
    O = vec4(c, 1.0);
}
