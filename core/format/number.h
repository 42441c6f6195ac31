/* Numbers as text: decimals and rationals to the nearest double, doubles to the shortest decimal that reads back.
 *
 * Grammar:  number   = [+-] ( decimal | rational )
 *           decimal  = ( digits [ "." [digits] ] | "." digits ) [ (e|E) [+-] digits ]
 *           rational = digits "/" digits
 * A number is followed by the end of the text or by a blank (space, tab, CR, LF, VT, FF).
 *
 * Invariants
 *  1. Reading rounds to the nearest double, ties to even, however many digits are written; what lies under half the
 *     smallest subnormal is zero. The sign of zero is kept.
 *  2. Nothing depends on the locale or on the floating-point environment's rounding of decimal conversions.
 *  3. Printing gives the shortest digits that read back as the same double; among those the closest to it.
 *
 * Method: a double interval with a proven bound around mantissa * 10^exponent (or p / q) is rounded at both ends; rounding
 * is monotone, so equal ends are the answer. What that leaves open (ties, and about 1 in 500 of the very long ones) is
 * done exactly with GMP. Printing is Giulietti's Schubfach on the same table of powers of ten.
 */
#ifndef BW_FORMAT_NUMBER_H
#define BW_FORMAT_NUMBER_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

enum {
    BW_NUMBER_TEXT = 32,       /* bytes that bw_number_print may need, with the NUL */
    BW_NUMBER_LENGTH = 1 << 16 /* longest number that is read, in bytes */
};

typedef enum {
    BW_NUMBER_OK,
    BW_NUMBER_SYNTAX,       /* not a number */
    BW_NUMBER_NOT_FINITE,   /* nan, inf, or larger than the largest double */
    BW_NUMBER_ZERO_DIVISOR, /* p/0 */
    BW_NUMBER_LENGTHY       /* longer than BW_NUMBER_LENGTH */
} bw_number_status;

/* Reads the number at *at; on success *at is one past it. On failure *at is where reading stopped and *value is as it was.
 * O(length) for up to 38 digits, else O(length^2 / 19^2) limb operations. */
bw_number_status bw_number_read(const char **at, const char *end, double *value);
/* Reads [+-] digits. A magnitude above INT64_MAX is given as +-INT64_MAX. Failures: BW_NUMBER_SYNTAX, BW_NUMBER_LENGTHY. */
bw_number_status bw_integer_read(const char **at, const char *end, int64_t *value);

/* Writes `value` (finite) and a NUL into text; returns the length without the NUL. */
size_t bw_number_print(double value, char text[BW_NUMBER_TEXT]);
size_t bw_integer_print(int64_t value, char text[BW_NUMBER_TEXT]);

static inline bool bw_is_blank(char c) { return c == ' ' || (c >= '\t' && c <= '\r'); }

#endif
