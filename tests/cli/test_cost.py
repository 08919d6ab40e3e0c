"""saltus explain --cost: every number against something else that knows it: the objects and the assembly of `build`, read here, or the program itself."""
import re
import struct
import unittest

from harness import *

TABLE = "\n".join(str(i / 64) for i in range(64))
GATHER = """
param float t[64] = "t.csv";
[Domain(0.0, 1.0)]
shader float main(float2 x) { return t[int(x.x * 64.0)] + x.y; }
"""
NO_GATHER = """
param float t[64] = "t.csv";
[Domain(0.0, 1.0)]
shader float main(float2 x) {
    float s = 0.0;
    for (int k = 0; k < 64; k++) s += t[k] * x.x;
    return s;
}
"""
MARCH = """
param float a = 0.3;
[Domain(0.0, 1.0)]
shader float main(float2 x) {
    float s = x.y;
    for (int k = 0; k < 37; k++) {
        s = sqrt(s + x.x) / (a + s);
        if (s > 0.9) break;
    }
    return s + 1.0;
}
"""
EDGE = """
param float r = 0.3;
[Domain(0.0, 1.0)]
shader float main(float2 x) {
    float s = 0.0;
    for (int k = 0; k < 40; k++) {
        [Disc] if (length(x) < r + 0.01 * float(k)) s += 1.0;
    }
    return s;
}
"""


def products(n, tail="+ x.y"):
    """A program of n numbers that are all alive at once: each is used again in the opposite order."""
    lines = ["    float v%d = x.x * %r %s;" % (i, 0.5 + i / 7, tail) for i in range(n)]
    sums = ["    s = s * 0.5 + v%d * (s - %r);" % (i, i / 3) for i in reversed(range(n))]
    return "[Domain(0.0, 1.0)]\nshader float main(float2 x) {\n    float s = x.y;\n%s\n    return s;\n}\n" % "\n".join(lines + sums)


class Assembly:
    """What `build` makes of one kernel: its instructions, and how large it is."""

    def __init__(self, case, file, kernel, *options):
        case.run_cli("build", file, "-o", "built.s", *options)
        case.run_cli("build", file, "-o", "built.o", *options)
        inside, self.lines = False, []
        for line in case.get("built.s").decode().splitlines():
            label = re.match(r"(\w[\w.]*):", line)
            if label:
                inside = label[1] == "built_" + kernel
            elif inside and re.match(r"\t[a-z{]", line):
                self.lines.append(line.strip().split("#")[0])
        self.bytes = self.size_of(case.get("built.o"), "built_" + kernel)

    @staticmethod
    def size_of(elf, name):
        at, = struct.unpack_from("<Q", elf, 40)
        size, count = struct.unpack_from("<HH", elf, 58)
        sections = [struct.unpack_from("<IIQQQQIIQQ", elf, at + i * size) for i in range(count)]
        symbols = next(s for s in sections if s[1] == 2)
        names = sections[symbols[6]][4]
        for i in range(symbols[5] // 24):
            where, _, _, _, _, length = struct.unpack_from("<IBBHQQ", elf, symbols[4] + 24 * i)
            if elf[names + where:elf.index(b"\0", names + where)].decode() == name:
                return length

    def count(self, pattern):
        return sum(1 for line in self.lines if re.match(pattern, line))

    def stack_stores(self):
        """Registers that are written to the stack; `push` at the head is of the caller's."""
        return self.count(r"v?mov\w*\s+%\w+,.*\((%rsp|%rbp)\)")


class Cost(Case):
    def setUp(self):
        super().setUp()
        self.put("t.csv", TABLE)

    def cost(self, text, *options):
        self.put("c.salt", text)
        j = self.json_cli("explain", "c.salt", "--cost", *options)
        self.assertEqual({k: v["lanes"] for k, v in j["cost"]["kernels"].items()}, {k: v["lanes"] for k, v in j["kernels"].items()})
        for name, k in j["cost"]["kernels"].items():
            self.assertEqual((k["ops"], k["llvm"], k["tape_bytes"]), tuple(j["kernels"][name][key] for key in ("ops", "instructions", "tape_bytes")))
        return j["cost"]

    def test_machine_code(self):
        """Counts of instructions, their bytes, divisions, roots, gathers and spills are those of the file that build makes."""
        for text in (GATHER, NO_GATHER, MARCH, products(60)):
            for options in (["--target-cpu", "avx512"], ["--target-cpu", "avx2"], ["--target-cpu", "sse2"], ["--width", 8]):
                with self.subTest(text=text[:60], options=options):
                    k = self.cost(text, *options)["kernels"]["value"]
                    m, built = k["machine"], Assembly(self, "c.salt", "value", *options)
                    self.assertEqual(m["instructions"], len(built.lines))
                    self.assertEqual(m["bytes"], built.bytes)
                    self.assertEqual(m["divisions"], built.count(r"v?div[ps][sd]\b"))
                    self.assertEqual(m["square_roots"], built.count(r"v?sqrt[ps][sd]\b"))
                    self.assertEqual(m["gathers"], built.count(r"vp?gather"))
                    self.assertEqual(m["scatters"], built.count(r"vp?scatter"))
                    self.assertEqual(sum(m["calls"].values()), built.count(r"call|jmp\s.*@PLT"))
                    self.assertEqual(m["spills"], built.stack_stores())

    def test_spills(self):
        """60 numbers that are alive at once do not fit 16 registers; three do."""
        many = self.cost(products(60), "--target-cpu", "avx2")["kernels"]["value"]["machine"]
        self.assertGreater(many["spills"], 60)
        self.assertGreaterEqual(many["reloads"], many["spills"])
        few = self.cost(products(3), "--target-cpu", "avx2")["kernels"]["value"]["machine"]
        self.assertEqual((few["spills"], few["reloads"]), (0, 0))

    def test_gathers(self):
        """One for each group of lanes where samples read different places; none where all read the same."""
        for target, native in (("avx512", True), ("sse2", False)):
            k = self.cost(GATHER, "--target-cpu", target)["kernels"]["value"]
            self.assertEqual(k["gathers"], 1)
            self.assertEqual(k["machine"]["gathers"], k["vectors"] if native else 0)
            self.assertEqual(self.cost(NO_GATHER, "--target-cpu", target)["kernels"]["value"]["gathers"], 0)
        self.assertEqual(self.cost(GATHER, "--width", 1)["kernels"]["value"]["gathers"], 0)

    def test_local_arrays(self):
        """Ten floats a lane; written at an index that differs, and read at one."""
        k = self.cost("[Domain(0.0, 1.0)]\nshader float main(float2 x) {\n    float a[10];\n    for (int i = 0; i < 10; i++) a[i] = x.y * float(i);\n"
                      "    a[int(x.x * 10.0)] = 1.0;\n    return a[int(x.y * 10.0)];\n}\n")["kernels"]["value"]
        self.assertEqual((k["array_bytes"], k["scatters"], k["gathers"]), (40 * k["lanes"], 1, 1))

    def test_fused(self):
        """Without hardware for it a fused product is a call of libm for every lane."""
        text = "[Domain(0.0, 1.0)]\nshader float main(float2 x) { return fma(x.x, x.y, 0.25); }\n"
        k = self.cost(text, "--target-cpu", "sse2")["kernels"]["value"]
        self.assertEqual((k["library_fma"], k["machine"]["calls"]), (1, {"fmaf": k["lanes"]}))
        k = self.cost(text, "--target-cpu", "avx2")["kernels"]["value"]
        self.assertEqual((k["library_fma"], k["machine"]["calls"]), (0, {}))

    def test_roundings(self):
        text = "[Domain(0.0, 1.0)]\nshader float main(float2 x) { return floor(x.x * 5.0) + x.y; }\n"
        self.assertEqual(self.cost(text, "--target-cpu", "sse2")["kernels"]["value"]["roundings"], 1)
        self.assertEqual(self.cost(text, "--target-cpu", "avx2")["kernels"]["value"]["roundings"], 0)

    def test_width(self):
        """Why a kernel has its lanes: 16 a vector with avx512."""
        loop = "[Domain(0.0, 1.0)]\nshader float main(float2 x) {\n    float s = x.y;\n    for (int k = 0; k < 1000; k++) s = s * x.x + 0.5;\n    return s;\n}\n"
        kept = "[Domain(0.0, 1.0)]\nshader float main(float2 x) {\n%s    for (int k = 0; k < 1000; k++) {\n%s    }\n    return %s;\n}\n" % (
            "".join("    float s%d = x.y + %d.0;\n" % (i, i) for i in range(9)), "".join("        s%d = s%d * s%d + x.x;\n" % (i, i, (i + 1) % 9) for i in range(9)), " + ".join("s%d" % i for i in range(9)))
        chain = kept.replace(" * ", " / ").replace("s0 = s0 / s1", "s0 = sqrt(s0 / s1)")  # a root of a quotient of the iteration before
        waiting = loop.replace("s = s * x.x + 0.5;", "if (s + x.x < float(k)) { s = s * s / x.x + x.y; if (s > 9.0) break; }")  # lanes that do not, wait
        leaving = loop.replace("s = s * x.x + 0.5;", "{ if (s + x.x < float(k)) s = s * s / x.x + x.y; if (s > 9.0) break; s = s * s + x.x; }")
        for text, options, lanes, reason in ((loop, [], 64, "short_loop"), (waiting, [], 32, "many_masks"), (leaving, [], 64, "short_loop"), (kept, [], 32, "much_kept"), (chain, [], 64, "chain"), (products(20), [], 64, "image"), (products(200), [], 32, "much_code"),
                                             (products(1200), [], 16, "most_code"), (loop, ["--width", 8], 8, "given"), (products(1200), ["--width", 8], 8, "given")):
            with self.subTest(reason):
                k = self.cost(text, "--target-cpu", "avx512", *options)["kernels"]["value"]
                self.assertEqual((k["lanes"], k["width_reason"]), (lanes, reason))
                self.assertEqual(k["vectors"], max(1, lanes // 16))
        kernels = self.cost(EDGE, "--target-cpu", "avx512")["kernels"]
        for kernel, reason in (("event", "neighbours"), ("site", "no_loop")):
            self.assertEqual((kernels[kernel]["lanes"], kernels[kernel]["width_reason"]), (32, reason))
        self.assertIn("event: 32 lanes, 2 vectors of 16: it compares neighbouring samples", self.run_cli("explain", "c.salt", "--cost", "--target-cpu", "avx512").out)

    def test_leaves_last(self):
        """A loop that ends with a break blends nothing for lanes that are gone, as one that begins with it: nobody looks at them."""
        body = "        a = a * b + 0.1;\n        b = b * c + 0.2;\n        c = c * a + 0.3;\n        t = a * b;\n"
        leave = "        if (t > 9.0) break;\n"
        first, last = (self.cost("[Domain(0.0, 1.0)]\nshader float main(float2 x) {\n    float a = x.x, b = x.y, c = x.x + x.y, t = 0.0;\n    for (int k = 0; k < 1000; k++) {\n%s    }\n    return t;\n}\n" % text,
                                 "--target-cpu", "avx512")["kernels"]["value"]["machine"]["instructions"] for text in (leave + body, body + leave))
        self.assertLess(last, first + 20)

    def test_few_samples(self):
        """Kernels on boxes of a loop with a list are called for a node of a tree at a time."""
        self.put("d.csv", "\n".join("%r,%r" % (i * 0.618034 % 1, i / 200) for i in range(200)))
        c = self.cost("""
param float2 at[200] = "d.csv";
param float r = 0.01;
[Domain(0.0, 1.0)]
shader float main(float2 x) {
    float s = 0.0;
    for (int i = 0; i < 200; i++) {
        float2 d = x - at[i];
        [Disc] if (dot(d, d) < r * r) s = 1.0;
    }
    return s;
}
""", "--target-cpu", "avx512")["kernels"]
        self.assertEqual((c["bounds"]["width_reason"], c["bounds"]["lanes"], c["bounds"]["vectors"]), ("few_samples", 16, 1))
        self.assertNotEqual(c["value"]["width_reason"], "few_samples")

    def test_sides(self):
        """An if on which samples differ runs both sides where they are long; one that is the same for all runs one."""
        side = "".join("        s = s * s + sin(s * %d.0);\n" % i for i in range(3, 6))
        text = "param float q = 0.4;\n[Domain(0.0, 1.0)]\nshader float main(float2 x) {\n    float s = x.y;\n    [NoDisc] if (%s < 0.5) {\n" + side + "    } else {\n" + side.replace("sin", "exp") + "    }\n    return s;\n}\n"
        self.assertEqual(self.cost(text % "x.x")["kernels"]["value"]["both_sides"], 1)
        self.assertEqual(self.cost(text % "q")["kernels"]["value"]["both_sides"], 0)
        self.assertEqual(self.cost(text % "x.x", "--width", 1)["kernels"]["value"]["both_sides"], 0)

    def test_searches(self):
        """A search is a call into the runtime."""
        k = self.cost("""
[Extent(0.0, 0.0, 1.0, 1.0)] param heightfield h = zeros(8, 8);
[Domain(0.0, 1.0)]
shader float main(float2 x) {
    [Disc] Hit v = h.trace(float3(x.x, -1.0, 0.5), float3(0.0, 1.0, x.y - 0.7), 0.0, 9.0);
    if (!v.hit) return 0.7;
    return v.t;
}
""")["kernels"]["value"]
        self.assertEqual(k["searches"], 1)
        self.assertEqual(k["machine"]["calls"], {"runtime": 1})

    def test_parts(self):
        """A kernel over many sites comes in functions, each of which counts."""
        text = "param float r = 0.3;\n[Domain(0.0, 1.0)]\nshader float main(float2 x) {\n    float s = 0.0;\n%s    return s;\n}\n" % "".join(
            "    [Disc] if (length(x - float2(%r, 0.5)) < r * %r) s += %d.0;\n" % (i / 90, 0.2 + i / 150, i) for i in range(90))
        k = self.cost(text, "--target-cpu", "avx2")["kernels"]["site_vjp"]
        self.run_cli("build", "c.salt", "-o", "built.s", "--target-cpu", "avx2")
        functions = re.findall(r"(?m)^built_site_vjp(?:\.part\d+)?:(?s:.*?)\n\.Lfunc_end", self.get("built.s").decode())
        self.assertGreater(len(functions), 2)
        self.assertEqual(k["machine"]["instructions"], sum(len(re.findall(r"(?m)^\t[a-z{]", f)) for f in functions))
        self.assertEqual(k["machine"]["calls"], {})
        self.assertGreater(k["machine"]["bytes"], 3 * k["machine"]["instructions"])

    def test_masks_travel_whole(self):
        """Lanes that leave a loop: no mask is packed on its way from one iteration to the next, where masks are vectors."""
        self.put("c.salt", """param float2 c = { -0.4, 0.6 };
[NoDisc] shader float main(float2 x) { float2 z = 2.0 * x; int n = 0;
for (int i = 0; i < 200; i++) { if (dot(z, z) > 4.0) break; z = float2(z.x * z.x - z.y * z.y, 2.0 * z.x * z.y) + c; n++; }
return float(n); }""")
        for target in "avx2", "sse2":
            lines = Assembly(self, "c.salt", "value", "--target-cpu", target).lines
            self.assertTrue(any(re.match(r"v?(movmskp|testp)", line) for line in lines))
            self.assertEqual([line for line in lines if re.match(r"v?(packss|pmovsxw|punpckl[bw])", line)], [])

    def test_only_what_is_read_is_blended(self):
        """Lanes that leave a loop, behind which only n is read: it is blended in the loop and at its end, z nowhere."""
        self.put("c.salt", """[NoDisc] shader float main(float2 x) { float2 z = x; int n = 0;
for (int i = 0; i < 200; i++) { if (dot(z, z) > 4.0) break; z = float2(z.x * z.x - z.y * z.y, 2.0 * z.x * z.y) + x; n++; }
return float(n); }""")
        lanes = self.json_cli("explain", "c.salt", "--target-cpu", "avx2")["kernels"]["value"]["lanes"]
        built = Assembly(self, "c.salt", "value", "--target-cpu", "avx2")
        self.assertEqual(built.count("vblendvps|vpblendvb"), 2 * lanes // 8)

    def test_lines(self):
        """The loop's line costs most, as often as the loop runs at most; what is dear in it is what stands there."""
        c = self.cost(MARCH)
        lines = c["lines"]
        self.assertLessEqual(len(lines), 10)
        self.assertEqual(sorted(lines, key=lambda l: -l["share"]), lines)
        self.assertLessEqual(sum(l["share"] for l in lines), 1 + 1e-9)
        self.assertEqual((lines[0]["file"], lines[0]["line"], lines[0]["times"]), ("c.salt", 7, 37))
        self.assertEqual(c["kernels"]["value"]["waits"], 1)
        self.assertTrue(any(l["line"] == 6 and l["waits"] for l in lines))
        text = self.run_cli("explain", "c.salt", "--cost").out
        self.assertRegex(text, r"(?m)^  c\.salt:7  \d+ %: .*of value")
        self.assertRegex(text, r"square roots?\n        where lengths are only compared")
        only = self.cost(MARCH, "--wrt", "a", "--interior-only")["kernels"]
        self.assertEqual((only["value"]["divisions"], only["value"]["square_roots"]), (1, 1))
        many = "\n".join("    s = s * x.x + %d.0 / (s + x.y);" % i for i in range(30))
        self.assertEqual(len(self.cost("[Domain(0.0, 1.0)]\nshader float main(float2 x) {\n    float s = 1.0;\n%s\n    return s;\n}\n" % many)["lines"]), 10)

    def test_tape(self):
        """A loop of 37 that stores: so many frames at most, and the report says which loop."""
        k = self.cost(MARCH)["kernels"]["vjp"]
        self.assertEqual(k["tape_bytes"] % 37, 0)
        self.assertGreaterEqual(k["tape_bytes"], 4 * 37)
        self.assertGreater(k["tape_pushes"], 0)
        self.assertRegex(k["tape"], "loop at line 6")

    def test_refused(self):
        self.put("c.salt", MARCH)
        for what in (["c.salt", "--at", "0.5,0.5"], ["E0101"], ["c.salt", "--cells", "c.svg"]):
            self.assertIn("--cost is of a program's kernels", self.run_cli("explain", *what, "--cost", code=2).err)
        self.run_cli("render", "c.salt", "--cost", "-o", "c.png", code=2)
        self.put("bad.salt", "shader float main(float2 x) { return y; }")
        self.assertIn("bad.salt:1:", self.run_cli("explain", "bad.salt", "--cost", code=3).err)
        self.assertIn("--cost", self.run_cli("explain", "--help").out)
        self.assertNotIn('"cost"', self.run_cli("explain", "c.salt", "--json").out)


if __name__ == "__main__":
    unittest.main()
