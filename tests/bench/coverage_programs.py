"""The programs that coverage.py measures: a source, its parameters, and the exact gradient of its integral as a function
of them. Closed forms; where there is only an integral over a boundary, a fine midpoint rule along it."""
from math import acos, asin, cos, exp, floor, gamma, hypot, log, pi, sin, sqrt

PROGRAMS = []
SQUARE = [(-1, -1), (1, -1), (1, 1), (-1, 1)]


class Program:
    def __init__(self, group, name, source, params, truth, options=(), moves=1.0, adjoint=None):
        self.group, self.name, self.source, self.params, self.truth = group, name, source, params, truth
        self.options, self.moves, self.adjoint, self.heights = list(options), moves, adjoint, None


def add(group, name, body, params, truth, domain=(-1.0, 1.0), dim=2, **more):
    """body: statements; params: name -> float or tuple. truth(**params) -> the gradient in the same shape."""
    head = "".join("param float%s %s = %s;\n" % (
        len(v) if isinstance(v, tuple) else "", k, "float%d%r" % (len(v), v) if isinstance(v, tuple) else v)
        for k, v in params.items())
    kind = "float" if dim == 1 else "float%d" % dim
    where = "[Domain(%s, %s)]\n" % domain
    PROGRAMS.append(Program(group, name, "%s%sshader float main(%s x) {\n    %s\n}\n" % (head, where, kind, body), params,
                            truth, **more))


def if_(test, inside="1.0", outside="0.0"):
    return "[Disc] if (%s) return %s; return %s;" % (test, inside, outside)


def midpoints(f, a, b, n=20000):
    h = (b - a) / n
    return h * sum(f(a + (i + 0.5) * h) for i in range(n))


def clipped(polygon, n, t):
    """The part of a convex polygon where n.x < t."""
    out = []
    for p, q in zip(polygon, polygon[1:] + polygon[:1]):
        a, b = n[0] * p[0] + n[1] * p[1] - t, n[0] * q[0] + n[1] * q[1] - t
        if a < 0:
            out.append(p)
        if (a < 0) != (b < 0):
            s = a / (a - b)
            out.append((p[0] + s * (q[0] - p[0]), p[1] + s * (q[1] - p[1])))
    return out


def moments(polygon):
    """Area, and the integrals of x and of y."""
    area = mx = my = 0
    for p, q in zip(polygon, polygon[1:] + polygon[:1]):
        c = p[0] * q[1] - q[0] * p[1]
        area, mx, my = area + c / 2, mx + c * (p[0] + q[0]) / 6, my + c * (p[1] + q[1]) / 6
    return area, mx, my


def differ(f, h=1e-4):
    """The derivative of f at 0, where f is a polynomial of degree four or less, or as good as that."""
    return (8 * (f(h) - f(-h)) - (f(2 * h) - f(-2 * h))) / (12 * h)


def gradient_of(value, shape):
    """Of value(**params) with scalars and pairs, by differences that are exact to rounding."""
    out = {}
    for k, v in shape.items():
        if isinstance(v, tuple):
            out[k] = [differ(lambda e: value(**{**shape, k: tuple(c + (e if i == j else 0) for j, c in enumerate(v))}))
                      for i in range(len(v))]
        else:
            out[k] = differ(lambda e: value(**{**shape, k: v + e}))
    return out


def by_value(value):
    return lambda **p: gradient_of(value, p)


# ---- 1D
add("1D", "edge", if_("x < p", "1.0 + x * x"), {"p": 0.37}, lambda p: {"p": 1 + p * p}, (0.0, 1.0), 1)
add("1D", "square", if_("x * x < p"), {"p": 0.29}, lambda p: {"p": 0.5 / sqrt(p)}, (0.0, 1.0), 1)
add("1D", "slab", if_("abs(x - c) < w", "exp(x)"), {"c": 0.52, "w": 0.13},
    lambda c, w: {"c": exp(c + w) - exp(c - w), "w": exp(c + w) + exp(c - w)}, (0.0, 1.0), 1)
add("1D", "two sides", if_("x < p", "sin(a * x)", "cos(a * x)"), {"p": 0.61, "a": 2.3}, lambda p, a: {
    "p": sin(a * p) - cos(a * p),
    "a": p * sin(a * p) / a + (cos(a * p) - 1) / a ** 2 + (cos(a) - p * cos(a * p)) / a - (sin(a) - sin(a * p)) / a ** 2}, (0.0, 1.0), 1)
add("1D", "floor", "[Disc] float k = floor(s * x); return k;", {"s": 5.4},
    lambda s: {"s": sum(k / s ** 2 for k in range(1, floor(s) + 1))}, (0.0, 1.0), 1, moves=0.02)
add("1D", "cubic", if_("x * x * x + x < p"), {"p": 0.9}, by_value(lambda p: cubic_root(p)), (0.0, 1.0), 1)
add("1D", "steep", if_("x < c", "exp(20.0 * (x - c))"), {"c": 0.44}, lambda c: {"c": exp(-20 * c)}, (0.0, 1.0), 1)
add("1D", "waves", if_("sin(31.0 * x + q) < s"), {"s": 0.3, "q": 0.2}, by_value(
    lambda s, q: sum(max(0, min(1, (2 * pi * n + asin(s) - q) / 31) - max(0, (2 * pi * n - pi - asin(s) - q) / 31))
                     for n in range(-1, 8))), (0.0, 1.0), 1, moves=0.1)


def cubic_root(p):
    x = 0.5
    for _ in range(60):
        x -= (x ** 3 + x - p) / (3 * x * x + 1)
    return x


# ---- 2D, curved
def disc(inside="1.0", r="r", at="float2(0.013, 0.027)"):
    return if_("length(x - %s) < %s" % (at, r), inside)


add("2D curved", "disc", disc(), {"r": 0.4}, lambda r: {"r": 2 * pi * r})
add("2D curved", "small disc", disc(), {"r": 0.06}, lambda r: {"r": 2 * pi * r})
add("2D curved", "shaded disc", disc("1.0 + x.x", at="c"), {"r": 0.33, "c": (0.1, -0.2)},
    lambda r, c: {"r": 2 * pi * r * (1 + c[0]), "c": [pi * r * r, 0]})
add("2D curved", "ellipse", if_("x.x * x.x / (a * a) + x.y * x.y / (b * b) < 1.0"), {"a": 0.8, "b": 0.3},
    lambda a, b: {"a": pi * b, "b": pi * a})
add("2D curved", "disc over the border", disc(at="c"), {"r": 0.4, "c": (0.8, 0.1)},
    lambda r, c: {"r": 2 * (pi - acos((1 - c[0]) / r)) * r, "c": [-2 * sqrt(r * r - (1 - c[0]) ** 2), 0]})
add("2D curved", "parabola", if_("x.y < a + b * x.x * x.x"), {"a": -0.3, "b": 0.5}, lambda a, b: {"a": 2, "b": 2 / 3})
add("2D curved", "sine", if_("x.y < a * sin(5.0 * x.x) + b"), {"a": 0.3, "b": 0.1}, lambda a, b: {"a": 0, "b": 2})
add("2D curved", "two discs", "[Disc] if (length(x - float2(0.2, 0.1)) < r) return 2.0; [Disc] if (length(x) < q) return 1.0; return 0.0;",
    {"r": 0.3, "q": 0.35}, lambda r, q: two_discs(r, q))
add("2D curved", "superellipse", if_("pow(abs(x.x), 4.0) + pow(abs(x.y), 4.0) < r * r * r * r"), {"r": 0.7},
    lambda r: {"r": 8 * gamma(1.25) ** 2 / gamma(1.5) * r})
add("2D curved", "flower", if_("length(x) < r * (1.0 + 0.2 * sin(5.0 * atan2(x.y, x.x)))"), {"r": 0.5},
    lambda r: {"r": 2.04 * pi * r})
add("2D curved", "gaussian disc", disc("exp(-k * dot(x - float2(0.013, 0.027), x - float2(0.013, 0.027)))"), {"r": 0.5, "k": 2.0}, lambda r, k: {
    "r": 2 * pi * r * exp(-k * r * r), "k": pi * (r * r * exp(-k * r * r) / k - (1 - exp(-k * r * r)) / k ** 2)})
add("2D curved", "wide ring", if_("abs(length(x) - r) < w"), {"r": 0.5, "w": 0.15},
    lambda r, w: {"r": 4 * pi * w, "w": 4 * pi * r})


def two_discs(r, q):
    d = hypot(0.2, 0.1)  # the larger circle about 0 is behind the other
    hidden = acos((q * q + d * d - r * r) / (2 * q * d))
    own = acos((r * r + d * d - q * q) / (2 * r * d))
    return {"q": 2 * (pi - hidden) * q, "r": 2 * own * r * 1 + 2 * (pi - own) * r * 2}


# ---- straight edges
def half_plane(slope, group="straight", **more):
    size = hypot(1, slope)
    n = (-slope / size, 1 / size)
    add(group, "slope %.4g" % slope, if_("dot(n, x) < t"), {"n": n, "t": 0.07},
        by_value(lambda n, t: moments(clipped(SQUARE, n, t))[0]), **more)


for slope in (0, 0.25, 1 / 3, 0.5, 0.75, 1, 2):
    half_plane(slope)
add("straight", "box", if_("abs(x.x - 0.1) < w.x && abs(x.y) < w.y"), {"w": (0.45, 0.31)},
    lambda w: {"w": [4 * w[1], 4 * w[0]]})
add("straight", "box at 45", if_("abs(x.x - 0.1) + abs(x.y) < r"), {"r": 0.6}, lambda r: {"r": 4 * r})
add("straight", "square distance", if_("max(abs(x.x - 0.1), abs(x.y)) < r"), {"r": 0.613}, lambda r: {"r": 8 * r})
add("straight", "triangle", if_("x.y > a && x.y < 0.5 + x.x && x.y < 0.5 - x.x"), {"a": -0.37}, lambda a: {"a": -2 * (0.5 - a)})
add("straight", "hexagon", if_("max(abs(x.y), 0.8660254 * abs(x.x) + 0.5 * abs(x.y)) < r"), {"r": 0.5},
    lambda r: {"r": 4 * sqrt(3) * r})
add("straight", "edge with steep shading", if_("x.x < p", "1.0 + exp(40.0 * (x.x - p))"), {"p": 0.23}, lambda p: {"p": 2})
add("straight", "short edge", if_("x.x < p && abs(x.y - 0.31) < 0.083"), {"p": 0.23}, lambda p: {"p": 0.166})
add("straight", "bars", "float f = 0.0; for (int i = 0; i < 9; i++) { [Disc] if (abs(x.x + 0.3 * x.y - 0.2 * i + 0.8) < w) f = 1.0 + 0.1 * i; } return f;",
    {"w": 0.06}, by_value(lambda w: sum((1 + 0.1 * i) * (moments(clipped(SQUARE, (1, 0.3), 0.2 * i - 0.8 + w))[0] - moments(
        clipped(SQUARE, (1, 0.3), 0.2 * i - 0.8 - w))[0]) for i in range(9))), moves=0.1)

# ---- 3D
add("3D", "sphere", if_("length(x) < r"), {"r": 0.6}, lambda r: {"r": 4 * pi * r * r}, dim=3)
add("3D", "shaded sphere", if_("length(x - c) < r", "1.0 + x.z"), {"r": 0.5, "c": (0.1, 0.02, 0.2)},
    lambda r, c: {"r": 4 * pi * r * r * (1 + c[2]), "c": [0, 0, 4 / 3 * pi * r ** 3]}, dim=3)
add("3D", "box", if_("abs(x.x) < w.x && abs(x.y) < w.y && abs(x.z) < w.z"), {"w": (0.5, 0.41, 0.33)},
    lambda w: {"w": [8 * w[1] * w[2], 8 * w[0] * w[2], 8 * w[0] * w[1]]}, dim=3)
add("3D", "box by maxima", "float3 d = abs(x) - w; " + if_("max(d.x, max(d.y, d.z)) < 0.0"), {"w": (0.4, 0.5, 0.3)},
    lambda w: {"w": [8 * w[1] * w[2], 8 * w[0] * w[2], 8 * w[0] * w[1]]}, dim=3)
add("3D", "plane", if_("x.x + 0.5 * x.y + 0.25 * x.z < t"), {"t": 0.05}, lambda t: {"t": 4}, dim=3)
add("3D", "cylinder", if_("length(x.xy) < r && abs(x.z) < h"), {"r": 0.5, "h": 0.4},
    lambda r, h: {"r": 4 * pi * r * h, "h": 2 * pi * r * r}, dim=3)
add("3D", "ellipsoid", if_("dot(x / a, x / a) < 1.0"), {"a": (0.7, 0.5, 0.3)},
    lambda a: {"a": [4 / 3 * pi * a[1] * a[2], 4 / 3 * pi * a[0] * a[2], 4 / 3 * pi * a[0] * a[1]]}, dim=3)
add("3D", "octahedron", if_("abs(x.x) + abs(x.y) + abs(x.z) < r"), {"r": 0.8}, lambda r: {"r": 4 * r * r}, dim=3)

# ---- thin
RING = if_("abs(length(x - float2(0.123, 0.05)) - r) < w")
for w in (1e-2, 1e-3, 1e-4):
    add("thin", "ring %g" % w, RING, {"r": 0.4, "w": w}, lambda r, w: {"r": 4 * pi * w, "w": 4 * pi * r})
add("thin", "band", if_("length(x) > r && length(x) < r + w"), {"r": 0.4, "w": 0.002},
    lambda r, w: {"r": 2 * pi * w, "w": 2 * pi * (r + w)})
add("thin", "hairs", "float f = 0.0; for (int i = 0; i < 90; i++) { float a = 0.07 * i; [Disc] if (abs(x.x * cos(a) + x.y * sin(a) - 0.02 * (i % 7)) < w) f += 1.0; } return f;",
    {"w": 4e-4}, by_value(lambda w: sum(moments(clipped(SQUARE, (cos(0.07 * i), sin(0.07 * i)), 0.02 * (i % 7) + w))[0] - moments(
        clipped(SQUARE, (cos(0.07 * i), sin(0.07 * i)), 0.02 * (i % 7) - w))[0] for i in range(90))), moves=0.1)
MANY = "float f = 0.0; for (int i = 0; i < 10; i++) { for (int j = 0; j < 10; j++) { [Disc] if (length(x - float2(0.05 + 0.1 * i, 0.0513 + 0.1 * j)) < r) f = 1.0; } } return f;"
add("thin", "100 discs of 0.002", MANY, {"r": 0.002}, lambda r: {"r": 200 * pi * r}, (0.0, 1.0), moves=0.3)
add("thin", "100 discs of 0.0005", MANY, {"r": 0.0005}, lambda r: {"r": 200 * pi * r}, (0.0, 1.0), moves=0.3)
add("thin", "iterated frac", "float u = x.x; for (int i = 0; i < 9; i++) { [Disc] u = frac(2.0 * u); } " + if_("u < p", "1.0 + x.y"),
    {"p": 0.3}, lambda p: {"p": 1.5}, (0.0, 1.0))
add("thin", "steps of an edge", "float y = x.y; for (int i = 1; i < 11; i++) { float s = exp2(1.0 * i); y += 0.4 / s * abs(frac(s * x.x) - 0.5); } " + if_("y < p"),
    {"p": 0.7}, lambda p: {"p": 1}, (0.0, 1.0), moves=0.1)

# ---- rand()
add("random", "radius", if_("length(x - 0.3 * (rand2() - 0.5)) < r + 0.1 * rand()"), {"r": 0.4},
    lambda r: {"r": 2 * pi * (r + 0.05)})
add("random", "ramp of chance", if_("rand() < p + 0.1 * x.x"), {"p": 0.3}, lambda p: {"p": 4})
add("random", "soft edge", if_("x.x + rand() < p"), {"p": 0.3}, by_value(lambda p: 2 * (p + 0.5)))
add("random", "smooth", "return rand() * a * (1.0 + x.x * x.x);", {"a": 0.7}, lambda a: {"a": 0.5 * 16 / 3})
add("random", "smooth of many", "float s = 0.0; for (int i = 0; i < 4; i++) { s += rand() * rand(); } return exp(a * s) * 0.1;", {"a": 0.5},
    lambda a: {"a": 0.4 * 4 * random_product(a) ** 3 * random_slope(a)})
add("random", "blurred disc", disc("1.0 + x.x", at="0.2 * rand2()"), {"r": 0.4}, lambda r: {"r": 2 * pi * r * 1.1})
add("random", "line", if_("x < p + 0.1 * rand()"), {"p": 0.37}, lambda p: {"p": 1}, (0.0, 1.0), 1)
add("random", "line of two", if_("x < p * rand() + 0.1 * rand()"), {"p": 0.37}, lambda p: {"p": 0.5}, (0.0, 1.0), 1)
add("random", "edge and light", if_("x.y < p * x.x", "a * rand() * rand()", "a * rand()"), {"p": 0.3, "a": 1.3},
    lambda p, a: {"p": 0, "a": 2 * 0.25 + 2 * 0.5})


def random_product(a):
    return sum(a ** k / gamma(k + 1) / (k + 1) ** 2 for k in range(40))


def random_slope(a):
    return sum(k * a ** (k - 1) / gamma(k + 1) / (k + 1) ** 2 for k in range(1, 40))


# ---- terrain
def heights(n, f):
    return [[f(i / (n - 1), j / (n - 1)) for i in range(n)] for j in range(n)]


def terrain(name, n, f, params, body, truth=None):
    """No truth: that is a long run by the lattice."""
    PROGRAMS.append(Program("terrain", name, "import camera;\n[NoDiff] param heightfield h = zeros(%d, %d);\n%s%s" % (
        n, n, "".join("param float%s %s = %s;\n" % ("3" if isinstance(v, tuple) else "", k, "float3%r" % (v,) if isinstance(v, tuple) else v)
                      for k, v in params.items()), body), params, truth, ["--param", "h=@heights.pfm"], 0.0))
    PROGRAMS[-1].heights = heights(n, f)


def hull(points):
    out = []
    for chain in (sorted(points), sorted(points)[::-1]):
        start = len(out)
        for p in chain:
            while len(out) > start + 1 and (out[-1][0] - out[-2][0]) * (p[1] - out[-2][1]) <= (out[-1][1] - out[-2][1]) * (p[0] - out[-2][0]):
                out.pop()
            out.append(p)
        out.pop()
    return out


def post_shadow(sun, at=(2 / 8, 3 / 8), tall=0.2, cell=1 / 8, raised=0.004):
    """A post of one texel on flat ground: its foot, cut at the height of the origins, and the shadow of its tip."""
    part, run = (tall - raised) / tall * cell, (tall - raised) / sun[2]
    foot = [(at[0] + part * i, at[1] + part * j) for i, j in ((1, 0), (0, 1), (-1, 1), (-1, 0), (0, -1), (1, -1))]
    return moments(hull(foot + [(at[0] - run * sun[0], at[1] - run * sun[1])]))[0]


def bumps(x, y):
    return 0.06 + 0.05 * sin(7 * x + 2 * y) * cos(5 * y - x) + 0.03 * sin(13 * x - 4 * y)


CAST = """shader float main(float2 x) {
    [Disc] if (h.occluded(float3(x, %s), sun, 0.0, 1e9)) return 0.0;
    return light;
}
"""
terrain("post", 9, lambda x, y: 0.2 if (round(8 * x), round(8 * y)) == (2, 3) else 0.0, {"sun": (-0.5, -0.2, 0.3), "light": 1.0}, CAST % "0.004",
        lambda sun, light: {"sun": [-light * g for g in gradient_of(lambda x, y, z: post_shadow((x, y, z)), dict(zip("xyz", sun))).values()],
                            "light": 1 - post_shadow(sun)})
terrain("shadows", 33, bumps, {"sun": (0.6, 0.3, 0.12), "light": 1.0}, CAST % "h.height(x) + 0.002")
terrain("view", 33, bumps, {"eye": (0.4, -0.7, 0.45), "sky": 0.8}, """[Domain(-1.0, 1.0)]
shader float main(float2 x) {
    Camera c = look_at(eye, float3(0.5, 0.5, 0.1), float3(0.0, 0.0, 1.0));
    [Disc] Hit v = h.trace(c.eye, camera_ray(c, x, 0.8), 0.0, 1e9);
    if (!v.hit) return sky;
    return 0.1 + 0.5 * max(v.normal.x, 0.0);
}
""")



def rough(x, y):
    """Noise from sample to sample, the same in every run."""
    return 0.05 * (round(4096 * x) * 7919 + round(4096 * y) * 104729 % 8191 * 31 % 1009) % 97 / 97


def spikes(x, y):
    return 0.03 + (0.3 if round(32 * x) % 7 == 3 and round(32 * y) % 5 == 2 else 0.0)


VIEW = """[Domain(-1.0, 1.0)]
shader float main(float2 x) {
    Camera c = look_at(eye, float3(0.5, 0.5, 0.1), float3(0.0, 0.0, 1.0));
    [Disc] Hit v = h.trace(c.eye, camera_ray(c, x, 0.8), 0.0, 1e9);
    if (!v.hit) return sky;
    float light = 0.1 + 0.5 * max(v.normal.x, 0.0);
%s    return light;
}
"""
terrain("rough shadows", 33, rough, {"sun": (0.6, 0.3, 0.12), "light": 1.0}, CAST % "h.height(x) + 0.002")
terrain("spike shadows", 33, spikes, {"sun": (-0.5, -0.23, 0.2), "light": 1.0}, CAST % "h.height(x) + 0.002")
terrain("clearance", 33, bumps, {"sun": (0.6, 0.3, 0.12), "light": 1.0}, """shader float main(float2 x) {
    [Disc] if (h.clearance(float3(x, h.height(x) + 0.002), sun, 0.05, 1e9) < 0.0) return 0.0;
    return light;
}
""")
terrain("view of spikes", 33, spikes, {"eye": (0.4, -0.7, 0.45), "sky": 0.8}, VIEW % "")
terrain("view of rough ground", 33, rough, {"eye": (0.4, -0.7, 0.25), "sky": 0.8}, VIEW % "")
terrain("view with shadows", 33, bumps, {"eye": (0.4, -0.7, 0.45), "sun": (0.6, 0.3, 0.2), "sky": 0.8},
        VIEW % "    [Disc] if (h.occluded(float3(v.p, h.height(v.p) + 0.002), sun, 0.0, 1e9)) light *= 0.3;\n")

# ---- images: the gradient of the sum of adjoint * image
def image(name, body, params, weighted, size=64, **more):
    """weighted(adjoint, **params): the exact gradient, where adjoint(x, y) is constant in each pixel."""
    def truth(**p):
        return weighted(lambda x, y: pixel_adjoint(x, y, size) * size * size / 4, **p)
    add("images", name, body, params, truth, adjoint=size, options=["--size", size, *more.pop("options", [])], **more)


def pixel_adjoint(x, y, size):
    i, j = min(size - 1, int((x + 1) / 2 * size)), min(size - 1, int((y + 1) / 2 * size))
    return 1 + 0.5 * cos(0.31 * i + 0.17 * j)


def on_circle(f, r, c=(0.013, 0.027), size=64):
    """The integral of f along a circle: three points of Gauss between the lines of pixels."""
    cuts = {0, 2 * pi}
    for i in range(1, size):
        for d, turn in ((0, 0), (1, pi / 2)):
            u = (-1 + 2 * i / size - c[d]) / r
            if abs(u) < 1:
                cuts |= {(turn + acos(u)) % (2 * pi), (turn - acos(u)) % (2 * pi)}
    cuts, total = sorted(cuts), 0
    for lo, hi in zip(cuts, cuts[1:]):
        for at, weight in ((0, 8), (-sqrt(0.6), 5), (sqrt(0.6), 5)):
            t = (lo + hi) / 2 + at * (hi - lo) / 2
            total += weight / 18 * (hi - lo) * r * f(c[0] + r * cos(t), c[1] + r * sin(t))
    return total


def between(f, cuts=(), size=64):
    """The integral from -1 to 1 of f, constant between rows of pixels and cuts."""
    cuts = sorted({-1 + 2 * i / size for i in range(size + 1)} | {c for c in cuts if -1 < c < 1})
    return sum((hi - lo) * f((lo + hi) / 2) for lo, hi in zip(cuts, cuts[1:]))


image("disc", disc(), {"r": 0.4}, lambda a, r: {"r": on_circle(a, r)})
image("disc, 16 samples", disc(), {"r": 0.4}, lambda a, r: {"r": on_circle(a, r)}, options=["--spp", 16])
image("half plane", if_("x.y < t"), {"t": 0.07}, lambda a, t: {"t": between(lambda x: a(x, t))})
image("oblique", if_("x.x + 0.5 * x.y < t"), {"t": 0.07}, lambda a, t: {"t": between(lambda y: a(t - 0.5 * y, y), [2 * (t - 1 + 2 * i / 64) for i in range(64)])})
image("box", if_("abs(x.x) < w && abs(x.y) < 0.31"), {"w": 0.413},
      lambda a, w: {"w": midpoints(lambda y: a(w, y) + a(-w, y), -0.31, 0.31, 100000)})
image("shaded", disc("1.0 + k * x.x"), {"r": 0.4, "k": 0.7}, lambda a, r, k: {
    "r": on_circle(lambda x, y: a(x, y) * (1 + k * x), r), "k": shaded_k(a, r)})
image("thin ring", if_("abs(length(x) - r) < w"), {"r": 0.4, "w": 0.004}, lambda a, r, w: {
    "r": on_circle(a, r + w, (0, 0)) - on_circle(a, r - w, (0, 0)), "w": on_circle(a, r + w, (0, 0)) + on_circle(a, r - w, (0, 0))})
image("random radius", disc(r="r + 0.1 * rand()"), {"r": 0.4}, lambda a, r: {
    "r": midpoints(lambda u: midpoints(lambda t: (r + 0.1 * u) * a(0.013 + (r + 0.1 * u) * cos(t), 0.027 + (r + 0.1 * u) * sin(t)), 0, 2 * pi, 1000), 0, 1, 100)})


def shaded_k(a, r, size=64):
    """The integral of a * x over the disc, row by row of pixels: a is constant in each pixel."""
    def row(y):
        half = sqrt(max(0, r * r - (y - 0.027) ** 2))
        lo, hi, total = 0.013 - half, 0.013 + half, 0
        for i in range(size):
            u, v = max(lo, -1 + 2 * i / size), min(hi, -1 + 2 * (i + 1) / size)
            if u < v:
                total += a(-1 + 2 * (i + 0.5) / size, y) * (v * v - u * u) / 2
        return total
    return midpoints(row, 0.027 - r, 0.027 + r, 10000)
