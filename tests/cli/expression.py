"""An expression of one operation a line (the models of Fidget, https://www.mattkeeter.com/projects/prospero) as a shader.

    _0 const 2.95        _1 var-x        _2 add _0 _1        _3 max _1 _2

Inside where the last line is negative: 1 there, else 0. Its place moves with `scale` and `shift`. From the shell: expression.py IN.vm > OUT.salt
"""
import sys

BINARY = {"add": "{} + {}", "sub": "{} - {}", "mul": "{} * {}", "div": "{} / {}", "min": "min({}, {})", "max": "max({}, {})"}
UNARY = {"neg": "-{}", "square": "{0} * {0}", "sqrt": "sqrt({})", "abs": "abs({})"}
HEAD = """param float scale = 1.0;
param float2 shift = float2(0.0, 0.0);
[Domain(-1.0, 1.0)]
shader float main(float2 p) {
  float2 q = p * scale + shift;
"""
TAIL = """  float inside = 0.0;
  [Disc] if (%s < 0.0) inside = 1.0;
  return inside;
}
"""


def value(op, arguments):
    if op == "const":
        return "float(%r)" % float(arguments[0])
    if op in ("var-x", "var-y"):
        return "q." + op[-1]
    return (BINARY[op] if op in BINARY else UNARY[op]).format(*("v" + a for a in arguments))


def shader(text):
    lines = [line.split() for line in text.splitlines() if line.strip() and not line.startswith("#")]
    body = ["  float v%s = %s;\n" % (name, value(op, arguments)) for name, op, *arguments in lines]
    return HEAD + "".join(body) + TAIL % ("v" + lines[-1][0])


if __name__ == "__main__":
    with open(sys.argv[1]) as source:
        sys.stdout.write(shader(source.read()))
