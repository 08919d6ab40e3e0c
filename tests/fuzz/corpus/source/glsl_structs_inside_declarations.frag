#version 300 es
struct S { float a; } s0, s1; const struct { vec2 v; } k = { vec2(0.5, 2) }; float f() { struct Q { float b; int n[2]; } q; struct R { Q q; }; R r; q.b = 0.25; r.q = q; return r.q.b; }
void mainImage(out vec4 O, in vec2 I) {
    vec2 p = I / iResolution.xy;
    vec3 c = vec3(0.0);
s0.a = p.x; S t = s0; c = vec3(t.a + s1.a, k.v.x, f());
    O = vec4(c, 1.0);
}
