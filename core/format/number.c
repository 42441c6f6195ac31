#include "format/number.h"

#include <assert.h>
#include <endian.h>
#include <gmp.h>
#include <pthread.h>
#include <string.h>

typedef unsigned __int128 u128;

enum {
    TEN_MIN = -342, /* 10^19 * 10^-343 is less than half the smallest subnormal */
    TEN_MAX = 324,  /* reading needs 308, printing subnormals 324 */
    EXACT_TEN = 55, /* 5^55 < 2^128: these powers of ten are exact in the table */
    DIGITS = 19     /* decimal digits that always fit 64 bits */
};

/* 10^q = (bits + d) * 2^exponent, 2^127 <= bits < 2^128, 0 <= d < 1; d = 0 for 0 <= q <= EXACT_TEN. */
typedef struct {
    u128 bits;
    int exponent;
} ten;

static ten ten_table[TEN_MAX - TEN_MIN + 1];
static pthread_once_t ten_once = PTHREAD_ONCE_INIT;

static u128 u128_of(const mpz_t z) {
    uint64_t word[2] = {0, 0};
    mpz_export(word, NULL, -1, sizeof *word, 0, 0, z);
    return (u128)word[1] << 64 | word[0];
}

static void ten_fill(void) {
    mpz_t five, z;
    mpz_inits(five, z, NULL);
    for (int q = TEN_MIN; q <= TEN_MAX; q++) {
        ten *t = &ten_table[q - TEN_MIN];
        mpz_ui_pow_ui(five, 5, (unsigned long)(q < 0 ? -q : q));
        int n = (int)mpz_sizeinbase(five, 2);
        if (q < 0) {
            mpz_setbit(z, (mp_bitcnt_t)n + 127);
            mpz_tdiv_q(z, z, five);
            t->exponent = q - n - 127;
        } else {
            if (n <= 128) mpz_mul_2exp(z, five, (mp_bitcnt_t)(128 - n));
            else mpz_tdiv_q_2exp(z, five, (mp_bitcnt_t)(n - 128));
            t->exponent = q + n - 128;
        }
        t->bits = u128_of(z);
        mpz_set_ui(z, 0);
    }
    mpz_clears(five, z, NULL);
}

static const ten *ten_power(int64_t q) { return &ten_table[q - TEN_MIN]; }

/* ---- rounding ----------------------------------------------------------------------------------------------- */

static const uint64_t infinity = (uint64_t)0x7ff << 52;

static double from_bits(uint64_t bits) {
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static int clz128(u128 m) {
    uint64_t high = (uint64_t)(m >> 64);
    return high ? __builtin_clzll(high) : 64 + __builtin_clzll((uint64_t)m);
}

/* Bits of the double nearest to (m + f) * 2^e, ties to even, where f = 0, or 0 < f < 1 if `more`. m > 0. */
static uint64_t round_bits(u128 m, int64_t e, bool more) {
    int zeros = clz128(m);
    m <<= zeros;
    int64_t top = e - zeros + 127; /* 2^top <= value < 2^(top + 1) */
    if (top > 1023) return infinity;
    if (top < -1075) return 0;
    int precision = top >= -1022 ? 53 : (int)(top + 1075); /* bits kept; 0 just under the smallest subnormal */
    u128 rest = m << precision, half = (u128)1 << 127;
    uint64_t kept = precision ? (uint64_t)(m >> (128 - precision)) : 0;
    kept += rest > half || (rest == half && (more || (kept & 1)));
    return top >= -1022 ? ((uint64_t)(top + 1022) << 52) + kept : kept; /* a carry moves on into the exponent */
}

/* Are all numbers in [low, high] * 2^e rounded to the same double? Gives it. */
static bool round_interval(u128 low, u128 high, int64_t e, uint64_t *bits) {
    *bits = round_bits(low, e, false);
    return *bits == round_bits(high, e, false);
}

/* Nearest to num / den, both positive. Destroys them. */
static uint64_t round_ratio(mpz_t num, mpz_t den) {
    int64_t shift = 100 - ((int64_t)mpz_sizeinbase(num, 2) - (int64_t)mpz_sizeinbase(den, 2));
    if (shift > 0) mpz_mul_2exp(num, num, (mp_bitcnt_t)shift);
    else mpz_mul_2exp(den, den, (mp_bitcnt_t)-shift);
    mpz_tdiv_qr(num, den, num, den); /* the quotient has 100 or 101 bits */
    return round_bits(u128_of(num), -shift, mpz_sgn(den) != 0);
}

/* ---- digits ------------------------------------------------------------------------------------------------- */

typedef struct {
    uint64_t mantissa; /* the first DIGITS digits, leading zeros not counted */
    int room;          /* digits that still fit */
} digits;

static bool is_digit(char c) { return (unsigned char)(c - '0') < 10; }

static uint64_t eight(const char *p) {
    uint64_t v;
    memcpy(&v, p, 8);
    return le64toh(v);
}

static bool eight_are_digits(uint64_t v) {
    return !(((v + 0x4646464646464646u) | (v - 0x3030303030303030u)) & 0x8080808080808080u);
}

static uint64_t eight_value(uint64_t v) {
    v -= 0x3030303030303030u;
    v = v * 10 + (v >> 8);
    return (((v & 0x000000ff000000ffu) * 0x000f424000000064u + (v >> 16 & 0x000000ff000000ffu) * 0x0000271000000001u) >> 32);
}

/* Reads a run of digits; what fits goes into d, *taken is one past the last digit that did (or is a leading zero). */
static const char *take_run(const char *p, const char *end, digits *d, const char **taken) {
    if (!d->mantissa)
        while (p < end && *p == '0') p++;
    for (uint64_t v; d->room >= 8 && end - p >= 8 && eight_are_digits(v = eight(p)); p += 8) {
        d->mantissa = d->mantissa * 100000000 + eight_value(v);
        d->room -= 8;
    }
    for (; d->room > 0 && p < end && is_digit(*p); p++) {
        d->mantissa = d->mantissa * 10 + (uint64_t)(*p - '0');
        d->room--;
    }
    *taken = p;
    while (end - p >= 8 && eight_are_digits(eight(p))) p += 8;
    while (p < end && is_digit(*p)) p++;
    return p;
}

static uint64_t power_of_ten(int n) { /* n <= 19 */
    uint64_t v = 1;
    while (n-- > 0) v *= 10;
    return v;
}

/* All digits in [p, end) as one integer; a point among them is passed over. */
static void take_all(mpz_t z, const char *p, const char *end) {
    mpz_set_ui(z, 0);
    while (p < end) {
        uint64_t chunk = 0;
        int n = 0;
        for (; p < end && n < DIGITS; p++)
            if (is_digit(*p)) chunk = chunk * 10 + (uint64_t)(*p - '0'), n++;
        mpz_mul_ui(z, z, power_of_ten(n));
        mpz_add_ui(z, z, chunk);
    }
}

/* ---- decimals ----------------------------------------------------------------------------------------------- */

/* mantissa * 10^exponent; with `cut`, more digits follow the mantissa's. They are all in [first, last). */
typedef struct {
    const char *first, *last;
    uint64_t mantissa;
    int64_t exponent;
    int64_t cut_digits;
} decimal;

static uint64_t decimal_exact(const decimal *d) {
    mpz_t num, den, scale;
    mpz_inits(num, den, scale, NULL);
    take_all(num, d->first, d->last);
    int64_t exponent = d->exponent - d->cut_digits;
    mpz_set_ui(den, 1);
    mpz_ui_pow_ui(scale, 10, (unsigned long)(exponent < 0 ? -exponent : exponent));
    mpz_mul(exponent < 0 ? den : num, exponent < 0 ? den : num, scale);
    uint64_t bits = round_ratio(num, den);
    mpz_clears(num, den, scale, NULL);
    return bits;
}

/* With w the mantissa moved up to 64 bits by z places and t = 10^exponent from the table, P = w * t.bits has 192 bits.
 * What the digits say lies in [P, (w + 2^z) * (t.bits + 1)), where 2^z stands for the digits cut off. In units of 2^64
 * that is at most floor(P / 2^64) + 2 + 2^(64 + z). */
static uint64_t decimal_bits(const decimal *d) {
    bool cut = d->cut_digits > 0;
    if (!d->mantissa) return 0;
    if (!cut && d->mantissa <= (uint64_t)1 << 53 && d->exponent >= -22 && d->exponent <= 22) {
        static const double exact[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                       1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};
        double m = (double)d->mantissa; /* both exact: one rounding */
        m = d->exponent < 0 ? m / exact[-d->exponent] : m * exact[d->exponent];
        uint64_t bits;
        memcpy(&bits, &m, sizeof bits);
        return bits;
    }
    if (d->exponent < TEN_MIN) return 0;
    if (d->exponent > 308) return infinity;
    const ten *t = ten_power(d->exponent);
    int z = __builtin_clzll(d->mantissa);
    uint64_t w = d->mantissa << z, bits;
    u128 low = (u128)w * (uint64_t)t->bits, product = (u128)w * (uint64_t)(t->bits >> 64) + (low >> 64), bound;
    int64_t e = t->exponent + 64 - z;
    if (!cut && d->exponent >= 0 && d->exponent <= EXACT_TEN) return round_bits(product, e, (uint64_t)low != 0);
    u128 width = 2 + (cut ? (u128)1 << (64 + z) : 0);
    if (!__builtin_add_overflow(product, width, &bound) && round_interval(product, bound, e, &bits)) return bits;
    return decimal_exact(d);
}

static int64_t read_exponent(const char **at, const char *end, bool *valid) {
    const char *p = *at;
    bool negative = p < end && *p == '-';
    if (p < end && (*p == '-' || *p == '+')) p++;
    *valid = p < end && is_digit(*p);
    int64_t value = 0;
    for (; p < end && is_digit(*p); p++)
        if (value < 100000000) value = value * 10 + (*p - '0'); /* beyond that it is zero or infinite anyway */
    *at = p;
    return negative ? -value : value;
}

/* The rest of a decimal whose whole digits [whole, p) are read. */
static bw_number_status read_decimal(const char **at, const char *end, const char *whole, digits m, const char *taken,
                                     uint64_t *bits) {
    const char *p = *at, *after = p;
    decimal d = {.first = whole, .cut_digits = p - taken, .exponent = p - taken};
    bool some = p > whole;
    if (p < end && *p == '.') {
        const char *fraction = ++p;
        p = take_run(fraction, end, &m, &after);
        some |= p > fraction;
        d.exponent -= after - fraction;
        d.cut_digits += p - after;
    }
    d.last = p;
    d.mantissa = m.mantissa;
    bool valid = some;
    if (some && p < end && (*p == 'e' || *p == 'E')) {
        p++;
        d.exponent += read_exponent(&p, end, &valid);
    }
    *at = p;
    if (!valid) return BW_NUMBER_SYNTAX;
    *bits = decimal_bits(&d);
    return BW_NUMBER_OK;
}

/* ---- rationals ---------------------------------------------------------------------------------------------- */

/* A run of digits: its first DIGITS in mantissa, the others in [taken, last). */
typedef struct {
    const char *first, *taken, *last;
    uint64_t mantissa;
} whole;

static bool whole_fits(const whole *w) { return w->last - w->taken <= DIGITS; } /* < 10^38 < 2^127 */

static u128 whole_value(const whole *w) {
    digits rest = {0, DIGITS};
    const char *taken;
    if (w->taken == w->last) return w->mantissa;
    take_run(w->taken, w->last, &rest, &taken);
    return (u128)w->mantissa * power_of_ten((int)(w->last - w->taken)) + rest.mantissa;
}

/* p/q for p, q < 2^127, from their leading 64 bits; false if those do not decide. */
static bool rational_leading(u128 p, u128 q, uint64_t *bits) {
    int zp = clz128(p), zq = clz128(q);
    u128 p_low = (p << zp) >> 64, q_low = (q << zq) >> 64;
    u128 p_high = p_low + ((uint64_t)(p << zp) != 0), q_high = q_low + ((uint64_t)(q << zq) != 0);
    u128 low = (p_low << 63) / q_high, high = (p_high << 63) / q_low;
    return round_interval(low, high + 1, (int64_t)zq - zp - 63, bits);
}

static uint64_t rational_bits(const whole *num, const whole *den) {
    if (!num->mantissa) return 0;
    if (num->taken == num->last && den->taken == den->last) {
        uint64_t p = num->mantissa, q = den->mantissa, bits;
        if (p <= (uint64_t)1 << 53 && q <= (uint64_t)1 << 53) {
            double value = (double)p / (double)q; /* both exact: one rounding */
            memcpy(&bits, &value, sizeof bits);
            return bits;
        }
        int zeros = __builtin_clzll(p);
        u128 high = (u128)p << (64 + zeros); /* the quotient has 64 bits or more */
        return round_bits(high / q, -64 - zeros, high % q != 0);
    }
    uint64_t bits;
    if (whole_fits(num) && whole_fits(den) && rational_leading(whole_value(num), whole_value(den), &bits)) return bits;
    mpz_t p, q;
    mpz_inits(p, q, NULL);
    take_all(p, num->first, num->last);
    take_all(q, den->first, den->last);
    bits = round_ratio(p, q);
    mpz_clears(p, q, NULL);
    return bits;
}

static bw_number_status read_rational(const char **at, const char *end, const whole *num, uint64_t *bits) {
    const char *p = *at + 1; /* past the bar */
    digits m = {0, DIGITS};
    whole den = {.first = p};
    p = take_run(p, end, &m, &den.taken);
    den.last = *at = p;
    den.mantissa = m.mantissa;
    if (den.first == p) return BW_NUMBER_SYNTAX;
    if (!den.mantissa) return BW_NUMBER_ZERO_DIVISOR;
    *bits = rational_bits(num, &den);
    return BW_NUMBER_OK;
}

/* ---- reading ------------------------------------------------------------------------------------------------ */

static bool names_non_number(const char *p, const char *end) {
    return end - p >= 3 && (!strncasecmp(p, "nan", 3) || !strncasecmp(p, "inf", 3));
}

bw_number_status bw_number_read(const char **at, const char *end, double *value) {
    pthread_once(&ten_once, ten_fill);
    const char *p = *at, *limit = end - p > BW_NUMBER_LENGTH ? p + BW_NUMBER_LENGTH : end;
    bool negative = p < limit && *p == '-';
    if (p < limit && (*p == '-' || *p == '+')) p++;
    digits m = {0, DIGITS};
    whole num = {.first = p};
    uint64_t bits = 0;
    *at = take_run(p, limit, &m, &num.taken);
    num.last = *at;
    num.mantissa = m.mantissa;
    bw_number_status status = *at > p && *at < limit && **at == '/'
                                  ? read_rational(at, limit, &num, &bits)
                                  : read_decimal(at, limit, p, m, num.taken, &bits);
    if (*at == limit && limit < end) return BW_NUMBER_LENGTHY;
    if (status == BW_NUMBER_SYNTAX) return names_non_number(p, end) ? BW_NUMBER_NOT_FINITE : BW_NUMBER_SYNTAX;
    if (status != BW_NUMBER_OK) return status;
    if (*at < end && !bw_is_blank(**at)) return BW_NUMBER_SYNTAX;
    if (bits >= infinity) return BW_NUMBER_NOT_FINITE;
    *value = from_bits(bits | (uint64_t)negative << 63);
    return BW_NUMBER_OK;
}

bw_number_status bw_integer_read(const char **at, const char *end, int64_t *value) {
    const char *p = *at, *limit = end - p > BW_NUMBER_LENGTH ? p + BW_NUMBER_LENGTH : end;
    bool negative = p < limit && *p == '-';
    if (p < limit && (*p == '-' || *p == '+')) p++;
    const char *first = p;
    int64_t v = 0;
    for (; p < limit && is_digit(*p); p++)
        if (__builtin_mul_overflow(v, 10, &v) || __builtin_add_overflow(v, *p - '0', &v)) v = INT64_MAX;
    *at = p;
    if (p == limit && limit < end) return BW_NUMBER_LENGTHY;
    if (p == first || (p < end && !bw_is_blank(*p))) return BW_NUMBER_SYNTAX;
    *value = negative ? -v : v;
    return BW_NUMBER_OK;
}

/* ---- printing ----------------------------------------------------------------------------------------------- */

/* Schubfach (R. Giulietti, The Schubfach way to render doubles): the shortest decimal in the rounding interval of
 * c * 2^q. Section 9.5 bounds the table entries: 126 bits, rounded up. */
typedef struct {
    uint64_t mantissa;
    int exponent;
} shortest;

static int64_t floor_scaled(int64_t x, int64_t factor, int64_t add, int shift) { return (x * factor + add) >> shift; }

/* floor(g * c / 2^127), made odd if the product is not whole up to the table's error. */
static uint64_t multiply_to_odd(u128 g, uint64_t c) {
    u128 low = (u128)(uint64_t)g * c, high = (u128)(uint64_t)(g >> 64) * c + (low >> 64);
    uint64_t fraction = (uint64_t)high & (UINT64_MAX >> 1);
    return (uint64_t)(high >> 63) | (fraction != 0);
}

static shortest shorten(uint64_t c, int q) {
    const int64_t log10_2 = 661971961083, log10_34 = -274743187321, log2_10 = 913124641741;
    uint64_t out = c & 1, cb = c << 2, cb_right = cb + 2, cb_left = cb - 2;
    bool uneven = c == (uint64_t)1 << 52 && q > -1074; /* a power of two: the interval is half as wide below */
    if (uneven) cb_left = cb - 1;
    int k = (int)floor_scaled(q, log10_2, uneven ? log10_34 : 0, 41);
    int h = q + (int)floor_scaled(-k, log2_10, 0, 38) + 2;
    u128 g = (ten_power(-k)->bits >> 2) + 1;
    uint64_t v = multiply_to_odd(g, cb << h), left = multiply_to_odd(g, cb_left << h),
             right = multiply_to_odd(g, cb_right << h), s = v >> 2;
    if (s >= 10) {
        uint64_t s10 = s / 10 * 10, t10 = s10 + 10;
        bool under = left + out <= s10 << 2, over = (t10 << 2) + out <= right;
        if (under != over) return (shortest){under ? s10 : t10, k};
    }
    uint64_t t = s + 1;
    bool under = left + out <= s << 2, over = (t << 2) + out <= right;
    if (under != over) return (shortest){under ? s : t, k};
    uint64_t middle = (s + t) << 1;
    return (shortest){v < middle || (v == middle && !(s & 1)) ? s : t, k};
}

static int print_digits(uint64_t value, char text[20]) { /* most significant first; returns how many */
    char reversed[20];
    int n = 0;
    do reversed[n++] = (char)('0' + value % 10);
    while (value /= 10);
    for (int i = 0; i < n; i++) text[i] = reversed[n - 1 - i];
    return n;
}

static char *put(char *to, const char *from, int n) {
    memcpy(to, from, (size_t)n);
    return to + n;
}

static char *fill(char *to, int zeros) {
    memset(to, '0', (size_t)zeros);
    return to + zeros;
}

/* point: how many of the n digits stand before the decimal point (may be outside 0..n). */
static char *lay_out(char *p, const char *digit, int n, int point) {
    if (point > 0 && point <= 17) {
        if (point >= n) return fill(put(p, digit, n), point - n);
        p = put(p, digit, point);
        *p++ = '.';
        return put(p, digit + point, n - point);
    }
    if (point <= 0 && point > -5) return put(fill(put(p, "0.", 2), -point), digit, n);
    *p++ = digit[0];
    if (n > 1) *p++ = '.', p = put(p, digit + 1, n - 1);
    *p++ = 'e';
    if (point <= 0) *p++ = '-';
    char exponent[20];
    return put(p, exponent, print_digits((uint64_t)(point > 0 ? point - 1 : 1 - point), exponent));
}

size_t bw_number_print(double value, char text[BW_NUMBER_TEXT]) {
    pthread_once(&ten_once, ten_fill);
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    char *p = text, digit[20];
    if (bits >> 63) *p++ = '-';
    bits &= UINT64_MAX >> 1;
    assert(bits < infinity);
    if (!bits) {
        *p++ = '0';
    } else {
        int biased = (int)(bits >> 52);
        uint64_t c = bits & (((uint64_t)1 << 52) - 1);
        shortest s = shorten(biased ? c | (uint64_t)1 << 52 : c, biased ? biased - 1075 : -1074);
        int n = print_digits(s.mantissa, digit), point = n + s.exponent;
        while (digit[n - 1] == '0') n--;
        p = lay_out(p, digit, n, point);
    }
    *p = 0;
    return (size_t)(p - text);
}

size_t bw_integer_print(int64_t value, char text[BW_NUMBER_TEXT]) {
    char *p = text;
    if (value < 0) *p++ = '-';
    p += print_digits(value < 0 ? -(uint64_t)value : (uint64_t)value, p);
    *p = 0;
    return (size_t)(p - text);
}
