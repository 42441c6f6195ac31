/* Large blocks of memory: pages of their own, huge ones where the system has any. A pool of some megabytes that grows step by step would otherwise cost a page
 * fault every 4 KiB, and a move of all its page entries at every step.
 *
 * A block starts at a multiple of BW_HUGE_PAGE. Its pages are huge only where they lie in it as a whole, so it takes no more memory than was asked for. */
#ifndef BW_BASE_LARGE_H
#define BW_BASE_LARGE_H

#include <stddef.h>

#define BW_HUGE_PAGE ((size_t)1 << 21)

/* Zeroed bytes; NULL if there are none. */
void *bw_large_new(size_t bytes);
/* Resizes a block of `before` bytes; new bytes are zero. NULL leaves it alone. Neither size is 0. */
void *bw_large_resize(void *block, size_t before, size_t bytes);
void bw_large_free(void *block, size_t bytes);

#endif
