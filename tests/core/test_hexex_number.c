/* Text to the nearest double and back, against glibc's correctly rounded strtod and against exact GMP rationals. */
#include "kit/kit.h"

#include <gmp.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format/number.h"

static uint64_t bits_of(double v) {
    uint64_t bits;
    memcpy(&bits, &v, sizeof bits);
    return bits;
}

static double read_whole(const char *text) {
    double value = NAN;
    const char *at = text, *end = text + strlen(text);
    bw_number_status status = bw_number_read(&at, end, &value);
    if (status != BW_NUMBER_OK || at != end) fail_msg("%.80s: status %d at byte %zu", text, status, (size_t)(at - text));
    return value;
}

static void expect_like_strtod(const char *text) {
    double expected = strtod(text, NULL), value = read_whole(text);
    if (bits_of(value) != bits_of(expected)) fail_msg("%.100s: read %a, nearest is %a", text, value, expected);
}

static void expect_status(const char *text, bw_number_status expected) {
    double value = 7;
    const char *at = text;
    bw_number_status status = bw_number_read(&at, text + strlen(text), &value);
    if (status != expected) fail_msg("%.80s: status %d, expected %d", text, status, expected);
    assert_true(value == 7);
}

static void hard_decimals_are_read_to_the_nearest_double(void **state) {
    (void)state;
    static const char *const hard[] = {
        "0", "-0", "0.0", "1", "-1", ".5", "5.", "1e0", "1E+5", "1e-5", "+3.25", "000001.5000", "0e9999", "123456789012345678",
        "9007199254740993", "9007199254740991", "9007199254740992.999999999999999999999999", "9007199254740993.0000000000000000001",
        "4.9e-324", "2.4703282292062327208e-324", "2.4703282292062328e-324", "2.47032822920623272088284396434110686182e-324",
        "2.470328229206232720882843964341106861825299013071623822127928412503377536351043759326499181808179961898982823477228588654633e-324",
        "2.2250738585072011e-308", "2.2250738585072014e-308", "1.7976931348623157e308", "1.7976931348623158e308", "1e-400",
        "1.7976931348623158079e308", "8.988465674311579e307", "179769313486231570000000000000000000000e270", "0.1", "0.3", "1e23", "8.5e23",
        "6.0221e23", "1e22", "1e-22", "5e-20", "7.2057594037927933e16", "72057594037927945", "72057594037927944.00000000000000000",
        "0.500000000000000166533453693773481063544750213623046875", "3.518437208883201171875e13", "62.5364939768271845828",
        "8.10109172351e-10", "1.50000000000000011102230246251565", "6.1094e-319", "1e-323", "45035996.273704985", "45035996.273704995",
        "0.000000000000000000000000000000000000000000000000000000000000001e63", "1000000000000000000000000000000000000000000000e-45"};
    for (size_t i = 0; i < sizeof hard / sizeof *hard; i++) expect_like_strtod(hard[i]);
}

static void random_doubles_with_any_number_of_digits_come_back_bit_for_bit(void **state) {
    (void)state;
    kit_random random = kit_random_start(1);
    char text[1100];
    for (int i = 0; i < 200000; i++) {
        double v = kit_random_bits(&random);
        if (i % 4 == 1) v = kit_random_range(&random, -10, 10);
        if (i % 4 == 2) v = (float)kit_random_range(&random, -10, 10); /* short dyadic fractions */
        snprintf(text, sizeof text, "%.*e", (int)kit_random_below(&random, 60), v);
        if (isinf(strtod(text, NULL))) continue;
        expect_like_strtod(text);
        snprintf(text, sizeof text, "%.17g", v);
        assert_true(bits_of(read_whole(text)) == bits_of(v));
    }
}

static void points_halfway_between_doubles_go_to_the_even_one(void **state) {
    (void)state;
    kit_random random = kit_random_start(2);
    char text[1200];
    for (int i = 0; i < 2000; i++) {
        double v = i % 3 ? fabs(kit_random_bits(&random)) : ldexp((double)kit_random_below(&random, 1 << 20), -1074);
        if (v < 0x1p-1000 && i % 3) continue;
        long double half = ((long double)v + nextafter(v, INFINITY)) / 2; /* 64 bits: exact */
        if (!isfinite((double)half)) continue;
        snprintf(text, sizeof text, "%.1080Lf", half);
        if (strlen(text) >= sizeof text - 1) continue;
        expect_like_strtod(text);
        text[strlen(text) - 1] = '1'; /* just above */
        expect_like_strtod(text);
    }
}

/* |p/q - v| <= |p/q - w| for both neighbours w of v, and v even where equal: by exact arithmetic. */
static void expect_nearest(const mpq_t exact, double v, const char *text) {
    mpq_t d, e;
    mpq_inits(d, e, NULL);
    mpq_set_d(d, v);
    mpq_sub(d, d, exact);
    mpq_abs(d, d);
    for (int side = -1; side <= 1; side += 2) {
        mpq_set_d(e, nextafter(v, (double)side * INFINITY));
        mpq_sub(e, e, exact);
        mpq_abs(e, e);
        int order = mpq_cmp(d, e);
        if (order > 0 || (order == 0 && (bits_of(v) & 1))) fail_msg("%.200s: %a is not the nearest double", text, v);
    }
    mpq_clears(d, e, NULL);
}

static void random_digits(kit_random *random, char *to, size_t n) {
    for (size_t i = 0; i < n; i++) to[i] = (char)('0' + kit_random_below(random, 10));
    to[0] = (char)('1' + kit_random_below(random, 9));
    to[n] = 0;
}

static void rationals_of_any_length_are_read_to_the_nearest_double(void **state) {
    (void)state;
    kit_random random = kit_random_start(3);
    char p[400], q[400], text[900];
    mpq_t exact;
    mpq_init(exact);
    for (int i = 0; i < 60000; i++) {
        size_t longest = i % 3 == 0 ? 20 : i % 3 == 1 ? 40 : 90;
        random_digits(&random, p, 1 + kit_random_below(&random, longest));
        random_digits(&random, q, 1 + kit_random_below(&random, longest));
        snprintf(text, sizeof text, "%s%s/%s", i & 1 ? "-" : "", p, q);
        mpq_set_str(exact, text, 10);
        mpq_canonicalize(exact);
        expect_nearest(exact, read_whole(text), text);
    }
    mpq_clear(exact);
}

static void rationals_that_lie_halfway_go_to_the_even_double(void **state) {
    (void)state;
    kit_random random = kit_random_start(4);
    mpq_t exact;
    mpq_init(exact);
    for (int i = 0; i < 20000; i++) {
        uint64_t odd = ((uint64_t)1 << 53 | kit_random_next(&random) >> 11) << 1 | 1; /* 55 bits: halfway between doubles of 54 */
        odd = (odd & (((uint64_t)1 << 54) - 1)) | (uint64_t)1 << 53;
        mpz_set_ui(mpq_numref(exact), odd);
        mpz_set_ui(mpq_denref(exact), 1);
        mpz_mul_2exp(mpq_denref(exact), mpq_denref(exact), kit_random_below(&random, 120));
        uint64_t extra = 1 + kit_random_below(&random, 1000000); /* not in lowest terms */
        mpz_mul_ui(mpq_numref(exact), mpq_numref(exact), extra);
        mpz_mul_ui(mpq_denref(exact), mpq_denref(exact), extra);
        char *text = mpq_get_str(NULL, 10, exact);
        if (!strchr(text, '/')) text = realloc(text, strlen(text) + 3), strcat(text, "/1");
        mpq_canonicalize(exact);
        double v = read_whole(text);
        expect_nearest(exact, v, text);
        assert_int_equal(bits_of(v) & 1, 0);
        free(text);
    }
    mpq_clear(exact);
}

static void what_is_no_finite_number_is_refused_by_its_kind(void **state) {
    (void)state;
    static const char *const syntax[] = {"",    "-",   "+",    ".",    "-.",    "e5",  "1e",   "1e+",  "abc",  "1.2.3", "1x", "--1", "1/",
                                         "/2",  "1/-2", "1.5/2", "1/2.5", "1/2/3", "0x10", "1,5", "1_000", "1e5.5", "1/2e3", "\x80", "nope"};
    for (size_t i = 0; i < sizeof syntax / sizeof *syntax; i++) expect_status(syntax[i], BW_NUMBER_SYNTAX);
    static const char *const infinite[] = {"nan", "-NaN", "inf", "-inf", "Infinity", "1e309", "1.7976931348623159e308", "1e99999999999999999999",
                                           "-1e400", "nan(0x1)"};
    for (size_t i = 0; i < sizeof infinite / sizeof *infinite; i++) expect_status(infinite[i], BW_NUMBER_NOT_FINITE);
    expect_status("1/0", BW_NUMBER_ZERO_DIVISOR);
    expect_status("0/000", BW_NUMBER_ZERO_DIVISOR);

    size_t length = BW_NUMBER_LENGTH + 10;
    char *text = malloc(length + 1);
    memset(text, '1', length);
    text[length] = 0;
    expect_status(text, BW_NUMBER_LENGTHY);
    text[400] = '/';
    expect_status(text, BW_NUMBER_LENGTHY);
    text[BW_NUMBER_LENGTH] = 0;
    assert_true(read_whole(text) == 0); /* 400 digits over 65 000 */
    text[400] = '1';
    expect_status(text, BW_NUMBER_NOT_FINITE);
    text[1] = '.';
    assert_true(read_whole(text) == 1.1111111111111111);
    free(text);
}

static void printed_doubles_are_the_shortest_that_read_back(void **state) {
    (void)state;
    kit_random random = kit_random_start(5);
    char text[BW_NUMBER_TEXT], other[64];
    for (int i = 0; i < 300000; i++) {
        double v = kit_random_bits(&random);
        if (i % 5 == 1) v = kit_random_range(&random, -10, 10);
        if (i % 5 == 2) v = (double)(int64_t)kit_random_below(&random, 1000000) / 1000;
        if (i % 5 == 3) v = ldexp(1, (int)kit_random_below(&random, 2098) - 1074);
        if (i % 5 == 4) v = ldexp((double)kit_random_below(&random, 4096), -1074 + (int)kit_random_below(&random, 5));
        size_t length = bw_number_print(v, text);
        assert_int_equal(length, strlen(text));
        assert_true(length < BW_NUMBER_TEXT);
        if (bits_of(strtod(text, NULL)) != bits_of(v) || bits_of(read_whole(text)) != bits_of(v)) fail_msg("%a printed as %s", v, text);
        int n = 0;
        for (const char *c = text; *c && *c != 'e'; c++) n += *c >= '0' && *c <= '9' && (n || *c != '0');
        for (const char *c = strchr(text, 'e') ? strchr(text, 'e') : text + length; n && !strchr(text, '.') && c[-1] == '0'; c--) n--;
        if (n < 2) continue;
        snprintf(other, sizeof other, "%.*e", n - 2, v);
        if (bits_of(strtod(other, NULL)) == bits_of(v)) fail_msg("%s is printed for %s", text, other);
        snprintf(other, sizeof other, "%.*e", n - 1, v);
        if (i % 5 != 3 && strtod(other, NULL) == v) { /* as many digits, and the closest of them */
            long double mine = strtold(text, NULL), theirs = strtold(other, NULL);
            if (fabsl(mine - (long double)v) > fabsl(theirs - (long double)v)) fail_msg("%s is farther than %s", text, other);
        }
    }
}

static void printing_has_one_form(void **state) {
    (void)state;
    static const struct {
        double value;
        const char *text;
    } form[] = {{0, "0"}, {-0.0, "-0"}, {1, "1"}, {-2.5, "-2.5"}, {0.1, "0.1"}, {1e-5, "0.00001"}, {1e-6, "1e-6"}, {1e16, "10000000000000000"},
                {1e17, "1e17"}, {123456789, "123456789"}, {5e-324, "5e-324"}, {1.7976931348623157e308, "1.7976931348623157e308"}, {0.3, "0.3"},
                {0.1 + 0.2, "0.30000000000000004"}, {2e23, "2e23"}, {9007199254740993.0, "9007199254740992"}, {1.5e-7, "1.5e-7"}};
    char text[BW_NUMBER_TEXT];
    for (size_t i = 0; i < sizeof form / sizeof *form; i++) {
        bw_number_print(form[i].value, text);
        assert_string_equal(text, form[i].text);
    }
    bw_integer_print(INT64_MIN, text);
    assert_string_equal(text, "-9223372036854775808");
}

static void the_locale_does_not_matter(void **state) {
    (void)state;
    if (!setlocale(LC_ALL, "de_DE.UTF-8") && !setlocale(LC_ALL, "fr_FR.UTF-8")) kit_skip("no locale with a decimal comma is installed");
    char text[BW_NUMBER_TEXT];
    bw_number_print(0.5, text);
    double value = read_whole("0.25000000000000000000000000000000000000000001");
    setlocale(LC_ALL, "C");
    assert_string_equal(text, "0.5");
    assert_true(value == 0.25);
}

static void whole_numbers_saturate_and_refuse_anything_else(void **state) {
    (void)state;
    static const struct {
        const char *text;
        bw_number_status status;
        int64_t value;
    } cases[] = {{"0", BW_NUMBER_OK, 0}, {"-17", BW_NUMBER_OK, -17}, {"+5 x", BW_NUMBER_OK, 5}, {"99999999999999999999999", BW_NUMBER_OK, INT64_MAX},
                 {"-9223372036854775809", BW_NUMBER_OK, -INT64_MAX}, {"", BW_NUMBER_SYNTAX, 0}, {"-", BW_NUMBER_SYNTAX, 0}, {"1.5", BW_NUMBER_SYNTAX, 0},
                 {"1e3", BW_NUMBER_SYNTAX, 0}, {"12x", BW_NUMBER_SYNTAX, 0}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        const char *at = cases[i].text;
        int64_t value = 0;
        assert_int_equal(bw_integer_read(&at, at + strlen(at), &value), cases[i].status);
        assert_int_equal(value, cases[i].value);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(hard_decimals_are_read_to_the_nearest_double),
    cmocka_unit_test(random_doubles_with_any_number_of_digits_come_back_bit_for_bit),
    cmocka_unit_test(points_halfway_between_doubles_go_to_the_even_one),
    cmocka_unit_test(rationals_of_any_length_are_read_to_the_nearest_double),
    cmocka_unit_test(rationals_that_lie_halfway_go_to_the_even_double),
    cmocka_unit_test(what_is_no_finite_number_is_refused_by_its_kind),
    cmocka_unit_test(printed_doubles_are_the_shortest_that_read_back),
    cmocka_unit_test(printing_has_one_form),
    cmocka_unit_test(the_locale_does_not_matter),
    cmocka_unit_test(whole_numbers_saturate_and_refuse_anything_else),
};
KIT_MAIN(tests)
