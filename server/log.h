/* The daemon's log: one line per event on stderr, as `time=... level=... event=... key=value ...` (logfmt), or, after
 * bw_log_configure, as one JSON object per line with the same members.
 *
 * A line is one write(2), so lines of several threads do not mix. Values that come from outside are
 * quoted by bw_quoted(), so nobody can forge a line. In JSON a member is a number where the format has a whole number for it
 * (key=%d), else a string.
 *
 * Never logged: tokens, Authorization headers, bodies, queries, names that clients have given.
 */
#ifndef BW_SERVER_LOG_H
#define BW_SERVER_LOG_H

#include <stdbool.h>
#include <stddef.h>

/* In the order of the settings log-level and log-format. */
typedef enum { BW_DEBUG, BW_INFO, BW_WARN, BW_ERROR } bw_level;
typedef enum { BW_LOGFMT, BW_LOG_JSON } bw_log_format;

/* Before it is called: BW_INFO, BW_LOGFMT. At any time, from any thread. Of this process only: the spawner has to log nothing. */
void bw_log_configure(bw_level least, bw_log_format format);
bool bw_logs(bw_level level); /* whether events of this level are logged */

/* `event` is a dotted word such as "job.accepted"; `format` gives the rest of the line ("" for none): key=%conversion with one
 * blank between, where a %s whose text may have blanks stands between double quotes or is a bw_quoted() text. */
void bw_event(bw_level level, const char *event, const char *format, ...) __attribute__((format(printf, 3, 4)));
/* `text` between double quotes, with quotes, backslashes and control characters escaped, cut to fit. Returns out. */
char *bw_quoted(const char *text, char *out, size_t size);

#endif
