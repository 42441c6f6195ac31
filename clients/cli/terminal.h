/* What people see: one progress line, sizes and durations in words, foreign text made harmless.
 *
 * On a terminal the progress line is redrawn in place (stage, bar, percent, elapsed). Elsewhere a stage is
 * announced by one plain line when it starts and nothing is ever redrawn. All of it goes to standard error.
 */
#ifndef BW_CLI_TERMINAL_H
#define BW_CLI_TERMINAL_H

#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

typedef struct {
    bool quiet, tty;
    double started; /* seconds on the monotonic clock */
    double drawn;   /* when the line was last drawn */
    char stage[32];
    int percent;
} cli_progress;

void cli_progress_open(cli_progress *p, bool quiet);
/* Shows that `stage` is `fraction` (0..1) done; cheap to call often. */
void cli_progress_show(cli_progress *p, const char *stage, double fraction);
/* Removes the line, so that other text may follow; the next show draws it again. */
void cli_progress_clear(cli_progress *p);

double cli_now(void);                                   /* seconds, monotonic */
void cli_pause(double seconds);
const char *cli_bytes(char text[24], uint64_t bytes);   /* "3.1 MB" (powers of 1000); returns text */
const char *cli_seconds(char text[24], double seconds); /* "0.36 s", "2 min 05 s"; returns text */
void cli_print_safe(FILE *stream,
                    const char *text); /* control characters become '?', newlines and tabs spaces */
/* The same into `out`, cut to fit, for a place in a printf; returns out. */
const char *cli_safe(char *out, size_t size, const char *text);
void cli_print_lines(FILE *stream, const char *text, size_t size); /* the same, but newlines and tabs stay */
void cli_error(const char *format, ...)
    __attribute__((format(printf, 1, 2))); /* "blockwright: ..." and a newline */

#endif
