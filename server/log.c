#include "server/log.h"

#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "server/clock.h"

enum { LINE_MOST = 2048 };

static const char *const level_names[] = {"debug", "info", "warn", "error"};
static atomic_int least_level = BW_INFO, line_format = BW_LOGFMT;

void bw_log_configure(bw_level least, bw_log_format format) {
    atomic_store(&least_level, (int)least);
    atomic_store(&line_format, (int)format);
}

bool bw_logs(bw_level level) { return (int)level >= atomic_load_explicit(&least_level, memory_order_relaxed); }

/* ---- JSON, made of the logfmt text ---- */

typedef struct {
    char text[6 * LINE_MOST + 256]; /* a letter becomes six at most */
    size_t at;
} json_line;

static void put(json_line *j, const char *text, size_t size) {
    if (j->at + size > sizeof j->text - 8) return;
    memcpy(j->text + j->at, text, size);
    j->at += size;
}

/* Bytes of the UTF-8 letter that begins here; 0 if none does. */
static size_t utf8_size(const char *text, const char *end) {
    const unsigned char *c = (const unsigned char *)text;
    size_t n = *c < 0x80 ? 1 : *c >= 0xc2 && *c < 0xe0 ? 2 : *c >= 0xe0 && *c < 0xf0 ? 3 : *c >= 0xf0 && *c < 0xf5 ? 4 : 0;
    if (n == 0 || (size_t)(end - text) < n) return 0;
    for (size_t i = 1; i < n; i++)
        if ((c[i] & 0xc0) != 0x80) return 0;
    bool overlong = (*c == 0xe0 && c[1] < 0xa0) || (*c == 0xf0 && c[1] < 0x90);
    bool surrogate = *c == 0xed && c[1] > 0x9f, beyond = *c == 0xf4 && c[1] > 0x8f;
    return overlong || surrogate || beyond ? 0 : n;
}

static void put_letters(json_line *j, const char *text, const char *end) {
    char escape[8];
    while (text < end) {
        size_t n = utf8_size(text, end);
        if (n == 0) put(j, "\xef\xbf\xbd", 3);
        else if ((unsigned char)*text < 0x20 || *text == 0x7f || *text == '"' || *text == '\\')
            put(j, escape, (size_t)snprintf(escape, sizeof escape, "\\u%04x", (unsigned char)*text));
        else put(j, text, n);
        text += n ? n : 1;
    }
}

/* A quoted value without its quotes; takes back what bw_quoted() did. */
static const char *put_quoted(json_line *j, const char *text, const char *end) {
    while (text < end && *text != '"') {
        unsigned code;
        const char *stop = text;
        if (*text == '\\' && end - text >= 4 && text[1] == 'x' && sscanf(text + 2, "%2x", &code) == 1) {
            char letter = (char)code;
            put_letters(j, &letter, &letter + 1);
            text += 4;
        } else if (*text == '\\' && end - text >= 2) {
            put_letters(j, text + 1, text + 2);
            text += 2;
        } else {
            while (stop < end && *stop != '"' && *stop != '\\') stop++;
            if (stop == text) stop++; /* a backslash at the end of a cut line */
            put_letters(j, text, stop);
            text = stop;
        }
    }
    return text < end ? text + 1 : text;
}

/* Whether the format's next member, named `key`, is a whole number. Moves on behind that member. */
static bool is_number(const char **format, const char *key, size_t length) {
    const char *f = *format + strspn(*format, " "), *value = f + length + 1;
    if (strncmp(f, key, length) != 0 || f[length] != '=') return false;
    size_t n = strcspn(value, " ");
    if (*value == '"') n = 1 + strcspn(value + 1, "\"");
    *format = value + n + (value[n] == '"');
    if (n < 2 || *value != '%') return false;
    size_t flags = strspn(value + 1, "hlzj");
    return 1 + flags + 1 == n && strchr("diu", value[n - 1]) != NULL;
}

static void put_members(json_line *j, const char *text, const char *end, const char *format) {
    while (text < end) {
        size_t length = 0;
        while (text + length < end && text[length] != '=' && text[length] != ' ') length++;
        bool valued = text + length < end && text[length] == '=';
        bool number = valued && is_number(&format, text, length);
        const char *value = text + length + (valued ? 1 : 0);
        put(j, ",\"", 2);
        put_letters(j, text, text + length);
        put(j, number ? "\":" : "\":\"", number ? 2 : 3);
        if (value < end && *value == '"') {
            text = put_quoted(j, value + 1, end);
        } else {
            for (text = value; text < end && *text != ' ';) text++;
            put_letters(j, value, text);
            if (number && text == value) put(j, "null", 4); /* the line was cut here */
        }
        if (!number) put(j, "\"", 1);
        while (text < end && *text == ' ') text++;
    }
}

static void write_json(bw_level level, const char *event, const char *rest, size_t size, const char *format) {
    json_line j;
    char time[BW_TIME_TEXT];
    j.at = (size_t)snprintf(j.text, sizeof j.text, "{\"time\":\"%s\",\"level\":\"%s\",\"event\":\"%s\"",
                            bw_time_text(bw_now_ms(), time), level_names[level], event);
    put_members(&j, rest, rest + size, format);
    memcpy(j.text + j.at, "}\n", 2);
    if (write(STDERR_FILENO, j.text, j.at + 2) < 0) return; /* nobody left to tell */
}

/* ---- events ---- */

void bw_event(bw_level level, const char *event, const char *format, ...) {
    char line[LINE_MOST], time[BW_TIME_TEXT];
    if (!bw_logs(level)) return;
    int n = snprintf(line, sizeof line, "time=%s level=%s event=%s", bw_time_text(bw_now_ms(), time), level_names[level],
                     event);
    size_t at = n < 0 ? 0 : (size_t)n, rest = at;
    if (*format) {
        line[at++] = ' ';
        rest = at;
        va_list args;
        va_start(args, format);
        n = vsnprintf(line + at, sizeof line - at, format, args);
        va_end(args);
        if (n > 0) at += (size_t)n;
        if (at > sizeof line - 1) at = sizeof line - 1;
    }
    if (atomic_load_explicit(&line_format, memory_order_relaxed) == BW_LOG_JSON) {
        write_json(level, event, line + rest, at - rest, format);
        return;
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
