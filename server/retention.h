/* Retention: what is old or too much goes, in the background (queue/retention.h says what may).
 *
 * A thread makes a pass at start, then every retention-interval, and when the cache has grown beyond cache-size. A pass works in small steps
 * and rests between them as long as a step took. Passes exclude one another, and a backup excludes them (bw_retention_hold).
 */
#ifndef BW_SERVER_RETENTION_H
#define BW_SERVER_RETENTION_H

#include "server/config.h"
#include "server/queue/retention.h"
#include "server/store.h"

typedef struct bw_retention bw_retention;

typedef struct {
    struct {
        int64_t count, bytes;
    } kinds[BW_KEEP_COUNT];
    int64_t held, held_bytes; /* outputs that are older than those taken, but in use */
    int64_t cache_bytes;      /* left */
} bw_retention_report;
extern const char *const bw_keep_names[BW_KEEP_COUNT];

/* All borrowed. Without bw_retention_begin there is no thread: for who does the daemon's work in its stead. */
bw_status bw_retention_open(const bw_config *config, bw_store *store, bw_queue *queue, bw_retention **retention);
bw_status bw_retention_begin(bw_retention *retention); /* starts the thread */
void bw_retention_stop(bw_retention *retention);       /* ends the thread; passes under way, of others too, end after their step */
void bw_retention_close(bw_retention *retention);      /* stops it first; both allow NULL */

bw_policy bw_retention_policy(const bw_config *config, int64_t now);
/* One pass, now. `dry`: changes nothing, tells what would go. */
bw_status bw_retention_pass(bw_retention *retention, const bw_policy *policy, bool dry, bw_retention_report *report);
/* Between the two nothing is collected. */
void bw_retention_hold(bw_retention *retention);
void bw_retention_release(bw_retention *retention);

/* At start, before any claim: rows and files of outputs, blobs and logs in pairs again; attempts left open are given back. Logged with its counts. */
bw_status bw_reconcile(bw_store *store, bw_queue *queue, int64_t now);

#endif
