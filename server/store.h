/* The data folder.
 *
 *     DATA/blobs/ab/<sha256>      uploaded inputs, named by their content
 *     DATA/cache/ab/<key>         stage outputs: a state file, or for the last stage a folder of result files
 *     DATA/logs/<job>.log         what the workers of a job said
 *     DATA/tmp/                   uploads under way                             emptied at start
 *     DATA/work/<job>.<attempt>/  folder that one attempt may write into       emptied at start
 *     DATA/uploads/               uploads that can be resumed (partial.h)
 *     DATA/jobs.db                the queue (queue.h)
 *     DATA/address                address of the running daemon
 *     DATA/control                socket of the running daemon (admin.h)
 *     DATA/lock, spawner.lock     held by the daemon, and by the spawner until its last worker is gone
 *
 * Invariants
 *  1. A file appears under blobs/ or cache/ complete and synced, by one rename, or not at all.
 *  2. Only the daemon renames into blobs/ and cache/; workers know nothing but their attempt's own folder, so an
 *     attempt that was given up can spoil nothing.
 *  3. The 256 folders of blobs/ and of cache/ are durable before anything is filed into one: they are made and synced at start, so that
 *     no rename waits for, or relies on, a folder that another thread is just making.
 *  4. A cache entry counts only if the queue has a row for it (bw_queue_output); the rename comes before the row.
 */
#ifndef BW_SERVER_STORE_H
#define BW_SERVER_STORE_H

#include <jansson.h>
#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

#include "server/digest.h"

typedef struct bw_store bw_store;
typedef struct bw_upload bw_upload;

/* Makes what is missing below `data` (absolute) and deletes the temporaries of an earlier daemon. */
bw_status bw_store_open(const char *data, bw_store **store);
void bw_store_close(bw_store *store);
uint64_t bw_store_room(const bw_store *store); /* bytes that can still be written */

/* An upload: begin, write..., then finish or abort (each frees it). errno tells ENOSPC apart. */
bw_status bw_upload_begin(bw_store *store, bw_upload **upload);
bw_status bw_upload_write(bw_upload *upload, const void *data, size_t size);
/* If the content has the hash `sha256` (NULL: whatever hash it has), it is a durable blob afterwards; else *matches is false and it is gone.
 * `actual` gets the hash in both cases. */
bw_status bw_upload_finish(bw_upload *upload, const char *sha256, bool *matches, char actual[BW_SHA256_TEXT]);
void bw_upload_abort(bw_upload *upload);
uint64_t bw_upload_bytes(const bw_upload *upload);

/* Makes a synced file of this content, which lies in the data folder, the blob: it is renamed, durably. May be
 * repeated when it has failed after the rename. */
bw_status bw_store_adopt(bw_store *store, const char *path, const char *sha256);
/* A descriptor for reading, or -1; errno is ENOENT if there is no such blob, else it may be there and cannot be had now. */
int bw_store_open_blob(const bw_store *store, const char *sha256, uint64_t *bytes);
/* A descriptor of the cached state file, or of result file `name` in the cached folder (NULL: the file itself). -1: none. */
int bw_store_open_cached(const bw_store *store, const char *key, const char *name, uint64_t *bytes);
bool bw_store_has_cached(const bw_store *store, const char *key);
bw_status bw_store_drop_cached(bw_store *store, const char *key); /* one without a row: nobody reads it */
bool bw_store_has_blob(const bw_store *store, const char *sha256);
/* Takes the entry out of its place at once, by a rename, and deletes it in the next bw_store_empty_discarded (or at the next start). */
void bw_store_discard_cached(bw_store *store, const char *key);
void bw_store_discard_blob(bw_store *store, const char *sha256);
/* Takes the blob out of its place at once. Its bytes go when the descriptor is closed, which may take long; -1: there is none. */
int bw_store_unlink_blob(bw_store *store, const char *sha256);
void bw_store_discard_log(bw_store *store, const char *job);
void bw_store_empty_discarded(bw_store *store); /* by one thread at a time */
bw_status bw_store_each_blob(bw_store *store, void (*visit)(void *user, const char *sha256, uint64_t bytes), void *user);
/* Calls `known` for every key in the cache and deletes the entries for which it says no. */
bw_status bw_store_sweep_cache(bw_store *store, bool (*known)(void *user, const char *key), void *user, int *dropped);

/* A descriptor to append to the job's log / to read it (-1: nothing logged yet). */
int bw_store_append_log(const bw_store *store, const char *job);
void bw_store_drop_log(const bw_store *store, const char *job);
/* Deletes the logs of jobs for which `known` says no. */
bw_status bw_store_sweep_logs(bw_store *store, bool (*known)(void *user, const char *job), void *user, int *dropped);
int bw_store_open_log(const bw_store *store, const char *job, uint64_t *bytes);

/* The folder of an attempt: a fresh empty one, open for the worker; the worker writes "out" in it. */
bw_status bw_attempt_begin(bw_store *store, const char *job, int attempt, int *folder);
/* Moves the attempt's "out" into the cache as `key`, synced. It must be one regular file, or a folder of regular files
 * with plain names; anything else is BW_E_CHECK. *bytes gets the total; *manifest is NULL for a file, else a new array of
 * {name, bytes, sha256, media_type} sorted by name. */
bw_status bw_attempt_publish(bw_store *store, const char *job, int attempt, const char *key, uint64_t *bytes,
                             json_t **manifest);
void bw_attempt_end(bw_store *store, const char *job, int attempt); /* deletes the folder */

#endif
