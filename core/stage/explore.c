#include "stage/explore.h"

#include <string.h>

/* The hexes of every block, if a cost wants them. */
static bw_status make_grids(bw_context *ctx, const bw_cells *cells, const bw_space *space, const bw_hex_mesh *hexes, bw_explore_choice *choice, bw_block_grids *grids) {
    choice->grids = NULL;
    if (choice->weight[BW_COST_BITS] <= 0 && choice->weight[BW_COST_BITS_BY_BLOCK] <= 0) return BW_OK;
    if (!hexes) return bw_fail(ctx, BW_E_USAGE, "exploration for bits wants a mesh of hexahedra");
    choice->grids = grids;
    return bw_block_grids_init(ctx, space, hexes, (int64_t)1 << cells->map->exponent, grids);
}

static bw_status take_walls_away(bw_context *ctx, bw_cells *cells, bw_complex *x, const uint8_t *wall) {
    for (size_t p = 0; p < x->patch_count; p++)
        for (size_t i = x->patch_polygon_begin[p]; i < x->patch_polygon_begin[p + 1] && !wall[p]; i++)
            cells->polygon[x->patch_polygon[i]].flags &= (uint8_t) ~(BW_WALL | BW_SPLIT);
    bw_torus_list tori = {0};
    bw_status status = bw_complex_rebuild(ctx, cells, x, &tori);
    if (status == BW_OK && tori.count) status = bw_fail(ctx, BW_E_CHECK, "exploration left %zu blocks that are no cuboids", tori.count);
    bw_free(ctx, tori.cell);
    return status == BW_OK ? bw_complex_check(ctx, cells, x) : status;
}

bw_status bw_explore_complex(bw_context *ctx, bw_cells *cells, bw_complex *x, const bw_hex_mesh *hexes, const bw_explore_choice *asked, bw_explore_found *found) {
    bw_explore_choice choice = *asked;
    bw_space space = {0};
    bw_block_grids grids = {0};
    size_t splits = x->torus_splits;
    bw_status status = bw_space_init(ctx, cells, x, &space);
    if (status == BW_OK) status = bw_space_check(ctx, &space);
    if (status == BW_OK) status = make_grids(ctx, cells, &space, hexes, &choice, &grids);
    uint8_t *wall = bw_alloc(ctx, space.patch_count, 1);
    if (status == BW_OK) status = ctx->error.status;
    if (status == BW_OK) status = bw_explore(ctx, &space, &choice, wall, found);
    if (status == BW_OK) status = take_walls_away(ctx, cells, x, wall);
    x->torus_splits = splits;
    if (status == BW_OK && x->block_count != found->best_blocks)
        status = bw_fail(ctx, BW_E_CHECK, "exploration counted %zu blocks, the complex has %zu", found->best_blocks, x->block_count);
    bw_free(ctx, wall);
    bw_block_grids_clear(ctx, &grids);
    bw_space_clear(ctx, &space);
    return status;
}
