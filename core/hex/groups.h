/* Hexes by block, quads by surface: for formats that list them group by group. */
#ifndef BW_HEX_GROUPS_H
#define BW_HEX_GROUPS_H

#include "hex/skin.h"

/* Groups that are not empty ascend by key; BW_NONE, if there is such a one, is the last. */
typedef struct {
    size_t count;
    int32_t *key;  /* [group] block or surface */
    size_t *begin; /* [group + 1] */
    size_t *item;  /* hexes or quads, ascending in each group */
} bw_hex_groups;

bw_status bw_hex_groups_of_blocks(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_groups *groups);
bw_status bw_hex_groups_of_surfaces(bw_context *ctx, const bw_hex_skin *skin, bw_hex_groups *groups);
void bw_hex_groups_clear(bw_context *ctx, bw_hex_groups *groups);

#endif
