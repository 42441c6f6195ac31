#include "complex/complex.h"

#include <string.h>

#include "complex/build.h"

void bw_complex_clear(bw_context *ctx, bw_complex *x) {
    void *blocks[] = {x->node_vertex, x->node_flags, x->arc_node, x->arc_length, x->arc_quarters, x->arc_flags,
                      x->arc_edge_begin, x->arc_edge, x->patch_block, x->patch_side, x->patch_extent, x->patch_low, x->patch_distance,
                      x->patch_flags, x->patch_polygon_begin, x->patch_polygon, x->patch_chain_begin, x->patch_chain,
                      x->patch_corner, x->block_extent, x->block_corner, x->block_side_begin, x->block_side,
                      x->block_edge_begin, x->block_edge, x->cell_block, x->cell_chart, x->chart};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    memset(x, 0, sizeof *x);
}

bw_transition bw_complex_across(const bw_cells *c, const bw_complex *x, bw_patch patch) {
    bw_polygon p = x->patch_polygon[x->patch_polygon_begin[patch]]; /* its cell[0] is on side 0 by construction */
    bw_cell inside = c->polygon[p].cell[0], outside = c->polygon[p].cell[1];
    bw_transition in = bw_cells_transition(c, p, outside), out = bw_transition_inverse(bw_complex_chart(x, outside));
    in = bw_transition_compose(&in, &out);
    return bw_transition_compose(bw_complex_chart(x, inside), &in);
}

static bw_status list_tori(bw_build *b, bw_torus_list *tori) {
    tori->count = 0;
    bw_block next = 0; /* blocks are numbered by their lowest cell */
    for (size_t cell = 0; cell < b->cells->cell_count; cell++) {
        if (b->complex->cell_block[cell] != next) continue;
        if (b->not_cuboid[next]) {
            bw_status status = bw_reserve(b->ctx, &tori->cell, &tori->room, tori->count + 1);
            if (status != BW_OK) return status;
            tori->cell[tori->count++] = (bw_cell)cell;
        }
        next++;
    }
    return BW_OK;
}

static bw_status build(bw_context *ctx, const bw_cells *cells, bw_complex *complex, bw_complex *before, bw_torus_list *tori) {
    memset(complex, 0, sizeof *complex);
    bw_build b = {.ctx = ctx, .cells = cells, .complex = complex, .before = before};
    b.edge = bw_alloc(ctx, cells->edge_count, sizeof *b.edge);
    bw_status status = b.edge ? bw_build_arcs(&b) : ctx->error.status;
    b.polygon_patch = bw_alloc(ctx, cells->polygon_count, sizeof *b.polygon_patch);
    b.polygon_slot = bw_alloc(ctx, cells->polygon_count, 1);
    b.polygon_side = bw_alloc(ctx, cells->polygon_count, sizeof *b.polygon_side);
    if (status == BW_OK) status = ctx->error.status;
    if (status == BW_OK) status = bw_build_blocks(&b);
    if (status == BW_OK) status = list_tori(&b, tori);
    if (status == BW_OK && tori->count == 0) status = bw_build_patches(&b);
    if (status == BW_OK && tori->count == 0) status = bw_build_chains(&b);
    void *scratch[] = {b.edge, b.low, b.high, b.not_cuboid, b.polygon_patch, b.polygon_slot, b.polygon_side};
    for (size_t i = 0; i < sizeof scratch / sizeof *scratch; i++) bw_free(ctx, scratch[i]);
    if (status != BW_OK) bw_complex_clear(ctx, complex);
    return status;
}

bw_status bw_complex_build(bw_context *ctx, const bw_cells *cells, bw_complex *complex, bw_torus_list *tori) {
    return build(ctx, cells, complex, NULL, tori);
}

bw_status bw_complex_rebuild(bw_context *ctx, const bw_cells *cells, bw_complex *complex, bw_torus_list *tori) {
    bw_complex before = *complex;
    bw_status status = build(ctx, cells, complex, &before, tori);
    bw_complex_clear(ctx, &before);
    return status;
}
