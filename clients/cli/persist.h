/* Requests that may be sent twice, until the daemon, and no proxy in its place, answers: after a connection that broke, and after
 * 502, 503 and 504, it is tried again, with pauses that double, and not before a Retry-After has passed. */
#ifndef BW_CLI_PERSIST_H
#define BW_CLI_PERSIST_H

#include <stdbool.h>

#include "http.h"

typedef struct {
    cli_http *http;
    const char *what;       /* that is wanted of the daemon: "upload" */
    cli_progress *progress; /* cleared before anything is said; NULL: none */
    char why[320];          /* the last try was in vain */
    double asked;           /* seconds that the daemon wanted to be left alone for then */
    int tries;              /* in vain, in a row */
    double pause;           /* after the next one */
} cli_persistence;

void cli_persist_begin(cli_persistence *p, cli_http *http, const char *what, cli_progress *progress);
void cli_persist_got_on(cli_persistence *p); /* something came of the last try: the next ones count from one again */
/* Keeps why a request was in vain; `status` 0: there was no answer. */
void cli_persist_note(cli_persistence *p, long status);
/* After a request in vain: true, after a pause, if it is worth another try. False: there were enough; this was said. */
bool cli_persist_again(cli_persistence *p);

/* Sends until there is an answer. False: there is none; *code is the exit code, and this was said. That no connection can be made is
 * tried again only if the daemon has answered before. */
bool cli_persist(cli_persistence *p, bool (*send)(void *user, cli_reply *reply), void *user, cli_reply *reply, int *code);

#endif
