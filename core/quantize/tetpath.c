#include "quantize/tetpath.h"

#include <string.h>

void bw_tet_path_init(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_tet_path *p) {
    *p = (bw_tet_path){.ctx = ctx, .cells = cells, .complex = complex};
}

void bw_tet_path_clear(bw_tet_path *p) {
    bw_free(p->ctx, p->tet), bw_free(p->ctx, p->queue), bw_free(p->ctx, p->before);
    *p = (bw_tet_path){0};
}

bw_status bw_tet_path_start(bw_tet_path *p, bw_tet tet) {
    memset(p->vector, 0, sizeof p->vector);
    p->count = 0;
    if (bw_reserve(p->ctx, &p->tet, &p->room, 1)) return p->ctx->error.status;
    p->tet[p->count++] = tet;
    return BW_OK;
}

static bool holds(const bw_tet_mesh *m, bw_tet tet, int kind, int32_t carrier) {
    if (kind == BW_IN_TET) return tet == carrier;
    if (kind == BW_IN_VERTEX) return bw_tet_corner(m, tet, carrier) >= 0;
    for (int i = 0; i < 6; i++)
        if (kind == BW_IN_EDGE ? m->tet_edge[tet][i] == carrier : i < 4 && m->tet_facet[tet][i] == carrier) return true;
    return false;
}

/* Tets around a vertex, breadth first from the last tet of the path; stops at the first one that holds the element. *found: its place in the queue. */
static bw_status search(bw_tet_path *p, const bw_cell_vertex *around, bw_carrier kind, int32_t carrier, size_t *found) {
    const bw_tet_mesh *m = p->cells->mesh;
    size_t head = 0, tail = 1;
    if (bw_reserve(p->ctx, &p->queue, &p->queue_room, 1) || bw_reserve(p->ctx, &p->before, &p->before_room, 1)) return p->ctx->error.status;
    p->queue[0] = p->tet[p->count - 1], p->before[0] = BW_NONE;
    for (; head < tail; head++) {
        if (holds(m, p->queue[head], kind, carrier)) {
            *found = head;
            return BW_OK;
        }
        for (int i = 0; i < 4; i++) {
            bw_tet to = bw_tet_across(m, m->tet_facet[p->queue[head]][i], p->queue[head]);
            bool known = to == BW_NONE || !holds(m, to, around->kind, around->carrier);
            for (size_t k = 0; k < tail && !known; k++) known = p->queue[k] == to;
            if (known) continue;
            if (bw_reserve(p->ctx, &p->queue, &p->queue_room, tail + 1) || bw_reserve(p->ctx, &p->before, &p->before_room, tail + 1))
                return p->ctx->error.status;
            p->queue[tail] = to, p->before[tail++] = (int32_t)head;
        }
    }
    return bw_fail(p->ctx, BW_E_CHECK, "the tets around a vertex of the complex are not joined");
}

static bw_facet common_facet(const bw_tet_mesh *m, bw_tet a, bw_tet b) {
    for (int i = 0; i < 4; i++)
        if (bw_tet_across(m, m->tet_facet[a][i], a) == b) return m->tet_facet[a][i];
    return BW_NONE;
}

bw_status bw_tet_path_turn(bw_tet_path *p, bw_cvertex around, bw_carrier kind, int32_t carrier) {
    size_t found = 0, steps = 0;
    if (search(p, &p->cells->vertex[around], kind, carrier, &found)) return p->ctx->error.status;
    for (int32_t i = (int32_t)found; p->before[i] != BW_NONE; i = p->before[i]) steps++;
    if (bw_reserve(p->ctx, &p->tet, &p->room, p->count + steps)) return p->ctx->error.status;
    for (size_t k = steps, i = found; k-- > 0; i = (size_t)p->before[i]) p->tet[p->count + k] = p->queue[i];
    for (; steps > 0; steps--, p->count++) {
        bw_tet from = p->tet[p->count - 1];
        bw_facet f = common_facet(p->cells->mesh, from, p->tet[p->count]);
        bw_rotate(bw_grid_map_across(p->cells->mesh, p->cells->map, f, from).rotation, p->vector, p->vector);
    }
    return BW_OK;
}

bw_status bw_tet_path_follow(bw_tet_path *p, bw_arc_use use, int64_t length) {
    const bw_cells *c = p->cells;
    const bw_complex *x = p->complex;
    size_t first = x->arc_edge_begin[use >> 1], n = x->arc_edge_begin[(use >> 1) + 1] - first;
    bw_cvertex at = x->node_vertex[bw_arc_use_start(x, use)];
    for (size_t i = 0; i < n; i++) {
        bw_cedge e = x->arc_edge[use & 1 ? first + n - 1 - i : first + i];
        const bw_cell_edge *edge = &c->edge[e];
        if (!p->count && bw_tet_path_start(p, bw_cells_tet(c, c->polygon[c->half[edge->half].polygon].cell[0]))) return p->ctx->error.status;
        if (bw_tet_path_turn(p, at, edge->kind, edge->carrier)) return p->ctx->error.status;
        bw_cvertex to = edge->vertex[edge->vertex[0] == at];
        bw_tet tet = p->tet[p->count - 1];
        int axis = bw_cells_edge_axis(c, e, tet);
        if (axis < 0) return bw_fail(p->ctx, BW_E_CHECK, "arc %d is not parallel to an axis", use >> 1);
        if (i == 0) p->vector[axis] += bw_cells_compare_along(c, to, at, tet, axis) * length;
        at = to;
    }
    return BW_OK;
}
