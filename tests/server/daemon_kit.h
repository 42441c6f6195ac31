/* A real daemon for a test: its own data folder, a free port, libcurl to talk to it. Everything asserts (cmocka). */
#ifndef BW_TESTS_DAEMON_KIT_H
#define BW_TESTS_DAEMON_KIT_H

#include <jansson.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include <cmocka.h>

#include "server/digest.h"

typedef struct {
    char data[64];     /* folder, below /tmp */
    char address[64];  /* "127.0.0.1:PORT" */
    const char *worker; /* NULL: the real one */
    pid_t pid;          /* 0: not running */
} kit_daemon;

/* Starts blockwrightd with the test worker (or `worker`) and more arguments (NULL-terminated, may be NULL); waits until it
 * listens. kit_start makes the folder, kit_restart uses it again. */
void kit_start(kit_daemon *daemon, const char *worker, const char *const *arguments);
void kit_restart(kit_daemon *daemon, const char *const *arguments);
/* Daemons that are started from now on have system calls that go wrong by these rules of tests/torture/shim.c; NULL: none any more. */
void kit_shim(const char *rules);
void kit_kill(kit_daemon *daemon, int signal); /* and waits for its end */
int kit_stop(kit_daemon *daemon);              /* SIGTERM; returns the exit code */
void kit_remove(kit_daemon *daemon);           /* stops it if it runs, deletes the folder */

typedef struct {
    long status;
    char type[80], etag[80], location[80], allow[80], policy[80], applied[80]; /* as much of them as fits */
    char headers[3000]; /* all of the last answer; see kit_header */
    char *body; /* NUL-terminated */
    size_t size;
} kit_reply;

/* One request. `headers`: lines separated by \n, or NULL. A failure of the transport asserts, unless status is 0 allowed:
 * kit_try returns false then. */
bool kit_try(const kit_daemon *daemon, const char *method, const char *path, const char *headers, const void *body,
             size_t size, kit_reply *reply);
kit_reply kit_request(const kit_daemon *daemon, const char *method, const char *path, const char *headers,
                      const void *body, size_t size);
kit_reply kit_get(const kit_daemon *daemon, const char *format, ...) __attribute__((format(printf, 2, 3)));
/* The value of a header, "" if it is not there; until the next call. */
const char *kit_header(const kit_reply *reply, const char *name);
void kit_free(kit_reply *reply);
json_t *kit_json(kit_reply *reply); /* parses and frees the reply */

void kit_hash(const void *data, size_t size, char hash[BW_SHA256_TEXT]);
void kit_upload(const kit_daemon *daemon, const char *content, char hash[BW_SHA256_TEXT]);
/* Creates a job for `content` with `options` (JSON, may be NULL); writes its id. */
void kit_submit(const kit_daemon *daemon, const char *content, const char *options, char id[32]);
/* The same with a file of parameters. */
void kit_submit_both(const kit_daemon *daemon, const char *content, const char *parameters, const char *options, char id[32]);
void kit_take_id(kit_reply reply, char id[32]); /* of the job that a reply with 201 has; frees it */
size_t kit_listed(const kit_daemon *daemon, const char *query); /* jobs on the first page of the list */
json_t *kit_job(const kit_daemon *daemon, const char *id);
/* Polls until the job has one of the final states; asserts that it takes less than `seconds`. */
json_t *kit_wait(const kit_daemon *daemon, const char *id, int seconds);
void kit_wait_state(const kit_daemon *daemon, const char *id, const char *state, int seconds);
const char *kit_text(const json_t *object, const char *name); /* "" if absent */
/* The reply must be a problem document of this code and its status must agree; if it is to be asked again, it says when. Frees it. */
void kit_expect_problem(kit_reply reply, long status, const char *code);
/* The whole of a raw exchange over TCP: sends, half-closes if asked, returns what comes back (malloc'ed). */
char *kit_raw(const kit_daemon *daemon, const char *data, size_t size, bool half_close);
/* Sends, and leaves the connection open / hangs up. */
int kit_connect(const kit_daemon *daemon, const char *data, size_t size);
void kit_abandon(const kit_daemon *daemon, const char *data, size_t size);
/* Waits until no upload is under way any more; false after `ms`. */
bool kit_no_uploads(const kit_daemon *daemon, int ms);
void kit_sleep_ms(int ms);
/* Worker processes of this daemon's spawner. */
size_t kit_workers(const kit_daemon *daemon, pid_t *pids, size_t most);

#endif
