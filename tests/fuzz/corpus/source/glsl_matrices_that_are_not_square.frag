#version 300 es
const mat3x2 K = mat3x2(1, 2, 3, 4, 5, 6); uniform mat2x3 u; mat2x3 turn(mat2x3 m) { m[0] *= 2.0; m[1][2] += 1.0; return m; }
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
mat2x3 m = turn(mat2x3(p.x, 2, 3, 4, p.y, 6)); int i = int(I.x) % 2; vec2 w = vec3(1, p) * m; mat2 s = K * m; mat3x2 t = transpose(m); mat4x3 d = mat4x3(2.0); mat2x3 o = outerProduct(vec3(1, 2, 3), p); c = m * p + vec3(w, s[1][0]) + mat3(m)[2] + vec3(t[2], mat2(u)[1].y) + d[2] + o[1] + m[i];
    O = vec4(c, 1.0);
}
