#define F(a, b) ((a) + (b))
#define G F
#define LOOP(n, body) for (int i = 0; i < n; ++i) { body }
#if defined(F) && !defined(Q) || 0x10 > 010
#define Z \
  1.
#elif 1
#error no
#else
it's
#endif
#pragma x('y')
#undef Q
uniform Block { float a; vec3 c[2]; } b;
const struct S { float v; } s = S(2.), u[2] = S[](S(1.), S(3.));
out vec4 color;
void main() { LOOP(3, color.x += G(b.a, Z);) color.yz = vec2(u[1].v, s.v > 1. ^^ true); }
