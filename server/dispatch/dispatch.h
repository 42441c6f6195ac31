/* The dispatcher: one thread that takes jobs from the queue, has a worker process run each of their stages, and books what
 * became of it.
 *
 * Invariants
 *  1. An attempt ends when the spawner has reported the worker's exit, never earlier: not by a result alone, not by time.
 *  2. Outputs are filed in the cache before the queue hears of them, and only for the attempt that is still the job's. Filing takes long where
 *     they are large, so threads of a pool do it; the slot stays busy until the dispatcher has booked it.
 *  3. Once a finish is noted, a worker gets SIGUSR1 when it has said hello (or later, as soon as the note is seen). If its search
 *     was cut by that, the output is filed under a key with the job's id, as all that the job makes after it; nobody else is served it.
 *  4. Stages are started only while the memory they need (admission.h) is less than the daemon's share of it; one that needs more runs alone.
 *  5. With --require-sandbox nothing is claimed until a worker has told of a complete sandbox; one is tried at the start.
 *  6. Two attempts never make the same cache entry at the same time: the second job waits and then reuses it.
 *
 * How an ended attempt is judged (judge.c), first match counts:
 *     the job was cancelled                       dismissed
 *     the daemon is stopping                      interrupted, given back to the queue
 *     out of wall time                            failed: time-limit
 *     its folder grew too large; it said too much failed: output-limit
 *     broke the protocol                          system: worker-protocol
 *     SIGXCPU / SIGXFSZ                           failed: time-limit / output-limit
 *     SIGSYS, from seccomp                        failed: sandbox-violation
 *     result with an error                        by the class of its code (input, algorithm, limit: failed; system)
 *     result ok, exit code 0, output as expected  next stage
 *     anything else                               system: worker-died
 * A system failure is tried again after a pause, until the stage has been claimed BW_TRIES_MOST times.
 */
#ifndef BW_SERVER_DISPATCH_H
#define BW_SERVER_DISPATCH_H

#include "server/config.h"
#include "server/queue/queue.h"
#include "server/store.h"
#include "server/watch.h"
#include "server/worker/session.h"

typedef struct bw_dispatch bw_dispatch;

/* Starts the thread. Everything is borrowed until bw_dispatch_stop. `watch` hears of every change of a job
 * that is booked here. `fatal` (an eventfd) is written to when the dispatcher
 * can do no more work and the daemon should end. */
bw_status bw_dispatch_start(const bw_config *config, bw_store *store, bw_queue *queue, bw_watch *watch, int spawner,
                            int fatal, bw_dispatch **dispatch);
void bw_dispatch_wake(bw_dispatch *dispatch); /* a job was added, cancelled, or asked to finish */
/* Progress of the running stage of a job and the best its search has found so far, 0 and "" if it does not run. */
double bw_dispatch_progress(bw_dispatch *dispatch, const char *job, char note[BW_NOTE_TEXT]);
/* Does the job's next stage wait until there is memory enough for it beside those that run? */
bool bw_dispatch_waits_for_memory(bw_dispatch *dispatch, const char *job);
/* What sandbox workers have here, as the last of them has told. */
bw_sandbox bw_dispatch_sandbox(bw_dispatch *dispatch);
bool bw_dispatch_alive(bw_dispatch *dispatch);
uint64_t bw_dispatch_turns(bw_dispatch *dispatch); /* rounds of the loop; one follows every wake */
/* Claims nothing any more, for good. What runs goes on, and its outputs are filed. */
void bw_dispatch_drain(bw_dispatch *dispatch);
bool bw_dispatch_draining(bw_dispatch *dispatch);
int bw_dispatch_running(bw_dispatch *dispatch); /* how many stages are running */
/* Ends the running attempts (given back to the queue), joins the thread and frees. */
void bw_dispatch_stop(bw_dispatch *dispatch);

#endif
