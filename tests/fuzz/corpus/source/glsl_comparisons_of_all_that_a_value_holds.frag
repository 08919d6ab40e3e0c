#version 300 es
struct S { float a; ivec2 n; }; struct T { S s[2]; bool b; };
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
int i = int(I.x) % 2; S a = S(0.5, ivec2(1, i)), b = S(0.5, ivec2(1, 0)); float v[2] = float[](0.0, p.x), w[2] = float[](0.0, p.y); T t = T(S[](a, b), true), u = T(S[](b, b), i == 0); c = vec3(a == b, v != w, mat2(p, p) == mat2(p.xyxy)); c.z += float(t == u) + float(mat2(1.0) != mat2(1, 0, 0, 1));
    O = vec4(c, 1.0);
}
