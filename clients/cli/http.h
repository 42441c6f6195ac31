/* Requests to a daemon, over libcurl. Paths start with "/"; replies are read whole into memory, except
 * downloads.
 *
 * A request that comes too often (429, too-many-requests) is made again when the daemon lets it. A reply is any other
 * HTTP answer, also an error; a call fails only if there is none (no connection, broken transfer; then the reply has no
 * body, and the status if that came), and then cli_http_error() tells why. cli_http_json() is the convenient form: it also
 * prints problems and turns them into exit codes.
 */
#ifndef BW_CLI_HTTP_H
#define BW_CLI_HTTP_H

#include <jansson.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>

#include "terminal.h"

typedef struct cli_http cli_http;

typedef struct {
    long status; /* HTTP status */
    char *body;  /* NUL-terminated, owned; free with cli_reply_clear */
    size_t size;
} cli_reply;

/* Where the daemon is, and what it is shown. NULL: by the environment. */
typedef struct {
    const char *server;     /* its URL; BLOCKWRIGHT_SERVER, or else http://127.0.0.1:8080 */
    const char *token_file; /* a file whose first line is the access token; BLOCKWRIGHT_TOKEN is the token itself */
    const char *ca_file;    /* certificates to trust, as PEM; BLOCKWRIGHT_CA_FILE, or else the system's */
} cli_remote;

/* Ends the program if libcurl cannot start or the token cannot be read. There is no way to give the token as a word: everybody on the
 * machine can read those. */
cli_http *cli_http_open(const cli_remote *remote);
void cli_http_close(cli_http *http);
const char *cli_http_server(const cli_http *http); /* without a trailing slash */
const char *cli_http_error(const cli_http *http);  /* why the last call failed */

/* Adds a header to the next cli_http_call, cli_http_json or cli_http_upload; `value` is printable ASCII. */
void cli_http_header(cli_http *http, const char *name, const char *value);
/* Did the last call fail for lack of a connection, which may pass? That none could be made counts only of a server that has answered before. */
bool cli_http_lost(const cli_http *http);
bool cli_http_call(cli_http *http, const char *method, const char *path, const char *json, cli_reply *reply);
/* Sends bytes `from` to `size` of `file`; `progress` (may be NULL) shows how much of the `size` has gone. */
bool cli_http_upload(cli_http *http, const char *method, const char *path, FILE *file, int64_t from, int64_t size,
                     cli_progress *progress, cli_reply *reply);
/* A header of the last answer, borrowed until the next call; NULL if it had none. */
const char *cli_http_answered(const cli_http *http, const char *name);
/* GETs into `file`, at most `limit` bytes; an answer other than 200 goes to reply->body instead. */
bool cli_http_download(cli_http *http, const char *path, FILE *file, int64_t limit, cli_reply *reply);
/* GETs, giving the body of a 200 to `take` as it comes, for as long as it goes on; `take` returns false to break it off. */
bool cli_http_stream(cli_http *http, const char *path, bool (*take)(void *user, const char *bytes, size_t size), void *user,
                     cli_reply *reply);
void cli_reply_clear(cli_reply *reply);
/* Is it the answer of a proxy whose daemon is not there, or of a daemon that stops or cannot just now: 502, 503, 504? */
bool cli_reply_passes(const cli_reply *reply);

/* Sends a request and parses the answer, which must have a 2xx status and be JSON. NULL otherwise: the reason
 * is on standard error and *exit_code is set. json_decref() the result. */
json_t *cli_http_json(cli_http *http, const char *method, const char *path, const char *json, int *exit_code);
/* The second half of it: parses a reply, and clears it. */
json_t *cli_http_parsed(const cli_http *http, cli_reply *reply, int *exit_code);
/* Says what a reply that is not a success means; returns the exit code. */
int cli_http_refused(const cli_http *http, const cli_reply *reply);
/* Says that the last call failed; returns the exit code. */
int cli_http_failed(const cli_http *http);

/* Is `id` one a daemon could have given? (Keeps paths clean.) */
bool cli_job_id_valid(const char *id);

#endif
