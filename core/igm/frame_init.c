/* The frame of a mesh from the integer charts of its blocks: homes, transitions, constants. */
#include <string.h>

#include "igm/frame.h"

typedef struct {
    bw_context *ctx;
    const bw_atlas *atlas;
    const bw_cells *cells;
    const bw_complex *x;
    bw_frame *frame;
    bw_transition *to_home; /* [cell] from the integer chart of its block to that of its tet's home */
    uint8_t *reached;       /* [cell] */
    bw_patch *patch;        /* [polygon]; BW_NONE if it is no wall */
    bw_arc *arc;            /* [cell complex edge] */
    bw_cell *stack;
    size_t stack_room;
    bw_polygon *leaf;       /* scratch: parts of a facet */
    size_t leaf_count, leaf_room;
} builder;

static bool same(const bw_transition *a, const bw_transition *b) { return bw_transition_equal(a, b); }

/* From the chart of the block of `cell` to that of the block across a polygon, in grid units. */
static bw_transition block_transition(const builder *b, bw_polygon polygon, bw_cell cell) {
    bw_transition back = bw_transition_inverse(bw_complex_chart(b->x, cell)), t = bw_cells_transition(b->cells, polygon, cell);
    t = bw_transition_compose(&t, &back);
    return bw_transition_compose(bw_complex_chart(b->x, bw_cells_across(b->cells, polygon, cell)), &t);
}

/* Whether a polygon lies in the rectangle that its patch has in the chart of the block of `cell`, as slot `slot`. */
static bool lies_in(const builder *b, bw_polygon polygon, bw_cell cell, bw_patch patch, int slot) {
    const bw_box *box = &b->atlas->box[patch][slot];
    const bw_transition *chart = bw_complex_chart(b->x, cell);
    bw_half head = b->cells->polygon[polygon].half, h = head;
    do {
        int64_t at[3];
        unsigned more = bw_cells_locate(b->cells, b->cells->half[h].origin, bw_cells_tet(b->cells, cell), at);
        int64_t low[3], high[3];
        for (int k = 0; k < 3; k++) low[k] = at[k], high[k] = at[k] + (more >> k & 1);
        bw_transition_apply(chart, low, low), bw_transition_apply(chart, high, high);
        for (int k = 0; k < 3; k++) {
            int64_t least = low[k] < high[k] ? low[k] : high[k], most = low[k] < high[k] ? high[k] : low[k];
            if (most < box->low[k].p || least > box->high[k].p) return false;
        }
        h = b->cells->half[h].next;
    } while (h != head);
    return true;
}

/* Which slot of the patch of a wall polygon the cell is on. */
static int slot_of(const builder *b, bw_polygon polygon, bw_cell cell) {
    bw_patch patch = b->patch[polygon];
    const bw_block *block = b->x->patch_block[patch];
    if (block[1] == BW_NONE) return 0;
    if (block[0] != block[1]) return b->x->cell_block[cell] != block[0];
    bw_transition t = block_transition(b, polygon, cell), other = bw_transition_inverse(&b->atlas->across[patch]);
    if (!same(&b->atlas->across[patch], &other)) return !same(&t, &b->atlas->across[patch]);
    return !lies_in(b, polygon, cell, patch, 0); /* a half turn: the places tell */
}

/* From the integer chart of the block of `cell` to that across a polygon. */
static bw_status cross(const builder *b, bw_polygon polygon, bw_cell cell, bw_transition *out) {
    bw_transition t = block_transition(b, polygon, cell);
    bw_patch patch = b->patch[polygon];
    *out = (bw_transition){.rotation = 0};
    if (patch == BW_NONE)
        return bw_transition_is_identity(&t) ? BW_OK : bw_fail(b->ctx, BW_E_CHECK, "polygon %d is in a block and no wall, but changes charts", polygon);
    *out = bw_atlas_out(b->atlas, patch, slot_of(b, polygon, cell));
    return out->rotation == t.rotation ? BW_OK : bw_fail(b->ctx, BW_E_CHECK, "polygon %d turns otherwise than its patch", polygon);
}

/* ---- homes ---- */

static bw_status flood_tet(builder *b, bw_tet tet) {
    bw_status status = BW_OK;
    size_t top = 0;
    b->reached[tet] = 1;
    b->to_home[tet] = (bw_transition){.rotation = 0};
    if (!bw_cells_is_open(b->cells, tet)) return BW_OK;
    if ((status = bw_reserve(b->ctx, &b->stack, &b->stack_room, 1))) return status;
    b->stack[top++] = tet;
    while (top && status == BW_OK) {
        bw_cell cell = b->stack[--top];
        for (bw_polygon p = bw_cells_first_in_cell(b->cells, cell); p != BW_NONE && status == BW_OK; p = bw_cells_next_in_cell(b->cells, p, cell)) {
            if (b->cells->polygon[p].kind != BW_IN_TET) continue;
            bw_cell next = bw_cells_across(b->cells, p, cell);
            bw_transition t;
            if ((status = cross(b, p, next, &t))) break;
            t = bw_transition_compose(&b->to_home[cell], &t);
            if (b->reached[next]) {
                if (!same(&t, &b->to_home[next])) status = bw_fail(b->ctx, BW_E_CHECK, "two ways through tet %d differ", tet);
                continue;
            }
            b->reached[next] = 1;
            b->to_home[next] = t;
            if ((status = bw_reserve(b->ctx, &b->stack, &b->stack_room, top + 1))) break;
            b->stack[top++] = next;
        }
    }
    return status;
}

static void set_tet(builder *b, bw_tet tet) {
    const bw_tet_mesh *mesh = b->cells->mesh;
    bw_frame_tet *t = &b->frame->tet[tet];
    const bw_transition *chart = bw_complex_chart(b->x, tet);
    for (int i = 0; i < 4; i++) {
        int64_t p[3];
        bw_transition_apply(chart, b->cells->map->value[tet][i], p);
        for (int k = 0; k < 3; k++) t->p[i][k] = (double)p[k];
        t->vertex[i] = mesh->tet[tet][i];
        t->next[i] = bw_tet_across(mesh, mesh->tet_facet[tet][i], tet);
        t->plane[i] = -1;
    }
    memset(t->line, -1, sizeof t->line);
    for (int j = 0; j < 6; j++) t->quarters[j] = b->cells->map->quarters[mesh->tet_edge[tet][j]];
    t->home = b->x->cell_block[tet];
    t->origin = tet;
}

/* ---- facets ---- */

static bw_status list_parts(builder *b, bw_polygon polygon) {
    if (bw_cells_polygon_is_leaf(b->cells, polygon)) {
        bw_status status = bw_reserve(b->ctx, &b->leaf, &b->leaf_room, b->leaf_count + 1);
        if (status == BW_OK) b->leaf[b->leaf_count++] = polygon;
        return status;
    }
    bw_status status = list_parts(b, bw_cells_polygon_part(b->cells, polygon, 0));
    return status == BW_OK ? list_parts(b, bw_cells_polygon_part(b->cells, polygon, 1)) : status;
}

static int local_facet(const bw_tet_mesh *mesh, bw_tet tet, bw_facet facet) {
    for (int i = 0; i < 4; i++)
        if (mesh->tet_facet[tet][i] == facet) return i;
    return -1;
}

/* The transition through one part of a facet, from facet_tet[0] to facet_tet[1]. */
static bw_status through(const builder *b, bw_facet facet, bw_polygon part, bw_transition *out) {
    const bw_cell *cell = b->cells->polygon[part].cell;
    int from = bw_cells_tet(b->cells, cell[0]) != b->cells->mesh->facet_tet[facet][0];
    bw_transition t, back = bw_transition_inverse(&b->to_home[cell[from]]);
    bw_status status = cross(b, part, cell[from], &t);
    t = bw_transition_compose(&t, &back);
    *out = bw_transition_compose(&b->to_home[cell[1 - from]], &t);
    return status;
}

static bw_status set_across(builder *b, bw_facet facet) {
    const bw_tet_mesh *mesh = b->cells->mesh;
    const bw_tet *tet = mesh->facet_tet[facet];
    bw_transition across = {.rotation = 0}, part;
    bw_status status = BW_OK;
    for (size_t i = 0; i < b->leaf_count && status == BW_OK; i++) {
        status = through(b, facet, b->leaf[i], i ? &part : &across);
        if (status == BW_OK && i && !same(&part, &across)) status = bw_fail(b->ctx, BW_E_CHECK, "two ways across facet %d differ", facet);
    }
    if (status == BW_OK && !b->leaf_count && b->x->cell_block[tet[0]] != b->x->cell_block[tet[1]])
        return bw_fail(b->ctx, BW_E_CHECK, "facet %d is no polygon, but parts two blocks", facet);
    b->frame->tet[tet[0]].across[local_facet(mesh, tet[0], facet)] = across;
    b->frame->tet[tet[1]].across[local_facet(mesh, tet[1], facet)] = bw_transition_inverse(&across);
    return status;
}

static bw_status hold(builder *b, bw_tet tet, int corner, int axis, int64_t value) {
    bw_frame_tet *t = &b->frame->tet[tet];
    if (t->mask[corner] & 1 << axis && t->hold[corner][axis] != value)
        return bw_fail(b->ctx, BW_E_CHECK, "vertex %d is held in two places", t->vertex[corner]);
    t->mask[corner] |= (uint8_t)(1 << axis);
    t->hold[corner][axis] = value;
    return BW_OK;
}

/* The plane of the side that a wall polygon lies in, in the integer chart of the home of its cell's tet. */
static bw_plane plane_of(const builder *b, bw_polygon polygon, bw_cell cell) {
    bw_patch patch = b->patch[polygon];
    int slot = slot_of(b, polygon, cell), side = b->x->patch_side[patch][slot];
    bw_plane plane = {side & 1 ? b->atlas->extent[b->x->patch_block[patch][slot]][side >> 1] : 0, (int8_t)(side >> 1)};
    return bw_transition_plane(&b->to_home[cell], plane);
}

static bw_status set_plane(builder *b, bw_facet facet, bool feature) {
    bw_status status = BW_OK;
    for (size_t i = 0; i < b->leaf_count && status == BW_OK; i++) {
        if (b->patch[b->leaf[i]] == BW_NONE) return bw_fail(b->ctx, BW_E_CHECK, "aligned facet %d is not in a patch", facet);
        for (int s = 0; s < 2 && b->cells->polygon[b->leaf[i]].cell[s] != BW_NONE; s++) {
            bw_cell cell = b->cells->polygon[b->leaf[i]].cell[s];
            bw_tet tet = bw_cells_tet(b->cells, cell);
            bw_plane plane = plane_of(b, b->leaf[i], cell);
            int f = local_facet(b->cells->mesh, tet, facet);
            b->frame->tet[tet].plane[f] = plane.axis;
            if (feature) b->frame->tet[tet].feature_facets |= (uint8_t)(1 << f);
            for (int c = 0; c < 4 && status == BW_OK; c++)
                if (c != f) status = hold(b, tet, c, plane.axis, plane.value);
        }
    }
    return status;
}

static bw_status set_facets(builder *b) {
    const bw_tet_mesh *mesh = b->cells->mesh;
    uint8_t *feature = bw_alloc(b->ctx, mesh->facet_count, 1);
    bw_status status = b->ctx->error.status;
    for (size_t i = 0; i < mesh->feature_facet_count && status == BW_OK; i++)
        feature[bw_tet_mesh_find_facet(mesh, mesh->feature_facet[i])] = 1;
    for (size_t f = 0; f < mesh->facet_count && status == BW_OK; f++) {
        bw_polygon whole = b->cells->of_facet[f];
        b->leaf_count = 0;
        if (whole != BW_NONE) status = list_parts(b, whole);
        if (status == BW_OK && mesh->facet_tet[f][1] != BW_NONE) status = set_across(b, (bw_facet)f);
        if (status == BW_OK && (mesh->facet_tet[f][1] == BW_NONE || feature[f])) status = set_plane(b, (bw_facet)f, feature[f]);
    }
    bw_free(b->ctx, feature);
    return status;
}

/* ---- lines and points ---- */

/* The rib of the block of `cell` that a leaf edge of an arc is part of. */
static const bw_rib *rib_of(const builder *b, bw_cedge edge, bw_cell cell) {
    const bw_atlas *a = b->atlas;
    bw_block block = b->x->cell_block[cell];
    int64_t at[2][3];
    for (int e = 0; e < 2; e++) {
        bw_cells_locate(b->cells, b->cells->edge[edge].vertex[e], bw_cells_tet(b->cells, cell), at[e]);
        bw_transition_apply(bw_complex_chart(b->x, cell), at[e], at[e]);
    }
    for (size_t i = a->rib_begin[block]; i < a->rib_begin[block + 1]; i++) {
        const bw_rib *r = &a->rib[i];
        bool inside = r->arc == b->arc[edge];
        for (int k = 0; k < 3 && inside; k++) {
            int64_t low = a->place[r->place[0]].at[k].p, high = a->place[r->place[1]].at[k].p;
            for (int e = 0; e < 2; e++) /* along the rib a floor may be turned into a ceiling: one unit more or less */
                inside = inside && at[e][k] >= low - (k == r->axis) && at[e][k] <= high + (k == r->axis);
        }
        if (inside) return r;
    }
    return NULL;
}

/* Holds a line at the tet of one cell that has a leaf of it; resolve carries it around. */
static bw_status set_line(builder *b, bw_edge edge) {
    const bw_tet_mesh *mesh = b->cells->mesh;
    bw_cedge leaf = b->cells->of_edge[edge];
    if (leaf == BW_NONE) return bw_fail(b->ctx, BW_E_CHECK, "edge %d is on no wall", edge);
    while (!bw_cells_edge_is_leaf(b->cells, leaf)) leaf = bw_cells_edge_part(b->cells, leaf, 0);
    if (b->arc[leaf] == BW_NONE) return bw_fail(b->ctx, BW_E_CHECK, "edge %d is on no arc", edge);
    bw_cell cell = b->cells->polygon[b->cells->half[b->cells->edge[leaf].half].polygon].cell[0];
    bw_tet tet = bw_cells_tet(b->cells, cell);
    const bw_rib *rib = rib_of(b, leaf, cell);
    if (!rib) return bw_fail(b->ctx, BW_E_CHECK, "arc %d of edge %d has no place in its block", b->arc[leaf], edge);
    for (int k = 0; k < 3; k++) {
        if (k == rib->axis) continue;
        bw_plane plane = bw_transition_plane(&b->to_home[cell], (bw_plane){b->atlas->place[rib->place[0]].at[k].q, (int8_t)k});
        for (int e = 0; e < 2; e++)
            if (hold(b, tet, bw_tet_corner(mesh, tet, mesh->edge[edge][e]), plane.axis, plane.value)) return b->ctx->error.status;
    }
    return BW_OK;
}

/* The axis of every line in every tet around it: that of its extent in the map. */
static void name_lines(builder *b) {
    const bw_tet_mesh *mesh = b->cells->mesh;
    for (size_t t = 0; t < mesh->tet_count; t++)
        for (int j = 0; j < 6; j++) {
            uint8_t flags = b->cells->map->edge_flags[mesh->tet_edge[t][j]];
            if (flags & BW_EDGE_FEATURE) b->frame->tet[t].feature_edges |= (uint8_t)(1 << j);
            if (!(flags & (BW_EDGE_SINGULAR | BW_EDGE_FEATURE))) continue;
            const double *u = b->frame->tet[t].p[bw_tet_edge_corners[j][0]], *v = b->frame->tet[t].p[bw_tet_edge_corners[j][1]];
            for (int8_t k = 0; k < 3; k++)
                if (u[k] != v[k]) b->frame->tet[t].line[j] = k;
        }
}

/* A feature vertex is a node: all its coordinates are known. */
static bw_status set_points(builder *b) {
    const bw_tet_mesh *mesh = b->cells->mesh;
    uint8_t *feature = bw_alloc(b->ctx, mesh->vertex_count, 1);
    bw_status status = b->ctx->error.status;
    for (size_t i = 0; i < mesh->feature_vertex_count && status == BW_OK; i++) feature[mesh->feature_vertex[i]] = 1;
    for (size_t i = 0; i < 4 * mesh->tet_count && status == BW_OK; i++) {
        bw_tet tet = (bw_tet)(i / 4);
        bw_vertex v = mesh->tet[tet][i % 4];
        if (!feature[v]) continue;
        /* of a closed tet the only cell is its home; of an opened one any cell at the vertex will do, if its block has the node there */
        size_t cells = bw_cells_is_open(b->cells, tet) ? b->cells->cell_count : 0;
        for (bw_cell cell = tet; cell == tet || (size_t)cell < cells; cell = (size_t)cell < mesh->tet_count ? (bw_cell)mesh->tet_count : cell + 1) {
            int64_t at[3], q[3];
            if (bw_cells_tet(b->cells, cell) != tet) continue;
            bw_transition_apply(bw_complex_chart(b->x, cell), b->cells->map->value[tet][i % 4], at);
            int32_t place = bw_atlas_find(b->atlas, b->x->cell_block[cell], at);
            if (place == BW_NONE || b->x->node_vertex[b->atlas->place[place].node] != v) continue;
            for (int k = 0; k < 3; k++) q[k] = b->atlas->place[place].at[k].q;
            bw_transition_apply(&b->to_home[cell], q, q);
            for (int k = 0; k < 3 && status == BW_OK; k++) status = hold(b, tet, (int)(i % 4), k, q[k]);
            feature[v] = 0;
            break;
        }
    }
    for (size_t v = 0; v < mesh->vertex_count && status == BW_OK; v++)
        if (feature[v]) status = bw_fail(b->ctx, BW_E_CHECK, "feature vertex %zu is no node", v);
    bw_free(b->ctx, feature);
    return status;
}

static bw_status set_lines(builder *b) {
    bw_status status = BW_OK;
    name_lines(b);
    for (size_t e = 0; e < b->cells->mesh->edge_count && status == BW_OK; e++)
        if (b->cells->map->edge_flags[e] & (BW_EDGE_SINGULAR | BW_EDGE_FEATURE)) status = set_line(b, (bw_edge)e);
    return status;
}

static bw_status prepare(builder *b) {
    const bw_complex *x = b->x;
    bw_frame *f = b->frame;
    f->vertex_count = f->vertex_room = b->cells->mesh->vertex_count, f->tet_count = f->tet_room = b->cells->mesh->tet_count;
    f->position = bw_alloc(b->ctx, f->vertex_count, sizeof *f->position);
    f->tet = bw_alloc(b->ctx, f->tet_count, sizeof *f->tet);
    b->to_home = bw_alloc(b->ctx, b->cells->cell_count, sizeof *b->to_home);
    b->reached = bw_alloc(b->ctx, b->cells->cell_count, 1);
    b->patch = bw_alloc(b->ctx, b->cells->polygon_count, sizeof *b->patch);
    b->arc = bw_alloc(b->ctx, b->cells->edge_count, sizeof *b->arc);
    if (b->ctx->error.status) return b->ctx->error.status;
    memcpy(f->position, b->cells->mesh->position, f->vertex_count * sizeof *f->position);
    for (size_t p = 0; p < b->cells->polygon_count; p++) b->patch[p] = BW_NONE;
    for (size_t e = 0; e < b->cells->edge_count; e++) b->arc[e] = BW_NONE;
    for (size_t p = 0; p < x->patch_count; p++)
        for (size_t i = x->patch_polygon_begin[p]; i < x->patch_polygon_begin[p + 1]; i++) b->patch[x->patch_polygon[i]] = (bw_patch)p;
    for (size_t a = 0; a < x->arc_count; a++)
        for (size_t i = x->arc_edge_begin[a]; i < x->arc_edge_begin[a + 1]; i++) b->arc[x->arc_edge[i]] = (bw_arc)a;
    return BW_OK;
}

bw_status bw_frame_init(bw_context *ctx, const bw_atlas *atlas, bw_frame *frame) {
    builder b = {.ctx = ctx, .atlas = atlas, .cells = atlas->cells, .x = atlas->complex, .frame = frame};
    memset(frame, 0, sizeof *frame);
    bw_status status = prepare(&b);
    for (size_t t = 0; t < frame->tet_count && status == BW_OK; t++) {
        set_tet(&b, (bw_tet)t);
        status = flood_tet(&b, (bw_tet)t);
    }
    if (status == BW_OK) status = set_facets(&b);
    if (status == BW_OK) status = set_lines(&b);
    if (status == BW_OK) status = set_points(&b);
    if (status == BW_OK) status = bw_frame_resolve(ctx, frame);
    void *scratch[] = {b.to_home, b.reached, b.patch, b.arc, b.stack, b.leaf};
    for (size_t i = 0; i < sizeof scratch / sizeof *scratch; i++) bw_free(ctx, scratch[i]);
    if (status != BW_OK) bw_frame_clear(ctx, frame);
    return status;
}
