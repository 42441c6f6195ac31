#include "base/large.h"

#include <stdint.h>
#include <string.h>
#include <sys/mman.h>

enum { PAGE = 4096 }; /* or a multiple of the system's: then the kernel rounds up as well */

static size_t round_up(size_t bytes, size_t to) { return (bytes + to - 1) / to * to; }

/* Address space of whole pages that starts at a multiple of BW_HUGE_PAGE. */
static void *reserve(size_t room) {
    char *p = mmap(NULL, room + BW_HUGE_PAGE, PROT_READ | PROT_WRITE, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (p == MAP_FAILED) return NULL;
    size_t before = round_up((uintptr_t)p, BW_HUGE_PAGE) - (uintptr_t)p;
    if (before) munmap(p, before);
    if (before < BW_HUGE_PAGE) munmap(p + before + room, BW_HUGE_PAGE - before);
    return p + before;
}

/* Only a wish: without huge pages all is the same, but slower. The whole block is of one kind, or it could not be moved; the kernel makes pages huge
 * only where they lie in it as a whole. */
static void *with_huge_pages(void *block, size_t room) {
    madvise(block, room, MADV_HUGEPAGE);
    return block;
}

void *bw_large_new(size_t bytes) {
    if (bytes > SIZE_MAX / 2) return NULL;
    size_t room = round_up(bytes, PAGE);
    void *block = reserve(room);
    return block ? with_huge_pages(block, room) : NULL;
}

/* Page entries are moved, not bytes: whole huge pages at a time, for both places start at a multiple of them. */
static void *move(void *block, size_t from, size_t to) {
    void *place = mremap(block, from, to, 0);
    if (place != MAP_FAILED) return place;
    place = reserve(to);
    if (!place) return NULL;
    if (mremap(block, from, to, MREMAP_MAYMOVE | MREMAP_FIXED, place) != MAP_FAILED) return place;
    munmap(place, to);
    return NULL;
}

void *bw_large_resize(void *block, size_t before, size_t bytes) {
    if (bytes > SIZE_MAX / 2) return NULL;
    size_t from = round_up(before, PAGE), to = round_up(bytes, PAGE);
    if (to < from) munmap((char *)block + to, from - to);
    void *place = to > from ? move(block, from, to) : block;
    if (!place) return NULL;
    if (bytes > before) memset((char *)place + before, 0, (bytes < from ? bytes : from) - before); /* pages beyond are new */
    return to > from ? with_huge_pages(place, to) : place;
}

void bw_large_free(void *block, size_t bytes) { munmap(block, round_up(bytes, PAGE)); }
