/* Uploads that can be resumed.
 *
 *     DATA/uploads/<id>.part    the bytes so far
 *     DATA/uploads/<id>.json    its sidecar: owner, length, offset, expiry, expected hash, metadata, and the blob when it is complete
 *
 * Invariants
 *  1. `offset` of the sidecar is durable: that many bytes of the file were synced before it was written. At start the file is cut to it;
 *     a file without sidecar, and a sidecar with neither file nor blob, are deleted.
 *  2. Who works on an upload has taken it; nobody else can take it until it is released.
 *  3. When the last byte is there, the sidecar names the blob first, then the file becomes it (repeated at start if the daemon died between).
 *  4. The hash grows with the bytes. After a restart it is not known, and the file is read again when it is complete.
 *
 * Of the functions here only those marked (slow) sync, read or delete files; they are not for HTTP threads.
 */
#ifndef BW_SERVER_PARTIAL_H
#define BW_SERVER_PARTIAL_H

#include <jansson.h>
#include <stdbool.h>
#include <stdint.h>

#include "server/queue/queue.h"
#include "server/store.h"

typedef struct bw_partials bw_partials;
typedef struct bw_partial bw_partial;

/* (slow) `data`: the daemon's folder. The store is borrowed. */
bw_status bw_partials_open(const char *data, bw_store *store, bw_partials **partials);
void bw_partials_close(bw_partials *partials); /* all are released */
/* (slow) Deletes those that are due and not taken, and of those that are complete the oldest beyond `most`: who has not heard that
 * its upload is complete asks soon. Returns how many. */
int bw_partials_expire(bw_partials *partials, int64_t now, int most);

typedef struct {
    int uploads, of_owner;   /* that are not complete */
    uint64_t bytes_of_owner; /* that they are to have when they are */
} bw_partial_tally;
void bw_partials_tally(bw_partials *partials, const char *owner, bw_partial_tally *tally);

typedef struct {
    const char *owner;    /* "": the local one */
    uint64_t length;      /* of the whole */
    const char *expected; /* SHA-256 that it is to have; NULL: any */
    const char *metadata; /* kept as it is, for the client; NULL: none */
    int64_t expires;      /* ms since 1970 */
} bw_partial_new;

/* Makes the file and takes the upload; it is durable, and known to others, after the first bw_partial_commit. */
bw_status bw_partial_create(bw_partials *partials, const bw_partial_new *wanted, bw_partial **partial);

typedef enum { BW_PARTIAL_TAKEN, BW_PARTIAL_UNKNOWN, BW_PARTIAL_BUSY, BW_PARTIAL_FAILED } bw_partial_found;
/* What is of another owner is as if it were not there. */
bw_partial_found bw_partial_take(bw_partials *partials, const char *id, const char *owner, int64_t now, bw_partial **partial);
void bw_partial_release(bw_partial *partial); /* one that was never committed is deleted */
void bw_partial_remove(bw_partial *partial);  /* (slow) deletes it; its blob, if it has become one, stays */

/* Of a taken upload. */
const char *bw_partial_id(const bw_partial *partial);
uint64_t bw_partial_length(const bw_partial *partial);
uint64_t bw_partial_offset(const bw_partial *partial);  /* bytes so far, durable or not */
bool bw_partial_durable(const bw_partial *partial);     /* all of them are */
int64_t bw_partial_expires(const bw_partial *partial);
const char *bw_partial_metadata(const bw_partial *partial); /* NULL: none */
const char *bw_partial_blob(const bw_partial *partial);     /* "" until it is complete */

/* Appends; BW_E_LIMIT if that is more than its length. errno tells ENOSPC apart. */
bw_status bw_partial_write(bw_partial *partial, const void *data, size_t size);
/* mark, write..., undo: what was written since the mark is gone. */
bw_status bw_partial_mark(bw_partial *partial);
bw_status bw_partial_undo(bw_partial *partial);
/* (slow) Makes durable what there is, with a new expiry; a complete upload becomes a blob. BW_E_CHECK: it is complete and has another hash
 * than expected (`actual`); it is to be removed then. BW_E_IO: the bytes since the last commit may be gone (bw_partial_offset tells), what was committed before is not. */
bw_status bw_partial_commit(bw_partial *partial, int64_t expires, char actual[BW_SHA256_TEXT]);

#endif
