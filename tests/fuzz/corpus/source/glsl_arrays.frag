#version 300 es
const float w[] = float[](0.25, 0.5, 1.0); struct S { vec2 a; float b; };
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
float s = 0.0; for (int i = 0; i < w.length(); i++) s += w[i] * p.x; S q[2] = S[2](S(p, 1.0), S(p.yx, 2.0)); c = vec3(q[1].a, s);
    O = vec4(c, 1.0);
}
