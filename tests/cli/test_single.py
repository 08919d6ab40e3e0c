"""Single precision, the default: what is stated covers what rounding does. Programs in which g rounds much more than it would have to, with
their exact answers; and random ones, held against double precision."""
import math
import random

from harness import *

UNIT = "[Domain(-1.0, 1.0)] "
DISC = 2 * math.pi * 0.4
# A program, and what it should give: of the parameter r, and the integral.
ROUNDED = {
    "1e4 added on both sides": ("param float r = 0.4; " + UNIT + "shader float main(float2 x) { float d = r - length(x); [Disc] if (d + 1e4 > 1e4) return 1.0; return 0.0; }",
                                DISC, math.pi * 0.16),
    "1e6 added on both sides": ("param float r = 0.4; " + UNIT + "shader float main(float2 x) { float d = r - length(x); [Disc] if (1e6 + d > 1e6) return 1.0; return 0.0; }",
                                DISC, math.pi * 0.16),
    "circle so large that it is a line": ("param float r = 0.3; " + UNIT + "shader float main(float2 x) { [Disc] if (length(x - float2(0.0, -1e4)) < r + 1e4) return 1.0; return 0.0; }",
                                          2.0, 2.6 - 1 / 3e4),
    "larger still": ("param float r = 0.3; " + UNIT + "shader float main(float2 x) { [Disc] if (length(x - float2(-1e6, 0.0)) < r + 1e6) return 1.0; return 0.0; }",
                     2.0, 2.6),
    "a dot": ("param float r = 0.23; param float a = 0.37; [Domain(0.0, 1.0)] shader float main(float2 x) { [Disc] if (length(x - float2(a, 0.61)) < 1e-3 * r) return 1.0; return 0.0; }",
              2 * math.pi * 0.23e-6, math.pi * 0.23e-3 ** 2),
}


def random_condition(r):
    """A boundary function of x and the parameters p, q, and rounding of its own."""
    shape = r.choice(["length(x - c) - 0.3 * (1.0 + q)", "dot(x - c, x - c) - 0.1 * q", "x.y - 0.3 * sin(3.0 * x.x + p) - 0.2 * q",
                      "max(abs(x.x - c.x) - 0.3, abs(x.y - c.y) - 0.2 * (1.0 + q))", "x.x * x.y - 0.1 * q", "x.x + 0.37 * x.y - 0.3 * p", "exp(x.x - c.x) - 1.0 - x.y * q"])
    spoil = r.choice(["{}", "{}", "1e-3 * ({})", "({}) + 100.0 - 100.0", "({}) * 7.0 + 1e4 - 1e4", "tanh({})", "(1.0 + ({})) * (1.0 + ({})) - 1.0"])
    return spoil.replace("{}", shape)


def random_shade(r):
    return r.choice(["1.0", "q", "1.0 + x.x * p", "exp(-3.0 * dot(x - c, x - c))", "sin(5.0 * x.y + q) + 2.0"])


def random_program(r):
    body = "float2 c = float2(p, %.3f); float f = %s; " % (r.uniform(-0.4, 0.4), random_shade(r))
    for _ in range(r.randint(1, 2)):
        body += "[Disc] if (%s < 0.0) f %s %s; " % (random_condition(r), r.choice(["=", "+=", "*="]), random_shade(r))
    return "param float p = %.4f; param float q = %.4f; %sshader float main(float2 x) { %sreturn f; }" % (r.uniform(-0.3, 0.3), r.uniform(0.3, 1.2), UNIT, body)


class Single(Case):
    def grad(self, source, *args):
        self.put("p.salt", source)
        j = self.json_cli("grad", "p.salt", "--integral", "--threads", "1", "--quiet", *args)
        j["gradient"]["integral"], j["stderr"]["integral"] = j["integral"][0], j["integral_stderr"][0]
        return j

    def test_g_that_rounds(self):
        for name, (source, r, integral) in ROUNDED.items():
            with self.subTest(name):
                j = self.grad(source)
                for of, true in (("r", r), ("integral", integral)):
                    self.assertLess(abs(j["gradient"][of] - true), 4 * j["stderr"][of] + 1e-6 * abs(true), of)
                self.assertLess(j["stderr"]["r"], 0.2 * abs(r))
                if "a" in j["gradient"]:  # by symmetry
                    self.assertLess(abs(j["gradient"]["a"]), 4 * j["stderr"]["a"])

    def test_random_programs(self):
        r, off = random.Random(20), []
        for k in range(40):
            source = random_program(r)
            j, true = self.grad(source), self.grad(source, "--precision", "f64")
            largest = max(abs(v) for v in true["gradient"].values())
            for name, v in true["gradient"].items():
                got, bar = j["gradient"][name], j["stderr"][name]
                if abs(got - v) > 4 * (bar + true["stderr"][name]) + 1e-7 * largest and not j["warnings"]:
                    off.append("%d: %s %.9g +- %.2g, %.9g in f64\n%s" % (k, name, got, bar, v, source))
        self.assertLessEqual(len(off), 1, "\n".join(off))


if __name__ == "__main__":
    unittest.main()
