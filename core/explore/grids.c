#include "explore/grids.h"

#include <string.h>

#include "hex/grid.h"

void bw_block_grids_clear(bw_context *ctx, bw_block_grids *g) {
    bw_free(ctx, g->begin), bw_free(ctx, g->vertex);
    memset(g, 0, sizeof *g);
}

static bool measure(const bw_space *s, const bw_block_grids *g, bw_block b, uint32_t n[3]) {
    for (int k = 0; k < 3; k++) {
        n[k] = (uint32_t)(s->block_extent[b][k] / g->unit);
        if (s->block_extent[b][k] % g->unit || s->block_extent[b][k] / g->unit > INT32_MAX) return false;
    }
    return true;
}

bw_status bw_block_grids_init(bw_context *ctx, const bw_space *s, const bw_hex_mesh *mesh, int64_t unit, bw_block_grids *g) {
    bw_hex_groups blocks;
    *g = (bw_block_grids){.mesh = mesh, .unit = unit};
    bw_status status = bw_hex_groups_of_blocks(ctx, mesh, &blocks);
    g->begin = bw_alloc(ctx, s->block_count + 1, sizeof *g->begin);
    if (status == BW_OK) status = ctx->error.status;
    uint32_t n[3], hexes[3];
    bool good = status == BW_OK && blocks.count == s->block_count;
    for (size_t b = 0; b < s->block_count && good; b++) {
        good = measure(s, g, (bw_block)b, n);
        g->begin[b + 1] = g->begin[b] + bw_hex_grid_points(n);
    }
    if (good) g->vertex = bw_alloc(ctx, g->begin[s->block_count], sizeof *g->vertex);
    if (status == BW_OK) status = ctx->error.status;
    for (size_t b = 0; b < s->block_count && good && status == BW_OK; b++) {
        measure(s, g, (bw_block)b, n);
        good = blocks.key[b] == (int32_t)b && bw_hex_grid_measure(mesh, &blocks, b, hexes) && !memcmp(n, hexes, sizeof n) &&
               bw_hex_grid_fill(mesh, &blocks, b, n, g->vertex + g->begin[b]);
    }
    if (!good && status == BW_OK) status = bw_fail(ctx, BW_E_CHECK, "the hexahedra of the blocks of the base complex are no grids");
    bw_hex_groups_clear(ctx, &blocks);
    return status;
}

void bw_grid_filler_clear(bw_context *ctx, bw_grid_filler *f) {
    bw_free(ctx, f->vertex);
    memset(f, 0, sizeof *f);
}

/* Copies the grid of one block to its place in the box. */
static void place_block(const bw_block_grids *g, const bw_space *s, bw_block b, const bw_transition *chart, const uint32_t n[3], bw_hvertex *out) {
    uint32_t m[3];
    const bw_hvertex *from = g->vertex + g->begin[b];
    int64_t zero[3], step[3];
    measure(s, g, b, m);
    size_t stride[3] = {1, (size_t)n[0] + 1, ((size_t)n[0] + 1) * ((size_t)n[1] + 1)};
    int64_t origin = 0;
    bw_transition_apply(chart, (int64_t[3]){0, 0, 0}, zero);
    for (int k = 0; k < 3; k++) {
        int axis = bw_rotation_axis[chart->rotation][k]; /* of the block, along axis k of the box */
        origin += zero[k] / g->unit * (int64_t)stride[k];
        step[axis] = bw_rotation_sign[chart->rotation][k] * (int64_t)stride[k];
    }
    for (int64_t z = 0; z <= m[2]; z++)
        for (int64_t y = 0; y <= m[1]; y++)
            for (int64_t x = 0; x <= m[0]; x++) out[origin + x * step[0] + y * step[1] + z * step[2]] = *from++;
}

bw_status bw_grid_fill(bw_context *ctx, const bw_block_grids *g, const bw_space *s, const bw_block_box *box, bw_grid_filler *f, uint32_t n[3], const bw_hvertex **vertex) {
    for (int k = 0; k < 3; k++) n[k] = (uint32_t)(box->extent[k] / g->unit);
    bw_status status = bw_reserve(ctx, &f->vertex, &f->room, bw_hex_grid_points(n));
    if (status != BW_OK) return status;
    for (size_t i = 0; i < box->count; i++) place_block(g, s, box->block[i], &box->chart[i], n, f->vertex);
    *vertex = f->vertex;
    return BW_OK;
}
