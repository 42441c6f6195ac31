/* Signs of determinants of grid vectors: floating point with a proven bound first, exact arithmetic where it does not decide. */
#ifndef BW_EXACT_DET_H
#define BW_EXACT_DET_H

#include <stdint.h>

/* Sign of det(a, b, c). Requires |entries| < 2^52 (every difference of two grid values is). */
int bw_det3_sign(const int64_t a[3], const int64_t b[3], const int64_t c[3]);
/* The same, always in exact arithmetic: what the tests hold the filter against. */
int bw_det3_sign_exact(const int64_t a[3], const int64_t b[3], const int64_t c[3]);

/* The same of doubles, rounded: its value. */
static inline double bw_det3_rounded(const double a[3], const double b[3], const double c[3]) {
    return a[0] * (b[1] * c[2] - b[2] * c[1]) - a[1] * (b[0] * c[2] - b[2] * c[0]) + a[2] * (b[0] * c[1] - b[1] * c[0]);
}

#endif
