/* Who waits for news of a job: requests with `Prefer: wait`, streams of events.
 *
 * A watcher is told once, of whatever comes first: news of its job, its deadline, or the daemon's end. Who wants to hear more watches
 * again. So one watcher is one bw_request_suspend() and one bw_request_resume().
 *
 * To miss nothing: add the watcher, then look at the job, then remove the watcher if there was something to see already:
 *     bw_request_suspend(r);
 *     bw_watch_add(watch, &w, id, deadline, fn, r);        fn calls bw_request_resume(r)
 *     if (<the job has ended> && bw_watch_remove(watch, &w)) bw_request_resume(r);
 *
 * Invariants
 *  1. fn is called exactly once for an added watcher that is not removed, with the watch's lock held: it is short and calls nothing of
 *     this file. When bw_watch_remove has returned false, fn has returned.
 *  2. A watcher belongs to the caller, who keeps it in place until it was told or removed.
 *  3. Whoever commits a change of a job calls bw_watch_notify after the commit, from any thread.
 */
#ifndef BW_SERVER_WATCH_H
#define BW_SERVER_WATCH_H

#include <stdbool.h>
#include <stdint.h>
#include <sys/queue.h>

#include "server/queue/queue.h"

typedef struct bw_watch bw_watch;
typedef enum { BW_WATCH_NEWS, BW_WATCH_TIME, BW_WATCH_STOP } bw_watch_reason;
typedef void (*bw_watch_fn)(void *user, bw_watch_reason reason);

typedef struct bw_watcher { /* private to watch.c */
    char job[BW_JOB_ID_TEXT];
    int64_t deadline;
    bw_watch_fn fn;
    void *user;
    bool added, listens;
    TAILQ_ENTRY(bw_watcher) same;  /* of the same hash of the job's id */
    TAILQ_ENTRY(bw_watcher) order; /* by deadline */
} bw_watcher;

bw_status bw_watch_open(bw_watch **watch); /* starts the thread that watches the deadlines */
void bw_watch_close(bw_watch *watch);      /* after bw_watch_stop; nobody is watching any more */
/* Tells all watchers, and every later one at once, that the daemon stops. */
void bw_watch_stop(bw_watch *watch);

/* `job`: its id, or "" for news of any job. `deadline` is of bw_mono_ms(). Time O(1) if deadlines come in order, at most O(watchers). */
void bw_watch_add(bw_watch *watch, bw_watcher *watcher, const char *job, int64_t deadline, bw_watch_fn fn, void *user);
/* The same, and hears also of progress and of the log (bw_watch_murmur). */
void bw_watch_listen(bw_watch *watch, bw_watcher *watcher, const char *job, int64_t deadline, bw_watch_fn fn, void *user);
bool bw_watch_remove(bw_watch *watch, bw_watcher *watcher); /* true: it will not be told any more; false: it has been */
void bw_watch_notify(bw_watch *watch, const char *job);     /* something about the job has changed, and a read sees it */
/* A worker of the job has said something: no change of the job, and nothing that is kept in the queue. */
void bw_watch_murmur(bw_watch *watch, const char *job);
bool bw_watch_stopped(bw_watch *watch);

#endif
