/* Server-sent events (HTML standard, 9.2), as a daemon tells what happens to a job. */
#ifndef BW_CLI_STREAM_H
#define BW_CLI_STREAM_H

#include <stdbool.h>
#include <stddef.h>

#include "http.h"

enum { CLI_EVENT_NAME = 32, CLI_EVENT_ID = 24 };

/* Called for every event; data is NUL-terminated, its lines end with \n but for the last. */
typedef void (*cli_event_fn)(void *user, const char *event, const char *data, size_t size);

/* Takes a stream apart, in whatever pieces it comes. */
typedef struct {
    cli_event_fn fn;
    void *user;
    char *line, *data;
    size_t line_size, line_room, data_size, data_room;
    char event[CLI_EVENT_NAME], id[CLI_EVENT_ID];
    char last[CLI_EVENT_ID]; /* id of the last event that had one and was complete */
    bool after_return;       /* the last byte was \r */
} cli_events;

void cli_events_clear(cli_events *events);
/* False: a line or an event is too long, or there is no memory. */
bool cli_events_take(cli_events *events, const char *bytes, size_t size);

/* GETs the stream at `path`, from after events->last on if that is not "", and calls events->fn until it ends. False if it was cut or there
 * was no answer at all; an answer other than 200 is in `reply`. */
bool cli_follow(cli_http *http, const char *path, cli_events *events, cli_reply *reply);

#endif
