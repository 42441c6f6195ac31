/* What a job carries through every stage: its byte budget, its first error, cancellation, progress and log.
 *
 * Invariants
 *  1. The first error wins: a later bw_fail() leaves message and elements as they are and returns the first status.
 *  2. Every heap block of a job is taken with bw_alloc/bw_grow and given back with bw_free, so bytes in use, the
 *     peak and the limit are known exactly; a refused block is BW_E_MEMORY, never a crash.
 *  3. Nothing here is shared between threads except `cancel` and `finish`, which a signal handler may set.
 */
#ifndef BW_BASE_CONTEXT_H
#define BW_BASE_CONTEXT_H

#include <signal.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "base/kinds.h"
#include "base/status.h"

enum { BW_ELEMENTS_KEPT = 32 }; /* offending elements listed by an error; the rest is only counted */
enum { BW_NOTE_MOST = 100 };
enum { BW_REGIONS_KEPT = 16, BW_REGION_TETS = 16 };

/* An element at fault: kind is "vertex", "edge", "facet", "tet", "line", ...; id counts from 0 as in the input file. */
typedef struct {
    char kind[12];
    int64_t id;
    bool has_position;
    double position[3]; /* in the input's coordinates */
} bw_element;

/* A place in which the input is defective: tets that hang together. */
typedef struct {
    size_t tet_count;
    int64_t tets[BW_REGION_TETS]; /* ids of the first of them, as in the input file; 0 beyond tet_count */
    double centre[3];             /* mean of the tets' centres, in the input's coordinates */
    double low[3], high[3];       /* box around their vertices */
} bw_region;

typedef struct {
    bw_status status;
    char message[480];
    size_t element_count; /* how many elements are at fault; the first BW_ELEMENTS_KEPT of them are listed */
    bw_element elements[BW_ELEMENTS_KEPT];
    size_t region_count; /* in how many places, where that is known; the first BW_REGIONS_KEPT are listed */
    bw_region regions[BW_REGIONS_KEPT];
} bw_error;

typedef struct {
    size_t used, peak, limit; /* bytes; limit 0 means none */
    uint64_t calls, fail_at;  /* tests: the fail_at-th allocation fails (0: never) */
} bw_memory;

typedef struct bw_context {
    bw_memory memory;
    bw_error error;
    int threads;                        /* at least 1 */
    const volatile sig_atomic_t *cancel; /* may be NULL; non-zero asks the job to stop */
    const volatile sig_atomic_t *finish; /* may be NULL; non-zero asks a search to end with the best it has found, and the job to go on with that */
    bool finished;                       /* a search has ended early because of that: what follows depends on when it was asked for */
    uint64_t next_need;                  /* of bw_stage_run: bytes that the stage after the one that ran will need; 0: there is none */
    bw_input_kind input_kind;            /* of bw_stage_run: what the job's input was found to be; BW_KIND_AUTO: not known */
    void (*progress)(void *user, const char *stage, double fraction); /* may be NULL; fraction in 0..1 of the stage */
    void (*note)(void *user, const char *text);                       /* may be NULL; what a search has found so far, in place of the note before */
    void (*log)(void *user, const char *line);                        /* may be NULL; one line without its newline */
    void *user;
    const char *stage; /* name of the running stage */
} bw_context;

void bw_context_init(bw_context *ctx); /* one thread, no limit, no callbacks */

/* Records a failure and returns the status now in force (the first one recorded). printf-like. */
bw_status bw_fail(bw_context *ctx, bw_status status, const char *format, ...) __attribute__((format(printf, 3, 4)));
/* Adds an offending element to the error; call it before or after bw_fail. position may be NULL. */
void bw_fail_element(bw_context *ctx, const char *kind, int64_t id, const double *position);
/* For messages: the word or words behind a number of things, `one` behind 1. */
static inline const char *bw_words(size_t count, const char *one, const char *many) { return count == 1 ? one : many; }
void bw_fail_region(bw_context *ctx, const bw_region *region); /* likewise a place */
void bw_log(bw_context *ctx, const char *format, ...) __attribute__((format(printf, 2, 3)));
void bw_progress(bw_context *ctx, double fraction);
void bw_note(bw_context *ctx, const char *format, ...) __attribute__((format(printf, 2, 3))); /* at most BW_NOTE_MOST characters */
/* BW_OK, or BW_E_CANCELLED once cancellation was asked for. Cheap: call it in every outer loop. */
bw_status bw_poll(bw_context *ctx);
double bw_seconds_now(void); /* of a clock that never goes back; for durations and limits only */

/* count * size zeroed bytes. NULL (error recorded as BW_E_MEMORY) if refused; count 0 gives a valid block. */
void *bw_alloc(bw_context *ctx, size_t count, size_t size);
/* Resizes a block of bw_alloc/bw_grow (or NULL) to count * size bytes; new bytes are zero; NULL leaves the old block alone. */
void *bw_resize(bw_context *ctx, void *block, size_t count, size_t size);
void bw_free(bw_context *ctx, void *block); /* NULL is fine */
/* Counts memory that a library holds for the job, and bw_alloc does not know of: *charged bytes were counted before, `bytes` are held now. BW_E_MEMORY beyond the limit; it is
 * counted nevertheless. */
bw_status bw_charge(bw_context *ctx, size_t *charged, size_t bytes);

/* Growable array: makes room for `need` items in *items (item size given), and for half as many more as there were; an eighth, if that is many. */
bw_status bw_reserve_(bw_context *ctx, void **items, size_t *capacity, size_t need, size_t size);
#define bw_reserve(ctx, items, capacity, need)                                                                        \
    ((need) <= *(capacity) ? BW_OK : bw_reserve_((ctx), (void **)(items), (capacity), (need), sizeof **(items)))
/* Gives back what a growable array has room for beyond its first `count` items. */
bw_status bw_trim_(bw_context *ctx, void **items, size_t *capacity, size_t count, size_t size);
#define bw_trim(ctx, items, capacity, count) bw_trim_((ctx), (void **)(items), (capacity), (count), sizeof **(items))

#endif
