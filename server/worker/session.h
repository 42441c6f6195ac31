/* What the daemon hears of one worker: its frames (worker_proto.h) and whatever it writes to its standard output and error.
 *
 * Invariants
 *  1. Nothing the worker says is kept without bounds: of its log lines and its standard error together LOG_MOST bytes per attempt go to
 *     the job's log; of notes and progress the last; and one that says more than BW_SAID_MOST bytes in all is to be stopped (BW_SAY_FLOOD).
 *  2. One call reads at most READ_MOST bytes, so that a worker that never stops talking does not keep the dispatcher from the others.
 *  3. Lines of the log hold no control characters and begin with time, stage and attempt.
 */
#ifndef BW_SERVER_SESSION_H
#define BW_SERVER_SESSION_H

#include <jansson.h>
#include <pthread.h>

#include "bw_api.h"
#include "server/worker/sandbox.h"
#include "server/worker/worker_proto.h"

enum { BW_NOTE_TEXT = 201, BW_LOG_LINE_MOST = 1000, BW_SAID_MOST = 64 << 20 };

typedef enum { BW_SAY_GOOD, BW_SAY_BROKEN, BW_SAY_FLOOD } bw_say;

typedef struct {
    const bw_api_stage *stage; /* NULL: a trial of the sandbox */
    int attempt;
    int channel, errors, log; /* descriptors, owned; -1: closed */
    bw_say state;             /* the first that was not good */
    size_t said, logged;
    char line[BW_LOG_LINE_MOST]; /* of standard error, until its newline comes */
    size_t line_size;
    pthread_mutex_t *lock;   /* borrowed; guards the next two, which other threads read */
    double progress;
    char note[BW_NOTE_TEXT]; /* printable ASCII */
    bw_sandbox sandbox;      /* as told in the hello, if decoder.hello */
    json_t *result;          /* NULL: not yet */
    bw_decoder decoder;
} bw_session;

/* Takes the descriptors. `log` may be -1: nothing is kept. */
void bw_session_open(bw_session *session, const bw_api_stage *stage, int attempt, pthread_mutex_t *lock, int channel, int errors, int log);
void bw_session_close(bw_session *session);
/* Takes what has arrived, without waiting. After a state that is not good nothing more is read. */
void bw_session_read(bw_session *session);
/* The same until there is no more; for a worker that has ended. */
void bw_session_drain(bw_session *session);
void bw_session_log(bw_session *session, const char *text); /* a line of the daemon's own */

#endif
