/* Which index a tag stands for: Gmsh's tags are any numbers, in any order. */
#ifndef BW_FORMAT_MSH_TAGS_H
#define BW_FORMAT_MSH_TAGS_H

#include "base/context.h"

typedef struct {
    int64_t tag;
    int64_t index;
} bw_tag;

typedef struct {
    bw_tag *tag;
    size_t count, room;
    bool dense; /* tag[i].tag == tag[0].tag + i: no search is needed */
} bw_tags;

/* Adds the tag of index `count`. */
bw_status bw_tags_add(bw_context *ctx, bw_tags *tags, int64_t tag);
/* After the last one. *twice: a tag that occurs twice, if it returns false. O(n), or O(n log n) if they are
 * not dense. */
bool bw_tags_end(bw_tags *tags, int64_t *twice);
/* -1 if there is none. */
int64_t bw_tags_find(const bw_tags *tags, int64_t tag);
void bw_tags_clear(bw_context *ctx, bw_tags *tags);

#endif
