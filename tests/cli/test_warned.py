"""Nothing silent, nothing for nothing: programs whose derivative lacks the motion of a jump are warned about, those that are continuous are not."""
import math

from harness import *

HEAD = "param float p = 0.4; param float q = 0.3; param float w[6] = {0.2, 0.3, 0.5, 0.1, 0.7, 0.4};\n[Domain(-1.0, 1.0)]\nshader float main(float2 x) {\n"

# Jumps that decisions make.
DECISIONS = {
    "stipple": "if (rand() < p) return 1.0; return 0.0;",
    "stipple_int": "int i = int(rand() * 8.0 * p); return 1.0 * i;",
    "stipple_select": "return select(rand() < p, x.x * x.x, 0.0);",
    "stipple_step": "return step(rand(), p) * x.y * x.y;",
    "stipple_floor": "return floor(3.0 * rand() + p);",
    "stipple_vector": "float2 u = rand2(); return u.x + u.y < p ? 1.0 : 0.0;",
    "stipple_sign": "return sign(rand() - p);",
    "choice_of_light": "float u = rand(); float c = 0.0; int k = 2; for (int i = 0; i < 3; i++) { c += w[i]; if (u < c) { k = i; break; } } return 1.0 * k * k;",
    "rejection": "float2 u = float2(0.0); for (int i = 0; i < 16; i++) { u = 2.0 * rand2() - 1.0; if (dot(u, u) < p * p) break; } return dot(u, u);",
    "roulette": "float t = 1.0; for (int i = 0; i < 8; i++) { if (rand() > p) break; t += 1.0; } return t;",
    "roulette_weighed": "float t = 1.0; for (int i = 0; i < 6; i++) { if (rand() > p) break; t += 1.0 / q; } return t;",
    "rarely_shown": "float u = rand(), v = rand(); float f = x.x < p ? 1.0 : 0.0; return v > 0.9 ? f : u;",
    "both": "if (rand() * x.x < p) return 1.0; return 0.0;",
    "isnan": "float v = sqrt(p - length(x)); return isnan(v) ? 0.0 : 1.0;",
    "isinf": "float v = exp(1000.0 * (x.x - p)); return isinf(v) ? 1.0 : 0.0;",
    "isfinite": "float v = log(x.x - p); return isfinite(v) ? 1.0 : 0.0;",
    "isnan_if": "if (isnan(acos(x.x + q))) return x.y; return 2.0;",
    "disc": "return length(x) < p ? 1.0 : 0.0;",
    "disc_if": "if (length(x) < p) return x.x + 2.0; return q;",
    "stripes": "return floor(4.0 * x.x + p) * q;",
    "saw": "return frac(4.0 * x.x + p);",
    "index": "return w[int(1.5 * (x.x + 1.0 + 0.1 * p))];",
    "checker": "int i = int(floor(4.0 * (x.x + p))) + int(floor(4.0 * x.y)); return (i & 1) == 0 ? 1.0 : 0.0;",
    "angle": "return atan2(x.y - p, x.x - q);",
    "sign": "return sign(x.x - p) * (1.0 + x.y);",
    "step": "return step(p, x.x) * x.y * x.y;",
    "steps_of_two": "float d = x.x - p; return (d > 0.0 ? 1.0 : 0.0) + (d < 0.0 ? 0.5 : 0.0);",
    "small": "float d = x.x - p; return 10.0 + (d > 0.0 ? 0.01 : 0.0);",
    "slope_too": "float d = x.x - p; return d > 0.0 ? 1.0 + d * d : 0.5 * d;",
    "hidden_mostly": "float f = x.x < p ? 1.0 : 0.0; return x.y > 0.8 ? f : 0.0;",
    "zero_now": "float d = x.x - p; return d > 0.0 ? q - 0.3 : 0.0;",
    "early_out": "for (int i = 0; i < 3; i++) if (length(x - 0.3 * i) < w[i]) return 1.0 + i; return 0.0;",
    "minimum": "float best = 1e9; int k = 0; for (int i = 0; i < 3; i++) { float d = length(x - w[i] * i); if (d < best) { best = d; k = i; } } return 1.0 * k;",
    "huber_wrong": "float a = abs(x.x - p); return a < 0.1 ? 0.5 * a * a : 0.1 * a;",
    "round": "return round(3.0 * x.x + p);",
    "fmod": "return fmod(x.x + 2.0 + p, 0.5);",
    "table_mod5": "float t = 3.0 * (x.x + 1.0) + p; int k = int(floor(t)); float f = t - float(k); return lerp(w[k % 6], w[(k + 1) % 5], f);",
    "table_wrap_forgot": "float t = 6.0 * frac(x.y + p); int k = int(t); return lerp(w[k], w[min(k + 1, 5)], t - float(k));",
    "noise_linear_bug": "float v = 4.0 * (x.x + 2.0 + p); float i = floor(v), f = v - i; return lerp(sin(7.0 * i), sin(7.0 * (i + 2.0)), f);",
    "worley_1cell": "float2 v = 3.0 * x + p; float2 i = floor(v); float2 o = 0.5 + 0.4 * sin(float2(12.0 * i.x + 7.0 * i.y, 5.0 * i.x + 11.0 * i.y)); return length(v - i - o);",
    "gauss_cut_small": "float2 d = x - float2(p, q); float r = dot(d, d); return r < 0.25 ? exp(-20.0 * r) : 0.0;",
    "angle_half": "float a = atan2(x.y - p, x.x - q); return sin(0.5 * a) * (1.0 + x.x);",
    "tagged_plus_slope": "[Disc] float k = floor(3.0 * x.x + p); return k + x.y > 0.5 ? 1.0 : 0.0;",
    "tagged_plus_param_slope": "float b = 0.0; [Disc] if (length(x) < p) b = 1.0; return b * x.y + q > 0.45 ? 1.0 : 0.0;",
    "rand_second_sel": "float u = rand(), v = rand(); float f = v < 0.2 ? (length(x) < p ? 3.0 : 1.0) : u; return f;",
    "mirror_wrong": "float v = 5.0 * (x.x + p); float k = floor(v); float f = v - k; return fmod(k + 10.0, 2.0) < 0.5 ? f : 0.9 - f;",
    "corner_floor": "return floor(x.x + 0.02 * p + 0.01) == 1.0 ? 3.0 : 0.0;",
    "wide_param": "float t = 8.0 * (x.x - p); return t > 5.2 ? 1.0 : 0.0;",
    "bits": "return (asuint(p - length(x)) >> 31) == 0u ? 1.0 : 0.0;",
}

# Roundings and loops of whose many jumps few matter.
FEW = {
    "third_ring": "int k = int(50.0 * (length(x) - p)); return k == 3 ? 1.0 : 0.0;",
    "last_floor": "return saturate(floor(200.0 * (x.x - p)));",
    "innermost_rings": "return min(floor(64.0 * length(x) / p), 3.0);",
    "last_iteration": "int n = 0; for (int i = 0; i < 100; i++) { if (0.01 * i < p - length(x)) n = i; } return n >= 37 ? 1.0 : 0.0;",
    "beside_much": "float f = 1000.0 * x.x * x.x; if (x.x < p) f += 1e-3; return f;",
    "clamped_int": "int k = int(1e9 * (p - length(x))); return clamp(k, 0, 1);",
    "many_ints": "int k = int(1e4 * (p - length(x))); return k > 0 ? 1.0 : 0.0;",
    "band_y": "float f = x.x < p ? 1.0 : 0.0; return x.y > 0.985 ? f : 0.0;",
    "mod11": "int k = int(floor(300.0 * (length(x) + p))); return k % 11 == 5 && k > 150 && k < 160 ? 1.0 : 0.0;",
    "gauss_int": "float k = floor(64.0 * length(x) / p); return exp(-10.0 * (k - 3.0) * (k - 3.0));",
    "gauss_int2": "float k = floor(64.0 * length(x) / p); return exp(-10.0 * (k - 77.0) * (k - 77.0));",
    "table3": "float t[4] = {0.0, 0.0, 0.0, 1.0}; return t[clamp(int(20.0 * (p - length(x)) - 4.0), 0, 3)];",
    "square_ij": "int a = int(30.0 * x.x / p), b = int(30.0 * x.y / p); return a == 7 && b == 11 ? 1.0 : 0.0;",
    "count17": "int m = 0; [MaxIters(60)] while (0.02 * float(m) < length(x) - p) m++; return m == 17 ? 1.0 : 0.0;",
    "bits": "uint k = uint(abs(100.0 * (x.x - p))); return (k & 64u) != 0u && (k & 32u) != 0u ? 1.0 : 0.0;",
    "modfl": "return fmod(floor(128.0 * (x.x + 2.0 + p)), 64.0) == 0.0 ? 1.0 : 0.0;",
    "powfl": "return pow(saturate(floor(100.0 * (x.x - p)) * 0.01 + 0.5), 60.0);",
    "corner": "return floor(3.0 * (x.x + x.y) + p) > 5.0 ? 1.0 : 0.0;",
    "nested": "int k = int(9.0 * length(x) / p); int m = k * k - 5 * k; return m == -6 && x.x > 0.0 ? x.y : 0.0;",
    "small_jump_big_f": "float f = 1e4 * x.y; if (length(x) < p) f += 1e-2; return f;",
    "ceil_sel": "float c = ceil(40.0 * (length(x) - p)); return c > 3.0 && c < 5.0 ? 1.0 : 0.0;",
    "hash_pick": "uint k = uint(int(20.0 * (x.x + 2.0 + p))); return (hash(k) & 31u) == 3u ? 1.0 : 0.0;",
    "frac_gate": "float t = frac(40.0 * x.x + p); return t > 0.98 ? 1.0 : 0.0;",
    "argmin": "float best = 1e9; int k = 0; for (int i = 0; i < 8; i++) { float d = length(x - float2(p * cos(1.0 * i), q * sin(1.0 * i))); if (d < best) { best = d; k = i; } } return k == 6 ? 1.0 : 0.0;",
    "int_cast_scale": "int k = int(1e6 * (x.x - p)); return k > 0 ? 1.0 : 0.0;",
    "round_tie": "return round(2.0 * (x.x - p)) == 1.0 ? 2.0 : 1.0;",
    "cond_or": "bool a = x.x > p, b = x.y > 0.97; return a && b ? 1.0 : 0.0;",
    "accum": "float s = 0.0; for (int i = 0; i < 20; i++) { s += step(p + 0.05 * i, length(x)); } return s > 11.5 ? 1.0 : 0.0;",
}

# Jumps made by arithmetic, and ramps narrower than the samples: d is the signed distance of a disc.
ARITHMETIC = {
    "tanh": "float d = p - length(x); return tanh(1e6 * d);",
    "saturate_single": "float d = p - length(x); return saturate(1e9 * d);",
    "logistic": "float d = p - length(x); return 1.0 / (1.0 + exp(-1e5 * d));",
    "hill": "float v = max(p - length(x), 0.0); return v / (v + 1e-12);",
    "soft_sign": "float d = p - length(x); return d / (abs(d) + 1e-9);",
    "huge": "float d = p - length(x); return saturate(1e30 * d);",
    "quotient": "float d = p - length(x); return 0.5 + 0.5 * d / abs(d);",
    "root": "float d = p - length(x); return d / sqrt(d * d);",
    "normalize": "return normalize(float2(x.x - p, 0.0)).x;",
    "atan": "return atan(1.0 / (x.x - p));",
    "divided_by_0": "float d = p - length(x); float z = q - 0.3; return saturate(d / z);",
    "smoothstep": "return smoothstep(p, p, length(x));",
    "max_over": "float d = p - length(x); return max(d, 0.0) / d;",
    "steep_step": "return smoothstep(p, p + 1e-8, length(x));",
    "power": "return 1.0 / (1.0 + pow(length(x) / p, 1e6));",
    "gauss_edge": "float d = p - length(x); return exp(-1e10 * max(-d, 0.0) * max(-d, 0.0));",
    "atan_ramp": "return atan(1e7 * (x.x - p)) / PI;",
    "algebraic": "float d = x.x - p; return d / sqrt(d * d + 1e-14);",
    "coloured": "float d = p - length(x); return lerp(0.2 + x.x, 0.9 - x.y, saturate(1e8 * d + 0.5));",
    "square": "float2 d = abs(x) - p; return tanh(1e6 * max(d.x, d.y));",
    "moved": "return tanh(1e6 * (length(x - float2(p, q)) - 0.25));",
    "exponent": "return exp(-exp(1e5 * (x.x + x.y - p)));",
    "shaded": "float d = p - length(x); return (1.0 + x.x * x.y) * (0.5 + 0.5 * tanh(1e6 * d)) + 0.1 * sin(3.0 * x.x);",
    "narrow_bump": "float2 e = x - float2(p, q); return exp(-1e6 * dot(e, e) / (p * p));",
    "in_rand": "float u = rand(); return saturate((p - u) * 1e8);",
    "second_rand": "float u = rand(), v = rand(); return u * saturate((p - v) * 1e8);",
    "rand_in_loop": "float f = 0.0; for (int i = 0; i < 3; i++) { float u = rand() - p; if (i > 0) f += u / abs(u); } return f;",
    "quotient_in_rand": "float u = rand() - p; return 0.5 + 0.5 * u / abs(u);",
    "beside_a_disc": "float f = 0.0; [Disc] if (length(x - 0.5) < q) f = 1.0; return f + tanh(1e6 * (p - length(x)));",
}

CONTINUOUS = {
    "huber": "float d = x.x - p; float a = abs(d); if (a < 0.1) return 0.5 * d * d; return 0.1 * (a - 0.05);",
    "huber_2d": "float a = length(x) - p; return abs(a) < q ? 0.5 * a * a : q * (abs(a) - 0.5 * q);",
    "smoothstep": "float t = (x.x - p) / 0.2; if (t < 0.0) return 0.0; if (t > 1.0) return 1.0; return t * t * (3.0 - 2.0 * t);",
    "abs": "float d = x.x - p; return d < 0.0 ? -d : d;",
    "abs_if": "float d = x.x - p; if (d < 0.0) d = -d; return d;",
    "relu": "float d = p - length(x); if (d > 0.0) return d; return 0.0;",
    "leaky": "float d = p - length(x); return d > 0.0 ? d : 0.1 * d;",
    "elu": "float d = p - length(x); return d > 0.0 ? d : exp(d) - 1.0;",
    "max": "float a = x.x - p, b = x.y - q; return a > b ? a : b;",
    "clamp": "float v = 2.0 * x.x + p; if (v < 0.0) v = 0.0; if (v > 1.0) v = 1.0; return v;",
    "sort": "float a = x.x + p, b = x.y; if (a > b) { float t = a; a = b; b = t; } return a + 2.0 * b;",
    "b_spline": "float t = abs(x.x - p) / 0.3; if (t < 1.0) return 2.0 / 3.0 - t * t + 0.5 * t * t * t; if (t < 2.0) { float u = 2.0 - t; return u * u * u / 6.0; } return 0.0;",
    "catmull": "float t = abs(x.x - p) / q; if (t < 1.0) return 1.5 * t * t * t - 2.5 * t * t + 1.0; if (t < 2.0) return -0.5 * t * t * t + 2.5 * t * t - 4.0 * t + 2.0; return 0.0;",
    "hat": "float t = abs(x.x - p) / q; return t < 1.0 ? 1.0 - t : 0.0;",
    "bump": "float t = dot(x - p, x - p) / (q * q); return t < 1.0 ? (1.0 - t) * (1.0 - t) : 0.0;",
    "box": "float2 d = abs(x) - float2(p, q); if (d.x > 0.0 && d.y > 0.0) return length(d); return d.x > d.y ? d.x : d.y;",
    "box_sdf": "float2 d = abs(x) - float2(p, q); return length(max(d, 0.0)) + min(max(d.x, d.y), 0.0);",
    "capsule": "float h = x.x / p; if (h < 0.0) h = 0.0; if (h > 1.0) h = 1.0; return length(x - float2(p * h, 0.0)) - q;",
    "smooth_min": "float a = length(x) - p, b = length(x - 0.5) - q, h = 0.2 - abs(a - b); if (h > 0.0) return min(a, b) - h * h / 0.8; return min(a, b);",
    "sinc": "float t = 9.0 * (x.x - p); return abs(t) < 1e-3 ? 1.0 - t * t / 6.0 : sin(t) / t;",
    "sinc_at_0": "float t = 9.0 * (x.x - p); return t == 0.0 ? 1.0 : sin(t) / t;",
    "guarded": "float l = length(x - p); return l > 1e-6 ? l * l / l : 0.0;",
    "guarded_normal": "float2 d = x - p; float l = dot(d, d); return l > 0.0 ? d.x * d.y / sqrt(l) : 0.0;",
    "floor_and_frac": "float t = 4.0 * x.x + p; return floor(t) + frac(t);",
    "value_noise": "float t = 4.0 * (x.x + 2.0 + p); float i = floor(t), f = t - i; return lerp(sin(7.0 * i), sin(7.0 * (i + 1.0)), f * f * (3.0 - 2.0 * f));",
    "triangle": "return abs(frac(4.0 * x.x + p) - 0.5);",
    "repeated": "float t = frac(3.0 * x.x + p); return t * (1.0 - t);",
    "table": "float t = saturate(0.5 + 0.5 * x.x * p) * 2.0; int i = min(int(t), 1); return lerp(w[i], w[i + 1], t - i);",
    "angle": "return cos(atan2(x.y - p, x.x));",
    "rose": "return length(x) - p - 0.1 * sin(5.0 * atan2(x.y, x.x - q));",
    "angle_squared": "float a = atan2(x.y, x.x + p); return a * a;",
    "square_of_sign": "float d = x.x - p; return sign(d) * d;",
    "step_times_0": "float d = x.x - p; return step(0.0, d) * d * d;",
    "softplus": "float t = 8.0 * (x.x - p); return t > 20.0 ? t : log(1.0 + exp(t));",
    "log_sum": "float a = x.x - p, b = x.y - q; return a > b ? a + log(1.0 + exp(b - a)) : b + log(1.0 + exp(a - b));",
    "quintic": "float t = saturate((length(x) - p) / q); return t * t * t * (t * (6.0 * t - 15.0) + 10.0);",
    "srgb": "float v = saturate(0.5 * (x.x + 1.0) * (0.5 + p)); return v < 0.5 ? 2.0 * v * v : 1.0 - 2.0 * (1.0 - v) * (1.0 - v);",
    "fresnel": "float c = x.x - p; if (c < 0.0) { c = -c; } float s = 1.0 - c * c; return s > 0.0 ? s * s * s : 0.0;",
    "reflected": "float t = x.x + p; if (t > 1.0) t = 2.0 - t; if (t < -0.5) t = -1.0 - t; return t * t;",
    "two_guards": "float d = length(x) - p; if (d <= 0.0) return 0.0; if (d >= 0.5) return 0.25; return d * d;",
    "shading": "float3 n = normalize(float3(x * p, 1.0)); return max(dot(n, normalize(float3(0.3, q, 1.0))), 0.0);",
    "waves": "return sin(20.0 * x.x + p) * cos(17.0 * x.y * q);",
    "steep_but_seen": "return tanh(40.0 * (p - length(x)));",
    "roots": "return sqrt(max(p - length(x), 0.0));",
    "narrow_peak": "float d = x.x - p; return 1.0 / (1.0 + 400.0 * d * d);",
    "tagged": "[Disc] if (length(x) < p) return 1.0 + x.x; return 0.0;",
    "tagged_stripes": "[Disc] float k = floor(5.0 * x.x + p); return k * x.y;",
    "random": "return (rand() + p) * (rand() * x.x + q);",
    "random_fixed": "float k = rand() < 0.3 ? 1.0 : 2.0; return k * p * x.x;",
    "jump_that_stays": "float s = x.x / abs(x.x); return s * p + q * x.y;",
    "grain_that_stays": "return frac(sin(dot(floor(16.0 * x), float2(12.9898, 78.233))) * 43758.5453) * p;",
    "fbm": "float s = 0.0, a = 0.5; float2 v = 3.0 * x + p; for (int o = 0; o < 4; o++) { float2 i = floor(v); float2 f = v - i; f = f * f * (3.0 - 2.0 * f); float h00 = frac(sin(dot(i, float2(12.9898, 78.233))) * 43.5453), h10 = frac(sin(dot(i + float2(1.0, 0.0), float2(12.9898, 78.233))) * 43.5453), h01 = frac(sin(dot(i + float2(0.0, 1.0), float2(12.9898, 78.233))) * 43.5453), h11 = frac(sin(dot(i + 1.0, float2(12.9898, 78.233))) * 43.5453); s += a * lerp(lerp(h00, h10, f.x), lerp(h01, h11, f.x), f.y); a *= 0.5; v *= 2.0; } return s;",
    "noise50": "float2 v = 50.0 * x + p; float2 i = floor(v); float2 f = v - i; f = f * f * (3.0 - 2.0 * f); float a = sin(3.0 * i.x + 5.0 * i.y), b = sin(3.0 * (i.x + 1.0) + 5.0 * i.y), c = sin(3.0 * i.x + 5.0 * (i.y + 1.0)), e = sin(3.0 * (i.x + 1.0) + 5.0 * (i.y + 1.0)); return lerp(lerp(a, b, f.x), lerp(c, e, f.x), f.y);",
    "takagi": "float s = 0.0, v = x.x + p; for (int i = 0; i < 7; i++) { s += abs(frac(v) - 0.5) / pow(2.0, 1.0 * i); v *= 2.0; } return s;",
    "table_lerp": "float t = saturate(0.5 * (x.x + 1.0) + 0.1 * p) * 2.0; int i = clamp(int(t), 0, 1); return lerp(w[i], w[i + 1], t - float(i));",
    "mirror": "float v = 5.0 * (x.x + p); int k = int(floor(v)); float f = v - float(k); return (k & 1) == 0 ? f : 1.0 - f;",
    "repeat_sdf": "float2 c = frac(3.0 * x + p) - 0.5; return length(c) - 0.2 < 0.0 ? 0.0 : (length(c) - 0.2);",
    "clamped": "float v = 20.0 * (x.x - p); int k = clamp(int(floor(v)), 0, 3); return float(k) + saturate(v - float(k));",
    "cull": "float f = 0.0; if (length(x - p) < q + 0.1) { [Disc] if (length(x - p) < q) f = 1.0; } return f;",
    "cull_box": "float f = 0.0; float2 d = abs(x - float2(p, q)); if (d.x < 0.3 && d.y < 0.3) { [Disc] if (dot(d, d) < 0.04 ) f = 1.0 + x.x; } return f;",
    "culled_loop": "float f = 0.0; for (int i = 0; i < 3; i++) { float l = length(x - w[i]); if (l > 0.3) continue; f += (0.3 - l) * (0.3 - l); } return f;",
    "argmin_d": "float best = 1e9; for (int i = 0; i < 3; i++) { float d = length(x - w[i] * i); if (d < best) best = d; } return best;",
    "kaleido": "float2 y = x - p; for (int i = 0; i < 4; i++) { y = abs(y) - 0.3; if (y.x < y.y) y = y.yx; } return y.x + 2.0 * y.y;",
    "wave_abs": "float v = 6.0 * x.x + p; float k = round(v); return abs(v - k);",
    "smooth_pulse": "float t = frac(2.0 * x.x + p); return t < 0.5 ? 16.0 * t * t * (0.5 - t) * (0.5 - t) : 0.0;",
    "pieces4": "float v = 2.0 * (x.x + 1.0) * (1.0 + 0.1 * p); if (v < 1.0) return v; if (v < 2.0) return 1.0 + 2.0 * (v - 1.0); if (v < 3.0) return 3.0 - (v - 2.0); return 2.0 + 0.5 * (v - 3.0);",
    "worley": "float2 v = 2.0 * x + p; float2 i = floor(v); float best = 9.0; for (int a = -2; a < 3; a++) for (int b = -2; b < 3; b++) { float2 c = i + float2(1.0 * a, 1.0 * b); float2 o = 0.5 + 0.4 * sin(float2(12.0 * c.x + 7.0 * c.y, 5.0 * c.x + 11.0 * c.y)); best = min(best, length(v - c - o)); } return best;",
    "gradient_noise": "float v = 7.0 * (x.x + 2.0 + p); float i = floor(v), f = v - i; float g0 = sin(12.9898 * i), g1 = sin(12.9898 * (i + 1.0)); float u = f * f * f * (f * (6.0 * f - 15.0) + 10.0); return lerp(g0 * f, g1 * (f - 1.0), u);",
    "tri_int": "int k = int(floor(8.0 * (x.x + p))); float f = 8.0 * (x.x + p) - k; float u = abs(f - 0.5); return u * u;",
    "polar": "float2 d = x - float2(p, q); float a = atan2(d.y, d.x), n = 3.0 * a / PI; float f = abs(n - 2.0 * round(0.5 * n)); return f * dot(d, d);",
    "hue_tables": "float h = 0.5 + 0.5 * x.x * p; float3 c = saturate(abs(frac(h + float3(0.0, 2.0 / 3.0, 1.0 / 3.0)) * 6.0 - 3.0) - 1.0); return c.x + 2.0 * c.y + 3.0 * c.z;",
    "hue_shift": "float h = frac(p + 0.2 * x.x); float r = abs(h * 6.0 - 3.0) - 1.0; float g = 2.0 - abs(h * 6.0 - 2.0); float b = 2.0 - abs(h * 6.0 - 4.0); return saturate(r) + 0.5 * saturate(g) + 0.25 * saturate(b);",
    "hsv_sector": "float h = 6.0 * frac(x.x + p); int i = int(floor(h)); float f = h - float(i); float v = 1.0, s = 0.8; float a = v * (1.0 - s), b = v * (1.0 - s * f), c = v * (1.0 - s * (1.0 - f)); float r = 0.0; int k = i % 6; if (k == 0) r = v; if (k == 1) r = b; if (k == 2) r = a; if (k == 3) r = a; if (k == 4) r = c; if (k == 5) r = v; return r;",
    "cyclic_table": "float t = 3.0 * (x.x + 1.0) + p; int k = int(floor(t)); float f = t - float(k); return lerp(w[k % 6], w[(k + 1) % 6], f);",
    "cyclic_cubic": "float t = 3.0 * (x.x + 1.0) + p; int k = int(floor(t)); float f = t - float(k); float u = f * f * (3.0 - 2.0 * f); return w[k % 6] * (1.0 - u) + w[(k + 1) % 6] * u;",
    "palette_cos": "float t = length(x) * p; return 0.5 + 0.5 * cos(TAU * (frac(t) + 0.3));",
    "angle_hue": "float h = atan2(x.y - p, x.x - q) / TAU + 0.5; float3 c = saturate(abs(frac(h + float3(0.0, 2.0 / 3.0, 1.0 / 3.0)) * 6.0 - 3.0) - 1.0); return dot(c, float3(0.2, 0.5, 0.3)) * length(x - float2(q, p));",
    "tagged_floor_if": "[Disc] float k = floor(4.0 * x.x + p); if (k > 2.0) return 1.0 + x.y; return k * 0.1;",
    "tagged_floor_eq": "[Disc] float k = floor(4.0 * x.x + p); return k == 1.0 ? 1.0 : k > 2.0 ? 0.5 : x.y;",
    "tagged_round_int": "[Disc] float k = round(3.0 * x.x + p); int i = int(k); return i == 1 ? 2.0 : w[clamp(i + 3, 0, 5)];",
    "tagged_bool": "[Disc] bool b = length(x) < p; float f = b ? 1.0 : 0.0; if (f > 0.5) return x.x; return 2.0;",
    "lanczos": "float t = abs(x.x - p) * 3.0; if (t < 1e-4) return 1.0; if (t >= 2.0) return 0.0; float a = PI * t; return 2.0 * sin(a) * sin(a / 2.0) / (a * a);",
    "sdf_moon": "float2 y = float2(x.x, abs(x.y)); float d = p, ra = 0.6, rb = 0.5; float a = (ra * ra - rb * rb + d * d) / (2.0 * d), b = sqrt(max(ra * ra - a * a, 0.0)); if (d * (y.x * b - y.y * a) > d * d * max(b - y.y, 0.0)) return length(y - float2(a, b)); return max(length(y) - ra, -(length(y - float2(d, 0.0)) - rb));",
    "bounce": "float t = saturate(0.5 + 0.5 * x.x * (0.5 + p)); if (t < 1.0 / 2.75) return 7.5625 * t * t; if (t < 2.0 / 2.75) { t -= 1.5 / 2.75; return 7.5625 * t * t + 0.75; } t -= 2.25 / 2.75; return 7.5625 * t * t + 0.9375;",
    "tagged_parity": "float n = 0.0; for (int i = 0; i < 3; i++) { [Disc] if (length(x - w[i]) < p) n += 1.0; } return fmod(n, 2.0) > 0.5 ? 1.0 : x.y;",
    "hsl": "float h = frac(0.5 * x.x + p), l = 0.5 + 0.2 * x.y; float c = (1.0 - abs(2.0 * l - 1.0)) * 0.8; float k = h * 6.0; float m = k - 2.0 * floor(k / 2.0); float y = c * (1.0 - abs(m - 1.0)); float r = 0.0; if (k < 1.0) r = c; else if (k < 2.0) r = y; else if (k < 4.0) r = 0.0; else if (k < 5.0) r = y; else r = c; return r + l - 0.5 * c;",
    "gradient_loop": "float t = 5.0 * saturate(0.5 + 0.45 * x.x + 0.1 * p), v = w[0]; for (int i = 0; i < 5; i++) if (t >= float(i)) v = lerp(w[i], w[i + 1], min(t - float(i), 1.0)); return v;",
    "angle_petal_mod": "float a = atan2(x.y - p, x.x - q); float s = TAU / 5.0; float m = a - s * round(a / s); return length(x - float2(q, p)) * cos(m);",
    "silenced": "[NoDisc] if (length(x) < p) return 1.0; return q;",
}


class Kinds(Case):
    def codes(self, body):
        self.put("s.salt", HEAD + body + "\n}\n")
        j = self.json_cli("grad", "s.salt", "--integral")
        return {d["code"] for d in j["warnings"] if d["code"].startswith("W04")}

    def sort(self, programs):
        return {name for name, body in programs.items() if self.codes(body)}

    def counted(self, what, found, programs):
        print(f"{what}: {len(found)} of {len(programs)}", file=sys.stderr)

    def test_decisions(self):
        found = self.sort(DECISIONS)
        self.counted("decisions warned about", found, DECISIONS)
        self.assertEqual(set(DECISIONS) - found, set())

    def test_few_of_many(self):
        found = self.sort(FEW)
        self.counted("decisions of which few matter, warned about", found, FEW)
        self.assertEqual(set(FEW) - found, set())

    def test_cells_with_them_are_not_certified(self):
        """Each jump of the edge weighs its length: nothing that the cells integrate moves."""
        disc = 2.0 * math.pi
        truth = {"third_ring": 0.02 * disc, "last_floor": -2.0, "last_iteration": 0.03 * disc, "band_y": 0.015, "cond_or": 0.03, "count17": 0.02 * disc}
        for name, want in truth.items():
            self.put("s.salt", HEAD + FEW[name] + "\n}\n")
            for options in (), ("--precision", "f64"):
                j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature", *options)
                self.assertLess(j["certified"], 1, (name, options))
                self.assertLessEqual(abs(j["gradient"]["p"] - want), 2 * j["stderr"]["p"], (name, options))
                self.assertIn("upset", {d["code"] for d in j["warnings"]}, (name, options))
        for name in "huber", "max", "cull", "mirror", "repeat_sdf", "value_noise":
            self.put("s.salt", HEAD + CONTINUOUS[name] + "\n}\n")
            j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature", "--precision", "f64")
            self.assertEqual([d["code"] for d in j["warnings"] if d["code"] == "upset"], [], name)

    def test_an_outline_on_its_own_seam(self):
        """A box whose corner is an arm of its own: the outline lies on the line where that arm begins, and is integrated. A decision that jumps over 0 there is told."""
        box = """
param float2 b = float2(0.25, 0.1);
param float2 h = float2(0.4, 0.3);
float box(float2 p) { float2 q = abs(p) - h; [NoDisc] if (q.x > 0.0 && q.y > 0.0) return length(q); return max(q.x, q.y); }
[Domain(-1.0, 1.0)] shader float main(float2 x) { [Disc] if (box(x - b) < 0.0) return 0.3; return 1.0; }
"""
        self.put("s.salt", box)
        for precision in "f32", "f64":
            j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature", "--precision", precision)
            self.assertEqual(j["warnings"], [])
            for name, k, want in ("h", 0, -0.84), ("h", 1, -1.12), ("b", 0, 0.0):
                self.assertLess(abs(j["gradient"][name][k] - want), 1e-5)
                self.assertLess(j["stderr"][name][k], 1e-4)
        self.put("s.salt", """
param float p = 0.5;
param float q = 0.5;
shader float main(float2 x) {
    float d = x.x - q - 0.1 * (x.y - 0.5) * (x.y - 0.5);
    [NoDisc] if (x.x > p) d = 1.0 + x.y;
    [Disc] if (d < 0.0) return 1.0;
    return 0.0;
}
""")
        j = self.json_cli("grad", "s.salt", "--integral", "--estimator", "quadrature")
        self.assertIn("upset", {d["code"] for d in j["warnings"]})
        self.assertGreater(j["stderr"]["p"], 0.99)

    def test_text_of_a_derivative_that_is_0(self):
        self.put("s.salt", HEAD + "[Disc] if (length(x) < 5.0 * p) return 1.0; return 0.0;\n}\n")
        r = self.run_cli("grad", "s.salt", "--integral")
        self.assertNotIn("lines miss", r.err)

    def test_arithmetic(self):
        """Warned about, or seen: then what is stated holds, and is a tenth of the answer at most."""
        found = self.sort(ARITHMETIC)
        self.counted("arithmetic warned about", found, ARITHMETIC)
        seen = {"narrow_bump": 2e-6 * math.pi * 0.4}
        for name in set(seen) - found:
            self.put("s.salt", HEAD + ARITHMETIC[name] + "\n}\n")
            j = self.json_cli("grad", "s.salt", "--integral")
            self.assertLessEqual(abs(j["gradient"]["p"] - seen[name]), 2 * j["stderr"]["p"], name)
            self.assertLess(j["stderr"]["p"], 0.1 * seen[name], name)
        self.assertEqual(set(ARITHMETIC) - found - set(seen), set())

    def test_errors_hold_what_is_lost(self):
        """The disc's circumference, or the line's length, times the jump."""
        disc = 2.0 * math.pi * 0.4
        truth = {"tanh": 2 * disc, "quotient": disc, "soft_sign": 2 * disc, "huge": disc, "hill": disc, "normalize": -4, "max_over": disc, "algebraic": -4, "atan_ramp": -2}
        for name, want in truth.items():
            self.put("s.salt", HEAD + ARITHMETIC[name] + "\n}\n")
            for options in (), ("--precision", "f64"), ("--estimator", "lattice"):
                j = self.json_cli("grad", "s.salt", "--integral", *options)
                off = abs(j["gradient"]["p"] - want)
                self.assertLessEqual(off, 2 * j["stderr"]["p"] + 2e-3 * abs(want), (name, options))
                if off > 0.1 * abs(want):
                    self.assertLess(j["certified"], 0.999, (name, options))
                self.assertEqual(j["stderr"]["q"], 0)

    def test_beside_shadows_of_terrain(self):
        """Lines see arithmetic there too; a shadow's edge, and what a [NoDisc] ray meets, is none."""
        n, head = 17, """import camera;
            [NoDiff] param heightfield h = zeros(17, 17); param float3 sun = float3(0.6, 0.3, 0.12); param float p = 0.4;
            shader float main(float2 x) {
                float s = 1.0;
                [Disc] if (h.occluded(float3(x, h.height(x) + 0.002), sun, 0.0, 1e9)) s = 0.2;
            """
        heights = [0.06 + 0.05 * math.sin(0.4 * i + 0.1 * j) * math.cos(0.3 * j - 0.1 * i) for j in range(n) for i in range(n)]
        self.put("h.pfm", write_pfm(n, n, 1, heights))
        jumps = {"d / abs(d)": "float d = x.x - p; return s + d / abs(d);", "ramp": "return s * saturate(1e7 * (x.x - p));"}
        smooth = {"shadow": "return s;", "lit": "return s * max(dot(h.normal(x), normalize(sun)), 0.0);", "p": "return s * smoothstep(0.3, 0.5, x.x * p);"}
        smooth["ray"] = ("[NoDisc] Hit v = h.trace(float3(0.4, -0.7, 0.45), normalize(float3(x.x - 0.5, 1.0, x.y - 0.9)), 0.0, 1e9);"
                         "return s * (v.hit ? v.normal.x + p * v.p.x : 0.0);")
        for programs, want in (jumps, {"W0405"}), (smooth, set()):
            for name, body in programs.items():
                self.put("s.salt", head + body + "\n}\n")
                j = self.json_cli("grad", "s.salt", "--integral", "--wrt", "sun,p", "--segments", "2^15", "--samples", "2^15", "--param", "h=@" + self.path("h.pfm"))
                self.assertEqual({d["code"] for d in j["warnings"] if d["code"].startswith("W04")}, want, name)
                self.assertLess(j["evaluations"], 1500000, name)  # bounds know nothing of an untagged ray, however small the box

    def test_text_names_the_operation(self):
        self.put("s.salt", HEAD + "float d = p - length(x);\nreturn tanh(1e6 * d);\n}\n")
        r = self.run_cli("grad", "s.salt", "--integral")
        self.assertIn("s.salt:5:", r.err)
        self.assertIn("W0405", r.err)
        r = self.run_cli("grad", "s.salt", "-o", "d.npy", "--size", "64x64")
        self.assertIn("W0405", r.err)
        self.assertNotIn("W0405", self.run_cli("grad", "s.salt", "--integral", "--quiet").err)

    def test_continuous_programs(self):
        found = self.sort(CONTINUOUS)
        self.counted("continuous programs warned about", found, CONTINUOUS)
        self.assertEqual(found, set())


if __name__ == "__main__":
    unittest.main()
