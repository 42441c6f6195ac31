/* Numbers against an independent judge: strtod for decimals, the exact distance to both neighbours for rationals. */
#include "fuzz.h"

#include <gmp.h>
#include <math.h>
#include <string.h>

#include "format/number.h"

static void expect_nearest(const char *text, double value) {
    mpq_t exact, near, far;
    mpq_inits(exact, near, far, NULL);
    FUZZ_EXPECT(mpq_set_str(exact, text + (*text == '+'), 10) == 0);
    mpq_canonicalize(exact);
    mpq_set_d(near, value);
    mpq_sub(near, near, exact);
    mpq_abs(near, near);
    for (int side = -1; side <= 1; side += 2) {
        double neighbour = nextafter(value, side * INFINITY);
        if (isinf(neighbour)) continue;
        mpq_set_d(far, neighbour);
        mpq_sub(far, far, exact);
        mpq_abs(far, far);
        FUZZ_EXPECT(mpq_cmp(near, far) <= 0);
    }
    mpq_clears(exact, near, far, NULL);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size > 4000) return 0;
    char *text = malloc(size + 1), printed[BW_NUMBER_TEXT], *end;
    memcpy(text, data, size);
    text[size] = 0;
    const char *at = text;
    double value = 0;
    char *exact = malloc(size ? size : 1); /* the reader gets no byte more than the input, so that reading past it is seen */
    memcpy(exact, data, size);
    const char *from = exact;
    bw_number_status status = bw_number_read(&from, exact + size, &value);
    at += from - exact;
    FUZZ_EXPECT(from >= exact && from <= exact + size);
    text[at - text] = 0;
    if (status == BW_NUMBER_OK) {
        if (strchr(text, '/')) expect_nearest(text, value);
        else FUZZ_EXPECT(strtod(text, &end) == value && !*end);
        size_t length = bw_number_print(value, printed);
        FUZZ_EXPECT(length < BW_NUMBER_TEXT && length == strlen(printed));
        double back = strtod(printed, NULL);
        FUZZ_EXPECT(!memcmp(&back, &value, sizeof value));
    }
    free(exact);
    free(text);
    return 0;
}
