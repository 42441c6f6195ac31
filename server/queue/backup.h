/* Copies of the queue's file: taken while it is written, looked at, checked.
 *
 * A copy is one snapshot: it has everything that was durable when it was begun. Writers go on meanwhile; the WAL grows until it is done.
 */
#ifndef BW_SERVER_QUEUE_BACKUP_H
#define BW_SERVER_QUEUE_BACKUP_H

#include <stdatomic.h>

#include "server/queue/queue.h"

enum { BW_COPY_ERROR = 200 };

/* What takes long is given a flag that others set to have it end soon, with BW_E_CANCELLED; NULL: nobody does. */
static inline bool bw_stopped(const atomic_bool *stop) { return stop && atomic_load(stop); }

typedef struct {
    int64_t version, jobs;
} bw_copy_facts;
/* `to` must not be there. Checked and synced when it returns BW_OK; else nothing is left of it. */
bw_status bw_queue_copy(bw_queue *queue, const char *to, const atomic_bool *stop, bw_copy_facts *facts);
/* Is it a sound copy that this program can read? BW_E_VERSION: of a newer one; BW_E_CHECK: it is damaged, or something else. `error` tells. */
bw_status bw_copy_check(const char *path, const atomic_bool *stop, bw_copy_facts *facts, char error[BW_COPY_ERROR]);

/* The files that the jobs of a copy need: "blobs" <sha256>; "cache" <key>, results and what is read next. */
typedef bw_status (*bw_copy_visit)(void *user, const char *kind, const char *name, int64_t bytes);
bw_status bw_copy_files(const char *path, bw_copy_visit visit, void *user);

#endif
