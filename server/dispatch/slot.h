/* The slots of the dispatcher, one for each worker that may run, and what its files do with them:
 *
 *     choose.c     which job is next, and whether there is memory for it
 *     slot.c       a slot's worker: started, listened to, stopped, released
 *     judge.c      how an attempt has ended, and what is booked of it
 *     filing.c     what takes long after that, on threads of a pool: hashing, syncing and filing the output, removing the folder
 *     dispatch.c   the thread, and what others ask it
 *
 * All but what is said to be under lock belongs to the dispatcher's thread.
 */
#ifndef BW_SERVER_DISPATCH_SLOT_H
#define BW_SERVER_DISPATCH_SLOT_H

#include <jansson.h>
#include <pthread.h>
#include <stdatomic.h>

#include "server/dispatch/dispatch.h"
#include "server/failure.h"
#include "server/limits.h"
#include "server/pool.h"
#include "server/worker/admission.h"
#include "server/worker/session.h"

enum { BW_SCRATCH_LOOK_MS = 250, BW_WAITERS_MOST = 256 };

typedef enum { BW_KEEP, BW_STOP_CANCELLED, BW_STOP_TIME, BW_STOP_SCRATCH, BW_STOP_FLOOD, BW_STOP_PROTOCOL, BW_STOP_DAEMON } bw_stop;

/* An output on its way into the cache: of the pool's thread until `done`. */
typedef struct {
    bw_pool_work work;
    atomic_bool done;
    bw_made made;      /* need, kind and cut before, the rest after it; its key is the slot's */
    bool fits;         /* after it: the attempt has not written more than it may */
    json_t *manifest;  /* of the last stage's */
    bw_status status;
} bw_filing;

typedef struct {
    bool busy;
    bool filing;        /* its worker has ended, and well */
    uint64_t token;
    bw_job job; /* as claimed */
    char key[BW_SHA256_TEXT];
    bw_stage_limits limits;
    uint64_t need;      /* bytes it was admitted with */
    int64_t peak;       /* bytes of memory that it had at most; 0 until it has ended */
    bw_spent spent;     /* by its worker; nothing until it has ended */
    int folder;         /* of the attempt; -1: closed */
    bw_session session; /* its progress and note under lock */
    bool asked;         /* it was sent SIGUSR1 */
    size_t told;        /* what it had said when watchers were last told, not too often */
    int64_t tell_at;
    int64_t started, deadline, kill_at, look_at; /* monotonic; kill_at 0: no SIGKILL pending; look_at: next look at the folder's size */
    bw_stop reason;
    struct bw_dispatch *dispatch;
    bw_filing output;
} bw_slot;

typedef struct {
    char job[BW_JOB_ID_TEXT];
    bool seen; /* in this pass */
} bw_waiter;

struct bw_dispatch {
    const bw_config *config;
    bw_store *store;
    bw_queue *queue;
    bw_watch *watch;
    bw_pool *pool;
    int spawner, wake, fatal;
    uint64_t tokens;
    pthread_t thread;
    pthread_mutex_t lock; /* progress, note and job id of the slots, waiters and sandbox, for other threads */
    atomic_bool stopping, draining, alive;
    _Atomic uint64_t turns;
    bw_slot *slots;
    bw_admission admission;
    bw_waiter waiters[BW_WAITERS_MOST]; /* under lock: jobs that the last pass left waiting for memory */
    size_t waiter_count;
    bw_sandbox sandbox; /* under lock: what the last worker told */
};

/* ---- slot.c ---- */

static inline bool bw_slot_runs(const bw_slot *s) { return s->busy && !s->filing; }
static inline const bw_api_stage *bw_slot_stage(const bw_slot *s) { return &bw_api_stages[s->job.stage]; }
static inline void bw_slot_log(bw_slot *s, const char *text) { bw_session_log(&s->session, text); }
/* Starts the claimed `job`, which is moved into the slot. What a worker needs and cannot have is a failure of the attempt, booked already. */
bw_status bw_slot_occupy(bw_dispatch *d, bw_slot *s, bw_job *job, const char *key, const json_t *options, uint64_t need);
/* Takes what the worker has said, all of it if it has ended, and acts on it. */
void bw_slot_listen(bw_dispatch *d, bw_slot *s, bool all);
/* Sends SIGTERM, with a SIGKILL to follow, or SIGKILL; the first reason counts. */
void bw_slot_stop(bw_dispatch *d, bw_slot *s, bw_stop reason, int signal);
/* Tells the worker to settle for the best found, once, if the job's owner has asked for it and the worker is listening. */
void bw_slot_ask_to_finish(bw_dispatch *d, bw_slot *s);
void bw_slot_release(bw_dispatch *d, bw_slot *s);
/* The key of the output that the job's stage makes or has made. False: no memory. */
bool bw_stage_key(const bw_job *job, const json_t *options, int stage, char key[BW_SHA256_TEXT]);
/* The file that the stage reads: the upload, or the state that the stage before has left in the cache. -1: it is not there. */
int bw_stage_input(bw_dispatch *d, const bw_job *job, const json_t *options, uint64_t *bytes);
/* Has a worker enter its sandbox and tell of it, before any job is given to one. */
void bw_dispatch_try_sandbox(bw_dispatch *d);

/* ---- choose.c ---- */

/* Is anything to be begun still? */
static inline bool bw_dispatch_claims(bw_dispatch *d) { return !atomic_load(&d->stopping) && !atomic_load(&d->draining); }
/* Fills the free slots, or takes as many jobs as are due to one round of the loop. *next_due: when to be called again at the latest, for there
 * is more to take or a job that waits for its time is due; 0: no need. */
bw_status bw_dispatch_choose(bw_dispatch *d, int64_t *next_due);
bw_waiter *bw_waiter_find(bw_dispatch *d, const char *job); /* under lock */

/* ---- filing.c ---- */

/* Has the output of an attempt that ended well filed as s->key; the dispatcher is woken when that is done. */
void bw_slot_file(bw_dispatch *d, bw_slot *s);
/* Removes the folder of an attempt, some time soon. */
void bw_dispatch_remove(bw_dispatch *d, const char *job, int attempt);

/* ---- judge.c: all free the slot, but the first if there is an output to be filed ---- */

/* After the spawner has reported the worker's exit. */
bw_status bw_slot_judge(bw_dispatch *d, bw_slot *s, int wait_status);
/* After the output has been filed, or not. */
bw_status bw_slot_book(bw_dispatch *d, bw_slot *s);
/* Books a failure: retried if it is the system's and there are tries left. `detail` or `error` (the worker's result) says what; exceeded may be NULL. */
bw_status bw_slot_give_up(bw_dispatch *d, bw_slot *s, bw_problem problem, const char *detail, const json_t *error,
                          const bw_exceeded *exceeded);
/* The same for want of something: what the limit is called, how much was allowed. */
bw_status bw_slot_exceed(bw_dispatch *d, bw_slot *s, bw_problem problem, const char *what, uint64_t allowed);

#endif
