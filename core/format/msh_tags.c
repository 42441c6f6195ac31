#include "format/msh_tags.h"

#include <stdlib.h>
#include <string.h>

bw_status bw_tags_add(bw_context *ctx, bw_tags *tags, int64_t tag) {
    if (tags->count == tags->room) {
        bw_status status = bw_reserve(ctx, &tags->tag, &tags->room, tags->count + 1);
        if (status != BW_OK) return status;
    }
    tags->tag[tags->count] = (bw_tag){tag, (int64_t)tags->count};
    tags->count++;
    return BW_OK;
}

static int by_tag(const void *a, const void *b) {
    const bw_tag *x = a, *y = b;
    return x->tag != y->tag ? (x->tag > y->tag) - (x->tag < y->tag)
                            : (x->index > y->index) - (x->index < y->index);
}

bool bw_tags_end(bw_tags *tags, int64_t *twice) {
    tags->dense = true;
    for (size_t i = 1; i < tags->count && tags->dense; i++)
        tags->dense = tags->tag[i - 1].tag < INT64_MAX && tags->tag[i].tag == tags->tag[i - 1].tag + 1;
    if (tags->dense) return true;
    qsort(tags->tag, tags->count, sizeof *tags->tag, by_tag);
    for (size_t i = 1; i < tags->count; i++)
        if (tags->tag[i].tag == tags->tag[i - 1].tag) {
            *twice = tags->tag[i].tag;
            return false;
        }
    return true;
}

int64_t bw_tags_find(const bw_tags *tags, int64_t tag) {
    if (!tags->count || tag < tags->tag[0].tag || tag > tags->tag[tags->count - 1].tag) return -1;
    if (tags->dense) return tag - tags->tag[0].tag;
    size_t low = 0, high = tags->count;
    while (low < high) {
        size_t middle = low + (high - low) / 2;
        if (tags->tag[middle].tag < tag)
            low = middle + 1;
        else
            high = middle;
    }
    return low < tags->count && tags->tag[low].tag == tag ? tags->tag[low].index : -1;
}

void bw_tags_clear(bw_context *ctx, bw_tags *tags) {
    bw_free(ctx, tags->tag);
    memset(tags, 0, sizeof *tags);
}
