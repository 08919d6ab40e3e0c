/* A lobe of GGX as a linearly transformed cosine (Heitz, Dupuy, Hill, Neubelt 2016), by an own table (ltc_table.inc,
 * which tests/bench/fit_ltc.c writes and whose error it measures).
 *
 * The lobe is D G2 / (4 n . view): GGX of alpha = roughness^2, isotropic, height-correlated Smith shadowing, no
 * Fresnel, the cosine included. It is amplitude / pi times the cosine about n of directions mapped by T, times the
 * Jacobian: so light against it is Lambert's of the mapped light. With s t the part of the view across n, t of unit
 * length,
 *
 *   M = [A 0 B; 0 C 0; D 0 E] in (t, n x t, n)    A = alpha (p0 + s^2 p1)  B = -s p2  C = alpha p0  D = alpha s p3  E =
 * p4
 *
 * and T = M^-1 up to a factor. p0 .. p4 and the amplitude p5 are smooth in roughness and cosine, also for small alpha
 * and where view and n agree: T depends on s t alone. */
#ifndef SALTUS_MESH_LTC_H
#define SALTUS_MESH_LTC_H

#include <stdbool.h>

enum { LTC_PARTS = 6, LTC_ROUGHNESSES = 24, LTC_COSINES = 32 };
#define LTC_LEAST 0.02 /* roughness; below counts as this, above 1 as 1 */

/* A number with its derivatives in n, view and roughness. */
enum { LTC_N = 0, LTC_VIEW = 3, LTC_ROUGHNESS = 6, LTC_SLOPES };
typedef struct LtcNumber {
    double v, d[LTC_SLOPES];
} LtcNumber;

typedef struct Ltc {
    LtcNumber map[3][3], amplitude;
} Ltc;

extern const double ltc_table[LTC_ROUGHNESSES][LTC_COSINES][LTC_PARTS];

/* p, and its derivatives in roughness and cosine: by cubics through the nodes, with continuous derivatives. */
void ltc_parts(double roughness, double cosine, double p[LTC_PARTS], double by_roughness[LTC_PARTS],
               double by_cosine[LTC_PARTS]);
/* n and view of unit length, view away from the surface. False: the view is below it, and nothing is seen. */
bool ltc_lobe(const double n[3], const double view[3], double roughness, Ltc *out);

#endif
