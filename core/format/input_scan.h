/* A cursor over a whole input in memory, for the readers of text and binary formats behind input.h.
 *
 * Invariants
 *  1. data <= at <= end, and nothing at or after `end` is ever read.
 *  2. Every failure names its place: "line 7 (tet 3): ..." in text, "byte 1234 (tet 3): ..." in binary
 *     inputs, with the record's number among the error's elements, and the line (or byte) too. Messages are
 *     printable ASCII.
 *  3. A count is held against the bytes that are left (bw_scan_count) before anything is allocated for it.
 *
 * A word is what stands between blanks (space, tab, line breaks). Words and numbers over 64 KiB are refused
 * (BW_E_LINE).
 */
#ifndef BW_FORMAT_INPUT_SCAN_H
#define BW_FORMAT_INPUT_SCAN_H

#include "base/context.h"
#include "base/index.h"

typedef struct {
    bw_context *ctx;
    const char *data, *at, *end;
    uint64_t line;    /* of `at`, from 1 */
    bool binary;      /* places are told in bytes, not lines */
    char comment;     /* words end and lines are cut at this character; 0: there are no comments */
    bool part;        /* over a part of the input: tells no progress, so that it never goes back */
    const char *kind; /* of the record being read, "tet"; NULL outside of lists */
    int64_t record;
    uint64_t base; /* offset of `data` in the input */
} bw_scan;

typedef struct {
    const char *text; /* not NUL-terminated */
    size_t length;
} bw_word;

bw_scan bw_scan_open(bw_context *ctx, const void *data, size_t size);
static inline size_t bw_scan_left(const bw_scan *s) {
    return (size_t)(s->end - s->at);
}

/* Records a failure at the cursor. printf-like, without the place. */
bw_status bw_scan_fail(bw_scan *s, bw_status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/* Passes blanks, line breaks and comments; false at the end of the input. */
bool bw_scan_blanks(bw_scan *s);
/* The next word. BW_E_TRUNCATED if there is none, BW_E_LINE if it is too long. */
bw_status bw_scan_word(bw_scan *s, bw_word *word);
/* What is left of the line, without blanks at its ends and without its break, which is passed. */
bw_word bw_scan_line(bw_scan *s);
bw_status bw_scan_whole(bw_scan *s, int64_t *value);
bw_status bw_scan_number(bw_scan *s, double *value);
/* A whole number from `first` to `first` + bound - 1; *index counts from 0. BW_E_INDEX. */
bw_status bw_scan_index(bw_scan *s, int64_t first, size_t bound, bw_vertex *index);
/* BW_OK if first <= value < first + bound. */
bw_status bw_scan_check_index(bw_scan *s, int64_t value, int64_t first, size_t bound);
/* The next `size` bytes, as they are. BW_E_TRUNCATED. */
bw_status bw_scan_bytes(bw_scan *s, size_t size, const char **bytes);

/* BW_E_COUNT unless 0 <= count <= most and `count` records of at least `bytes` bytes may be in what is left
 * (in text a number takes two bytes, and the last one may lack its blank). `plural`: "tets". */
bw_status bw_scan_count(bw_scan *s, const char *plural, int64_t count, int64_t most, uint64_t bytes);
/* Goes on to record number `record` of a list of `kind`; sees to cancellation and progress now and then. */
bw_status bw_scan_record(bw_scan *s, const char *kind, int64_t record);

bool bw_word_is(bw_word word, const char *text); /* letters of either case are the same */
bool bw_word_starts(bw_word word, const char *text);
/* Copies a word fit to be shown: printable ASCII, cut where room ends. Returns `text`. */
const char *bw_word_show(bw_word word, char *text, size_t room);

#endif
