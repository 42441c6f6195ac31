#include "exact/det.h"

#include <gmp.h>
#include <math.h>

/* Entries are exact in a double. Each of the six products is rounded twice and the sum five times, so the error is below
 * 7 * 2^-53 times the sum of the absolute products; 2^-49 leaves room for rounding in the bound itself. */
static const double bound = 0x1p-49;

static void mpz_set_i64(mpz_t z, int64_t x) { mpz_set_si(z, (long)x); }
_Static_assert(sizeof(long) == sizeof(int64_t), "GMP's signed longs hold grid values");

int bw_det3_sign_exact(const int64_t a[3], const int64_t b[3], const int64_t c[3]) {
    mpz_t sum, term, factor;
    mpz_inits(sum, term, factor, NULL);
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        __int128 minor = (__int128)b[j] * c[k] - (__int128)b[k] * c[j];
        uint64_t low = (uint64_t)minor;
        mpz_set_i64(term, (int64_t)(minor >> 64));
        mpz_mul_2exp(term, term, 64);
        mpz_import(factor, 1, -1, sizeof low, 0, 0, &low);
        mpz_add(term, term, factor);
        mpz_set_i64(factor, a[i]);
        mpz_addmul(sum, term, factor);
    }
    int sign = mpz_sgn(sum);
    mpz_clears(sum, term, factor, NULL);
    return sign;
}

int bw_det3_sign(const int64_t a[3], const int64_t b[3], const int64_t c[3]) {
    double sum = 0, size = 0;
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        double p = (double)a[i] * (double)b[j] * (double)c[k], q = (double)a[i] * (double)b[k] * (double)c[j];
        sum += p - q;
        size += fabs(p) + fabs(q);
    }
    if (sum > bound * size) return 1;
    if (sum < -bound * size) return -1;
    return bw_det3_sign_exact(a, b, c);
}
