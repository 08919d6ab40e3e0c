/* The third set of forward kernels, in scalar C; behind ../ispc.h the same text is ISPC. */
#include "../kernels.h"

INL float sq(float x) { return x * x; }
INL float len3(float x, float y, float z) { return sqrtf(x * x + y * y + z * z); }

/* A torus over a floor, marched, with Phong's highlight and a soft shadow; d = {R, r} */
INL float torus_map(float x, float y, float z, DATA d) {
    float q = len2(x, y) - d[0];
    return minf(len2(q, z) - d[1], y + 1.3f);
}
INL uint32_t px_torus(float u, float v, DATA d) {
    float rx = (u - 0.5f) * 1.6f, ry = (0.5f - v) * 1.6f - 0.3f, rz = 1.6f;
    float il = 1.0f / len3(rx, ry, rz);
    rx *= il;
    ry *= il;
    rz *= il;
    const float oy = 0.7f, oz = -3.6f, lx = 0.5773503f, ly = 0.5773503f, lz = -0.5773503f;
    float t = 0.0f, hit = 0.0f, skyr = 0.5f - 0.3f * ry, skyg = 0.7f - 0.2f * ry;
    for (UNI int i = 0; i < 80; i++) {
        float h = torus_map(t * rx, oy + t * ry, oz + t * rz, d);
        if (h < 0.0005f * t) {
            hit = 1.0f;
            break;
        }
        t += h;
        if (t > 14.0f) break;
    }
    if (hit == 0.0f) return pack(skyr, skyg, 0.9f);
    float x = t * rx, y = oy + t * ry, z = oz + t * rz;
    const float e = 0.002f;
    float nx = torus_map(x + e, y, z, d) - torus_map(x - e, y, z, d);
    float ny = torus_map(x, y + e, z, d) - torus_map(x, y - e, z, d);
    float nz = torus_map(x, y, z + e, d) - torus_map(x, y, z - e, d);
    il = 1.0f / len3(nx, ny, nz);
    nx *= il;
    ny *= il;
    nz *= il;
    float diff = maxf(nx * lx + ny * ly + nz * lz, 0.0f), shadow = 1.0f, s = 0.03f;
    if (diff > 0.0f) {
        for (UNI int i = 0; i < 24; i++) {
            float h = torus_map(x + s * lx, y + s * ly, z + s * lz, d);
            shadow = minf(shadow, 10.0f * h / s);
            if (shadow < 0.005f) {
                shadow = 0.0f;
                break;
            }
            s += minf(maxf(h, 0.02f), 0.3f);
            if (s > 4.0f) break;
        }
    }
    float k = 2.0f * (nx * rx + ny * ry + nz * rz);
    float spec = powf(maxf((rx - k * nx) * lx + (ry - k * ny) * ly + (rz - k * nz) * lz, 0.0f), 32.0f);
    float r = 0.8f, g = 0.35f, b = 0.2f;
    if (y < -1.29f) {
        float c = floorf(x) + floorf(z);
        r = c - 2.0f * floorf(0.5f * c) > 0.5f ? 0.8f : 0.3f;
        g = r;
        b = r;
        spec = 0.0f;
    }
    float light = 0.2f + 0.8f * diff * shadow, fog = 1.0f - expf(-0.004f * t * t), gloss = 0.6f * spec * shadow;
    return pack(mix(r * light + gloss, skyr, fog), mix(g * light + gloss, skyg, fog),
                mix(b * light + gloss, 0.9f, fog));
}
KERNEL(torus)

/* A sphere and a box, less three cylinders, normals by differences, occlusion by five samples; d = {turn} */
INL float csg_map(float x, float y, float z) {
    float sphere = len3(x, y, z) - 1.25f;
    float qx = fabsf(x) - 1.0f, qy = fabsf(y) - 1.0f, qz = fabsf(z) - 1.0f;
    float box = len3(maxf(qx, 0.0f), maxf(qy, 0.0f), maxf(qz, 0.0f)) + minf(maxf(qx, maxf(qy, qz)), 0.0f);
    float holes = minf(len2(x, y), minf(len2(y, z), len2(z, x))) - 0.6f;
    return maxf(maxf(sphere, box), -holes);
}
INL uint32_t px_csg(float u, float v, DATA d) {
    float rx = (u - 0.5f) * 1.2f, ry = (0.5f - v) * 1.2f - 0.35f, rz = 1.4f;
    float il = 1.0f / len3(rx, ry, rz);
    float c = cosf(d[0]), s = sinf(d[0]);
    rx *= il;
    ry *= il;
    rz *= il;
    float ox = -3.6f * s, oy = 1.5f, oz = -3.6f * c, k = c * rx + s * rz;
    rz = c * rz - s * rx;
    rx = k;
    float t = 1.5f, hit = 0.0f;
    for (UNI int i = 0; i < 64; i++) {
        float h = csg_map(ox + t * rx, oy + t * ry, oz + t * rz);
        if (h < 0.001f) {
            hit = 1.0f;
            break;
        }
        t += h;
        if (t > 7.0f) break;
    }
    if (hit == 0.0f) return pack(0.15f + 0.1f * v, 0.15f + 0.1f * v, 0.2f + 0.15f * v);
    float x = ox + t * rx, y = oy + t * ry, z = oz + t * rz;
    const float e = 0.001f;
    float a = csg_map(x + e, y - e, z - e), b = csg_map(x - e, y - e, z + e), f = csg_map(x - e, y + e, z - e),
          g = csg_map(x + e, y + e, z + e);
    float nx = a - b - f + g, ny = f - a - b + g, nz = b - a - f + g;
    il = 1.0f / len3(nx, ny, nz);
    nx *= il;
    ny *= il;
    nz *= il;
    float occ = 0.0f, w = 1.0f;
    for (UNI int i = 1; i <= 5; i++) {
        float h = 0.08f * (float)i;
        occ += w * (h - csg_map(x + h * nx, y + h * ny, z + h * nz));
        w *= 0.6f;
    }
    float ao = clamp01(1.0f - 1.5f * occ), light = maxf(0.48f * nx + 0.72f * ny - 0.5f * nz, 0.0f);
    float fill = 0.25f + 0.15f * ny;
    return pack(ao * (fill + 0.7f * light), ao * (fill + 0.5f * light), ao * (1.2f * fill + 0.3f * light));
}
KERNEL(csg)

/* Seven plane waves that interfere, a quasicrystal; d = {x and y of each} and phase */
INL uint32_t px_waves(float u, float v, DATA d) {
    float x = (u - 0.5f) * 90.0f, y = (v - 0.5f) * 90.0f, s = 0.0f;
    for (UNI int i = 0; i < 7; i++) s += 0.5f + 0.5f * cosf(d[2 * i] * x + d[2 * i + 1] * y + d[14]);
    float k = floorf(s);
    float f = s - k;
    if (((int)k & 1) != 0) f = 1.0f - f;
    return pack(f, f * f, 0.3f + 0.1f * k);
}
KERNEL(waves)

/* 24 Gaussians {x, y, a, b, c, red, green, blue}, weighed against each other */
INL uint32_t px_mixture(float u, float v, DATA d) {
    float sum = 1e-6f, r = 0.0f, g = 0.0f, b = 0.0f;
    for (UNI int i = 0; i < 24; i++) {
        float x = u - d[8 * i], y = v - d[8 * i + 1];
        float w = expf(-0.5f * (d[8 * i + 2] * x * x + 2.0f * d[8 * i + 3] * x * y + d[8 * i + 4] * y * y));
        sum += w;
        r += w * d[8 * i + 5];
        g += w * d[8 * i + 6];
        b += w * d[8 * i + 7];
    }
    float k = 1.0f / sum;
    return pack(k * r, k * g, k * b);
}
KERNEL(mixture)

/* Marble: four octaves of Perlin's noise; d = a permutation of 256 */
INL float perlin_slope(int h, float x, float y) {
    float a = (h & 4) != 0 ? y : x, b = (h & 4) != 0 ? x : y;
    return ((h & 1) != 0 ? -a : a) + ((h & 2) != 0 ? -2.0f * b : 2.0f * b);
}
INL float fade(float t) { return t * t * t * (t * (t * 6.0f - 15.0f) + 10.0f); }
INL float perlin(float x, float y, DATA d) {
    float flx = floorf(x), fly = floorf(y);
    int ix = (int)flx & 255, iy = (int)fly & 255;
    x -= flx;
    y -= fly;
    int a = (int)d[ix] + iy, b = (int)d[(ix + 1) & 255] + iy;
    float s = fade(x), t = fade(y);
    float n0 = mix(perlin_slope((int)d[a & 255], x, y), perlin_slope((int)d[b & 255], x - 1.0f, y), s);
    float n1 = mix(perlin_slope((int)d[(a + 1) & 255], x, y - 1.0f),
                   perlin_slope((int)d[(b + 1) & 255], x - 1.0f, y - 1.0f), s);
    return mix(n0, n1, t);
}
INL uint32_t px_perlin(float u, float v, DATA d) {
    float x = 6.0f * u, y = 6.0f * v, s = 0.0f, a = 0.5f;
    for (UNI int i = 0; i < 4; i++) {
        s += a * fabsf(perlin(x, y, d));
        x = 2.0f * x + 3.1f;
        y = 2.0f * y + 1.7f;
        a *= 0.5f;
    }
    float m = 0.5f + 0.5f * sinf(12.0f * u + 5.0f * s);
    return pack(mix(0.2f, 0.95f, m), mix(0.2f, 0.9f, m), mix(0.3f, 0.85f, sqrtf(m)));
}
KERNEL(perlin)

/* A table of 32 x 32, by Catmull and Rom's splines; d = it, row by row */
INL uint32_t px_bicubic(float u, float v, DATA d) {
    float x = 32.0f * u - 0.5f, y = 32.0f * v - 0.5f;
    float flx = floorf(x), fly = floorf(y);
    float fx = x - flx, fy = y - fly, s = 0.0f, wx[4], wy[4];
    int ix = (int)flx, iy = (int)fly;
    wx[0] = fx * (-0.5f + fx * (1.0f - 0.5f * fx));
    wx[1] = 1.0f + fx * fx * (-2.5f + 1.5f * fx);
    wx[2] = fx * (0.5f + fx * (2.0f - 1.5f * fx));
    wx[3] = fx * fx * (-0.5f + 0.5f * fx);
    wy[0] = fy * (-0.5f + fy * (1.0f - 0.5f * fy));
    wy[1] = 1.0f + fy * fy * (-2.5f + 1.5f * fy);
    wy[2] = fy * (0.5f + fy * (2.0f - 1.5f * fy));
    wy[3] = fy * fy * (-0.5f + 0.5f * fy);
    for (UNI int j = 0; j < 4; j++) {
        int row = iy + j - 1;
        row = row < 0 ? 0 : row > 31 ? 31 : row;
        float line = 0.0f;
        for (UNI int i = 0; i < 4; i++) {
            int column = ix + i - 1;
            column = column < 0 ? 0 : column > 31 ? 31 : column;
            line += wx[i] * d[32 * row + column];
        }
        s += wy[j] * line;
    }
    return pack(s, s * s * (3.0f - 2.0f * s), 0.2f + 0.6f * s);
}
KERNEL(bicubic)

/* A ball of metal under three lights {x, y, z, red, green, blue}, by GGX; then roughness and reflectance */
INL uint32_t px_ggx(float u, float v, DATA d) {
    float x = (u - 0.5f) * 2.2f, y = (0.5f - v) * 2.2f;
    float zz = 1.0f - x * x - y * y;
    if (zz <= 0.0f) return pack(0.1f, 0.1f, 0.12f);
    float z = sqrtf(zz), r = 0.0f, g = 0.0f, b = 0.0f, alpha = d[18] * d[18];
    float a2 = alpha * alpha;
    float nv = z;
    float kv = nv + sqrtf(a2 + (1.0f - a2) * nv * nv);
    for (UNI int i = 0; i < 3; i++) {
        float lx = d[6 * i] - x, ly = d[6 * i + 1] - y, lz = d[6 * i + 2] - z;
        float q = lx * lx + ly * ly + lz * lz;
        float il = 1.0f / sqrtf(q);
        lx *= il;
        ly *= il;
        lz *= il;
        float nl = x * lx + y * ly + z * lz;
        if (nl <= 0.0f) continue;
        float hx = lx, hy = ly, hz = lz + 1.0f;
        float ih = 1.0f / len3(hx, hy, hz);
        float nh = (x * hx + y * hy + z * hz) * ih, vh = hz * ih;
        float den = nh * nh * (a2 - 1.0f) + 1.0f;
        float D = a2 / (3.14159265f * den * den);
        float G = 1.0f / (kv * (nl + sqrtf(a2 + (1.0f - a2) * nl * nl)));
        float m = 1.0f - vh;
        float m5 = m * m * m * m * m, light = nl / q;
        float s = D * G * light;
        r += d[6 * i + 3] * (s * (d[19] + (1.0f - d[19]) * m5) + 0.02f * light);
        g += d[6 * i + 4] * (s * (d[20] + (1.0f - d[20]) * m5) + 0.02f * light);
        b += d[6 * i + 5] * (s * (d[21] + (1.0f - d[21]) * m5) + 0.02f * light);
    }
    return pack(powf(r / (1.0f + r), 0.4545455f), powf(g / (1.0f + g), 0.4545455f), powf(b / (1.0f + b), 0.4545455f));
}
KERNEL(ggx)

/* A picture printed in three grids of dots; d = {cells} */
INL float dots(float x, float y, float c, float s, float tone, DATA d) {
    float a = fract((c * x - s * y) * d[0]) - 0.5f, b = fract((s * x + c * y) * d[0]) - 0.5f;
    return 1.0f - smooth(-0.08f, 0.08f, sqrtf(a * a + b * b) - 0.7f * sqrtf(tone));
}
INL uint32_t px_halftone(float u, float v, DATA d) {
    float x = u - 0.5f, y = v - 0.5f;
    float q = 4.0f * (x * x + y * y);
    float cyan = clamp01(0.5f + 0.5f * sinf(9.0f * u + 2.0f * v)), magenta = clamp01(q),
          yellow = clamp01(1.0f - u * v * 2.0f);
    float c = dots(u, v, 0.9659258f, 0.2588190f, cyan, d), m = dots(u, v, 0.2588190f, 0.9659258f, magenta, d),
          w = dots(u, v, 1.0f, 0.0f, yellow, d);
    return pack(1.0f - 0.9f * c, 1.0f - 0.85f * m, 1.0f - 0.9f * w);
}
KERNEL(halftone)

/* Ordered dither of a sky to five levels, by Bayer's matrix of 8 x 8 in big pixels; d = {pixels} */
INL uint32_t px_dither(float u, float v, DATA d) {
    int ix = (int)(u * d[0]), iy = (int)(v * d[0]);
    int m = 0, q = ix ^ iy;
    for (UNI int i = 0; i < 3; i++) m = (m << 2) | (((q >> i) & 1) << 1) | ((iy >> i) & 1);
    float threshold = ((float)m + 0.5f) * (1.0f / 64.0f) - 0.5f;
    float x = ((float)ix + 0.5f) / d[0], y = ((float)iy + 0.5f) / d[0];
    float sun = expf(-30.0f * (sq(x - 0.7f) + sq(y - 0.3f)));
    float r = 0.3f + 0.5f * y + sun, g = 0.4f + 0.3f * y + 0.7f * sun, b = 0.8f - 0.2f * y;
    r = floorf(4.0f * r + 0.5f + threshold) * 0.25f;
    g = floorf(4.0f * g + 0.5f + threshold) * 0.25f;
    b = floorf(4.0f * b + 0.5f + threshold) * 0.25f;
    return pack(r, g, b);
}
KERNEL(dither)

/* Newton's method for z^3 = 1; d = {x, y, size} */
INL uint32_t px_newton(float u, float v, DATA d) {
    float x = d[0] + (u - 0.5f) * d[2], y = d[1] + (v - 0.5f) * d[2];
    int n = 0;
    for (UNI int i = 0; i < 40; i++) {
        float x2 = x * x - y * y, y2 = 2.0f * x * y;
        float fx = x * x2 - y * y2 - 1.0f, fy = x * y2 + y * x2;
        if (fx * fx + fy * fy < 1e-6f) break;
        float k = 1.0f / (3.0f * (x2 * x2 + y2 * y2) + 1e-20f);
        x -= (fx * x2 + fy * y2) * k;
        y -= (fy * x2 - fx * y2) * k;
        n++;
    }
    float shade = 1.0f / (1.0f + 0.12f * (float)n);
    if (x > 0.0f) return pack(shade, 0.3f * shade, 0.2f * shade);
    if (y > 0.0f) return pack(0.2f * shade, shade, 0.4f * shade);
    return pack(0.2f * shade, 0.4f * shade, shade);
}
KERNEL(newton)

/* The burning ship; d = {x, y, size} */
INL uint32_t px_ship(float u, float v, DATA d) {
    float cx = d[0] + (u - 0.5f) * d[2], cy = d[1] + (v - 0.5f) * d[2], x = 0.0f, y = 0.0f;
    int n = 0;
    while (n < 128 && x * x + y * y < 16.0f) {
        float t = x * x - y * y + cx;
        y = 2.0f * fabsf(x * y) + cy;
        x = t;
        n++;
    }
    if (n == 128) return pack(0.0f, 0.0f, 0.0f);
    float s = ((float)n + 1.0f - log2f(0.5f * log2f(x * x + y * y))) * (1.0f / 128.0f);
    float q = sqrtf(maxf(s, 0.0f));
    return pack(1.6f * q, 2.0f * s, 0.6f * s + 0.1f * q);
}
KERNEL(ship)

/* Menger's sponge, marched; d = {turn} */
INL float menger_map(float x, float y, float z) {
    float h = maxf(fabsf(x), maxf(fabsf(y), fabsf(z))) - 1.0f, s = 1.0f;
    for (UNI int i = 0; i < 4; i++) {
        float ax = x * s, ay = y * s, az = z * s;
        ax = ax - 2.0f * floorf(0.5f * ax) - 1.0f;
        ay = ay - 2.0f * floorf(0.5f * ay) - 1.0f;
        az = az - 2.0f * floorf(0.5f * az) - 1.0f;
        s *= 3.0f;
        float rx = fabsf(1.0f - 3.0f * fabsf(ax)), ry = fabsf(1.0f - 3.0f * fabsf(ay)),
              rz = fabsf(1.0f - 3.0f * fabsf(az));
        float c = (minf(maxf(rx, ry), minf(maxf(ry, rz), maxf(rz, rx))) - 1.0f) / s;
        h = maxf(h, c);
    }
    return h;
}
INL uint32_t px_menger(float u, float v, DATA d) {
    float rx = (u - 0.5f) * 1.5f, ry = (0.5f - v) * 1.5f - 0.5f, rz = 1.5f;
    float il = 1.0f / len3(rx, ry, rz);
    float c = cosf(d[0]), s = sinf(d[0]);
    rx *= il;
    ry *= il;
    rz *= il;
    float ox = -3.2f * s, oy = 1.3f, oz = -3.2f * c, k = c * rx + s * rz;
    rz = c * rz - s * rx;
    rx = k;
    float t = 0.5f, hit = 0.0f;
    int n = 0;
    for (UNI int i = 0; i < 48; i++) {
        float h = menger_map(ox + t * rx, oy + t * ry, oz + t * rz);
        if (h < 0.0015f) {
            hit = 1.0f;
            break;
        }
        t += h;
        n++;
        if (t > 7.0f) break;
    }
    if (hit == 0.0f) return pack(0.75f - 0.2f * v, 0.8f - 0.2f * v, 0.9f);
    float x = ox + t * rx, y = oy + t * ry, z = oz + t * rz;
    float h = menger_map(x, y, z);
    const float e = 0.001f;
    float nx = menger_map(x + e, y, z) - h, ny = menger_map(x, y + e, z) - h, nz = menger_map(x, y, z + e) - h;
    il = 1.0f / (len3(nx, ny, nz) + 1e-9f);
    float light = maxf((0.4f * nx + 0.8f * ny - 0.45f * nz) * il, 0.0f), ao = 1.0f - (float)n * (1.0f / 60.0f);
    return pack(ao * (0.25f + 0.7f * light), ao * (0.22f + 0.55f * light), ao * (0.25f + 0.3f * light));
}
KERNEL(menger)

/* Five balls {x, y, z, r} on a floor under a lamp of 4 x 4 points */
INL uint32_t px_lamp(float u, float v, DATA d) {
    float rx = (u - 0.5f) * 1.4f, ry = (0.5f - v) * 1.4f - 0.45f, rz = 1.3f;
    float il = 1.0f / len3(rx, ry, rz);
    const float oy = 2.2f, oz = -4.0f;
    rx *= il;
    ry *= il;
    rz *= il;
    float t = 1e9f, nx = 0.0f, ny = 1.0f, nz = 0.0f, r = 0.7f, g = 0.7f, b = 0.65f;
    if (ry < 0.0f) t = -oy / ry;
    for (UNI int i = 0; i < 5; i++) {
        float x = -d[4 * i], y = oy - d[4 * i + 1], z = oz - d[4 * i + 2], radius = d[4 * i + 3];
        float p = x * rx + y * ry + z * rz;
        float q = p * p - (x * x + y * y + z * z - radius * radius);
        if (q > 0.0f) {
            float s = -p - sqrtf(q);
            if (s > 0.0f && s < t) {
                t = s;
                nx = (x + s * rx) / radius;
                ny = (y + s * ry) / radius;
                nz = (z + s * rz) / radius;
                r = 0.9f;
                g = 0.3f + 0.1f * (float)i;
                b = 0.25f;
            }
        }
    }
    if (t > 60.0f) return pack(0.05f, 0.06f, 0.1f);
    float x = t * rx + 0.001f * nx, y = oy + t * ry + 0.001f * ny, z = oz + t * rz + 0.001f * nz, light = 0.0f;
    for (UNI int j = 0; j < 4; j++)
        for (UNI int i = 0; i < 4; i++) {
            float lx = -0.9f + 0.6f * (float)i - x, ly = 4.0f - y, lz = -0.9f + 0.6f * (float)j - z;
            float q = lx * lx + ly * ly + lz * lz;
            float k = 1.0f / sqrtf(q);
            lx *= k;
            ly *= k;
            lz *= k;
            float cosine = nx * lx + ny * ly + nz * lz;
            if (cosine > 0.0f) {
                int dark = 0;
                for (UNI int o = 0; o < 5; o++) {
                    float px = x - d[4 * o], py = y - d[4 * o + 1], pz = z - d[4 * o + 2];
                    float p = px * lx + py * ly + pz * lz, f = px * px + py * py + pz * pz - sq(d[4 * o + 3]);
                    if (p < 0.0f && p * p > f) {
                        dark = 1;
                        break;
                    }
                }
                if (dark == 0) light += cosine * ly / q;
            }
        }
    light = 0.06f + light;
    return pack(r * light, g * light, b * light);
}
KERNEL(lamp)

/* Twelve boxes {x, y, z, half sizes, red, green, blue} by slabs, with a shadow */
INL uint32_t px_boxes(float u, float v, DATA d) {
    float rx = (u - 0.5f) * 1.5f, ry = (0.5f - v) * 1.5f - 0.4f, rz = 1.4f;
    float il = 1.0f / len3(rx, ry, rz);
    const float ox = 0.3f, oy = 2.0f, oz = -4.5f, lx = 0.4f, ly = 0.8f, lz = -0.4472136f;
    rx *= il;
    ry *= il;
    rz *= il;
    float ix = 1.0f / rx, iy = 1.0f / ry, iz = 1.0f / rz;
    float t = 1e9f, nx = 0.0f, ny = 1.0f, nz = 0.0f, r = 0.6f, g = 0.6f, b = 0.6f;
    if (ry < 0.0f) t = -oy * iy;
    for (UNI int i = 0; i < 12; i++) {
        float mx = ix * (d[9 * i] - ox), my = iy * (d[9 * i + 1] - oy), mz = iz * (d[9 * i + 2] - oz);
        float kx = fabsf(ix) * d[9 * i + 3], ky = fabsf(iy) * d[9 * i + 4], kz = fabsf(iz) * d[9 * i + 5];
        float ax = mx - kx, ay = my - ky, az = mz - kz;
        float lo = maxf(maxf(ax, ay), az), hi = minf(minf(mx + kx, my + ky), mz + kz);
        if (lo < hi && lo > 0.0f && lo < t) {
            t = lo;
            nx = ax == lo ? (rx > 0.0f ? -1.0f : 1.0f) : 0.0f;
            ny = ax == lo ? 0.0f : ay == lo ? (ry > 0.0f ? -1.0f : 1.0f) : 0.0f;
            nz = ax == lo || ay == lo ? 0.0f : rz > 0.0f ? -1.0f : 1.0f;
            r = d[9 * i + 6];
            g = d[9 * i + 7];
            b = d[9 * i + 8];
        }
    }
    if (t > 50.0f) return pack(0.6f + 0.2f * ry, 0.75f, 0.95f);
    float x = ox + t * rx + 0.001f * nx, y = oy + t * ry + 0.001f * ny, z = oz + t * rz + 0.001f * nz;
    float light = maxf(nx * lx + ny * ly + nz * lz, 0.0f);
    if (light > 0.0f) {
        const float jx = 1.0f / lx, jy = 1.0f / ly, jz = 1.0f / lz;
        for (UNI int i = 0; i < 12; i++) {
            float mx = jx * (d[9 * i] - x), my = jy * (d[9 * i + 1] - y), mz = jz * (d[9 * i + 2] - z);
            float kx = fabsf(jx) * d[9 * i + 3], ky = fabsf(jy) * d[9 * i + 4], kz = fabsf(jz) * d[9 * i + 5];
            float lo = maxf(maxf(mx - kx, my - ky), mz - kz), hi = minf(minf(mx + kx, my + ky), mz + kz);
            if (lo < hi && lo > 0.0f) {
                light = 0.0f;
                break;
            }
        }
    }
    light = 0.25f + 0.75f * light;
    return pack(r * light, g * light, b * light);
}
KERNEL(boxes)

/* A sign of 16 glowing strokes {ax, ay, bx, by} */
INL uint32_t px_neon(float u, float v, DATA d) {
    float best = 1e9f, glow = 0.0f;
    for (UNI int i = 0; i < 16; i++) {
        float s = sd_segment(u, v, d[4 * i], d[4 * i + 1], d[4 * i + 2], d[4 * i + 3]);
        best = minf(best, s);
        glow += 0.0008f / (s * s + 0.0008f);
    }
    float tube = 1.0f - smooth(0.004f, 0.008f, best), wall = 0.06f + 0.02f * fract(12.0f * v);
    return pack(wall + 0.5f * glow + tube, wall + 0.12f * glow + 0.9f * tube, wall + 0.25f * glow + 0.8f * tube);
}
KERNEL(neon)

/* Light of a black body behind a prism: Wien's law, and the observer as sums of Gaussians; d = {least and most kelvin}
 */
INL float lobe(float x, float m, float lo, float hi) {
    float t = (x - m) * (x < m ? lo : hi);
    return expf(-0.5f * t * t);
}
INL uint32_t px_prism(float u, float v, DATA d) {
    float l = 380.0f + 340.0f * u, kelvin = mix(d[0], d[1], v);
    float m = 1e-3f * l;
    float power = 0.02f * expf(24.8f - 14388.0f / (m * kelvin)) / (m * m * m * m * m) * 1e-9f;
    float e = power / (power + 0.4f);
    float X = 1.056f * lobe(l, 599.8f, 0.0264f, 0.0323f) + 0.362f * lobe(l, 442.0f, 0.0624f, 0.0374f) -
              0.065f * lobe(l, 501.1f, 0.0490f, 0.0382f);
    float Y = 0.821f * lobe(l, 568.8f, 0.0213f, 0.0247f) + 0.286f * lobe(l, 530.9f, 0.0613f, 0.0322f);
    float Z = 1.217f * lobe(l, 437.0f, 0.0845f, 0.0278f) + 0.681f * lobe(l, 459.0f, 0.0385f, 0.0725f);
    float r = maxf(3.2406f * X - 1.5372f * Y - 0.4986f * Z, 0.0f) * e,
          g = maxf(-0.9689f * X + 1.8758f * Y + 0.0415f * Z, 0.0f) * e,
          b = maxf(0.0557f * X - 0.2040f * Y + 1.0570f * Z, 0.0f) * e;
    return pack(r < 0.0031308f ? 12.92f * r : 1.055f * powf(r, 0.4166667f) - 0.055f,
                g < 0.0031308f ? 12.92f * g : 1.055f * powf(g, 0.4166667f) - 0.055f,
                b < 0.0031308f ? 12.92f * b : 1.055f * powf(b, 0.4166667f) - 0.055f);
}
KERNEL(prism)

/* Voronoi's cells, joined smoothly; d = {cells, sharpness} */
INL uint32_t px_cells(float u, float v, DATA d) {
    float x = u * d[0], y = v * d[0];
    float flx = floorf(x), fly = floorf(y), sum = 0.0f, r = 0.0f, g = 0.0f;
    for (UNI int j = -1; j <= 1; j++)
        for (UNI int i = -1; i <= 1; i++) {
            uint32_t h = hash2((int)flx + i, (int)fly + j);
            float a = (float)(int)(h & 1023u) * (1.0f / 1024.0f),
                  b = (float)(int)((h >> 10) & 1023u) * (1.0f / 1024.0f);
            float px = flx + (float)i + a - x, py = fly + (float)j + b - y;
            float w = expf(-d[1] * (px * px + py * py));
            sum += w;
            r += w * a;
            g += w * b;
        }
    float s = -logf(sum) / d[1], k = 1.0f / sum;
    float line = smooth(0.3f, 0.6f, s);
    return pack(mix(r * k, 1.0f, line), mix(g * k, 0.9f, line), 0.3f + 0.6f * s);
}
KERNEL(cells)

/* Cloth woven by automata: every square runs a rule of three neighbours from its own seed; d = {squares} */
INL uint32_t px_automata(float u, float v, DATA d) {
    float x = u * d[0], y = v * d[0];
    int ix = (int)x, iy = (int)y;
    int column = (int)(32.0f * (x - (float)ix)), row = (int)(32.0f * (y - (float)iy));
    uint32_t w = hash2(ix, iy) | 1u;
    for (UNI int i = 0; i < 31; i++) {
        if (i >= row) break;
        uint32_t l = (w << 1) | (w >> 31), r = (w >> 1) | (w << 31);
        w = l ^ (w | r);
    }
    float on = (float)(int)((w >> (uint32_t)column) & 1u);
    uint32_t c = hash2(iy, ix);
    float a = (float)(int)(c & 255u) * (1.0f / 255.0f), b = (float)(int)((c >> 8) & 255u) * (1.0f / 255.0f);
    return pack(mix(0.95f, a, on), mix(0.92f, b, on), mix(0.85f, 0.5f * (a + b), on));
}
KERNEL(automata)

/* A march through clouds of noise, front to back; d = {x, z, density} */
INL float corner3(int x, int y, int z) {
    uint32_t h = (uint32_t)x * 374761393u + (uint32_t)y * 668265263u + (uint32_t)z * 2246822519u;
    h = (h ^ (h >> 15)) * 2654435761u;
    return (float)(int)((h >> 8) & 0xffffu) * (1.0f / 65536.0f);
}
INL float noise3(float x, float y, float z) {
    float flx = floorf(x), fly = floorf(y), flz = floorf(z);
    float fx = x - flx, fy = y - fly, fz = z - flz;
    int ix = (int)flx, iy = (int)fly, iz = (int)flz;
    fx = fx * fx * (3.0f - 2.0f * fx);
    fy = fy * fy * (3.0f - 2.0f * fy);
    fz = fz * fz * (3.0f - 2.0f * fz);
    float a = mix(corner3(ix, iy, iz), corner3(ix + 1, iy, iz), fx);
    float b = mix(corner3(ix, iy + 1, iz), corner3(ix + 1, iy + 1, iz), fx);
    float c = mix(corner3(ix, iy, iz + 1), corner3(ix + 1, iy, iz + 1), fx);
    float e = mix(corner3(ix, iy + 1, iz + 1), corner3(ix + 1, iy + 1, iz + 1), fx);
    return mix(mix(a, b, fy), mix(c, e, fy), fz);
}
INL uint32_t px_clouds(float u, float v, DATA d) {
    float rx = (u - 0.5f) * 1.4f, ry = (0.5f - v) * 1.4f + 0.35f, rz = 1.2f;
    float il = 1.0f / len3(rx, ry, rz);
    rx *= il;
    ry *= il;
    rz *= il;
    float sky = 0.5f + 0.5f * ry;
    float sr = mix(0.9f, 0.25f, sky), sg = mix(0.9f, 0.45f, sky), sb = 0.9f;
    if (ry < 0.02f) return pack(sr, sg, sb);
    float t = 1.0f / ry, T = 1.0f, light = 0.0f, step = 0.12f / maxf(ry, 0.15f);
    for (UNI int i = 0; i < 20; i++) {
        float x = d[0] + t * rx, y = t * ry, z = d[1] + t * rz;
        float f = 0.6f * noise3(1.3f * x, 1.3f * y, 1.3f * z) + 0.4f * noise3(3.1f * x, 3.1f * y, 3.1f * z);
        float rho = maxf(f - 0.5f, 0.0f) * d[2];
        if (rho > 0.0f) {
            float a = 1.0f - expf(-rho * step);
            light += T * a * (1.3f - 0.9f * f);
            T *= 1.0f - a;
            if (T < 0.01f) break;
        }
        t += step;
    }
    return pack(light + T * sr, light + T * sg, light + T * sb);
}
KERNEL(clouds)

/* A pendulum over three magnets {x, y}: where it comes to rest; then friction, spring, height */
INL uint32_t px_pendulum(float u, float v, DATA d) {
    float x = (u - 0.5f) * 4.0f, y = (v - 0.5f) * 4.0f, vx = 0.0f, vy = 0.0f, way = 0.0f;
    const float dt = 0.05f;
    for (UNI int i = 0; i < 120; i++) {
        float ax = -d[7] * x - d[6] * vx, ay = -d[7] * y - d[6] * vy;
        for (UNI int k = 0; k < 3; k++) {
            float px = d[2 * k] - x, py = d[2 * k + 1] - y;
            float q = px * px + py * py + d[8] * d[8];
            float w = 1.0f / (q * sqrtf(q));
            ax += px * w;
            ay += py * w;
        }
        vx += dt * ax;
        vy += dt * ay;
        x += dt * vx;
        y += dt * vy;
        way += dt * len2(vx, vy);
    }
    float c[3];
    for (UNI int k = 0; k < 3; k++) c[k] = 1.0f / (1.0f + 6.0f * (sq(x - d[2 * k]) + sq(y - d[2 * k + 1])));
    float shade = 1.0f / (1.0f + 0.05f * way);
    return pack(c[0] * shade, c[1] * shade, c[2] * shade);
}
KERNEL(pendulum)

/* Lyapunov exponents of the logistic map, driven by AABAB; d = {x, y, size} */
INL uint32_t px_lyapunov(float u, float v, DATA d) {
    float a = d[0] + u * d[2], b = d[1] + v * d[2], x = 0.5f, sum = 0.0f;
    for (UNI int i = 0; i < 60; i++) {
        UNI int k = i % 5;
        float r = k == 2 || k == 4 ? b : a;
        x = r * x * (1.0f - x);
        sum += logf(maxf(fabsf(r * (1.0f - 2.0f * x)), 1e-9f));
    }
    float l = sum * (1.0f / 60.0f);
    if (l < 0.0f) {
        float s = expf(l);
        return pack(1.0f - 0.7f * s, 0.9f - 0.6f * s, 0.3f * s);
    }
    return pack(0.0f, 0.0f, minf(l, 1.0f));
}
KERNEL(lyapunov)

/* A walk through a grid of blocks, cell by cell; d = {x, y, z, turn} */
INL uint32_t px_voxels(float u, float v, DATA d) {
    float rx = (u - 0.5f) * 1.5f, ry = (0.5f - v) * 1.5f - 0.35f, rz = 1.3f;
    float il = 1.0f / len3(rx, ry, rz), c = cosf(d[3]), s = sinf(d[3]);
    float kx = (c * rx + s * rz) * il;
    rz = (c * rz - s * rx) * il;
    rx = kx;
    ry *= il;
    int ix = (int)floorf(d[0]), iy = (int)floorf(d[1]), iz = (int)floorf(d[2]);
    int sx = rx < 0.0f ? -1 : 1, sy = ry < 0.0f ? -1 : 1, sz = rz < 0.0f ? -1 : 1;
    float dx = fabsf(1.0f / rx), dy = fabsf(1.0f / ry), dz = fabsf(1.0f / rz);
    float fx = d[0] - floorf(d[0]), fy = d[1] - floorf(d[1]), fz = d[2] - floorf(d[2]);
    float tx = dx * (sx > 0 ? 1.0f - fx : fx), ty = dy * (sy > 0 ? 1.0f - fy : fy), tz = dz * (sz > 0 ? 1.0f - fz : fz);
    float t = 0.0f, light = 0.0f;
    uint32_t h = 0u;
    for (UNI int i = 0; i < 64; i++) {
        if (tx < ty && tx < tz) {
            ix += sx;
            t = tx;
            tx += dx;
            light = 0.7f;
        } else if (ty < tz) {
            iy += sy;
            t = ty;
            ty += dy;
            light = sy < 0 ? 1.0f : 0.35f;
        } else {
            iz += sz;
            t = tz;
            tz += dz;
            light = 0.5f;
        }
        h = hash2(ix, iz);
        if (iy < (int)(h & 7u) - 2) break;
    }
    if (t > 30.0f) return pack(0.6f, 0.75f, 0.95f);
    float fog = expf(-0.05f * t), g = 0.4f + (float)(int)((h >> 4) & 15u) * (1.0f / 30.0f);
    return pack(mix(0.6f, light * g, fog), mix(0.75f, light * (0.5f + 0.5f * g), fog), mix(0.95f, 0.3f * light, fog));
}
KERNEL(voxels)

/* The median of nine values of a noisy picture */
INL float speckled(float x, float y) {
    uint32_t h = hash2((int)x, (int)y) & 15u;
    float s = 0.5f + 0.5f * sinf(0.02f * x) * cosf(0.03f * y);
    return h == 0u ? 0.0f : h == 1u ? 1.0f : s;
}
INL uint32_t px_median(float u, float v, DATA d) {
    float x = floorf(u * d[0]), y = floorf(v * d[0]), p[9];
    for (UNI int j = 0; j < 3; j++)
        for (UNI int i = 0; i < 3; i++) p[3 * j + i] = speckled(x + (float)i, y + (float)j);
    for (UNI int k = 0; k < 5; k++)
        for (UNI int i = 0; i < 8 - k; i++) {
            float lo = minf(p[i], p[i + 1]), hi = maxf(p[i], p[i + 1]);
            p[i] = lo;
            p[i + 1] = hi;
        }
    return pack(p[4], p[4] * p[4], 0.5f * (p[3] + p[5]));
}
KERNEL(median)

/* A complex function by its argument and magnitude; d = {size} */
INL float hue(float h, float k) {
    float t = fabsf(6.0f * fract(h + k) - 3.0f) - 1.0f;
    return clamp01(t);
}
INL uint32_t px_complex(float u, float v, DATA d) {
    float x = (u - 0.5f) * d[0], y = (0.5f - v) * d[0];
    float ax = x * x - y * y - 1.0f, ay = 2.0f * x * y;
    float bx = x - 2.0f, by = y - 1.0f;
    float cx = bx * bx - by * by, cy = 2.0f * bx * by;
    float nx = ax * cx - ay * cy, ny = ax * cy + ay * cx, qx = x * x - y * y + 2.0f, qy = 2.0f * x * y + 2.0f;
    float m = 1.0f / (qx * qx + qy * qy + 1e-20f);
    float wx = (nx * qx + ny * qy) * m, wy = (ny * qx - nx * qy) * m;
    float h = atan2f(wy, wx) * 0.15915494f, l = log2f(wx * wx + wy * wy + 1e-20f);
    float k = 0.6f + 0.4f * sqrtf(fract(0.5f * l)), g = powf(fabsf(sinf(3.14159265f * 6.0f * h)), 0.3f);
    float w = k * (0.7f + 0.3f * g);
    return pack(w * hue(h, 0.0f), w * hue(h, 0.6666667f), w * hue(h, 0.3333333f));
}
KERNEL(complex)

/* Light bent by a black hole, a disc of gas around it; d = {height, mass} */
INL uint32_t px_hole(float u, float v, DATA d) {
    float x = 0.0f, y = d[0], z = -9.0f, vx = (u - 0.5f) * 1.2f, vy = (0.5f - v) * 1.2f - 0.11f, vz = 1.0f;
    float il = 1.0f / len3(vx, vy, vz), r = 0.0f, g = 0.0f, b = 0.0f;
    vx *= il;
    vy *= il;
    vz *= il;
    float cx = y * vz - z * vy, cy = z * vx - x * vz, cz = x * vy - y * vx;
    float h2 = cx * cx + cy * cy + cz * cz;
    int fell = 0;
    for (UNI int i = 0; i < 90; i++) {
        float q = x * x + y * y + z * z;
        if (q < 1.0f) {
            fell = 1;
            break;
        }
        if (q > 120.0f) break;
        float k = -1.5f * d[1] * h2 / (q * q * sqrtf(q)), step = 0.12f + 0.012f * q, oy = y;
        if (step > 0.5f) step = 0.5f;
        vx += step * k * x;
        vy += step * k * y;
        vz += step * k * z;
        x += step * vx;
        y += step * vy;
        z += step * vz;
        if (oy * y < 0.0f) {
            float rho = len2(x, z);
            if (rho > 2.2f && rho < 6.0f) {
                float e = expf(-0.5f * (rho - 2.2f)) * (0.7f + 0.3f * sinf(9.0f * rho));
                r += 1.4f * e;
                g += 0.8f * e;
                b += 0.4f * e;
            }
        }
    }
    if (fell == 0) {
        float s = 0.1f + 0.1f * vy;
        r += s;
        g += s;
        b += 2.0f * s;
    }
    return pack(r, g, b);
}
KERNEL(hole)

/* 24 triangles {three corners x, y, z}, the nearest is seen */
INL uint32_t px_triangles(float u, float v, DATA d) {
    float depth = 1e9f, r = 0.1f, g = 0.12f, b = 0.15f;
    for (UNI int i = 0; i < 24; i++) {
        UNI const float ax = d[9 * i], ay = d[9 * i + 1], az = d[9 * i + 2], bx = d[9 * i + 3], by = d[9 * i + 4];
        UNI const float bz = d[9 * i + 5], cx = d[9 * i + 6], cy = d[9 * i + 7], cz = d[9 * i + 8];
        UNI const float area = (bx - ax) * (cy - ay) - (by - ay) * (cx - ax);
        float p = ((bx - u) * (cy - v) - (by - v) * (cx - u)) / area;
        float q = ((cx - u) * (ay - v) - (cy - v) * (ax - u)) / area;
        float s = 1.0f - p - q;
        if (p >= 0.0f && q >= 0.0f && s >= 0.0f) {
            float z = p * az + q * bz + s * cz;
            if (z < depth) {
                depth = z;
                r = p;
                g = q;
                b = s;
            }
        }
    }
    return pack(r, g, b);
}
KERNEL(triangles)

/* Smoke of noise whose hash is that of sines; d = {time} */
INL float sine_hash(float x, float y) { return fract(sinf(x * 12.9898f + y * 78.233f) * 437.5453f); }
INL float sine_noise(float x, float y) {
    float ix = floorf(x), iy = floorf(y);
    float fx = x - ix, fy = y - iy;
    fx = fx * fx * (3.0f - 2.0f * fx);
    fy = fy * fy * (3.0f - 2.0f * fy);
    return mix(mix(sine_hash(ix, iy), sine_hash(ix + 1.0f, iy), fx),
               mix(sine_hash(ix, iy + 1.0f), sine_hash(ix + 1.0f, iy + 1.0f), fx), fy);
}
INL float smoke_fbm(float x, float y) {
    float s = 0.0f, a = 0.5f;
    for (UNI int i = 0; i < 4; i++) {
        s += a * sine_noise(x, y);
        float t = 1.6f * x + 1.2f * y;
        y = 1.6f * y - 1.2f * x;
        x = t;
        a *= 0.5f;
    }
    return s;
}
INL uint32_t px_smoke(float u, float v, DATA d) {
    float x = 4.0f * u, y = 4.0f * v;
    float qx = smoke_fbm(x, y + d[0]), qy = smoke_fbm(x + 5.2f, y + 1.3f);
    float f = smoke_fbm(x + 3.0f * qx, y + 3.0f * qy + 0.5f * d[0]);
    float k = clamp01(f * f * 3.0f);
    return pack(mix(0.1f, 0.95f, k), mix(0.15f + 0.3f * qx, 0.8f, k), mix(0.3f + 0.3f * qy, 0.7f, k));
}
KERNEL(smoke)

/* Gabor's noise: in every cell two kernels, a wave in a Gaussian; d = {cells, frequency, angle} */
INL uint32_t px_gabor(float u, float v, DATA d) {
    float x = u * d[0], y = v * d[0];
    float flx = floorf(x), fly = floorf(y), sum = 0.0f;
    for (UNI int j = -1; j <= 1; j++)
        for (UNI int i = -1; i <= 1; i++) {
            uint32_t h = hash2((int)flx + i, (int)fly + j);
            for (UNI int k = 0; k < 2; k++) {
                float px = (float)(int)(h & 255u) * (1.0f / 256.0f),
                      py = (float)(int)((h >> 8) & 255u) * (1.0f / 256.0f);
                float w = (h & 0x10000u) != 0u ? 1.0f : -1.0f, a = d[2] + (float)(int)((h >> 17) & 63u) * 0.01f;
                float ex = x - flx - (float)i - px, ey = y - fly - (float)j - py;
                sum += w * expf(-3.0f * (ex * ex + ey * ey)) * cosf(d[1] * (ex * cosf(a) + ey * sinf(a)));
                h = h * 1664525u + 1013904223u;
            }
        }
    float s = 0.5f + 0.35f * sum;
    return pack(s, 0.9f * s + 0.05f, 0.7f * s + 0.1f);
}
KERNEL(gabor)

/* Sunflower: the nearest of seeds in a spiral of golden angles; d = {seeds} */
INL uint32_t px_seeds(float u, float v, DATA d) {
    float x = 2.0f * u - 1.0f, y = 2.0f * v - 1.0f;
    float n = (x * x + y * y) * d[0], best = 1e9f, which = 0.0f;
    float first = floorf(n - 18.0f);
    for (UNI int i = 0; i < 36; i++) {
        float k = first + (float)i;
        if (k < 0.0f) continue;
        float r = sqrtf((k + 0.5f) / d[0]), a = 2.3999632f * k;
        float q = sq(x - r * cosf(a)) + sq(y - r * sinf(a));
        if (q < best) {
            best = q;
            which = k;
        }
    }
    float s = sqrtf(best * d[0]);
    float disc = 1.0f - smooth(0.6f, 0.75f, s), t = which / d[0];
    return pack(mix(0.1f, 0.9f - 0.3f * t, disc), mix(0.08f, 0.7f * t + 0.2f * s, disc), mix(0.05f, 0.1f, disc));
}
KERNEL(seeds)

/* Where a comet is at a time: Kepler's equation, by Newton; d = {eccentricity} */
INL uint32_t px_kepler(float u, float v, DATA d) {
    float mean = 6.2831853f * u, e = 0.97f * v * d[0];
    float E = mean + 0.85f * e;
    for (UNI int i = 0; i < 6; i++) E -= (E - e * sinf(E) - mean) / (1.0f - e * cosf(E));
    float x = cosf(E) - e, y = sqrtf(1.0f - e * e) * sinf(E), r = 1.0f - e * cosf(E);
    return pack(0.5f + 0.25f * x, 0.5f + 0.5f * y, 0.2f / r);
}
KERNEL(kepler)

/* A ball of glass over a chequered floor: what it reflects and refracts, by Fresnel; d = {index} */
INL float glass_scene(float y, float rx, float ry, float rz, float x, float z) {
    if (ry >= -1e-3f) return 0.7f + 0.3f * ry;
    float t = -(y + 1.0f) / ry;
    float fx = floorf(x + t * rx), fz = floorf(z + t * rz);
    float f = fx + fz;
    float k = f - 2.0f * floorf(0.5f * f) > 0.5f ? 0.85f : 0.15f;
    return mix(0.7f, k, expf(-0.05f * t));
}
INL float schlick(float c, float f0) {
    float m = 1.0f - c;
    return f0 + (1.0f - f0) * m * m * m * m * m;
}
INL uint32_t px_glass(float u, float v, DATA d) {
    float rx = (u - 0.5f) * 1.2f, ry = (0.5f - v) * 1.2f - 0.15f, rz = 1.2f;
    float il = 1.0f / len3(rx, ry, rz);
    const float oy = 0.5f, oz = -3.5f;
    rx *= il;
    ry *= il;
    rz *= il;
    float p = oy * ry + oz * rz;
    float q = p * p - (oy * oy + oz * oz - 1.0f);
    if (q < 0.0f) {
        float s = glass_scene(oy, rx, ry, rz, 0.0f, oz);
        return pack(s, s, 0.1f + 0.9f * s);
    }
    float t = -p - sqrtf(q);
    float x = t * rx, y = oy + t * ry, z = oz + t * rz;
    float c = -(x * rx + y * ry + z * rz);
    float f0 = sq((d[0] - 1.0f) / (d[0] + 1.0f));
    float F = schlick(c, f0);
    float mirror = glass_scene(y, rx + 2.0f * c * x, ry + 2.0f * c * y, rz + 2.0f * c * z, x, z), through = 0.0f,
          w = 1.0f;
    float eta = 1.0f / d[0];
    float k = eta * c - sqrtf(1.0f - eta * eta * (1.0f - c * c));
    rx = eta * rx + k * x;
    ry = eta * ry + k * y;
    rz = eta * rz + k * z;
    for (UNI int i = 0; i < 4; i++) {
        float s = -2.0f * (x * rx + y * ry + z * rz);
        x += s * rx;
        y += s * ry;
        z += s * rz;
        float o = x * rx + y * ry + z * rz;
        float m = 1.0f - d[0] * d[0] * (1.0f - o * o), f = 1.0f;
        if (m > 0.0f) {
            float n = sqrtf(m);
            f = schlick(n, f0);
            float g = n - d[0] * o;
            through += w * (1.0f - f) * glass_scene(y, d[0] * rx + g * x, d[0] * ry + g * y, d[0] * rz + g * z, x, z);
        }
        w *= f;
        if (w < 0.01f) break;
        rx -= 2.0f * o * x;
        ry -= 2.0f * o * y;
        rz -= 2.0f * o * z;
    }
    float s = mix(through, mirror, F);
    return pack(0.95f * s, s, 0.1f + 0.9f * s);
}
KERNEL(glass)
