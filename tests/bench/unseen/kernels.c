/* The second set of forward kernels, in scalar C; behind ../ispc.h the same text is ISPC. */
#include "../kernels.h"

/* Julia set with smooth colouring; d = {cx, cy, size} */
INL uint32_t px_julia(float u, float v, DATA d) {
    float zx = (u - 0.5f) * d[2], zy = (v - 0.5f) * d[2], m2 = 0.0f;
    int n = 0;
    for (UNI int i = 0; i < 200; i++) {
        float x2 = zx * zx, y2 = zy * zy;
        m2 = x2 + y2;
        if (m2 > 256.0f) break;
        zy = 2.0f * zx * zy + d[1];
        zx = x2 - y2 + d[0];
        n++;
    }
    if (n == 200) return pack(0.0f, 0.0f, 0.0f);
    float s = (float)n - log2f(log2f(m2)) + 4.0f;
    return pack(0.5f + 0.5f * cosf(3.0f + s * 0.15f), 0.5f + 0.5f * cosf(3.6f + s * 0.15f),
                0.5f + 0.5f * cosf(4.0f + s * 0.15f));
}
KERNEL(julia)

/* 2D distances joined smoothly, drawn with bands; d = {blend, round} */
INL float smin(float a, float b, float k) {
    float h = maxf(k - fabsf(a - b), 0.0f) / k;
    return minf(a, b) - h * h * k * 0.25f;
}
INL float sd_box(float x, float y, float hx, float hy) {
    float qx = fabsf(x) - hx, qy = fabsf(y) - hy;
    return len2(maxf(qx, 0.0f), maxf(qy, 0.0f)) + minf(maxf(qx, qy), 0.0f);
}
INL uint32_t px_sdf2d(float u, float v, DATA d) {
    float x = 2.0f * u - 1.0f, y = 2.0f * v - 1.0f;
    float s = sd_box(x + 0.4f, y + 0.3f, 0.3f, 0.2f) - d[1];
    s = smin(s, len2(x - 0.3f, y - 0.2f) - 0.35f, d[0]);
    s = smin(s, sd_segment(x, y, -0.6f, 0.6f, 0.5f, -0.6f) - 0.05f, d[0]);
    float rx = 0.8f * x - 0.6f * y, ry = 0.6f * x + 0.8f * y;
    s = maxf(s, -(sd_box(rx - 0.2f, ry - 0.1f, 0.15f, 0.1f) - 0.02f));
    float r = s > 0.0f ? 0.9f : 0.65f, g = s > 0.0f ? 0.6f : 0.85f, b = s > 0.0f ? 0.3f : 1.0f;
    float k = (1.0f - expf(-6.0f * fabsf(s))) * (0.8f + 0.2f * cosf(150.0f * s));
    float w = 1.0f - smooth(0.0f, 0.01f, fabsf(s));
    return pack(mix(r * k, 1.0f, w), mix(g * k, 1.0f, w), mix(b * k, 1.0f, w));
}
KERNEL(sdf2d)

/* Worley noise, F2 - F1; d = {scale} */
INL uint32_t px_worley(float u, float v, DATA d) {
    float x = u * d[0], y = v * d[0];
    float flx = floorf(x), fly = floorf(y);
    float fx = x - flx, fy = y - fly;
    int ix = (int)flx, iy = (int)fly;
    float f1 = 8.0f, f2 = 8.0f;
    for (UNI int j = -1; j <= 1; j++)
        for (UNI int i = -1; i <= 1; i++) {
            uint32_t h = hash2(ix + i, iy + j);
            float dx = (float)i + (float)(int)(h & 0xffffu) * (1.0f / 65536.0f) - fx;
            float dy = (float)j + (float)(int)(h >> 16) * (1.0f / 65536.0f) - fy;
            float q = dx * dx + dy * dy;
            if (q < f1) {
                f2 = f1;
                f1 = q;
            } else if (q < f2) {
                f2 = q;
            }
        }
    float e = sqrtf(f2) - sqrtf(f1);
    float c = smooth(0.0f, 0.15f, e);
    return pack(c * (1.0f - f1), c * 0.7f, 0.3f + 0.5f * e);
}
KERNEL(worley)

/* Warped noise on the hash of a sine; d = {scale, time} */
INL float sin_hash(float x, float y) { return fract(sinf(x * 12.71f + y * 31.17f) * 43.758547f); }
INL float value_noise(float x, float y) {
    float ix = floorf(x), iy = floorf(y);
    float fx = x - ix, fy = y - iy;
    float a = sin_hash(ix, iy), b = sin_hash(ix + 1.0f, iy), c = sin_hash(ix, iy + 1.0f),
          e = sin_hash(ix + 1.0f, iy + 1.0f);
    float ux = fx * fx * (3.0f - 2.0f * fx), uy = fy * fy * (3.0f - 2.0f * fy);
    return mix(mix(a, b, ux), mix(c, e, ux), uy);
}
INL float octaves(float x, float y) {
    float s = 0.0f, a = 0.5f;
    for (UNI int i = 0; i < 4; i++) {
        s += a * value_noise(x, y);
        float t = 1.6f * x + 1.2f * y;
        y = -1.2f * x + 1.6f * y;
        x = t;
        a *= 0.5f;
    }
    return s;
}
INL uint32_t px_warp(float u, float v, DATA d) {
    float x = u * d[0], y = v * d[0];
    float qx = octaves(x, y), qy = octaves(x + 5.2f + d[1], y + 1.3f);
    float f = octaves(x + 2.0f * qx, y + 2.0f * qy);
    return pack(mix(0.1f, 0.9f, f * f * 2.0f), mix(0.2f, 0.8f, qx * f), mix(0.4f, 0.6f, qy));
}
KERNEL(warp)

/* 32 metaballs {x, y, r}, lit by the slope of the field */
INL uint32_t px_metaballs(float u, float v, DATA d) {
    float f = 0.0f, gx = 0.0f, gy = 0.0f;
    for (UNI int i = 0; i < 32; i++) {
        float dx = u - d[3 * i], dy = v - d[3 * i + 1], r = d[3 * i + 2];
        float inv = 1.0f / (dx * dx + dy * dy + 1e-5f);
        float w = r * r * inv;
        f += w;
        gx -= 2.0f * w * inv * dx;
        gy -= 2.0f * w * inv * dy;
    }
    float a = smooth(0.95f, 1.05f, f);
    float l = 1.0f / sqrtf(gx * gx + gy * gy + 1.0f);
    float lit = clamp01((0.6f * gx + 0.5f * gy + 0.6f) * l);
    return pack(mix(0.05f, 0.2f + 0.8f * lit, a), mix(0.06f, 0.4f * lit + 0.1f, a), mix(0.1f, lit * lit, a));
}
KERNEL(metaballs)

/* The least distance to 12 quadratic curves {ax, ay, bx, by, cx, cy}, by the roots of a cubic */
INL float dot2(float x, float y) { return x * x + y * y; }
INL float sd_bezier(float px, float py, float ax, float ay, float bx, float by, float cx, float cy) {
    float Ax = bx - ax, Ay = by - ay, Bx = ax - 2.0f * bx + cx, By = ay - 2.0f * by + cy;
    float Cx = 2.0f * Ax, Cy = 2.0f * Ay, Dx = ax - px, Dy = ay - py;
    float kk = 1.0f / dot2(Bx, By);
    float kx = kk * (Ax * Bx + Ay * By);
    float ky = kk * (2.0f * dot2(Ax, Ay) + Dx * Bx + Dy * By) / 3.0f, kz = kk * (Dx * Ax + Dy * Ay);
    float p = ky - kx * kx;
    float p3 = p * p * p, q = kx * (2.0f * kx * kx - 3.0f * ky) + kz;
    float h = q * q + 4.0f * p3, res;
    if (h >= 0.0f) {
        h = sqrtf(h);
        float x0 = (h - q) * 0.5f, x1 = (-h - q) * 0.5f;
        float u0 = powf(fabsf(x0), 1.0f / 3.0f), u1 = powf(fabsf(x1), 1.0f / 3.0f);
        float t = clamp01((x0 < 0.0f ? -u0 : u0) + (x1 < 0.0f ? -u1 : u1) - kx);
        res = dot2(Dx + (Cx + Bx * t) * t, Dy + (Cy + By * t) * t);
    } else {
        float z = sqrtf(-p);
        float w = acosf(q / (p * z * 2.0f)) / 3.0f;
        float m = cosf(w), n = sinf(w) * 1.7320508f;
        float t0 = clamp01((m + m) * z - kx), t1 = clamp01((-n - m) * z - kx);
        res = minf(dot2(Dx + (Cx + Bx * t0) * t0, Dy + (Cy + By * t0) * t0),
                   dot2(Dx + (Cx + Bx * t1) * t1, Dy + (Cy + By * t1) * t1));
    }
    return res;
}
INL uint32_t px_bezier(float u, float v, DATA d) {
    float best = 1e9f;
    for (UNI int i = 0; i < 12; i++)
        best =
            minf(best, sd_bezier(u, v, d[6 * i], d[6 * i + 1], d[6 * i + 2], d[6 * i + 3], d[6 * i + 4], d[6 * i + 5]));
    float s = sqrtf(best);
    float ink = 1.0f - smooth(0.006f, 0.009f, s);
    return pack(mix(1.0f - s, 0.1f, ink), mix(0.97f - s, 0.1f, ink), mix(0.9f, 0.3f, ink));
}
KERNEL(bezier)

/* Plasma; d = {time} */
INL uint32_t px_plasma(float u, float v, DATA d) {
    float x = u * 10.0f - 5.0f, y = v * 10.0f - 5.0f, t = d[0];
    float s = sinf(x + t) + sinf(0.5f * (y + t)) + sinf(0.5f * (x + y + t));
    float cx = x + 5.0f * sinf(t * 0.2f), cy = y + 5.0f * cosf(t * 0.333f);
    s += sinf(sqrtf(cx * cx + cy * cy + 1.0f) + t);
    s *= 0.5f;
    return pack(0.5f + 0.5f * sinf(s * 3.14159f), 0.5f + 0.5f * sinf(s * 3.14159f + 2.1f),
                0.5f + 0.5f * cosf(s * 3.14159f));
}
KERNEL(plasma)

/* Eight spheres {x, y, z, r, red, green, blue, mirror} on a chequered floor, shadows and three bounces */
INL uint32_t px_spheres(float u, float v, DATA d) {
    float ox = 0.0f, oy = 1.2f, oz = -5.0f, rx = (u - 0.5f) * 1.4f, ry = (0.5f - v) * 1.4f - 0.15f, rz = 1.0f;
    float il = 1.0f / sqrtf(rx * rx + ry * ry + rz * rz);
    rx *= il;
    ry *= il;
    rz *= il;
    const float lx = 0.48f, ly = 0.76f, lz = -0.4385f;
    float cr = 0.0f, cg = 0.0f, cb = 0.0f, weight = 1.0f;
    for (UNI int bounce = 0; bounce < 3; bounce++) {
        float t = 1e9f, nx = 0.0f, ny = 1.0f, nz = 0.0f, kr = 0.0f, kg = 0.0f, kb = 0.0f, mirror = 0.0f;
        if (ry < 0.0f) {
            t = -oy / ry;
            float fx = floorf(ox + t * rx), fz = floorf(oz + t * rz);
            float odd = fx + fz - 2.0f * floorf((fx + fz) * 0.5f);
            kr = kg = kb = odd > 0.5f ? 0.8f : 0.25f;
            mirror = 0.15f;
        }
        for (UNI int i = 0; i < 8; i++) {
            float sx = ox - d[8 * i], sy = oy - d[8 * i + 1], sz = oz - d[8 * i + 2], r = d[8 * i + 3];
            float b = sx * rx + sy * ry + sz * rz, c = sx * sx + sy * sy + sz * sz - r * r;
            float q = b * b - c;
            if (q > 0.0f) {
                float s = -b - sqrtf(q);
                if (s > 1e-3f && s < t) {
                    t = s;
                    nx = (sx + s * rx) / r;
                    ny = (sy + s * ry) / r;
                    nz = (sz + s * rz) / r;
                    kr = d[8 * i + 4];
                    kg = d[8 * i + 5];
                    kb = d[8 * i + 6];
                    mirror = d[8 * i + 7];
                }
            }
        }
        if (t > 1e8f) {
            float s = weight * (0.5f + 0.5f * ry);
            cr += 0.5f * s;
            cg += 0.7f * s;
            cb += s;
            break;
        }
        ox += t * rx;
        oy += t * ry;
        oz += t * rz;
        float light = maxf(nx * lx + ny * ly + nz * lz, 0.0f);
        if (light > 0.0f) {
            for (UNI int i = 0; i < 8; i++) {
                float sx = ox - d[8 * i], sy = oy - d[8 * i + 1], sz = oz - d[8 * i + 2], r = d[8 * i + 3];
                float b = sx * lx + sy * ly + sz * lz, c = sx * sx + sy * sy + sz * sz - r * r;
                if (b < 0.0f && b * b > c && c > 1e-3f) {
                    light = 0.0f;
                    break;
                }
            }
        }
        float k = weight * (1.0f - mirror) * (0.15f + 0.85f * light);
        cr += k * kr;
        cg += k * kg;
        cb += k * kb;
        weight *= mirror;
        if (weight < 0.01f) break;
        float e = 2.0f * (rx * nx + ry * ny + rz * nz);
        rx -= e * nx;
        ry -= e * ny;
        rz -= e * nz;
        ox += 1e-3f * nx;
        oy += 1e-3f * ny;
        oz += 1e-3f * nz;
    }
    return pack(cr, cg, cb);
}
KERNEL(spheres)

/* Hexagonal tiles, each with its colour and a ring; d = {scale} */
INL float wrap(float x, float m) { return x - m * floorf(x / m); }
INL uint32_t px_hexes(float u, float v, DATA d) {
    float x = u * d[0], y = v * d[0];
    const float sx = 1.0f, sy = 1.7320508f;
    float ax = wrap(x, sx) - 0.5f * sx, ay = wrap(y, sy) - 0.5f * sy;
    float bx = wrap(x - 0.5f * sx, sx) - 0.5f * sx, by = wrap(y - 0.5f * sy, sy) - 0.5f * sy;
    float gx = ax, gy = ay;
    if (bx * bx + by * by < ax * ax + ay * ay) {
        gx = bx;
        gy = by;
    }
    int ix = (int)floorf((x - gx) * 2.0f + 0.5f), iy = (int)floorf((y - gy) * (2.0f / sy) + 0.5f);
    uint32_t h = hash2(ix, iy);
    float edge = 0.5f - maxf(fabsf(gx), 0.5f * fabsf(gx) + 0.8660254f * fabsf(gy));
    float ring = fabsf(len2(gx, gy) - 0.3f) - 0.04f;
    float line = smooth(0.0f, 0.03f, edge), r = smooth(0.02f, 0.0f, ring);
    float c = (float)(int)(h & 255u) * (1.0f / 255.0f), e = (float)(int)((h >> 8) & 255u) * (1.0f / 255.0f);
    return pack(line * mix(c, 1.0f, r), line * mix(e, 0.9f, r), line * mix(0.5f + 0.5f * c * e, 0.2f, r));
}
KERNEL(hexes)

/* Repeated rings of light in four folds; d = {time} */
INL uint32_t px_rings(float u, float v, DATA d) {
    float x = 2.0f * u - 1.0f, y = 2.0f * v - 1.0f;
    float l0 = len2(x, y);
    float e0 = expf(-l0), r = 0.0f, g = 0.0f, b = 0.0f;
    for (UNI int i = 0; i < 4; i++) {
        x = fract(x * 1.5f) - 0.5f;
        y = fract(y * 1.5f) - 0.5f;
        float s = len2(x, y) * e0, t = l0 + (float)i * 0.4f + d[0] * 0.4f;
        s = fabsf(sinf(s * 8.0f + d[0]) / 8.0f);
        s = powf(0.01f / s, 1.2f);
        r += s * (0.5f + 0.5f * cosf(6.28318f * (t + 0.263f)));
        g += s * (0.5f + 0.5f * cosf(6.28318f * (t + 0.416f)));
        b += s * (0.5f + 0.5f * cosf(6.28318f * (t + 0.557f)));
    }
    return pack(r, g, b);
}
KERNEL(rings)

/* A kaleidoscope: the plane folded by an angle, then by squares; d = {turn, zoom} */
INL uint32_t px_folds(float u, float v, DATA d) {
    float x = 2.0f * u - 1.0f, y = 2.0f * v - 1.0f;
    float r = len2(x, y), a = atan2f(y, x) + d[0];
    const float sector = 6.2831853f / 7.0f;
    a = fabsf(wrap(a, sector) - 0.5f * sector);
    x = r * cosf(a) * d[1];
    y = r * sinf(a) * d[1];
    float trap = 1e9f, c = cosf(d[0]), s = sinf(d[0]), scale = 1.0f;
    for (UNI int i = 0; i < 8; i++) {
        x = fabsf(x) - 0.7f;
        y = fabsf(y) - 0.4f;
        float t = c * x - s * y;
        y = (s * x + c * y) * 1.4f;
        x = t * 1.4f;
        scale *= 1.4f;
        trap = minf(trap, fabsf(x * x + y * y - 0.5f) / scale);
    }
    float k = expf(-4.0f * trap), p = len2(x, y) / scale;
    return pack(k * (0.5f + 0.5f * cosf(6.0f * p)), k * (0.5f + 0.5f * cosf(6.0f * p + 2.0f)),
                k * (0.5f + 0.5f * cosf(6.0f * p + 4.0f)));
}
KERNEL(folds)

/* A network of sines, 2 -> 24 -> 24 -> 3 */
INL uint32_t px_siren(float u, float v, DATA d) {
    float a[24], b[24], o[3];
    float x = u * 2.0f - 1.0f, y = v * 2.0f - 1.0f;
    for (UNI int j = 0; j < 24; j++) a[j] = sinf(20.0f * (d[2 * j] * x + d[2 * j + 1] * y + d[48 + j]));
    for (UNI int k = 0; k < 24; k++) {
        float s = d[648 + k];
        for (UNI int j = 0; j < 24; j++) s += d[72 + 24 * k + j] * a[j];
        b[k] = sinf(4.0f * s);
    }
    for (UNI int k = 0; k < 3; k++) {
        float s = 0.5f;
        for (UNI int j = 0; j < 24; j++) s += d[672 + 24 * k + j] * b[j];
        o[k] = s;
    }
    return pack(o[0], o[1], o[2]);
}
KERNEL(siren)

/* 64 Gaussians {x, y, a, b, c, opacity, red, green, blue}, front to back */
INL uint32_t px_splats(float u, float v, DATA d) {
    float T = 1.0f, r = 0.0f, g = 0.0f, b = 0.0f;
    for (UNI int i = 0; i < 64; i++) {
        float dx = u - d[9 * i], dy = v - d[9 * i + 1];
        float power = -0.5f * (d[9 * i + 2] * dx * dx + d[9 * i + 4] * dy * dy) - d[9 * i + 3] * dx * dy;
        if (power > 0.0f) continue;
        float alpha = minf(0.99f, d[9 * i + 5] * expf(power));
        if (alpha < 1.0f / 255.0f) continue;
        float next = T * (1.0f - alpha);
        if (next < 1e-4f) break;
        r += T * alpha * d[9 * i + 6];
        g += T * alpha * d[9 * i + 7];
        b += T * alpha * d[9 * i + 8];
        T = next;
    }
    return pack(r, g, b);
}
KERNEL(splats)

/* The Mandelbulb, marched; d = {turn} */
INL uint32_t px_bulb(float u, float v, DATA d) {
    float rx = (u - 0.5f) * 1.2f, ry = (0.5f - v) * 1.2f, rz = 1.0f;
    float il = 1.0f / sqrtf(rx * rx + ry * ry + rz * rz);
    float c = cosf(d[0]), s = sinf(d[0]);
    rx *= il;
    ry *= il;
    rz *= il;
    float ox = -2.6f * s, oz = -2.6f * c, k = c * rx + s * rz;
    rz = c * rz - s * rx;
    rx = k;
    float b = ox * rx + oz * rz;
    float q = b * b - (ox * ox + oz * oz - 1.5625f);
    if (q < 0.0f) return pack(0.1f, 0.1f, 0.15f + 0.2f * v);
    float t = -b - sqrtf(q), end = -b + sqrtf(q), trap = 1.0f;
    int steps = 0;
    for (UNI int i = 0; i < 24; i++) {
        float px = ox + t * rx, py = t * ry, pz = oz + t * rz;
        float x = px, y = py, z = pz, dr = 1.0f, r = 0.0f;
        trap = 1e9f;
        for (UNI int j = 0; j < 4; j++) {
            r = sqrtf(x * x + y * y + z * z);
            trap = minf(trap, r);
            if (r > 2.0f) break;
            float th = acosf(z / r) * 8.0f, ph = atan2f(y, x) * 8.0f, zr = powf(r, 8.0f);
            dr = powf(r, 7.0f) * 8.0f * dr + 1.0f;
            x = zr * sinf(th) * cosf(ph) + px;
            y = zr * sinf(th) * sinf(ph) + py;
            z = zr * cosf(th) + pz;
        }
        float e = 0.5f * logf(r) * r / dr;
        if (e < 0.002f) break;
        t += e;
        if (t > end) return pack(0.1f, 0.1f, 0.15f + 0.2f * v);
        steps++;
    }
    float ao = 1.0f - (float)steps * (1.0f / 24.0f);
    return pack(ao * trap, ao * (0.3f + 0.5f * trap), ao * (1.2f - trap));
}
KERNEL(bulb)

/* A march over heights of noise, lit and in fog; d = {x, z, height} */
INL float height_noise(float x, float y) {
    float flx = floorf(x), fly = floorf(y);
    float fx = x - flx, fy = y - fly;
    int ix = (int)flx, iy = (int)fly;
    float a = (float)(int)(hash2(ix, iy) & 0xffffu), b = (float)(int)(hash2(ix + 1, iy) & 0xffffu);
    float c = (float)(int)(hash2(ix, iy + 1) & 0xffffu), e = (float)(int)(hash2(ix + 1, iy + 1) & 0xffffu);
    float ux = fx * fx * (3.0f - 2.0f * fx), uy = fy * fy * (3.0f - 2.0f * fy);
    return mix(mix(a, b, ux), mix(c, e, ux), uy) * (1.0f / 65536.0f);
}
INL float height(float x, float y) {
    float s = 0.0f, a = 1.0f;
    for (UNI int i = 0; i < 3; i++) {
        s += a * height_noise(x, y);
        x = 2.1f * x + 7.3f;
        y = 2.1f * y - 3.1f;
        a *= 0.4f;
    }
    return s;
}
INL uint32_t px_terrain(float u, float v, DATA d) {
    float rx = (u - 0.5f) * 1.5f, ry = (0.5f - v) - 0.25f, rz = 1.0f;
    float il = 1.0f / sqrtf(rx * rx + ry * ry + rz * rz);
    rx *= il;
    ry *= il;
    rz *= il;
    float t = 0.2f, hit = 0.0f;
    for (UNI int i = 0; i < 48; i++) {
        float y = d[2] + t * ry, h = height(d[0] + t * rx, d[1] + t * rz);
        float gap = y - h;
        if (gap < 0.002f * t) {
            hit = 1.0f;
            break;
        }
        t += 0.4f * gap + 0.01f;
        if (t > 20.0f || y > 2.0f) break;
    }
    float sr = 0.5f + 0.2f * ry, sg = 0.65f, sb = 0.85f + 0.15f * ry;
    if (hit == 0.0f) return pack(sr, sg, sb);
    float x = d[0] + t * rx, z = d[1] + t * rz, e = 0.01f + 0.002f * t;
    float h0 = height(x, z);
    float nx = h0 - height(x + e, z), nz = h0 - height(x, z + e);
    float n = 1.0f / sqrtf(nx * nx + nz * nz + e * e);
    float l = maxf((0.6f * nx + 0.5f * e - 0.6f * nz) * n, 0.0f), fog = 1.0f - expf(-0.01f * t * t);
    float snow = smooth(0.7f, 0.9f, h0 * e * n);
    return pack(mix(mix(0.35f, 0.9f, snow) * (0.2f + l), sr, fog), mix(mix(0.3f, 0.9f, snow) * (0.2f + l), sg, fog),
                mix(mix(0.2f, 0.95f, snow) * (0.25f + l), sb, fog));
}
KERNEL(terrain)

/* A chequered plane to the horizon, filtered; d = {x, z, turn} */
INL float check_filter(float x, float y, float w) {
    float ix = 2.0f * (fabsf(fract((x - 0.5f * w) * 0.5f) - 0.5f) - fabsf(fract((x + 0.5f * w) * 0.5f) - 0.5f)) / w;
    float iy = 2.0f * (fabsf(fract((y - 0.5f * w) * 0.5f) - 0.5f) - fabsf(fract((y + 0.5f * w) * 0.5f) - 0.5f)) / w;
    return 0.5f - 0.5f * ix * iy;
}
INL uint32_t px_floor(float u, float v, DATA d) {
    float x = (u - 0.5f) * 1.6f, y = 0.4f - v;
    if (y > -0.002f) return pack(0.6f - 0.4f * y, 0.75f - 0.3f * y, 0.95f);
    float t = -1.0f / y, c = cosf(d[2]), s = sinf(d[2]);
    float px = d[0] + t * (c * x + s), pz = d[1] + t * (c - s * x), w = 0.0016f * t * t + 0.002f;
    float k = check_filter(px, pz, w), fog = expf(-0.04f * t);
    return pack(mix(0.6f, 0.1f + 0.8f * k, fog), mix(0.75f, 0.15f + 0.7f * k, fog), mix(0.95f, 0.2f + 0.6f * k, fog));
}
KERNEL(floor)

/* Truchet tiles of arcs; d = {scale, width} */
INL uint32_t px_truchet(float u, float v, DATA d) {
    float x = u * d[0], y = v * d[0];
    float flx = floorf(x), fly = floorf(y);
    float fx = x - flx, fy = y - fly;
    if ((hash2((int)flx, (int)fly) & 1u) != 0u) fx = 1.0f - fx;
    float a = len2(fx, fy), b = len2(fx - 1.0f, fy - 1.0f);
    float s = fabsf(minf(a, b) - 0.5f) - d[1];
    float l = smooth(-0.02f, 0.02f, s);
    float shade = 0.6f + 0.4f * s;
    return pack(mix(0.9f * shade, 0.1f, l), mix(0.5f * shade, 0.15f, l), mix(0.2f, 0.3f + 0.1f * shade, l));
}
KERNEL(truchet)
