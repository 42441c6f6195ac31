#include "stage/trace.h"

#include "mesh/fire.h"

/* All leaves of a tet edge. */
static bw_status ignite_edge(bw_fire *fire, bw_cedge e) {
    if (bw_cells_edge_is_leaf(fire->cells, e)) return bw_fire_ignite_edge(fire, e);
    bw_status status = BW_OK;
    for (int i = 0; i < 2 && status == BW_OK; i++) status = ignite_edge(fire, fire->cells->edge[e].child[i]);
    return status;
}

bw_status bw_trace(bw_context *ctx, bw_cells *cells, bw_complex_kind kind, uint64_t max_cells) {
    bw_fire fire;
    bw_fire_init(&fire, ctx, cells, &(bw_fire_rules){.stops_at_walls = kind == BW_COMPLEX_MC, .max_cells = max_cells});
    bw_status status = BW_OK;
    for (size_t e = 0; e < cells->mesh->edge_count && status == BW_OK; e++)
        if (cells->map->edge_flags[e] & BW_EDGE_SINGULAR) status = ignite_edge(&fire, (bw_cedge)e);
    if (status == BW_OK) status = bw_fire_run(&fire);
    bw_fire_clear(&fire);
    return status;
}
