/* Work on the items 0..count-1 by ctx->threads threads, each on one contiguous range, or on pieces as it comes to them.
 *
 * Invariants
 *  1. The outcome does not depend on the number of threads: if ranges fail, the failure of the lowest range is the one reported, and a range stops at
 *     its first failure; so it is the failure of the lowest item, as with one thread.
 *  2. `work` gets a context of its own for its range: an error, no progress, no log. It must not allocate: the byte budget belongs to
 *     the caller's context, which hands out scratch beforehand, one piece per range.
 */
#ifndef BW_BASE_PARALLEL_H
#define BW_BASE_PARALLEL_H

#include "base/context.h"

enum { BW_PARALLEL_MOST = 64 };

/* Works on items begin..end-1. `range` counts the ranges from 0. */
typedef bw_status bw_parallel_work(bw_context *ctx, size_t begin, size_t end, int range, void *user);

/* Number of ranges that bw_parallel will make: at least 1, at most BW_PARALLEL_MOST, one for every `least` items at most. */
int bw_parallel_ranges(const bw_context *ctx, size_t count, size_t least);
/* Runs the work on that many ranges (a number that bw_parallel_ranges gave) and waits for all of them. */
bw_status bw_parallel(bw_context *ctx, size_t count, int ranges, bw_parallel_work *work, void *user);
/* For items of unequal cost: pieces of so many consecutive items, the next for the thread that is ready first. `range` is the thread's number, 0..ranges-1;
 * which pieces it gets is left to chance, so what the work leaves behind must not depend on that. */
bw_status bw_parallel_pieces(bw_context *ctx, size_t count, size_t piece, int ranges, bw_parallel_work *work, void *user);

#endif
