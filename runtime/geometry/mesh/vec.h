/* Vectors of three doubles. */
#ifndef SALTUS_MESH_VEC_H
#define SALTUS_MESH_VEC_H

static inline double vec_dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }

static inline void vec_cross(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* to += part * a */
static inline void vec_add(double to[3], double part, const double a[3]) {
    for (int i = 0; i < 3; i++) to[i] += part * a[i];
}

static inline void vec_minus(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = a[i] - b[i];
}

/* m a, and the transposed m times a. */
static inline void vec_map(const double m[3][3], const double a[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = vec_dot(m[i], a);
}

static inline void vec_back(const double m[3][3], const double a[3], double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = m[0][i] * a[0] + m[1][i] * a[1] + m[2][i] * a[2];
}

#endif
