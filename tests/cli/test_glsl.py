"""GLSL: every meaning that differs from the language's, beside the same in the language, to the bit; messages; gradients."""
import math

from harness import *

SIZE = (48, 32)
TOY = "void mainImage(out vec4 O, in vec2 I) {\n    vec2 p = I / iResolution.xy;\n    vec3 c = vec3(0.0);\n%s\n    O = vec4(c, 1.0);\n}\n"
OURS = "[Display] [Domain(float2(0.0), float2(48.0, 32.0))]\nshader float3 main(float2 I) {\n    float2 p = I / float2(48.0, 32.0);\n    float3 c = float3(0.0);\n%s\n    return c;\n}\n"

# Name: what stands before mainImage, its body; the same in the language.
PAIRS = {
    "matrix times vector": ("", "mat2 m = mat2(1.0, 2.0, 3.0, 4.0); c.xy = m * p; c.z = (p * m).x;",
                            "", "c.xy = float2(1.0 * p.x + 3.0 * p.y, 2.0 * p.x + 4.0 * p.y); c.z = p.x * 1.0 + p.y * 2.0;"),
    "vector *= matrix": ("mat2 turn(float a) { float s = sin(a), k = cos(a); return mat2(k, -s, s, k); }", "vec3 q = vec3(p, 0.5); q.xz *= turn(0.3); c = q;",
                         "", "float s = sin(0.3), k = cos(0.3); c = float3(p.x * k + 0.5 * -s, p.y, p.x * s + 0.5 * k);"),
    "matrix products": ("", "mat2 a = mat2(1, 2, 3, 4), b = mat2(0.5, p.x, 0.25, 1); mat2 m = a * b; a *= b; c = vec3(m[0], a[1].y);",
                        "", "c = float3(1.0 * 0.5 + 3.0 * p.x, 2.0 * 0.5 + 4.0 * p.x, 2.0 * 0.25 + 4.0);"),
    "constructors of matrices": ("", "mat3 m = mat3(2.0); mat2 k = mat2(mat3(1, 2, 3, 4, p.x, 6, 7, 8, 9)); mat4 w = mat4(k); c = m * vec3(p, 1) + vec3(k[1], w[3][3]);",
                                 "", "c = float3(2.0 * p, 2.0) + float3(4.0, p.x, 1.0);"),
    "columns": ("", "mat3 m = mat3(1, 2, 3, 4, 5, 6, 7, 8, 9); c = m[1] * p.x + vec3(m[0][2], transpose(m)[0][1], 0);", "", "c = float3(4.0, 5.0, 6.0) * p.x + float3(3.0, 4.0, 0.0);"),
    "matrices that are not square": ("const mat3x2 K = mat3x2(1, 2, 3, 4, 5, 6); uniform mat2x3 u; mat2x3 turn(mat2x3 m) { m[0] *= 2.0; m[1][2] += 1.0; return m; }",
                                     "mat2x3 m = turn(mat2x3(p.x, 2, 3, 4, p.y, 6)); int i = int(I.x) % 2; vec2 w = vec3(1, p) * m; mat2 s = K * m; mat3x2 t = transpose(m); mat4x3 d = mat4x3(2.0); mat2x3 o = outerProduct(vec3(1, 2, 3), p); c = m * p + vec3(w, s[1][0]) + mat3(m)[2] + vec3(t[2], mat2(u)[1].y) + d[2] + o[1] + m[i];",
                                     "", "float3 a = float3(p.x, 2.0, 3.0) * 2.0, b = float3(4.0, p.y, 7.0), v = float3(1.0, p); c = a * p.x + b * p.y + float3(dot(v, a), dot(v, b), b.x + 3.0 * b.y + 5.0 * b.z) + float3(0.0, 0.0, 1.0) + float3(a.z, b.z, 0.0) + float3(0.0, 0.0, 2.0) + float3(1.0, 2.0, 3.0) * p.y + (int(I.x) % 2 == 0 ? a : b);"),
    "matrices component by component": ("", "mat2 m = mat2(1, 2, 3, 4); m += 1.0; m--; m = 1.0 - m / mat2(2, 2, 4, 4) * p.x; c = vec3(m[0], m[1].y);", "", "c = 1.0 - float3(0.5, 1.0, 1.0) * p.x;"),
    "comparisons of all that a value holds": ("struct S { float a; ivec2 n; }; struct T { S s[2]; bool b; };",
                                              "int i = int(I.x) % 2; S a = S(0.5, ivec2(1, i)), b = S(0.5, ivec2(1, 0)); float v[2] = float[](0.0, p.x), w[2] = float[](0.0, p.y); T t = T(S[](a, b), true), u = T(S[](b, b), i == 0); c = vec3(a == b, v != w, mat2(p, p) == mat2(p.xyxy)); c.z += float(t == u) + float(mat2(1.0) != mat2(1, 0, 0, 1));",
                                              "", "c = float3(int(I.x) % 2 == 0 ? 1.0 : 0.0, p.x != p.y ? 1.0 : 0.0, 1.0); c.z += c.x;"),
    "vectors cut off": ("", "vec4 v = vec4(p, 0.25, 1); vec2 a = vec2(v); vec3 b = vec3(v); vec3 d = vec3(a, v); c = b + d + float(v);",
                        "", "c = float3(p, 0.25) + float3(p, p.x) + p.x;"),
    "whole comparisons": ("", "c.x = p == vec2(0.5) ? 1.0 : 0.25; c.y = ivec2(I) != ivec2(3, 4) ? 0.5 : 1.0; c.z = all(equal(I, vec2(0.5))) ? 1.0 : 0.0;",
                          "", "int2 i = int2(I); c.x = p.x == 0.5 && p.y == 0.5 ? 1.0 : 0.25; c.y = i.x != 3 || i.y != 4 ? 0.5 : 1.0; c.z = I.x == 0.5 && I.y == 0.5 ? 1.0 : 0.0;"),
    "letters": ("", "c.rg = p.ts; c.b = vec4(p, 1, 0.25).q;", "", "c = float3(p.yx, 0.25);"),
    "builtins": ("", "c = vec3(mod(-p.x * 3.0, 1.0), fract(p.y * 5.0), mix(p.x, 1.0, p.y)) + inversesqrt(p.x + 1.0) + atan(p.y, p.x) + atan(p.x) + radians(90.0) * length(p.x - 0.5) + mix(vec3(1), vec3(2), lessThan(vec3(p, 1), vec3(0.5)));",
                 "", "float m = -p.x * 3.0; c = float3(m - 1.0 * floor(m / 1.0), frac(p.y * 5.0), lerp(p.x, 1.0, p.y)) + rsqrt(p.x + 1.0) + atan2(p.y, p.x) + atan(p.x) + 90.0 * (PI / 180.0) * abs(p.x - 0.5) + float3(p.x < 0.5 ? 2.0 : 1.0, p.y < 0.5 ? 2.0 : 1.0, 1.0);"),
    "variables of the file": ("float level = 0.25; vec3 sum; const float K = 2.0; float twice() { level += 0.125; return level * K; } void add(vec3 v) { sum += v; sum.x += twice(); }",
                              "float level0 = level; add(vec3(p, 1)); { float level = 9.0; add(vec3(level)); } c = sum * level0;",
                              "", "float l = 0.375; float3 s = float3(p, 1.0); s.x += l * 2.0; l += 0.125; s += float3(9.0); s.x += l * 2.0; c = s * 0.25;"),
    "values that are missing": ("float f(float a) { float r; if (a > 0.5) r = a; return r; } float g(float a) { if (a > 0.5) return 1.0; }", "vec2 v; v.x = p.x; c = vec3(f(p.x), g(p.y), v.y);",
                                "", "c = float3(p.x > 0.5 ? p.x : 0.0, p.y > 0.5 ? 1.0 : 0.0, 0.0);"),
    "sequences in choices": ("", "float d = 2.0; p.x < 0.5 ? d = p.y, c.x = 0.25 : d; c.y = p.x > 0.5 ? c.z = 1.0, 0.5 : d; p.y > 0.5 ? d = 4.0 : c.z += d;", "", "float d = p.x < 0.5 ? p.y : 2.0; if (p.x < 0.5) c.x = 0.25; if (p.x > 0.5) c.z = 1.0; c.y = p.x > 0.5 ? 0.5 : d; if (!(p.y > 0.5)) c.z += d;"),
    "octal numbers": ("", "c = vec3(010 + 0x10, 00, 017u) / 32.0;", "", "c = float3(24.0, 0.0, 15.0) / 32.0;"),
    "arrays without a name": ("float pick(float a[3], int i) { return a[i]; } float[2] two(float x) { return float[2](x, 1.0 - x); }",
                              "int k = int(I.x) % 3; c = vec3(float[3](0.1, 0.5, 0.9)[k], pick(float[](p.x, 0.2, p.y), k), two(p.x)[1]); c += vec3[](vec3(1, 0, 0), vec3(0, 1, 0), vec3(0, 0, 1))[k];",
                              "", "int k = int(I.x) % 3; c = float3(k == 0 ? 0.1 : k == 1 ? 0.5 : 0.9, k == 0 ? p.x : k == 1 ? 0.2 : p.y, 1.0 - p.x); c[k] += 1.0;"),
    "patterns of bits": ("const int k[2] = int[2](0xFFFFFFFE, 0x80000000);", "int i = 0xfefd4986; c = vec3(k[0] + 3, k[1] >> 31, i >> 24);", "", "c = float3(1.0, -1.0, -2.0);"),
    "names of the host": ("uniform vec2 image, main_; float gl_color_; vec2 point;", "c = vec3(image + p, point.x);", "", "c.xy = p;"),
    "structs inside declarations": ("struct S { float a; } s0, s1; const struct { vec2 v; } k = { vec2(0.5, 2) }; float f() { struct Q { float b; int n[2]; } q; struct R { Q q; }; R r; q.b = 0.25; r.q = q; return r.q.b; }",
                                    "s0.a = p.x; S t = s0; c = vec3(t.a + s1.a, k.v.x, f());", "", "c = float3(p.x, 0.5, 0.25);"),
    "blocks of uniforms": ("uniform Block { vec2 shift; mat2 m; }; layout(std140, binding = 0) uniform Other { float level; vec3 tint[2]; } other;", "c = other.tint[1] + other.level + vec3(m * shift, p.x);", "", "c.z = p.x;"),
    "names that are builtins here": ("float frac(float x) { return fract(x) + 1.0; } float lerp(float a, float b) { return mix(a, b, 0.25); } vec2 atan2(vec2 v) { return v.yx; } float saturate(float v) { return v * 0.5; }",
                                     "c = vec3(frac(p.x * 4.0), lerp(p.y, 1.0), saturate(atan2(p).x));", "", "c = float3(frac(p.x * 4.0) + 1.0, lerp(p.y, 1.0, 0.25), p.y * 0.5);"),
    "variables with the names of builtins here": ("const float frac = 0.25; float rsqrt; const float HALF = radians(90.0);", "vec2 lerp = fract(p * 3.0); float atan2 = 0.5; c = vec3(mix(lerp.x, frac, atan2), fract(p.y * 4.0) + rsqrt, inversesqrt(p.x + 1.0) + dot(p.x, atan2) + HALF);",
                                                  "", "c = float3(lerp(frac(p.x * 3.0), 0.25, 0.5), frac(p.y * 4.0), rsqrt(p.x + 1.0) + p.x * 0.5 + 90.0 * (PI / 180.0));"),
    "variables of the file as arguments": ("float g = 1.0; vec3 v; void f(inout float x) { x += 1.0; g = 10.0; x += 1.0; } float h(inout float x) { x = 5.0; return g; }", "f(g); c.x = g; f(v.y); c.y = v.y + g; g = p.x; c.z = h(g) + g;",
                                           "", "c = float3(3.0, 12.0, p.x + 5.0);"),
    "what people leave standing": ("#version 300 es\nuniform samplerCube sky;\ninvariant gl_FragColor;\nin vec4 gl_FragCoord;\n#define HERE float(__LINE__)", "int i = 0; if (i++, i == 1) c.x = p.x; vec2 two; mat3 m; c.y = float(two.length() * 10 + m.length()) + HERE; c.z = float(gl_MaxDrawBuffers); if (gl_MaxTextureImageUnits < 8 || gl_MaxVaryingVectors < 8) c = vec3(0);",
                                   "", "c = float3(p.x, 32.0, 1.0);"),
    "bounds drop what is no number": ("", "float n = p.x * 0.0; n /= n; c = vec3(clamp(n, 0.25, 1.0), max(n, 0.5), 0.25 + smoothstep(0.0, 1.0, n) + min(n, 0.75));", "", "c = float3(0.25, 0.5, 1.0);"),
    "builtins behind functions of their name": ("vec3 pow(vec3 v, float e) { return pow(v, vec3(e)); } int mod(int a, int b) { return a - b * (a / b); } float round(float x) { return floor(x + 0.5); }",
                                                "c = pow(vec3(p, 0.5), 2.0) + mod(p.x * 4.0, 1.0) + float(mod(int(I.x), 3)) + round(p.y) + round(p.xyy);",
                                                "", "c = pow(float3(p, 0.5), float3(2.0)); float m = p.x * 4.0; int i = int(I.x); c += m - floor(m); c += float(i % 3); c += floor(p.y + 0.5); c += round(p.xyy);"),
    "bits": ("", "uint u = uint(I.x) * 2654435761u; int k = bitCount(u) + 8 * findLSB(u | 4u) + 64 * findMSB(u >> 3) + findMSB(-5); c.x = float(k) / 4096.0; c.y = float(bitfieldReverse(uint(I.y)) >> 24) / 256.0; c.z = float(bitfieldExtract(-12, 1, 6) + int(bitfieldInsert(0u, 5u, 2, 2))) / 16.0;",
             "", "uint u = uint(I.x) * 2654435761u; int n = 0, low = -1, high = -1; for (int i = 0; i < 32; i++) { if (((u >> uint(i)) & 1u) != 0u) n++; if (low < 0 && (((u | 4u) >> uint(i)) & 1u) != 0u) low = i; if ((((u >> 3) >> uint(i)) & 1u) != 0u) high = i; } c.x = float(n + 8 * low + 64 * high + 2) / 4096.0; uint r = 0u; for (int i = 0; i < 8; i++) r |= ((uint(I.y) >> uint(i)) & 1u) << uint(7 - i); c.y = float(r) / 256.0; c.z = -2.0 / 16.0;"),
    "sums and products of 64 bits": ("", "uint k, b, h, l; int i, j; uint s = uaddCarry(0xFFFFFFF0u, uint(I.x), k), d = usubBorrow(uint(I.x), 20u, b); umulExtended(0xDEADBEEFu, 0xCAFEBABEu, h, l); imulExtended(int(0xDEADBEEFu), 7, i, j); c = vec3(k, b, h == 2962402171u && l == 2295290722u && i == -1 && j == int(381696137u) && s + d == 2u * uint(I.x) - 36u);",
                                     "", "c = float3(I.x > 16.0 ? 1.0 : 0.0, I.x < 20.0 ? 1.0 : 0.0, 1.0);"),
    "numbers packed": ("", "c = unpackUnorm4x8(packUnorm4x8(vec4(p, 2.0, -1.0))).xyz; c.xy += unpackHalf2x16(packHalf2x16(p * 3.0)) + unpackSnorm2x16(packSnorm2x16(-p)) + unpackUnorm2x16(0x80000000u); c.z += unpackHalf2x16(packHalf2x16(vec2(0.0, 65504.0))).y / 65504.0 + unpackHalf2x16(0x0001u).x * 16777216.0;",
                       "", "float2 h = p * 3.0, s = asfloat((asuint(h) + uint2(0xFFFu) + ((asuint(h) >> 13) & uint2(1u))) & uint2(0xFFFFE000u)); c = float3(round(p * 255.0) / 255.0, 1.0); c.xy += s - round(p * 32767.0) / 32767.0; c.y += 32768.0 / 65535.0; c.z += 2.0;"),
    "powers of two": ("", "int e; c.x = frexp(p.x * 300.0 + 1.0, e); c.y = ldexp(c.x, e) / 512.0; c.z = float(e) / 16.0;", "", "float v = p.x * 300.0 + 1.0; float e = floor(log2(v)) + 1.0; if (v >= exp2(e)) e += 1.0; c = float3(v / exp2(e), v / 512.0, e / 16.0);"),
    "which side": ("", "c.x = gl_FrontFacing ? p.x : 1.0;", "", "c.x = p.x;"),
    "text that is no code": ("#pragma x: import('./a.glsl', b=c)\n#ifdef NO\n it's @nothing\n#error it's not\n#endif", "c = vec3(p, 0);", "", "c = float3(p, 0.0);"),
    "lines that go on": ("// a comment \\\n that goes on $$ \\\r\n and on", "c = vec3(p, 0); // once \\\n more: c.x = 2.0;", "", "c = float3(p, 0.0);"),
    "conditions that declare": ("", "int n = 5; while (bool b = n > 0) { n--; if (n == 2) continue; c.x += float(b) * p.x; } for (int i = 0; bool q = i < 4; i++) { if (i == 1) continue; if (i == 3) break; c.y += p.y; }",
                                "", "c.x = p.x + p.x; c.x += p.x; c.x += p.x; c.y = p.y + p.y;"),
    "a name in its own value": ("vec3 normal(vec2 q) { return vec3(q, 0.5); }", "vec3 normal = normal(p); c = normal;", "", "c = float3(p, 0.5);"),
    "arrays": ("const float w[] = float[](0.25, 0.5, 1.0); struct S { vec2 a; float b; };", "float s = 0.0; for (int i = 0; i < w.length(); i++) s += w[i] * p.x; S q[2] = S[2](S(p, 1.0), S(p.yx, 2.0)); c = vec3(q[1].a, s);",
               "", "c = float3(p.yx, 0.25 * p.x + 0.5 * p.x + 1.0 * p.x);"),
    "macros": ("#define sat(x) clamp(x, 0.0, 1.0)\n#define TWO (1.0 + \\\n  1.0)\n#define SWAP(a, b) vec2(b, a)\n#if defined(TWO) && !defined(THREE) && (2 * 3 > 5)\n#define PICK 0.5\n#else\nbroken\n#endif\n#ifndef GL_ES\n#error no\n#elif 0\n%%%\n#endif",
               "c = vec3(sat(p.x * TWO), SWAP(p.x, p.y)) * PICK;", "", "c = float3(clamp(p.x * 2.0, 0.0, 1.0), p.y, p.x) * 0.5;"),
    "loops without a bound": ("", "float t = 0.0; while (t < p.x) t += 0.125; float i = 0.0; for (c *= 0.0; i++ < 3.0; c += p.y); c.x = t;",
                              "", "float t = 0.0; [MaxIters(9)] while (t < p.x) t += 0.125; c += p.y; c += p.y; c += p.y; c.x = t;"),
    "comma, xor, implicit floats": ("", "float a = 1, b; b = (a += 1.0, a * 2); bool k = p.x > 0.5 ^^ p.y > 0.5; c = vec3(b, k ? 1 : 0, 3 / 2);",
                                    "", "c = float3(4.0, (p.x > 0.5) != (p.y > 0.5) ? 1.0 : 0.0, 1.0);"),
    "derivatives": ("", "float d = length(I - 16.0); c = vec3(dFdx(d), dFdy(I.x * I.y), fwidth(sin(I.x) * 2.0));",
                    "", "float2 v = I - 16.0; c = float3(dFdx(length(v)), I.x, abs(dFdx(sin(I.x) * 2.0)));"),
    "out arguments": ("void both(vec2 q, out float a, inout float b) { a = q.x; b += q.y; }", "float a, b = 0.5; both(p, a, b); c = vec3(a, b, 0);", "", "c = float3(p.x, 0.5 + p.y, 0.0);"),
    "words of the language": ("float param = 0.5; float lerp(float shader) { return shader * 2.0; }", "vec3 float3 = vec3(p, 1); c = float3 * lerp(param);", "", "c = float3(p, 1.0);"),
}


class Meaning(Case):
    def picture(self, name, *args):
        self.run_cli("render", name, "--size", "48x32", "--centres", "-o", "o.pfm", "--quiet", *args)
        return self.get("o.pfm")

    def test_pairs(self):
        for name, (head, body, our_head, ours) in PAIRS.items():
            with self.subTest(name):
                self.put("a.frag", head + "\n" + TOY % body)
                self.put("a.salt", our_head + "\n" + OURS % ours)
                self.assertEqual(self.picture("a.frag"), self.picture("a.salt"))

    def test_bytes(self):
        """A comment may hold any bytes, the rest of the file may not."""
        self.put("a.frag", b"// caf\xe9\nvoid main() { gl_FragColor = vec4(1); /* \xff */ }")
        self.run_cli("render", "a.frag", "--size", 4)
        self.put("b.frag", b"void main() {\n  gl_FragColor = vec4(\xe91); }")
        self.assertIn("b.frag:2:", self.run_cli("render", "b.frag", "--size", 4, code=3).err)

    def test_long_expression_behind_a_loop(self):
        """A loop that may be cut off, which is counted, before an expression long enough to be pruned by bounds."""
        discs = "".join("    d = min(d, length(q - vec2(%d, %d)) - %.1f);\n" % (7 * k % 48, 5 * k % 32, k % 7 / 3) for k in range(300))
        text = "void mainImage(out vec4 c, vec2 p) {\n    vec2 q = p; float d = 9.0;\n    for (float i = min(iTime, 0.0); i < 60.0; i++) { q.x += 0.1; if (q.x > 20.0) break; }\n%s    c = vec4(d);\n}"
        self.put("a.frag", text % discs)
        self.put("b.frag", (text % discs).replace("float i = min(iTime, 0.0); i < 60.0", "int i = 0; i < 60"))
        self.assertEqual(self.picture("a.frag"), self.picture("b.frag"))

    def test_entries(self):
        """gl_FragColor, gl_FragData, an output of the file, a place from a vertex shader, `discard`."""
        want = {}
        for name, text in {
            "color": "void main() { gl_FragColor = vec4(gl_FragCoord.xy / vec2(48, 32), 0, 1); }",
            "data": "void main() { gl_FragData[0] = vec4(gl_FragCoord.xy / vec2(48, 32), 0, 1); }",
            "out": "#version 300 es\nprecision highp float;\nlayout(location = 0) out lowp vec4 color;\nuniform vec2 u_resolution;\nvoid main() { color = vec4(gl_FragCoord.xy / u_resolution, 0, 1); }",
            "uv": "varying vec2 vUv;\nvoid main() { gl_FragColor = vec4(vUv, 0, 1); }",
            "toy": "void mainImage(out vec4 c, vec2 p) { c = vec4(p / iResolution.xy, 0, 1); }",
        }.items():
            self.put(name + ".glsl", text)
            want[name] = self.picture(name + ".glsl")
        self.assertEqual(len(set(want.values())), 1)
        self.put("d.frag", "void f(vec2 p) { if (p.x > 24.0) discard; }\nvoid main() { f(gl_FragCoord.xy); gl_FragColor = vec4(1); }")
        self.put("d.salt", OURS % "c = I.x > 24.0 ? float3(0.0) : float3(1.0);")
        self.assertEqual(self.picture("d.frag"), self.picture("d.salt"))

    def test_display(self):
        """What a fragment shader gives is for a screen: no curve is applied, as under [Display]."""
        self.put("a.frag", "void mainImage(out vec4 c, vec2 p) { c = vec4(0.5); }")
        self.put("a.salt", "shader float3 main(float2 x) { return float3(0.5); }")
        self.put("b.salt", "[Display] shader float3 main(float2 x) { return float3(0.5); }")
        got = []
        for name in ("a.frag", "a.salt", "b.salt"):
            self.run_cli("render", name, "--size", 4, "-o", "o.png")
            got.append(read_png(self.get("o.png"))[1][0])
        self.assertEqual([128, 188, 128], got)

    def test_textures(self):
        """Repeating, bilinear, (0, 0) at the lower left, PNG values as they are; `texelFetch` counts from below."""
        self.run_cli("render", "--expr", "float3(step(0.5, x.x), step(0.5, x.y), 0.0)", "--size", 2, "--centres", "-o", "t.png")
        self.put("t.frag", "uniform sampler2D t;\nvoid main() { vec2 p = gl_FragCoord.xy / vec2(48, 32); gl_FragColor = texture2D(t, p * 3.0 - 1.0) + 0.5 * texelFetch(t, ivec2(0, 1), 0) + float(textureSize(t, 0).x); }")
        self.put("t.salt", OURS % "float2 w = frac(p * 3.0 - 1.0); float2 k = clamp(abs(w - 0.25 - floor(w - 0.25 + 0.5)) * 2.0, 0.0, 1.0); c = float3(k, 0.0) + float3(2.0, 2.5, 2.0);")
        a = read_pfm(self.picture("t.frag", "--param", "t=@t.png"))[1]
        b = read_pfm(self.picture("t.salt"))[1]
        self.assertLess(max(abs(x - y) for x, y in zip(a, b)), 1e-4)

    def test_parameters(self):
        """Uniforms are parameters, 0 where nothing is said; the ones of hosts are there when used."""
        self.put("u.frag", "uniform float a, b[3]; uniform vec3 tint; uniform int n = 4;\nvoid mainImage(out vec4 c, vec2 p) { c = vec4(a + b[1], tint.x, iTime + float(n) + iMouse.z, 1); }")
        j = self.json_cli("render", "u.frag", "--integral", "--param", "a=0.5", "--param", "b=[0,1,0]", "--param", "iTime=2", "--size", "4x2")
        for got, want in zip(j["integral"], [12, 0, 48]):
            self.assertAlmostEqual(got, want, delta=1e-3)

    def test_includes(self):
        """Files are relative to the one that names them; messages point into them; a circle ends."""
        os.makedirs(self.dir + "/lib")
        self.put("lib/one.glsl", '#ifndef ONE\n#define ONE\n#include "../lib/two.glsl"\nfloat one(float x) { return two(x) * K; }\n#endif\n')
        self.put("lib/two.glsl", "#define K 0.5\nfloat two(float x) { return x * 2.0; }")
        self.put("a.frag", '#include "lib/one.glsl"\n#if 0\n#include "no.glsl"\n#endif\n#include "lib/one.glsl"\nuniform vec2 canvas_resolution;\nvoid mainImage(out vec4 c, vec2 p) { c = vec4(one(p.x) / canvas_resolution.x); }')
        for got in self.json_cli("render", "a.frag", "--integral", "--size", "8x4")["integral"]:
            self.assertAlmostEqual(got, 16, delta=1e-3)
        self.put("lib/bad.glsl", '#include "bad.glsl"\n')
        self.put("b.frag", '#include "lib/none.glsl"\n#include <x>\n#include "lib/bad.glsl"\n')
        said = self.run_cli("render", "b.frag", code=3).err
        for text in ("b.frag:1:1: error: cannot read `%s/lib/none.glsl`" % ".", "b.frag:2:", "lib/bad.glsl:1:1: error: files include each other too deeply"):
            self.assertIn(text, said.replace(self.dir, "."))

    def test_size_of_target(self):
        """A fit without --size takes its size from the target, iResolution too; a gl.salt of the user's is not ours."""
        self.put("gl.salt", "shader float main(float2 x) { return 1.0; }")
        self.put("t.frag", "void mainImage(out vec4 c, vec2 p) { c = vec4(0.5); }")
        self.put("s.frag", "uniform float r;\nvoid mainImage(out vec4 c, vec2 p) { c = vec4(mod(iResolution.x / 64.0, 4.0) + r); }")
        self.run_cli("render", "t.frag", "--size", "32x16", "-o", "t.png")
        j = self.json_cli("fit", "s.frag", "--wrt", "r", "--target", "t.png", "--iters", 1)
        self.assertLess(j["initial_loss"], 1e-4, j)

    def test_unread(self):
        """What hosts set is no error where nothing reads it; other names are."""
        self.put("u.frag", "void mainImage(out vec4 c, vec2 p) { c = vec4(1); }")
        said = self.run_cli("render", "u.frag", "--size", 4, "--param", "iTime=2", "--param", "iMouse.x=3", "--param", "iChannel0=@none.png").err
        for name in ("iTime", "iMouse.x", "iChannel0"):
            self.assertIn("note: the shader does not read `%s`" % name, said)
        self.run_cli("render", "u.frag", "--size", 4, "--param", "iTimer=2", code=2)
        self.put("v.frag", "uniform vec2 v;\nvoid mainImage(out vec4 c, vec2 p) { c = vec4(v, 0, 1); }")
        self.assertIn("vec2 has no component `z`", self.run_cli("render", "v.frag", "--param", "v.z=1", code=2).err)
        self.assertIn("--size", self.run_cli("render", "u.frag", "--param", "iResolution=[4,4]", code=2).err)

    def test_language_option(self):
        self.put("a.txt", "void mainImage(out vec4 c, vec2 p) { c = vec4(1); }")
        self.assertIn("--lang glsl", self.run_cli("render", "a.txt", code=3).err)
        for name in ("BIG.FRAG", "a.fsh", "a.frag.txt", "a.Fs"):
            self.put(name, "void mainImage(out vec4 c, vec2 p) { c = vec4(1); }")
            self.run_cli("render", name, "--size", 4)
        self.run_cli("render", "a.txt", "--lang", "glsl", "--size", 4)
        self.put("b.frag", "shader float main(float2 x) { return 1.0; }")
        self.run_cli("render", "b.frag", "--lang", "salt", "--size", 4)


class Messages(Case):
    def test_places(self):
        """What is not accepted says so with its line, once."""
        for text, line, what in [
            ("#include <x>\nvoid main() {}", 1, "wants the name of a file"),
            ("void main() { gl_FragColor = vec4(1); }\n#if 1\n", 2, "no `#endif`"),
            ("#define f(a, b) a\nvoid main() {\n gl_FragColor = vec4(f(1)); }", 3, "takes 2 arguments, 1 given"),
            ("#if 1 +\n#endif\nvoid main() { gl_FragColor = vec4(1); }", 1, "no condition"),
            ("uniform samplerCube s;\nvoid main() { gl_FragColor = textureCube(s, vec3(1)); }", 1, "`samplerCube` is not supported"),
            ("void main() {\n mat3 m = mat2(1.0);\n gl_FragColor = vec4(1); }", 2, "cannot convert mat2 to mat3"),
            ("void main() {\n gl_FragColor = vec4(mix(vec3(1), vec2(0), 0.5), 1); }", 2, "`mix` takes floats"),
            ("\nvarying vec3 n;\nvoid main() { gl_FragColor = vec4(n, 1); }", 2, "no vertex shader"),
            ("uniform int a[];\nvoid main() { gl_FragColor = vec4(a[0]); }", 1, "needs a size"),
            ("uniform sampler1D s;\nvoid main() { gl_FragColor = texture(s, 0.5); }", 1, "`sampler1D` is not supported"),
            ("void main() { int i = 08; gl_FragColor = vec4(i); }", 1, "octal"),
            ("uniform B { float a;\nvoid main() { gl_FragColor = vec4(1); }", 2, "expected `;`"),
            ("float f(float v) { return v; }\nvoid main() { gl_FragColor = vec4(f(vec2(1))); }", 2, "cannot convert vec2 to float"),
            ("float f() { return 1.0; }", 1, "no `void mainImage"),
            ("void main() { }", 1, "writes to no output"),
            ("#define A B(1.0)\nvoid mainImage(out vec4 c, vec2 p) {\n    c = vec4(A);\n}", 3, "unknown name `B`"),
            ("uniform sampler2D t;\nvoid main() {\n  gl_FragColor = vec4((t, 1.0));\n}", 3, "is not a value"),
            ("void main() { gl_FragColor = vec4(1.0lf); }", 1, "no doubles"),
            ("void mainImage(vec4 c, vec2 p) { c = vec4(1); }", 1, "gives its colour by its first argument"),
            ("\nfloat mainImage(out vec4 c, vec2 p) { return 1.0; }", 2, "gives its colour by its first argument"),
            ("void mainImage(out vec3 c, vec2 p) { c = vec3(1); }", 1, "gives its colour by its first argument"),
            ("void main() {\n float a[3]; a[5] = 1.0; gl_FragColor = vec4(a[0]); }", 2, "there is no [5] in float[3]"),
            ("void main() {\n gl_FragColor = vec4(vec3(1)[3]); }", 2, "there is no [3] in vec3"),
            ("void main() {\n gl_FragColor = vec4(5.0 % 2.0); }", 2, "`mod(x, y)` of floats"),
            ("void main() {\n gl_FragColor = vec4(lerp(0.0, 1.0, 0.5)); }", 2, "unknown name `lerp`: GLSL has `mix`"),
            ("void main() { vec3 v;\n gl_FragColor = vec4(float3(1), 1); }", 2, "unknown name `float3`"),
            ("void main() {\n gl_FragColor = mat3(1) * vec4(1); }", 2, "`*` does not apply to mat3 and vec4"),
            ("void main() {\n mat2 m = mat2(1) + vec2(1); gl_FragColor = vec4(m[0], 1, 1); }", 2, "`+` does not apply to mat2 and vec2"),
            ("void f(out float x) { x = 1.0; }\nvoid main() { f(1.0); gl_FragColor = vec4(1); }", 2, "`out` argument `x` of `f` must be something"),
            ("float g;\nfloat f(float x) { return g += x; }\nvoid main() { gl_FragColor = vec4(f(1.0, 2.0)); }", 3, "`f` takes 1 argument, 2 given"),
            ("uniform float r;\nvoid main() {\n r = 1.0; gl_FragColor = vec4(r); }", 3, "cannot assign to uniform `r`"),
            ("void main() {\n gl_FragColor = vec4(vec2(1).length(), gl_FragCoord.x.length(), 1, 1); }", 2, "`length` takes an array"),
            ("void main() {\n iTime = 1.0; gl_FragColor = vec4(1); }", 2, "cannot assign to uniform `iTime`"),
            ("uniform sampler2D t;\nvoid main() { gl_FragColor = texture(t); }", 2, "`texture` takes 2 arguments, 1 given"),
            ("#error told you\nvoid main() { gl_FragColor = vec4(1); }", 1, "#error"),
            ("void mainImage(out vec4 c, vec2 p) {\n  c = vec3(1.0);\n}", 2, "cannot convert"),
        ]:
            self.put("m.frag", text)
            r = self.run_cli("render", "m.frag", "--size", 4, code=3)
            self.assertIn("m.frag:%d:" % line, r.err)
            self.assertIn(what, r.err)
            self.assertEqual(r.err.count("error:"), 1, r.err)
            for word in ("<host>", "gl.salt", "inout", "len`"):
                self.assertNotIn(word, r.err)

    def test_places_behind_names(self):
        """What jumps or fails inside a builtin of GLSL is where the source calls it."""
        self.put("a.frag", "uniform float r;\nvoid mainImage(out vec4 c, vec2 p) {\n  float t = mod(iTime, 3.0);\n  c = vec4(mod(p.x, r) + t,\n    acosh(p.x - 900.0), 0, 1);\n}")
        for args in (["render", "a.frag", "--size", 4], ["grad", "a.frag", "--integral", "--param", "r=0.3"], ["explain", "a.frag"]):
            said = self.run_cli(*args)
            self.assertNotIn("gl.salt", said.err + said.out)
            self.assertNotIn("gl_", said.err + said.out.replace("<host>", ""))
        self.assertRegex(said.out, r"a.frag:4:12 +floor +mod\(p.x, r\) +in image > mainImage,")
        self.assertIn("a.frag:3:13: warning: static", said.err)
        self.assertIn("a.frag:5:5: results that are not finite", self.run_cli("render", "a.frag", "--size", 4, "--param", "r=0.3").err)

    def test_macros_end(self):
        """Macros that call themselves, each other, or grow without end."""
        self.put("a.frag", "#define a b\n#define b a\nfloat a = 0.5; float f(float x) { return x; }\n#define f(x) f(x + 1.0)\nvoid main() { gl_FragColor = vec4(a, f(1.0), 0, 1); }")
        self.run_cli("render", "a.frag", "--size", 4)
        doubling = "#define x0 1.0 + 1.0\n" + "".join("#define x%d x%d + x%d\n" % (k, k - 1, k - 1) for k in range(1, 40))
        self.put("b.frag", doubling + "void main() { gl_FragColor = vec4(x39); }")
        self.assertIn("500 000", self.run_cli("render", "b.frag", "--size", 4, code=3).err)
        self.put("c.frag", "#define x(" + ",".join("a%d" % k for k in range(70)) + ") 1\nvoid main() { gl_FragColor = vec4(1); }")
        self.assertIn("at most 64", self.run_cli("render", "c.frag", "--size", 4, code=3).err)
        self.put("d.frag", "#if 1\n" * 300 + "void main() { gl_FragColor = vec4(1); }\n" + "#endif\n" * 300)
        self.assertIn("deeper than 256", self.run_cli("render", "d.frag", "--size", 4, code=3).err)


class Edges(Case):
    """Gradients of what shaders of this kind draw, in pixels: closed forms. Everything counts as [Disc]."""

    def near(self, source, values, truth, *args):
        self.put("e.frag", source)
        params = [a for k, v in values.items() for a in ("--param", "%s=%s" % (k, v))]
        j = self.json_cli("grad", "e.frag", "--integral", "--size", "64x48", "--precision", "f64", *params, *args)
        for name, want in truth.items():
            got, bar = j["gradient"][name], j["stderr"][name]
            if isinstance(got, list):
                got, bar = got[0], bar[0]
            self.assertLessEqual(abs(got - want), 4 * bar + 1e-7 * abs(want), (source, name, got, want, bar))
            self.assertLess(bar, 1e-2 * max(1, abs(want)), (source, name, bar))

    def test_shapes(self):
        toy = "uniform float r, s;\nuniform vec2 m;\n%s\nvoid mainImage(out vec4 c, vec2 p) {\n    vec2 q = p - 0.5 * iResolution.xy;\n%s\n}\n"
        self.near(toy % ("", "c = vec4(length(q) < r ? 1.0 : 0.0);"), {"r": 15}, {"r": 2 * math.pi * 15})
        self.near(toy % ("", "c = vec4(step(length(q - m), r));"), {"r": 15, "m": "[2,1]"}, {"r": 2 * math.pi * 15})
        self.near(toy % ("float box(vec2 v, vec2 b) { vec2 d = abs(v) - b; return max(d.x, d.y); }", "float a = 0.3; q *= mat2(cos(a), -sin(a), sin(a), cos(a)); if (box(q, vec2(r, s)) < 0.0) c = vec4(1);"),
                  {"r": 12, "s": 7}, {"r": 4 * 7, "s": 4 * 12})
        self.near(toy % ("", "c = vec4(1.0 - step(r, abs(length(q) - s)));"), {"r": 2, "s": 12}, {"r": 4 * math.pi * 12, "s": 8 * math.pi})
        self.near(toy % ("#define T(v) ((v) < r ? 1. : 0.)", "vec2 k = mod(p, 16.0) - 8.0; c = vec4(T(length(k)));"), {"r": 5}, {"r": 12 * 2 * math.pi * 5})
        self.near(toy % ("", "float a = atan(q.y, q.x); c = vec4(a > 0.0 && a < r && length(q) < 20.0 ? 1.0 : 0.0);"), {"r": 1}, {"r": 200})
        self.near(toy % ("", "if (q.y > r * q.x + s) discard; c = vec4(1);"), {"r": 0.25, "s": 2}, {"s": 64, "r": 0})
        self.near(toy % ("float union2(float a, float b) { return min(a, b); }", "float d = union2(length(q - vec2(12, 0)) - r, length(q + vec2(12, 0)) - s); c = vec4(d < 0.0 ? 1.0 : 0.0);"),
                  {"r": 6, "s": 8}, {"r": 12 * math.pi, "s": 16 * math.pi})
        self.near(toy % ("", "for (int i = 0; i < 3; i++) if (length(q - float(i - 1) * vec2(20, 0)) < r) c += 1.0;"), {"r": 5}, {"r": 30 * math.pi})

    def test_marches(self):
        """How many steps a march takes is no boundary, however the loop ends; what it hands on may be one."""
        march = "uniform float r;\n#define NEAR 0.0005\nconst float FAR = 60.0;\nfloat map(vec3 v) { return length(v) - r; }\nvoid mainImage(out vec4 c, vec2 p) {\n    vec3 o = vec3(p - 0.5 * iResolution.xy, -30.0); float t = 0.0, d;\n%s\n}\n"
        for body in ("for (int i = 0; i < 90; i++) { float h = map(o + vec3(0, 0, t)); if (h < NEAR || t > FAR) break; t += h; } if (t < FAR) c = vec4(1);",
                     "int i; for (i = 0; i < 90; i++) { d = map(o + vec3(0, 0, t)); if (abs(d) < NEAR * 1.5) break; t += d; if (t > FAR) { break; } } if (d < NEAR * 1.5) c = vec4(1);",
                     "for (int i = 0; i < 90; ++i) { float h = map(o + vec3(0, 0, t)); t += h; if (t > FAR || abs(h) < NEAR) break; } c = vec4(step(t, FAR));",
                     "bool hit = false; for (int i = 0; i < 90; i++) { float h = map(o + vec3(0, 0, t)); if (h < NEAR) { hit = true; break; } t += h; if (t > FAR) break; } if (hit) c = vec4(1);",
                     "float m = -1.0; if (p.x > -1.0) for (int i = 0; i < 90; i++) { float h = map(o + vec3(0, 0, t)); if (h < NEAR) { m = t; break; } t += h; } c = vec4(m > 0.0);"):
            self.put("e.frag", march % body)  # rays that graze run out of steps: not quite the disc
            j = self.json_cli("grad", "e.frag", "--integral", "--size", "64x48", "--param", "r=12")
            self.assertAlmostEqual(j["gradient"]["r"][0], 2 * math.pi * 12, delta=0.6, msg=body)
            self.assertLess(j["stderr"]["r"][0], 0.5, body)

    def test_counted_steps(self):
        """A loop that shows where it ended keeps its boundaries: rings by the number of steps, each of its own radius."""
        self.near("uniform float r;\nvoid mainImage(out vec4 c, vec2 p) {\n    float d = length(p - 0.5 * iResolution.xy), n = 0.0;\n    for (int i = 0; i < 8; i++) { if (0.01 * (d - r * float(i)) < 0.01) break; n++; }\n    c = vec4(n);\n}\n",
                  {"r": 2}, {"r": -2 * math.pi * sum((2 * i + 1) * i for i in range(8))})


if __name__ == "__main__":
    unittest.main()
