/* How the daemon is: the checks behind /readyz, and the measurements that /metrics reads.
 *
 * A check says ok, warn or fail, and why. One that fails makes the daemon not ready. Limits are settings (ready-...). How to add one: a
 * function and a row in checks[] (health.c).
 *
 * A thread measures the disk every probe-interval: it writes and syncs a small file in DATA/tmp. That its last try failed, or has not
 * returned, is known without another write, so /readyz waits for no sync. Nor does bw_health_stop: a sync that has not returned a second later
 * is left alone, with the thread and what belongs to it.
 */
#ifndef BW_SERVER_HEALTH_H
#define BW_SERVER_HEALTH_H

#include <jansson.h>

#include "server/config.h"
#include "server/dispatch/dispatch.h"
#include "server/queue/queue.h"
#include "server/store.h"

typedef struct bw_health bw_health;
typedef enum { BW_VERDICT_OK, BW_VERDICT_WARN, BW_VERDICT_FAIL } bw_verdict;

/* Starts the thread. Everything is borrowed until bw_health_stop. */
bw_status bw_health_start(const bw_config *config, bw_store *store, bw_queue *queue, bw_dispatch *dispatch, bw_health **health);
void bw_health_stop(bw_health *health); /* NULL allowed */

/* Makes every check: a new object {NAME: {status, detail}}. *worst is the verdict on the whole. NULL if out of memory. */
json_t *bw_health_checks(bw_health *health, bw_verdict *worst);
/* Brings the gauges up to date that nobody else sets (metrics.h). */
void bw_health_measure(bw_health *health);

#endif
