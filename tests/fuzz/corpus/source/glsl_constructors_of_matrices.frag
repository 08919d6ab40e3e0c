#version 300 es
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
mat3 m = mat3(2.0); mat2 k = mat2(mat3(1, 2, 3, 4, p.x, 6, 7, 8, 9)); mat4 w = mat4(k); c = m * vec3(p, 1) + vec3(k[1], w[3][3]);
    O = vec4(c, 1.0);
}
