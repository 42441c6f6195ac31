/* The daemon's log: one line per event on stderr, `time=... level=... event=... key=value ...`.
 *
 * A line is one write(2), so lines of several threads and of the spawner do not mix. Values that come from outside are
 * quoted by bw_quoted(), so nobody can forge a line.
 */
#ifndef BW_SERVER_LOG_H
#define BW_SERVER_LOG_H

#include <stddef.h>

typedef enum { BW_INFO, BW_WARN, BW_ERROR } bw_level;

/* `event` is a dotted word such as "job.accepted"; `format` gives the rest of the line ("" for none). */
void bw_event(bw_level level, const char *event, const char *format, ...) __attribute__((format(printf, 3, 4)));
/* `text` between double quotes, with quotes, backslashes and control characters escaped, cut to fit. Returns out. */
char *bw_quoted(const char *text, char *out, size_t size);

#endif
