/* The checker's rules, one row each: a program and the errors it gives as "CODE@line:column", sorted by place, or ""
 * where it is right. Rows whose body stands in a shader begin at line 2. */
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "compiler/front/ast.h"

typedef struct Row {
    const char *source, *expected;
} Row;

#define S(body) "shader float main(float2 x) {\n" body "\nreturn 0.0; }\n"
/* Text at file scope, then a shader that is right. */
#define F(text) text "\nshader float main(float2 x) { return 0.0; }\n"

static const Row names[] = {
    {S(""), ""},
    {S("float y = radus;"), "E0101@2:11"},
    {S("float y = a; float a = 1.0;"), "E0101@2:11"},
    {S("{ float a = 1.0; } float y = a;"), "E0101@2:30"},
    {S("float a = 1.0; float a = 2.0;"), "E0103@2:22"},
    {S("float a = 1.0; { float a = 2.0; }"), ""},
    {S("float x = 1.0;"), "E0103@2:7"},
    {S("for (int i = 0; i < 2; i++) { int i = 3; }"), ""},
    {F("const float A = B; const float B = 2.0;"), ""},
    {F("float f() { return g(); } float g() { return K; } const float K = 1.0;"), ""},
    {F("const int A = B; const int B = A;"), "E0124@1:11"},
    {F("const int A = A + 1;"), "E0124@1:11"},
    {F("struct S { float a[N]; }; const int N = M; const int M = 2;"), ""},
    {F("struct A { A next; };"), "E0128@1:12"},
    {F("struct A { B b; }; struct B { A a; };"), "E0128@1:31"},
    {F("struct A { float a; float a; };"), "E0128@1:27"},
    {F("typedef T T;"), "E0124@1:9"},
    {F("typedef float3 Colour; struct D { Colour c; }; param D d = { float3(1.0) };"), ""},
    {F("float f(float a) { return a; } const float f = 1.0;"), "E0103@1:44"},
    {F("float f(float a) { return a; } float f(float b) { return b; }"), "E0208@1:38"},
    {F("float f(float a) { return a; } float f(int b) { return 1.0; }"), ""},
    {F("vec3 v() { return 1.0; }"), "E0102@1:1"},
    {F("struct Disc { float r; }; float f(Disk d) { return d.r; }"), "E0102@1:35"},
    {S("float y = main;"), "E0105@2:11"},
    {S("float y = sin;"), "E0105@2:11"},
    {S("float sin = 1.0; float y = sin(1.0);"), "E0106@2:28"},
    {F("param float step = 0.1; float f() { return step(0.1, 0.2); }"), "E0106@1:44"},
    {S("float y = PI + TAU + EPSILON; bool b = y < INFINITY;"), ""},
    {F("float lerp(float a) { return a; } float g() { return lerp(1.0); }"), ""},
    {F("float lerp(float a) { return a; } float g() { return lerp(1.0, 2.0, 3.0); }"), "E0120@1:54"},
    {S("foo(1.0);"), "E0101@2:1"},
    {S("float y = foo(bar);"), "E0101@2:11 E0101@2:15"},
    {S("Hit h; h.t = 1.0; float y = h.t; Silhouette s; s.found = true;"), ""},
};

static const Row conversions[] = {
    {S("float y = 1; uint u = 1; float z = 1u; float2 v = int2(1, 2); uint2 w = int2(1, 2);"), ""},
    {S("int i = 1u;"), "E0107@2:9"},
    {S("int i = 1.5;"), "E0107@2:9"},
    {S("uint u = 1.0;"), "E0107@2:10"},
    {S("bool b = 1;"), "E0107@2:10"},
    {S("float y = true;"), "E0107@2:11"},
    {S("int i = int(1.5); uint u = uint(2.5); bool b = bool(1); float f = float(true);"), ""},
    {S("float y = x;"), "E0107@2:11"},
    {S("float2 v = float3(1.0);"), "E0107@2:12"},
    {S("float3 v = x;"), "E0107@2:12"},
    {S("float3 v = 1.0; v = 2; int3 i = 1; v = i;"), ""},
    {S("float2x2 m = 1.0;"), "E0107@2:14"},
    {S("float2x2 m = float2x2(1.0);"), "E0114@2:14"},
    {S("float2x2 m = float2x2(1, 2, 3, 4); float2x2 n = float2x2(x, x);"), ""},
    {S("float2x2 m = float2x2(1, 2, 3);"), "E0114@2:14"},
    {S("float3 v = float3(x, 1.0); float4 w = float4(x, x); float3 a = float3(1);"), ""},
    {S("float3 v = float3(x);"), "E0114@2:12"},
    {S("float3 v = float3(x, x);"), "E0114@2:12"},
    {S("int2 i = int2(x); uint3 u = uint3(1.5, 2.5, 3.5);"), ""},
    {S("float2 v = float2(float3(1.0));"), "E0114@2:12"},
    {F("float3 f() { return 1.0; } float g() { return float2(1.0); }"), "E0107@1:47"},
    {F("float f(float3 v) { return v.x; } float g() { return f(1.0); }"), "E0107@1:56"},
    {F("float f(float v) { return v; } float g() { return f(1) + f(2u); }"), ""},
    {F("float f(float v) { return v; } float g() { return f(true); }"), "E0107@1:53"},
    {F("float f(float3 v) { return v.x; } float g() { return f(int3(1)); }"), ""},
    {S("float a[2] = { 1, 2u }; float b[2] = a; b = a;"), ""},
    {S("float a[2] = { 1.0 };"), "E0115@2:14"},
    {S("float a[2] = { 1.0, 2.0, 3.0 };"), "E0115@2:14"},
    {S("float a[2] = 1.0;"), "E0107@2:14"},
    {S("float a[2][2] = { { 1, 2 }, { 3, 4 } };"), ""},
    {S("float a[2][2] = { { 1, 2 }, { 3 } };"), "E0115@2:29"},
    {S("float3 v = { 1, 2, 3 }; float2x2 m = { { 1, 2 }, { 3, 4 } }; float2x2 n = { 1, 2, 3, 4 };"), ""},
    {S("float3 v = { 1, 2 };"), "E0115@2:12"},
    {S("float v = { 1 };"), "E0115@2:11"},
    {S("float a[2]; float b[3]; a = b;"), "E0107@2:29"},
    {F("struct D { float2 c; int n; }; float f() { D d = { float2(1.0), 3 }; D e = D(1.0, 2); D z = (D)0; return d.c.x + e.c.y; }"),
     ""},
    {F("struct D { float2 c; int n; }; float f() { D d = { float2(1.0) }; return 1.0; }"), "E0115@1:50"},
    {F("struct D { float2 c; int n; }; float f() { D d = { 1.0, 1.5 }; return 1.0; }"), "E0107@1:57"},
    {F("struct D { float a; }; struct E { float a; }; float f(D d) { E e = d; return 1.0; }"), "E0107@1:68"},
};

static const Row operators[] = {
    {S("float3 v = float3(1.0) * 2 + 1 - int3(1) / 2u;"), ""},
    {S("float2 v = float2(1.0) + float3(1.0);"), "E0108@2:24"},
    {S("float y = true + 1.0;"), "E0108@2:16"},
    {S("bool b = true + false;"), "E0108@2:15"},
    {S("bool b = true < false;"), "E0108@2:15"},
    {S("bool b = true == false; bool c = b != true; bool2 d = bool2(true, false) == b;"), ""},
    {S("bool b = true == 1;"), "E0108@2:15"},
    {S("bool2 b = x < 1.0; bool2 c = b & (x > 0.0) | b ^ b; bool2 d = !c;"), ""},
    {S("bool b = x < 1.0;"), "E0107@2:10"},
    {S("if (x < 1.0) { }"), "E0116@2:5"},
    {S("bool b = any(x < 1.0) && all(x > 0.0) || true;"), ""},
    {S("bool b = (x < 1.0) && true;"), "E0116@2:10"},
    {S("bool b = 1 && true;"), "E0116@2:10"},
    {S("if (1) { }"), "E0116@2:5"},
    {S("float y = 1 ? 2.0 : 3.0;"), "E0116@2:11"},
    {S("float2 y = true ? x : 1.0; float z = true ? 1 : 2.5;"), ""},
    {S("float2 y = true ? x : float3(1.0);"), "E0108@2:17"},
    {S("float y = true ? 1.0 : false;"), "E0108@2:16"},
    {S("int i = 7 % 3 & 1 | 2 ^ 4 << 2 >> 1; uint u = 1u << 3; u = ~u; i = 1 << 2u;"), ""},
    {S("int i = 1.0 & 2;"), "E0108@2:13"},
    {S("int i = 1 << 2.0;"), "E0108@2:11"},
    {S("float y = 5.5 % 2.0; float2 z = x % 2;"), ""},
    {S("int i = ~1.0;"), "E0109@2:9"},
    {S("float y = -true;"), "E0109@2:11"},
    {S("bool b = !1;"), "E0109@2:10"},
    {S("float2x2 m = float2x2(1, 0, 0, 1); m = m * m + m - m; float2 v = m * x; v = x * m; m = m * 2; m = 2 * m; m = m / 2; m *= m; v *= m; m *= 2; m /= 2.0;"),
     ""},
    {S("float2x2 m = float2x2(1, 0, 0, 1); m = m + 1.0;"), "E0108@2:42"},
    {S("float2x2 m = float2x2(1, 0, 0, 1); m = m / m;"), "E0108@2:42"},
    {S("float2x2 m = float2x2(1, 0, 0, 1); float3 v = m * float3(1.0);"), "E0108@2:49"},
    {S("float2x2 m = float2x2(1, 0, 0, 1); m = 2.0 / m;"), "E0108@2:44"},
    {S("float2x2 m = float2x2(1, 0, 0, 1); bool b = m == m;"), "E0108@2:47"},
    {S("float2x3 m = { { 1, 2, 3 }, { 4, 5, 6 } }; float2 v = m * float3(1.0); float3 w = x * m; float3x2 t = transpose(m); float2x2 q = m * t; float3x3 r = t * m; m[1] = w; m = m + m; m = q * m;"),
     ""},
    {S("float2x3 m = float2x3(1, 2, 3, 4, 5, 6); float2 v = m * x;"), "E0108@2:55"},
    {S("float2x3 m = float2x3(1, 2, 3, 4, 5, 6); m = m * m;"), "E0108@2:48"},
    {S("float2x3 m = float2x3(1, 2, 3, 4, 5, 6); float d = determinant(m);"), "E0119@2:52"},
    {S("float2x2 m = float2x2(1, 0, 0, 1); m = mul(m, m); float2 v = mul(m, x) + mul(x, m) + mul(x, x);"), ""},
    {S("float2x2 m = float2x2(1, 0, 0, 1); m[0][1] = 2.0; m[1] = x; m[0].y = m[1][0];"), ""},
    {S("float a[2]; bool b = a == a;"), "E0108@2:24"},
    {S("int i = 0; i++; --i; float f = 0.0; f++; float2 v = x; v++;"), ""},
    {S("bool b = true; b++;"), "E0109@2:17"},
    {S("int i = 0; i += 1.5;"), "E0107@2:14"},
    {S("int i = 0; i += 1u;"), "E0107@2:14"},
    {S("float f = 0.0; f += 1; uint u = 1u; u += 2; float3 v = 1.0; v *= 2; v += f; u <<= 2; bool b = true; b &= false;"),
     ""},
    {S("float f = 0.0; f += x;"), "E0107@2:18"},
};

static const Row parts[] = {
    {S("float4 v = x.xyxy; v = v.bgra; v.xz = x; float y = v.wzyx.x;"), ""},
    {S("float2 v = x.xg;"), "E0111@2:14"},
    {S("float y = x.z;"), "E0111@2:13"},
    {S("float y = x.q;"), "E0111@2:13"},
    {S("float4 v = x.xyxyx;"), "E0111@2:14"},
    {S("float2 v = x; v.xx = x;"), "E0113@2:15"},
    {S("float2 v = x; v.xy.yx = x; v.yx.x = 1.0;"), ""},
    {S("float3 v = (2.0).xxx; float y = 1.0; v = y.xxx; y.x = 2.0;"), ""},
    {S("float y = x[0]; y = x[1u]; int i = 1; y = x[i];"), ""},
    {S("float y = x[1.0];"), "E0112@2:13"},
    {S("float y = 1.0; y = y[0];"), "E0112@2:20"},
    {F("struct D { float radius; }; float f(D d) { return d.radus; }"), "E0110@1:53"},
    {S("float a[3]; float y = a[7]; y = a.x;"), "E0110@2:35"},
    {S("x = x + 1.0; x.x = 2.0;"), ""},
    {F("param float p = 1.0; float f() { p = 2.0; return p; }"), "E0113@1:34"},
    {F("const float K = 1.0; float f() { K += 2.0; return K; }"), "E0113@1:34"},
    {F("param float p[2] = { 1, 2 }; float f() { p[0] = 2.0; return p[1]; }"), "E0113@1:42"},
    {S("const float k = 1.0; k = 2.0;"), "E0113@2:22"},
    {S("1.0 = 2.0;"), "E0113@2:1"},
    {S("(x + x).x = 2.0;"), "E0113@2:1"},
    {S("float3(1.0).x++;"), "E0113@2:1"},
    {F("float f(in float a, inout float b, out float c) { a = 1.0; b += a; c = b; return c; }"), ""},
};

static const Row calls[] = {
    {F("float f(float a) { return a; } float g() { return f(1.0, 2.0); }"), "E0120@1:51"},
    {F("float f(float a) { return a; } float f(float2 a) { return a.x; } float g() { return f(true); }"), "E0117@1:85"},
    {F("float f(uint a) { return 1.0; } float f(float a) { return a; } float g() { return f(1); }"), "E0118@1:83"},
    {F("float f(int a) { return 1.0; } float f(float a) { return a; } float g() { return f(1) + f(1u) + f(1.0); }"),
     ""},
    {F("float f(int a, float b) { return b; } float f(float a, int b) { return a; } float g() { return f(1, 1); }"),
     "E0118@1:96"},
    {F("float f(int a, float b) { return b; } float f(float a, float b) { return a; } float g() { return f(1, 1) + f(1.0, 1); }"),
     ""},
    {F("float f(int a, float b) { return b; } float f(float a, int b) { return a; } float f(int a, int b) { return 1.0; } float g() { return f(1, 1); }"),
     ""},
    {F("void f(out float a) { a = 1.0; } float g() { float b; f(b); return b; }"), ""},
    {F("void f(out float a) { a = 1.0; } float g() { f(1.0); return 1.0; }"), "E0207@1:48"},
    {F("void f(out float a) { a = 1.0; } float g() { int b; f(b); return 1.0; }"), "E0207@1:55"},
    {F("void f(inout float3 a) { a = 1.0; } float g() { float b = 1.0; f(b); return 1.0; }"), "E0207@1:66"},
    {F("param float p = 1.0; void f(out float a) { a = 1.0; } float g() { f(p); return 1.0; }"), "E0207@1:69"},
    {F("void f(out float2 a) { a = 1.0; } float g() { float3 v = 1.0; f(v.xz); return v.x; }"), ""},
    {F("void f(out float2 a) { a = 1.0; } float g() { float3 v = 1.0; f(v.xx); return v.x; }"), "E0207@1:65"},
    {F("void f() { } float g() { float y = f(); return 1.0; }"), "E0127@1:36"},
    {F("void f() { } float g() { f(); return sin(f()); }"), "E0127@1:42"},
    {S("float y = main(x);"), "E0211@2:11"},
    {F("float f() { return f(); }"), "E0202@1:20"},
    {F("float f() { return g(); } float g() { return h(); } float h() { return f(); }"), "E0202@1:72"},
    {S("float y = dot(x, x) + length(x) + distance(x, x); float3 c = cross(float3(1.0), int3(2)); c = normalize(c);"),
     ""},
    {S("float y = dot(1.0, x);"), "E0119@2:11"},
    {S("float y = dot(x, float3(1.0));"), "E0119@2:11"},
    {S("float y = length(1.0);"), "E0119@2:11"},
    {S("float3 c = cross(x, x);"), "E0119@2:18"},
    {S("float y = sin(true);"), "E0119@2:11"},
    {S("float y = sin();"), "E0120@2:11"},
    {S("float y = max(1, 2.0); int i = max(1, 2); uint u = min(1, 2u); float2 v = clamp(x, 0, 1); v = lerp(x, 1.0, 0.5); v = lerp(0, 1, x);"),
     ""},
    {S("float2 v = max(x, float3(1.0));"), "E0119@2:12"},
    {S("int i = floor(1.5);"), "E0107@2:9"},
    {S("bool2 b = isnan(x); bool c = isinf(1.0);"), ""},
    {S("float2 v = select(x < 0.5, x, 1.0); float y = select(true, 1, 2.0); v = select(true, x, -x);"), ""},
    {S("float2 v = select(x < 0.5, float3(1.0), 2.0);"), "E0119@2:12"},
    {S("float y = select(1.0, 2.0, 3.0);"), "E0119@2:11"},
    {S("uint u = asuint(1.0) + hash(1) + hash(uint2(1, 2)) + hash(int3(1)); float y = asfloat(u); uint2 v = asuint(x);"),
     ""},
    {S("uint u = hash(1.0);"), "E0119@2:10"},
    {S("float2x2 m = float2x2(1, 0, 0, 1); float y = determinant(inverse(transpose(m))); y = determinant(x);"),
     "E0119@2:86"},
    {S("float y = rand() + rand2().x + rand3().z; int2 p = pixel() + resolution(); uint u = sample_index(); y = detach(y);"),
     ""},
    {S("float2 v = refract(x, x, 1.5) + reflect(x, x);"), ""},
    {S("print(\"x = {}\", x); assert(x.x > 0.0);"), ""},
    {S("assert(1.0);"), "E0116@2:8"},
    {S("float a[2]; print(\"{}\", a);"), "E0119@2:25"},
};

static const Row resources[] = {
    {F("param texture2D t = zeros(4, 4); float f(float2 x) { float4 a = t.sample(x); float3 b = t.sample(x); float c = t.nearest(x); float2 d = t.load(int2(x)); int2 n = t.size(); b = t.sample(x); return t.sample(x); }"),
     ""},
    {F("param texture2D t = zeros(4, 4); float f(float2 x) { float3 b = t.sample(x) * 2.0; return b.x; }"),
     "E0107@1:65"},
    {F("param texture2D t = zeros(4, 4); float g(float3 v) { return v.x; } float f(float2 x) { return g(t.sample(x)) + g(t.sample(x).rgb); }"),
     ""},
    {F("param texture2D t = zeros(4, 4); float f(float2 x) { float3 c = 0.0; c += t.sample(x); c = lerp(c, t.sample(x), 0.5); return c.x; }"),
     ""},
    {F("param texture2D t = zeros(4, 4); float g(texture2D u, float2 x) { return u.sample(x); } float f(float2 x) { return g(t, x); }"),
     ""},
    {F("param texture2D t = zeros(4, 4); float f(float2 x) { texture2D u = t; return 1.0; }"), "E0121@1:64 E0121@1:68"},
    {F("param texture2D t[2] = zeros(4, 4);"), "E0121@1:7"},
    {F("struct S { texture2D t; };"), "E0121@1:12"},
    {F("texture2D f() { return 1.0; }"), "E0121@1:1"},
    {F("float f(out texture2D t) { return 1.0; }"), "E0121@1:23"},
    {F("param texture2D t = zeros(4, 4); float f(float2 x) { return t.sampel(x); }"), "E0122@1:63"},
    {F("param texture2D t = zeros(4, 4); float f(float2 x) { return t.sample(1.0); }"), "E0107@1:70"},
    {F("param texture2D t = zeros(4, 4); float f(float2 x) { return t.sample(); }"), "E0120@1:63"},
    {F("param texture2D t = zeros(4, 4); float f(float2 x) { return t + 1.0; }"), "E0121@1:61"},
    {F("param heightfield h = zeros(8, 8); float f(float3 o) { Hit v = h.trace(o, o, 0, 1e9); bool b = h.occluded(o, o, 0, 1); Silhouette s = h.silhouette(o, o.xy, 0, 1); return v.t + h.height(o.xy) + h.gradient(o.xy).x + h.normal(o.xy).z + h.clearance(o, o, 0.1, 1e9); }"),
     ""},
    {F("param heightfield h = zeros(8, 8); float f(float2 x) { return h.sample(x); }"), "E0122@1:65"},
    {F("float f(float2 x) { return x.length(); }"), "E0122@1:30"},
    {F("const texture2D t = 1.0;"), "E0121@1:17"},
};

static const Row constants[] = {
    {F("const int N = 2 + 3 * int(sqrt(4.0)); float f() { float a[N]; float b[8]; a = b; return a[0]; }"), ""},
    {F("const float A[3] = { 1, 2, 3 }; const int N = int(A[2]); float f() { float a[N]; float b[3]; a = b; return a[0]; }"),
     ""},
    {F("struct D { int n; float2 c; }; const D ds[2] = { { 3, 1.0 }, { 4, 2.0 } }; float f() { float a[ds[1].n]; float b[4]; a = b; return ds[0].c.x; }"),
     ""},
    {F("const float3 v = normalize(float3(3.0, 0.0, 4.0)) * 5; float f() { float a[int(v.z)]; float b[4]; a = b; return 1.0; }"),
     ""},
    {F("const bool b = PI > 3.0 && true; const int n = b ? 2 : 3; float f() { float a[n]; float c[2]; a = c; return 1.0; }"),
     ""},
    {F("param int n = 3; float f() { float a[n]; return a[0]; }"), "E0123@1:38"},
    {F("float g() { return 1.0; } const float K = g();"), "E0123@1:43"},
    {F("param float p = 1.0; const float K = p * 2.0;"), "E0123@1:38"},
    {F("const float K = rand();"), "E0123@1:17"},
    {F("const int N; param float p; float f() { return N; }"), "E0011@1:11 E0011@1:26"},
    {S("float a[0];"), "E0125@2:9"},
    {S("float a[-1];"), "E0125@2:9"},
    {S("float a[1.5];"), "E0107@2:9"},
    {S("int n = 2; float a[n];"), "E0123@2:20"},
    {S("const int n = 2; float a[n]; float b[2]; a = b;"), ""},
    {S("float a[100000];"), "E0126@2:9"},
    {F("param float a[500000][1000] = { { 1 } };"), "E0126@1:15"},
    {F("const float a[5000][1000] = { { 1 } };"), "E0126@1:15"},
    {F("typedef float Big[5000000]; param Big a = (Big)0;"), "E0126@1:43"},
    {S("float a[3]; float b[len(a) + 1]; float c[4]; c = b;"), ""},
    {S("int n = len(x);"), "E0119@2:13"},
    {F("param float v[][2] = { { 1, 2 }, { 3, 4 }, { 5, 6 } }; float f() { float a[len(v)]; float b[3]; a = b; return v[2][1]; }"),
     ""},
    {F("const int I = 2147483647 + 1; const int Z = 1 / 0; const int M = 7 % 0; float f() { float a[1 + (I < 0 ? 1 : 0) + Z + M]; float b[2]; a = b; return 1.0; }"),
     ""},
    {F("const uint U = 0u - 1u; float f() { float a[int(U >> 30)]; float b[3]; a = b; return 1.0; }"), ""},
    {F("const float2x2 m = float2x2(1, 2, 3, 4) * float2x2(0, 1, 1, 0); float f() { float a[int(m[0][0])]; float b[2]; a = b; return 1.0; }"),
     ""},
    {F("const int N = floor(2.5);"), "E0107@1:15"},
};

static const Row params[] = {
    {F("param float a = 1; param float2 b = 1.0; param int c = 3; param bool d = true; param uint e = 1; param float2x2 m = float2x2(1, 2, 3, 4); param float w[2] = { 1, 2 };"),
     ""},
    {F("param float a = 1.0 + sin(K); const float K = 2.0;"), ""},
    {F("param float a = b; param float b = 1.0;"), "E0123@1:17"},
    {F("param float a = true;"), "E0107@1:17"},
    {F("struct D { float r; float2 c; }; const D Z = { 1.0, 2.0 }; param D d = Z; param D ds[2] = { Z, { 3, 4 } };"),
     ""},
    {F("struct D { float r; }; param D ds[3] = init(f); D f(int i) { D d; d.r = 0.1 * i + rand(); return d; }"), ""},
    {F("param float a[3][7] = init(f); float f(int i, int j) { return float(i * j); }"), ""},
    {F("param float a[3] = init(f); float f(int i, int j) { return 1.0; }"), "E0302@1:25"},
    {F("param float a[3] = init(f); int f(int i) { return 1; }"), "E0302@1:25"},
    {F("param float a[3] = init(g);"), "E0302@1:25"},
    {F("param float a = init(f); float f(int i) { return 1.0; }"), "E0302@1:22"},
    {F("param float a[] = init(f); float f(int i) { return 1.0; }"), "E0301@1:24"},
    {F("param texture2D t = zeros(4, 4, 3); param heightfield h = zeros(16, 16);"), ""},
    {F("param texture2D t = zeros(4, 4, 5);"), "E0305@1:21"},
    {F("param texture2D t = zeros(0, 4);"), "E0305@1:21"},
    {F("param heightfield h = zeros(4, 4, 2);"), "E0305@1:23"},
    {F("param float a = zeros(4, 4);"), "E0301@1:17"},
    {F("param texture2D t = 1.0;"), "E0301@1:21"},
    {F("param float a = \"f.npy\";"), "E0301@1:17"},
    {F("param float v[][3] = \"mesh.npy\"; param float2 p[] = \"pts.npy\"; float f() { float a[len(v)]; float b[5]; a = b; float c[len(p)]; c = b; return 1.0; }"),
     ""},
    {F("param float v[4][3] = \"mesh.npy\";"), "E0304@1:23"},
    {F("param float v[][2] = \"mesh.npy\";"), "E0304@1:22"},
    {F("param float v[][3] = \"none.npy\";"), "E0303@1:22"},
    {F("param texture2D t = \"a.exr\"; param heightfield h = \"dem.exr\";"), ""},
    {F("param texture2D t = \"none.exr\";"), "E0303@1:21"},
    {F("[Range(0.0, 1.0)] param float a = 0.5; [Range(1, 5)] param int n = 3; [NoDiff] param float e = 1.0; [Doc(\"ink\")] [Color] param float3 c = 1.0; [Log] param float l = 1.0;"),
     ""},
    {F("[Range(1.0, 0.0)] param float a = 0.5;"), "E0307@1:2"},
    {F("[Range(0.0, 1.0)] param bool b = true;"), "E0306@1:2"},
    {F("[Range(q, 1.0)] param float a = 0.5;"), "E0101@1:8"},
    {F("param float q = 1.0; [Range(q, 1.0)] param float a = 0.5;"), "E0123@1:29"},
    {F("[Color] param float a = 0.5;"), "E0306@1:2"},
    {F("[Log] param int a = 5;"), "E0306@1:2"},
    {F("[Extent(0, 0, 1, 1)] [Height(2.0, 0.5)] param heightfield h = zeros(8, 8);"), ""},
    {F("[Extent(0, 0, 0, 1)] param heightfield h = zeros(8, 8);"), "E0307@1:2"},
    {F("[Height(1, 0)] param float a = 0.5;"), "E0306@1:2"},
};

static const Row flow[] = {
    {F("float f(float a) { if (a > 0.0) return 1.0; }"), "E0201@1:7"},
    {F("float f(float a) { if (a > 0.0) return 1.0; else return 2.0; }"), ""},
    {F("float f(int a) { switch (a) { case 0: return 1.0; default: return 2.0; } }"), ""},
    {F("float f(int a) { switch (a) { case 0: return 1.0; case 1: return 2.0; } }"), "E0201@1:7"},
    {F("float f(int a) { switch (a) { case 0: break; default: return 2.0; } }"), "E0201@1:7"},
    {F("float f(float a) { [MaxIters(9)] while (true) { if (a > 1.0) return a; a += 1.0; } }"), "E0201@1:7"},
    {F("float f(float a) { for (int i = 0; i < 3; i++) { return a; } }"), ""},
    {F("float f(int n) { [MaxIters(8)] for (int i = 0; i < n; i++) { return 1.0; } }"), "E0201@1:7"},
    {F("float f(float a) { do { return a; } while (false); }"), ""},
    {F("float f() { return; }"), "E0206@1:13"},
    {F("void f() { return 1.0; }"), "E0206@1:19"},
    {F("void f() { return; } void g() { }"), ""},
    {S("return 1.0; float y = 2.0;"), ""},
    {S("break;"), "E0203@2:1"},
    {S("continue;"), "E0203@2:1"},
    {S("switch (1) { case 1: continue; }"), "E0203@2:22"},
    {S("for (int i = 0; i < 3; i++) { switch (i) { case 1: continue; case 2: break; } if (i == 1) break; }"), ""},
    {S("float y; float z = y;"), "E0204@2:20"},
    {S("float y; if (x.x > 0.0) y = 1.0; float z = y;"), "E0204@2:44"},
    {S("float y; if (x.x > 0.0) y = 1.0; else y = 2.0; float z = y;"), ""},
    {S("float y; if (x.x > 0.0) y = 1.0; else return 2.0; float z = y;"), ""},
    {S("float2 v; v.x = 1.0; v.y = 2.0; float2 w = v;"), ""},
    {S("float2 v; v.x = 1.0; float2 w = v;"), "E0204@2:33"},
    {S("float2 v; v.x = 1.0; float w = v.x; w = v.y;"), "E0204@2:41"},
    {S("float4 v; v.xy = x; v.wz = x; v += 1.0;"), ""},
    {S("float2 v; v[0] = 1.0; v[1] = 2.0; float2 w = v;"), ""},
    {S("float2 v; int i = 1; v[i] = 1.0; float2 w = v;"), "E0204@2:45"},
    {S("float2x2 m; m[0] = x; m[1][0] = 1.0; m[1].y = 2.0; float2 v = m * x;"), ""},
    {F("struct D { float r; float2 c; float a[3]; }; float f() { D d; d.r = 1.0; d.c = float2(1.0); D e = d; return e.r; }"),
     ""},
    {F("struct D { float r; float2 c; }; float f() { D d; d.r = 1.0; d.c.x = 1.0; D e = d; return e.r; }"),
     "E0204@1:81"},
    {S("float a[3]; float y = a[1]; a[0] += 1.0;"), ""},
    {S("float y; y += 1.0;"), "E0204@2:10"},
    {S("int i; i++;"), "E0204@2:8"},
    {S("float y = y;"), "E0204@2:11"},
    {S("float y; for (int i = 0; i < 3; i++) y = 1.0; float z = y;"), ""},
    {S("float y; for (int i = 0; i < 0; i++) y = 1.0; float z = y;"), "E0204@2:57"},
    {S("float y; int n = 3; [MaxIters(4)] for (int i = 0; i < int(x.x); i++) y = 1.0; float z = y;"), "E0204@2:89"},
    {S("float y; for (int i = 0; i < 3; i++) { if (i == 1) break; y = 1.0; } float z = y;"), "E0204@2:80"},
    {S("float y; [MaxIters(4)] do { y = 1.0; } while (y < x.x); float z = y;"), ""},
    {S("float y; [MaxIters(4)] while (x.x > 0.0) { y = 1.0; x.x -= 1.0; } float z = y;"), "E0204@2:77"},
    {S("for (int i = 0; i < 3; i++) { float y; if (i > 1) y = 1.0; float z = y; }"), "E0204@2:70"},
    {S("float y; switch (int(x.x)) { case 0: y = 1.0; break; case 1: default: y = 2.0; } float z = y;"), ""},
    {S("float y; switch (int(x.x)) { case 0: y = 1.0; break; } float z = y;"), "E0204@2:66"},
    {F("bool g(out float v) { v = 1.0; return true; } float f(bool a) { float y; if (a && g(y)) return y; return 0.0; }"),
     ""},
    {F("bool g(out float v) { v = 1.0; return true; } float f(bool a) { float y; if (a || g(y)) return y; return 0.0; }"),
     "E0204@1:96"},
    {F("bool g(out float v) { v = 1.0; return true; } float f(bool a) { float y; if (!(a && g(y))) return 1.0; return y; }"),
     ""},
    {F("bool g(out float v) { v = 1.0; return true; } float f(bool a) { float y; bool b = a && g(y); return y; }"),
     "E0204@1:101"},
    {F("void g(out float v) { }"), "E0205@1:23"},
    {F("void g(bool a, out float v) { if (a) return; v = 1.0; }"), "E0205@1:38"},
    {F("void g(out float2 v) { v.x = 1.0; v.y = v.x; }"), ""},
    {F("void g(out float v) { v += 1.0; v = 2.0; }"), "E0204@1:23"},
    {F("void g(inout float v) { v += 1.0; }"), ""},
    {S("switch (1.0) { }"), "E0210@2:9"},
    {S("const int A = 1; switch (int(x.x)) { case 0: case A: break; case 1: break; }"), "E0209@2:66"},
    {S("int a = 1; switch (a) { case a: break; }"), "E0123@2:30"},
    {S("switch (1) { default: break; default: break; }"), "E0209@2:30"},
};

static const Row loops[] = {
    {S("for (int i = 0; i < 10; i++) { } for (int i = 10; i > 0; --i) { } for (uint i = 0u; i <= 9u; i += 2u) { } for (int i = 0; i != 8; i += 2) { }"),
     ""},
    {S("for (int i = 1; i < 1000; i *= 2) { } for (int i = 64; i > 0; i >>= 1) { } for (int i = 1; i <= 64; i <<= 1) { } for (int i = 100; i >= 1; i /= 3) { }"),
     ""},
    {S("for (int i = 0; 10 > i; i = i + 1) { } for (int i = 9; i >= 0; i -= 3) { } for (int i = 0, j = 5; i < j; i++) { }"),
     ""},
    {S("for (int i = 0; i < 4; i++) for (int j = 0; j < i; j++) for (int k = j; k < i + j; k++) { }"), ""},
    {S("float a[4]; for (int i = 0; i < len(a); i++) a[i] = 1.0; for (float t = 0.0; t < 1.0; t += 0.1) { }"), ""},
    {S("for (int i = 0; i < 8 && x.x > 0.0; i++) { x.x -= 1.0; } int n = 5; for (int i = 0; i < n; i++) { }"), ""},
    {S("for (int i = 0; i < min(int(x.x * 8.0), 16); i++) { }"), ""},
    {S("for (int i = 0; i < (int(x.x) & 7); i++) { } for (int i = 0; i < clamp(int(x.x), 0, 7); i++) { }"), ""},
    {S("int i = 0; while (i < 4) { i++; } for (; i < 8; ) { break; }"), "E0310@2:35"},
    {S("do { } while (false); while (false) { }"), ""},
    {F("float f(int n) { float s = 0.0; for (int i = 0; i < n; i++) s += 1.0; return s; } float g() { return f(3); }"),
     ""},
    {F("param int n = 3; float f() { for (int i = 0; i < n; i++) { } return 1.0; }"), "E0310@1:30"},
    {F("param int n = 3; float f() { [MaxIters(9)] for (int i = 0; i < n; i++) for (int j = 0; j < i; j++) { } return 1.0; }"),
     ""},
    {S("while (x.x > 0.0) x.x -= 1.0;"), "E0310@2:1"},
    {S("[MaxIters(64)] while (x.x > 0.0) x.x -= 1.0;"), ""},
    {S("while (true) { break; }"), "E0310@2:1"},
    {S("for (;;) { break; }"), "E0310@2:1"},
    {S("for (int i = 0; i < 10; i--) { }"), "E0310@2:1"},
    {S("for (int i = 0; i < 10; i++) { i = 0; }"), "E0310@2:1"},
    {S("for (int i = 0; i < 10; ) { if (x.x > 0.0) i++; }"), "E0310@2:1"},
    {S("for (uint i = 3u; i >= 0u; i--) { }"), "E0310@2:1"},
    {S("for (int i = 0; i < int(x.x); i++) { }"), "E0310@2:1"},
    {S("for (int i = int(x.x); i < 10; i++) { }"), "E0310@2:1"},
    {S("for (int i = 0; i < 20000000; i++) { }"), "E0311@2:1"},
    {S("for (int i = 0; i < 16777216; i++) { }"), ""},
    {S("[MaxIters(20000000)] while (x.x > 0.0) { }"), "E0311@2:11"},
    {S("[MaxIters(0)] while (x.x > 0.0) { }"), "E0312@2:11"},
    {S("[MaxIters(1.5)] while (x.x > 0.0) { }"), "E0312@2:11"},
    {S("int n = 3; [MaxIters(n)] while (x.x > 0.0) { }"), "E0312@2:22"},
    {F("const int N = 8; float f(float a) { [MaxIters(N * 2)] while (a > 0.0) a -= 1.0; return a; }"), ""},
    {S("[MaxIters(8)] if (x.x > 0.0) { }"), "E0306@2:2"},
};

static const Row discs[] = {
    {S("[Disc] if (x.x < 0.0) { } [Disc] float y = x.x > 0.5 ? 1.0 : 0.0; [Disc] y = floor(y); [Disc] int i = int(y); [Disc] return y < 0.0 ? 1.0 : 2.0;"),
     ""},
    {S("bool hit = x.x < 0.0; [Disc] if (hit) { }"), "E0401@2:24"},
    {S("[Disc] if (1 < 2) { }"), "E0401@2:2"},
    {S("[Disc] { if (x.x < 0.0) { } }"), "E0401@2:2"},
    {F("bool inside(float d) { return d < 0.0; } float f(float2 x) { [Disc] if (inside(x.x)) return 1.0; return 0.0; }"),
     "E0401@1:63"},
    {S("[Disc] if (x.x == 0.0) { }"), "E0402@2:16"},
    {S("[Disc] if (x.x < 0.0 && x.y != 1.0) { }"), "E0402@2:29"},
    {S("[Disc] float2 s = step(0.5, x); [Disc] float y = fmod(x.x, 2.0) + x.y % 2.0; [Disc] y = sign(y); [Disc] y = atan2(x.x, x.y); [Disc] y %= 2.0;"),
     ""},
    {S("[Disc] int s = sign(3);"), "E0401@2:2"},
    {S("[Disc] float y = abs(x.x) + min(x.x, x.y);"), "E0401@2:2"},
    {S("[Disc] bool2 b = x < 0.5; [Disc, NoDisc] if (x.x < 0.5) { }"), "E0404@2:28"},
    {S("for (int i = 0; i < 3; i++) { [Disc] [SkipLoop] if (x.x < 0.1 * i) { } [Disc, SkipLoop] if (x.y < 0.0) { } }"),
     ""},
    {S("[Disc, SkipLoop] if (x.x < 0.0) { }"), "E0403@2:8"},
    {S("for (int i = 0; i < 3; i++) { [SkipLoop] if (x.x < 0.0) { } }"), "E0403@2:32"},
    {S("for (int i = 0; i < 3; i++) { [Disc, SkipLoop] x.x = floor(x.x); }"), "E0403@2:38"},
    {S("[NoDisc] if (x.x < 0.0) { } [Disc] for (float t = 0.0; t < 1.0; t += 0.25) { }"), ""},
    {F("param heightfield h = zeros(8, 8); float f(float3 o) { [Disc] Hit v = h.trace(o, o, 0, 1e9); [Disc] if (h.clearance(o, o, 0.1, 1) < 0.0) return 1.0; [Disc] bool b = h.occluded(o, o, 0, 1); return v.t; }"),
     ""},
    {F("param texture2D t = zeros(8, 8); float f(float2 x) { [Disc] float4 a = t.nearest(x); [Disc] float4 b = t.sample(x); return a.x; }"),
     "E0401@1:87"},
};

static const Row shaders[] = {
    {"float f() { return 1.0; }\n", "E0213@1:1"},
    {"shader float a(float x) { return x; } shader float b(float x) { return x; }\n", "E0215@1:52"},
    {"shader float a(float x) { return x; } shader float main(float3 x) { return x.x; }\n", ""},
    {"shader float2 only(float x) { return x; }\n", ""},
    {"shader int main(float2 x) { return 1; }\n", "E0212@1:8"},
    {"shader float main(float4 x) { return 1.0; }\n", "E0212@1:26"},
    {"shader float main(float2 x, float y) { return 1.0; }\n", "E0212@1:14"},
    {"shader float main() { return 1.0; }\n", "E0212@1:14"},
    {"[Domain(-1.0, 1.0)] shader float main(float2 x) { return 1.0; }\n", ""},
    {"[Domain(float2(0, 1), float2(2, 3))] shader float main(float2 x) { return 1.0; }\n", ""},
    {"[Domain(float2(0, 1), float2(2, 1))] shader float main(float2 x) { return 1.0; }\n", "E0307@1:2"},
    {"[Domain(1, 0)] shader float main(float2 x) { return 1.0; }\n", "E0307@1:2"},
    {"[Domain(float3(0), 1)] shader float main(float2 x) { return 1.0; }\n", "E0107@1:9"},
    {"param float p = 1.0; [Domain(0, p)] shader float main(float2 x) { return 1.0; }\n", "E0123@1:33"},
    {F("[Domain(0, 1)] float f() { return 1.0; }"), "E0009@1:2"},
    {F("float df(float a, float b, float da, float db) { return da * b + a * db; } [Tangent(df)] float f(float a, float b) { return a * b; }"),
     ""},
    {F("float df(float a, int n, float da) { return da * n; } [Tangent(df)] float f(float a, int n) { return a * n; }"),
     ""},
    {F("float df(float a, float da) { return da; } [Tangent(df)] float f(float a, float b) { return a * b; }"),
     "E0216@1:53"},
    {F("[Tangent(df)] float f(float a) { return a; }"), "E0216@1:10"},
    {F("float df(int a) { return 1.0; } [Tangent(df)] float f(int a) { return 1.0; }"), "E0216@1:42"},
    {S("return 1.0; } float4 box(int i) { return float4(0.0); } float f(float2 x) { [Cull(box)] for (int i = 0; i < 9; i++) { x.x += 1.0; } return x.x;"),
     ""},
    {F("float4 box(int i) { return float4(0.0); } float f() { [Cull(box)] for (int i = 1; i < 9; i++) { } return 1.0; }"),
     "E0313@1:61"},
    {F("float4 box(int i) { return float4(0.0); } float f() { [Cull(box)] for (int i = 0; i < 9; i += 2) { } return 1.0; }"),
     "E0313@1:61"},
    {F("float f() { [Cull(box)] for (int i = 0; i < 9; i++) { } return 1.0; }"), "E0313@1:19"},
    {F("float3 box(int i) { return float3(0.0); } float f() { [Cull(box)] for (int i = 0; i < 9; i++) { } return 1.0; }"),
     "E0313@1:61"},
    {F("float4 box(int i) { return float4(0.0); } float g() { return rand(); } float f() { [Cull(box)] for (int i = 0; i < 9; i++) { float y = g(); } return 1.0; }"),
     "E0313@1:136"},
    {F("float4 box(int i) { return float4(0.0); } float f() { [Cull(box)] if (true) { } return 1.0; }"), "E0306@1:61"},
    {"float4 box(int i) { return float4(0.0); } float f() { [Cull(box)] for (int i = 0; i < 9; i++) { } return 1.0; } shader float main(float3 x) { return f(); }\n",
     "E0313@1:61"},
    /* all errors of a file */
    {F("float f() { return a; } float g() { int i = 1.5; float y; return y + b; }"),
     "E0101@1:20 E0107@1:45 E0204@1:66 E0101@1:70"},
};

static bool probe(void *user, const char *path, const Symbol *of, uint32_t dims[4], uint32_t *ndims, const char **why) {
    (void)user;
    TypeKind kind = of->type->kind;
    const char *name = strrchr(path, '/') ? strrchr(path, '/') + 1 : path;
    *ndims = 2;
    if (!strcmp(name, "mesh.npy") && kind == T_ARRAY) dims[0] = 5, dims[1] = 3;
    else if (!strcmp(name, "pts.npy") && kind == T_ARRAY) dims[0] = 5, dims[1] = 2;
    else if (!strcmp(name, "a.exr") && kind == T_TEXTURE) dims[0] = 8, dims[1] = 4, dims[2] = 3, *ndims = 3;
    else if (!strcmp(name, "dem.exr") && kind == T_GEOMETRY) dims[0] = 9, dims[1] = 9;
    else {
        *why = "No such file or directory";
        return false;
    }
    return true;
}

typedef struct Run {
    const char *source;
    FrontOptions opt;
    Module *module;
    Func *entry;
} Run;

static void run_body(Session *s, void *arg) {
    Run *r = arg;
    int file = session_add_text(s, "t.salt", ".", r->source, strlen(r->source));
    r->module = load_modules(s, file);
    r->entry = check_program(s, r->module, &r->opt);
}

static int by_place(const void *a, const void *b) {
    const Diag *x = *(Diag *const *)a, *y = *(Diag *const *)b;
    return x->span.pos < y->span.pos ? -1 : x->span.pos > y->span.pos;
}

static void errors_text(Session *s, char *out, size_t size) {
    Diag *list[64];
    size_t n = 0, used = 0;
    for (Diag *d = s->diags; d && n < 64; d = d->next)
        if (d->severity == SEV_ERROR) list[n++] = d;
    qsort(list, n, sizeof *list, by_place);
    out[0] = 0;
    for (size_t i = 0; i < n && used < size; i++) {
        uint32_t line, column;
        span_position(s, list[i]->span, &line, &column);
        used += (size_t)snprintf(out + used, size - used, "%s%s@%u:%u", i ? " " : "", diag_code_name(list[i]->code),
                                 line, column);
    }
}

/* Every expression of a right program has a type, every call its function, every name its symbol. */
static void check_tree(Expr *e) {
    if (!e) return;
    if (e->kind == E_LITERAL && e->name && !e->type) return;
    assert_non_null(e->type);
    assert_int_not_equal(e->type->kind, T_ERROR);
    if (e->kind == E_NAME) assert_non_null(e->sym);
    if (e->kind == E_CALL) assert_non_null(e->func);
    if (e->kind == E_BUILTIN) assert_int_not_equal(e->builtin, B_NONE);
    if (e->kind == E_BINARY && e->a[0]->type->kind != T_MATRIX && e->a[1]->type->kind != T_MATRIX)
        assert_ptr_equal(e->a[0]->type, e->a[1]->type);
    if (e->kind == E_BROADCAST) assert_ptr_equal(e->a[0]->type, e->type->elem);
    if (e->kind == E_COND) assert_true(e->a[1]->type == e->type && e->a[2]->type == e->type);
    if (e->kind == E_CALL)
        for (uint32_t i = 0; i < e->nargs; i++) assert_ptr_equal(e->args[i]->type, e->func->args[i]->type);
    for (int i = 0; i < 3; i++) check_tree(e->a[i]);
    for (uint32_t i = 0; i < e->nargs; i++) check_tree(e->args[i]);
}

static void check_trees(Stmt *st) {
    if (!st) return;
    check_tree(st->expr);
    check_tree(st->step);
    for (uint32_t i = 0; i < st->ndecls; i++) {
        check_tree(st->decls[i]->init);
        if (st->decls[i]->init) assert_ptr_equal(st->decls[i]->init->type, st->decls[i]->type);
    }
    for (uint32_t i = 0; i < st->nargs; i++) check_tree(st->args[i]);
    check_trees(st->init);
    check_trees(st->body);
    check_trees(st->orelse);
    for (uint32_t i = 0; i < st->nstmts; i++) check_trees(st->stmts[i]);
    for (uint32_t i = 0; i < st->ncases; i++)
        for (uint32_t j = 0; j < st->cases[i].nbody; j++) check_trees(st->cases[i].body[j]);
}

static void run_rows(const Row *rows, size_t n) {
    unsigned failed = 0;
    for (size_t i = 0; i < n; i++) {
        Session *s = session_create(0);
        Run r = {.source = rows[i].source, .opt = {.probe = probe}};
        assert_int_equal(session_protect(s, run_body, &r), 0);
        char got[512];
        errors_text(s, got, sizeof got);
        if (strcmp(got, rows[i].expected)) {
            print_error("%s  expected: %s\n  got:      %s\n", rows[i].source, rows[i].expected, got);
            diag_print_text(s, stderr, false);
            failed++;
        } else if (!got[0]) {
            assert_non_null(r.entry);
            for (Func *f = r.module->funcs; f; f = f->next) check_trees(f->body);
        }
        session_destroy(s);
    }
    if (failed) fail_msg("%u of %zu rows", failed, n);
}

#define ROWS(table)                                                                                                    \
    static void test_##table(void **state) {                                                                           \
        (void)state;                                                                                                   \
        run_rows(table, sizeof table / sizeof *table);                                                                 \
    }
ROWS(names)
ROWS(conversions)
ROWS(operators)
ROWS(parts)
ROWS(calls)
ROWS(resources)
ROWS(constants)
ROWS(params)
ROWS(flow)
ROWS(loops)
ROWS(discs)
ROWS(shaders)

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_names),     cmocka_unit_test(test_conversions), cmocka_unit_test(test_operators),
        cmocka_unit_test(test_parts),     cmocka_unit_test(test_calls),       cmocka_unit_test(test_resources),
        cmocka_unit_test(test_constants), cmocka_unit_test(test_params),      cmocka_unit_test(test_flow),
        cmocka_unit_test(test_loops),     cmocka_unit_test(test_discs),       cmocka_unit_test(test_shaders),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
