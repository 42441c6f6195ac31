#include "stream.h"

#include <stdlib.h>
#include <string.h>

static const size_t event_most = (size_t)1 << 20;

void cli_events_clear(cli_events *e) {
    free(e->line);
    free(e->data);
    memset(e, 0, sizeof *e);
}

static bool append(char **text, size_t *size, size_t *room, const char *more, size_t n) {
    if (n > event_most || *size + n > event_most) return false;
    if (*size + n + 1 > *room) {
        char *grown = realloc(*text, 2 * (*size + n + 1));
        if (!grown) return false;
        *text = grown;
        *room = 2 * (*size + n + 1);
    }
    if (n) memcpy(*text + *size, more, n);
    (*text)[*size += n] = 0;
    return true;
}

/* An empty line: the event is complete. One without data is none. */
static void dispatch(cli_events *e) {
    if (e->data_size) {
        e->data[--e->data_size] = 0; /* the last newline */
        e->fn(e->user, *e->event ? e->event : "message", e->data, e->data_size);
    }
    if (*e->id) memcpy(e->last, e->id, sizeof e->last);
    e->data_size = 0;
    e->event[0] = e->id[0] = 0;
}

static void copy(char *to, size_t room, const char *value, size_t size) {
    if (size >= room) return;
    memcpy(to, value, size);
    to[size] = 0;
}

static bool end_line(cli_events *e) {
    const char *line = e->line ? e->line : "";
    size_t name = strcspn(line, ":"), at = name + (line[name] == ':');
    at += line[name] && line[at] == ' ';
    const char *value = line + at;
    size_t size = e->line_size - at;
    bool good = true;
    if (!e->line_size) dispatch(e);
    else if (name == 4 && !memcmp(line, "data", 4))
        good = append(&e->data, &e->data_size, &e->data_room, value, size) && append(&e->data, &e->data_size, &e->data_room, "\n", 1);
    else if (name == 5 && !memcmp(line, "event", 5)) copy(e->event, sizeof e->event, value, size);
    else if (name == 2 && !memcmp(line, "id", 2) && strlen(value) == size) copy(e->id, sizeof e->id, value, size);
    e->line_size = 0;
    if (e->line) e->line[0] = 0;
    return good;
}

bool cli_events_take(cli_events *e, const char *bytes, size_t size) {
    for (const char *end = bytes + size; bytes < end;) {
        size_t n = 0;
        while (bytes + n < end && bytes[n] != '\n' && bytes[n] != '\r') n++;
        if (n && !append(&e->line, &e->line_size, &e->line_room, bytes, n)) return false;
        if (n) e->after_return = false;
        bytes += n;
        if (bytes == end) break;
        bool rest = *bytes == '\n' && e->after_return; /* of \r\n */
        e->after_return = *bytes++ == '\r';
        if (!rest && !end_line(e)) return false;
    }
    return true;
}

static bool take(void *user, const char *bytes, size_t size) { return cli_events_take(user, bytes, size); }

bool cli_follow(cli_http *http, const char *path, cli_events *e, cli_reply *reply) {
    e->line_size = e->data_size = 0;
    e->event[0] = e->id[0] = 0;
    e->after_return = false;
    if (e->line) e->line[0] = 0;
    if (*e->last) cli_http_header(http, "Last-Event-ID", e->last);
    cli_http_header(http, "Accept", "text/event-stream");
    return cli_http_stream(http, path, take, e, reply);
}
