#include "format/input_scan.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>

#include "format/number.h"

enum { POLL_EVERY = 1 << 14 };

bw_scan bw_scan_open(bw_context *ctx, const void *data, size_t size) {
    const char *begin = size ? data : "";
    return (bw_scan){.ctx = ctx, .data = begin, .at = begin, .end = begin + size, .line = 1};
}

/* ---- errors -------------------------------------------------------------------------------------------- */

static bool printable(char c) {
    return c >= ' ' && c <= '~';
}

bw_status bw_scan_fail(bw_scan *s, bw_status status, const char *format, ...) {
    if (s->ctx->error.status != BW_OK) return s->ctx->error.status;
    char what[360];
    va_list args;
    va_start(args, format);
    vsnprintf(what, sizeof what, format, args);
    va_end(args);
    for (char *c = what; *c; c++) *c = printable(*c) ? *c : '?'; /* names may come from the input */
    char record[60] = "";
    if (s->kind) {
        snprintf(record, sizeof record, " (%s %lld)", s->kind, (long long)s->record);
        bw_fail_element(s->ctx, s->kind, s->record, NULL);
    }
    uint64_t place = s->binary ? s->base + (uint64_t)(s->at - s->data) : s->line;
    const char *unit = s->binary ? "byte" : "line";
    bw_fail_element(s->ctx, unit, (int64_t)place, NULL);
    return bw_fail(s->ctx, status, "%s %llu%s: %s", unit, (unsigned long long)place, record, what);
}

const char *bw_word_show(bw_word word, char *text, size_t room) {
    size_t n = word.length < room - 1 ? word.length : room - 1;
    for (size_t i = 0; i < n; i++) text[i] = printable(word.text[i]) ? word.text[i] : '?';
    text[n] = 0;
    if (word.length > n && n > 3) memcpy(text + n - 3, "...", 3);
    return text;
}

/* ---- words --------------------------------------------------------------------------------------------- */

bool bw_word_is(bw_word word, const char *text) {
    return word.length == strlen(text) && !strncasecmp(word.text, text, word.length);
}

bool bw_word_starts(bw_word word, const char *text) {
    return word.length >= strlen(text) && !strncasecmp(word.text, text, strlen(text));
}

bool bw_scan_blanks(bw_scan *s) {
    for (; s->at < s->end; s->at++) {
        if (s->comment && *s->at == s->comment) {
            const char *stop = memchr(s->at, '\n', bw_scan_left(s));
            s->at = stop ? stop : s->end;
            if (!stop) return false;
        }
        if (!bw_is_blank(*s->at)) return true;
        s->line += *s->at == '\n';
    }
    return false;
}

/* The word at the cursor, at most one byte more than the longest allowed. */
static bw_word peek(const bw_scan *s) {
    const char *p = s->at;
    const char *stop = bw_scan_left(s) > BW_NUMBER_LENGTH ? s->at + BW_NUMBER_LENGTH + 1 : s->end;
    while (p < stop && !bw_is_blank(*p) && !(s->comment && *p == s->comment)) p++;
    return (bw_word){s->at, (size_t)(p - s->at)};
}

bw_status bw_scan_word(bw_scan *s, bw_word *word) {
    if (!bw_scan_blanks(s)) return bw_scan_fail(s, BW_E_TRUNCATED, "the input ends here");
    *word = peek(s);
    if (word->length > BW_NUMBER_LENGTH)
        return bw_scan_fail(s, BW_E_LINE, "a word is longer than %d bytes", BW_NUMBER_LENGTH);
    s->at += word->length;
    return BW_OK;
}

bw_word bw_scan_line(bw_scan *s) {
    const char *from = s->at, *mark = memchr(s->at, '\n', bw_scan_left(s)), *to = mark ? mark : s->end;
    s->at = mark ? mark + 1 : s->end;
    s->line += mark != NULL;
    const char *cut = s->comment && to > from ? memchr(from, s->comment, (size_t)(to - from)) : NULL;
    if (cut) to = cut;
    while (from < to && bw_is_blank(*from)) from++;
    while (from < to && bw_is_blank(to[-1])) to--;
    return (bw_word){from, (size_t)(to - from)};
}

/* ---- numbers ------------------------------------------------------------------------------------------- */

static bw_status fail_number(bw_scan *s, bw_number_status why, const char *wanted) {
    char text[40];
    bw_word_show(peek(s), text, sizeof text);
    switch (why) {
    case BW_NUMBER_NOT_FINITE:
        return bw_scan_fail(s, BW_E_NUMBER, "'%s' is not a finite number", text);
    case BW_NUMBER_ZERO_DIVISOR:
        return bw_scan_fail(s, BW_E_NUMBER, "'%s' divides by zero", text);
    case BW_NUMBER_LENGTHY:
        return bw_scan_fail(s, BW_E_LINE, "'%s' is too long a number", text);
    default:
        return bw_scan_fail(s, BW_E_SYNTAX, "'%s' is not a %s", text, wanted);
    }
}

static bw_status begin_number(bw_scan *s) {
    return bw_scan_blanks(s) ? BW_OK : bw_scan_fail(s, BW_E_TRUNCATED, "the input ends before a number");
}

bw_status bw_scan_whole(bw_scan *s, int64_t *value) {
    bw_status status = begin_number(s);
    if (status != BW_OK) return status;
    const char *at = s->at;
    bw_number_status read = bw_integer_read(&at, s->end, value);
    if (read == BW_NUMBER_OK) s->at = at;
    return read == BW_NUMBER_OK ? BW_OK : fail_number(s, read, "whole number");
}

bw_status bw_scan_number(bw_scan *s, double *value) {
    bw_status status = begin_number(s);
    if (status != BW_OK) return status;
    const char *at = s->at;
    bw_number_status read = bw_number_read(&at, s->end, value);
    if (read == BW_NUMBER_OK) s->at = at;
    return read == BW_NUMBER_OK ? BW_OK : fail_number(s, read, "number");
}

bw_status bw_scan_check_index(bw_scan *s, int64_t value, int64_t first, size_t bound) {
    if (value >= first && (uint64_t)(value - first) < bound) return BW_OK;
    if (!bound)
        return bw_scan_fail(s, BW_E_INDEX, "index %lld, but there is nothing to point at", (long long)value);
    return bw_scan_fail(s, BW_E_INDEX, "index %lld is outside %lld..%lld", (long long)value, (long long)first,
                        (long long)first + (long long)bound - 1);
}

bw_status bw_scan_index(bw_scan *s, int64_t first, size_t bound, bw_vertex *index) {
    int64_t value = 0;
    bw_status status = bw_scan_whole(s, &value);
    if (status == BW_OK) status = bw_scan_check_index(s, value, first, bound);
    if (status == BW_OK) *index = (bw_vertex)(value - first);
    return status;
}

/* ---- bytes and counts ---------------------------------------------------------------------------------- */

bw_status bw_scan_bytes(bw_scan *s, size_t size, const char **bytes) {
    if (size > bw_scan_left(s))
        return bw_scan_fail(s, BW_E_TRUNCATED, "%zu bytes are needed here and %zu are left", size,
                            bw_scan_left(s));
    *bytes = s->at;
    s->at += size;
    return BW_OK;
}

bw_status bw_scan_count(bw_scan *s, const char *plural, int64_t count, int64_t most, uint64_t bytes) {
    uint64_t left = (uint64_t)bw_scan_left(s) + !s->binary;
    if (count < 0)
        return bw_scan_fail(s, BW_E_COUNT, "the number of %s is negative: %lld", plural, (long long)count);
    if (count > most)
        return bw_scan_fail(s, BW_E_COUNT, "%lld %s are more than the %lld supported", (long long)count,
                            plural, (long long)most);
    if (bytes && (uint64_t)count > left / bytes)
        return bw_scan_fail(s, BW_E_COUNT, "%lld %s cannot be in the %zu bytes that are left",
                            (long long)count, plural, bw_scan_left(s));
    return BW_OK;
}

bw_status bw_scan_record(bw_scan *s, const char *kind, int64_t record) {
    s->kind = kind;
    s->record = record;
    if (record % POLL_EVERY) return BW_OK;
    if (s->end > s->data && !s->part)
        bw_progress(s->ctx, (double)(s->at - s->data) / (double)(s->end - s->data));
    return bw_poll(s->ctx);
}
