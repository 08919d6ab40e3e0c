#define E
#define F(x)
#define G(x) x E
#if E 1
E out F(vec2) vec4 color;
#endif
void main() { E color = G(vec4(F() 1. F(E))); }
