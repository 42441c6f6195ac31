#include "server/log.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "server/clock.h"

void bw_event(bw_level level, const char *event, const char *format, ...) {
    static const char *const names[] = {"info", "warn", "error"};
    char line[2048], time[BW_TIME_TEXT];
    int n = snprintf(line, sizeof line, "time=%s level=%s event=%s", bw_time_text(bw_now_ms(), time), names[level],
                     event);
    size_t at = n < 0 ? 0 : (size_t)n;
    if (*format) {
        line[at++] = ' ';
        va_list args;
        va_start(args, format);
        n = vsnprintf(line + at, sizeof line - at, format, args);
        va_end(args);
        if (n > 0) at += (size_t)n;
        if (at > sizeof line - 1) at = sizeof line - 1;
    }
    line[at++] = '\n';
    if (write(STDERR_FILENO, line, at) < 0) return; /* nobody left to tell */
}

char *bw_quoted(const char *text, char *out, size_t size) {
    size_t at = 0;
    out[at++] = '"';
    for (const unsigned char *c = (const unsigned char *)text; *c && at + 6 < size; c++) {
        if (*c == '"' || *c == '\\') {
            out[at++] = '\\';
            out[at++] = (char)*c;
        } else if (*c < 0x20 || *c == 0x7f) {
            at += (size_t)snprintf(out + at, size - at, "\\x%02x", *c);
        } else {
            out[at++] = (char)*c;
        }
    }
    out[at++] = '"';
    out[at] = '\0';
    return out;
}
