#include "persist.h"

#include <stdlib.h>
#include <string.h>

#include "command.h"

enum { TRIES = 8 }; /* in a row that bring nothing */
static const double pause_first = 0.5, pause_most = 8; /* seconds; doubled from try to try, 39.5 together */
static const double asked_most = 60;                   /* a daemon that wants to be left alone for longer is not waited for */

void cli_persist_begin(cli_persistence *p, cli_http *http, const char *what, cli_progress *progress) {
    *p = (cli_persistence){.http = http, .what = what, .progress = progress};
    cli_persist_got_on(p);
}

void cli_persist_got_on(cli_persistence *p) { p->tries = 0, p->pause = pause_first; }

void cli_persist_note(cli_persistence *p, long status) {
    const char *asked = status ? cli_http_answered(p->http, "Retry-After") : NULL; /* as a date, which no daemon sends: as if it were not there */
    if (status) snprintf(p->why, sizeof p->why, "HTTP status %ld", status);
    else snprintf(p->why, sizeof p->why, "%s", cli_http_error(p->http));
    p->asked = asked && strspn(asked, "0123456789") == strlen(asked) ? strtod(asked, NULL) : 0;
}

bool cli_persist_again(cli_persistence *p) {
    double pause = p->asked > p->pause ? p->asked : p->pause;
    if (++p->tries <= TRIES && pause <= asked_most) {
        cli_pause(pause);
        p->pause = p->pause * 2 < pause_most ? p->pause * 2 : pause_most;
        return true;
    }
    if (p->progress) cli_progress_clear(p->progress);
    if (pause > asked_most) cli_error("%s wants no %s for the next %.0f seconds: %s", cli_http_server(p->http), p->what, pause, p->why);
    else cli_error("%s did not take the %s, nor did it in %d more tries: %s", cli_http_server(p->http), p->what, TRIES, p->why);
    return false;
}

bool cli_persist(cli_persistence *p, bool (*send)(void *user, cli_reply *reply), void *user, cli_reply *reply, int *code) {
    *code = CLI_INTERNAL;
    do {
        bool answered = send(user, reply);
        long status = answered ? reply->status : 0;
        if (answered && !cli_reply_passes(reply)) {
            *code = CLI_DONE;
            cli_persist_got_on(p);
            return true;
        }
        if (!answered && !cli_http_lost(p->http)) {
            *code = cli_http_failed(p->http);
            return false;
        }
        cli_persist_note(p, status);
        cli_reply_clear(reply);
    } while (cli_persist_again(p));
    return false;
}
