/* Vertices of the T-mesh: corners of cells, seen by all blocks that have them on their surface; and T-joints. */
#include <stdlib.h>
#include <string.h>

#include "tspline/parts.h"

enum { OFTEN = 256 }; /* points between questions whether to go on */

typedef struct {
    bw_context *ctx;
    bw_tmesh *mesh;
    size_t room, slots;
    int32_t *slot;   /* by hash; index of a point, or BW_NONE. A power of two */
    int32_t *parent; /* [point] */
    size_t parent_room, joint_room;
} numberer;

static size_t hash_of(bw_block block, const int64_t at[3]) {
    uint64_t h = (uint64_t)block;
    for (int k = 0; k < 3; k++) h = (h ^ (uint64_t)at[k]) * 0x9e3779b97f4a7c15u, h ^= h >> 29;
    return (size_t)h;
}

static bool is_point(const bw_tpoint *p, bw_block block, const int64_t at[3]) {
    return p->block == block && !memcmp(p->at, at, sizeof p->at);
}

/* The slot that has the point, or where it would be. */
static size_t slot_of(const numberer *n, bw_block block, const int64_t at[3]) {
    size_t s = hash_of(block, at) & (n->slots - 1);
    while (n->slot[s] != BW_NONE && !is_point(&n->mesh->point[n->slot[s]], block, at)) s = (s + 1) & (n->slots - 1);
    return s;
}

static bw_status make_slots(numberer *n) {
    size_t slots = n->slots ? 2 * n->slots : 1024;
    int32_t *slot = bw_alloc(n->ctx, slots, sizeof *slot);
    if (!slot) return n->ctx->error.status;
    bw_free(n->ctx, n->slot);
    n->slot = slot, n->slots = slots;
    for (size_t i = 0; i < slots; i++) slot[i] = BW_NONE;
    for (size_t i = 0; i < n->mesh->point_count; i++) slot[slot_of(n, n->mesh->point[i].block, n->mesh->point[i].at)] = (int32_t)i;
    return BW_OK;
}

/* The point, added if it is new. */
static bw_status find_or_add(numberer *n, bw_block block, const int64_t at[3], int32_t *out) {
    bw_tmesh *mesh = n->mesh;
    bw_status status = 2 * mesh->point_count < n->slots ? BW_OK : make_slots(n);
    if (status != BW_OK) return status;
    size_t s = slot_of(n, block, at);
    if (n->slot[s] == BW_NONE) {
        if (mesh->point_count == INT32_MAX) return bw_fail(n->ctx, BW_E_LIMIT, "the T-mesh has more than 2^31 - 1 points");
        status = bw_reserve(n->ctx, &mesh->point, &n->room, mesh->point_count + 1);
        if (status == BW_OK) status = bw_reserve(n->ctx, &n->parent, &n->parent_room, mesh->point_count + 1);
        if (status != BW_OK) return status;
        bw_tpoint *p = &mesh->point[mesh->point_count];
        *p = (bw_tpoint){.block = block};
        memcpy(p->at, at, sizeof p->at);
        n->slot[s] = n->parent[mesh->point_count] = (int32_t)mesh->point_count;
        mesh->point_count++;
    }
    *out = n->slot[s];
    return BW_OK;
}

static int32_t root_of(numberer *n, int32_t i) {
    while (n->parent[i] != i) i = n->parent[i] = n->parent[n->parent[i]];
    return i;
}

/* The same point beyond a patch of its block's surface. */
static bw_status cross(numberer *n, int32_t from, bw_patch patch, int slot) {
    const bw_atlas *atlas = n->mesh->atlas;
    int64_t at[3];
    int32_t to;
    memcpy(at, n->mesh->point[from].at, sizeof at);
    if (!bw_tpatch_has(atlas, patch, slot, at)) return BW_OK;
    bw_transition out = bw_tmesh_out(atlas, patch, slot);
    bw_transition_apply(&out, at, at);
    bw_status status = find_or_add(n, atlas->complex->patch_block[patch][1 - slot], at, &to);
    if (status != BW_OK) return status;
    int32_t a = root_of(n, from), b = root_of(n, to);
    n->parent[a < b ? b : a] = a < b ? a : b;
    return BW_OK;
}

static bw_status cross_side(numberer *n, int32_t from, bw_block block, size_t side) {
    const bw_complex *x = n->mesh->atlas->complex;
    size_t key = 6 * (size_t)block + side;
    bw_status status = BW_OK;
    for (size_t i = x->block_side_begin[key]; i < x->block_side_begin[key + 1]; i++)
        for (int slot = 0; slot < 2 && status == BW_OK; slot++) {
            bw_patch p = x->block_side[i];
            if (x->patch_block[p][slot] == block && x->patch_side[p][slot] == side && x->patch_block[p][1] != BW_NONE) status = cross(n, from, p, slot);
        }
    return status;
}

/* Follows a point through all walls that it lies on; what is found on the way is followed in its turn. */
static bw_status follow(numberer *n, int32_t from) {
    bw_tpoint p = n->mesh->point[from];
    bw_status status = BW_OK;
    for (int k = 0; k < 3 && status == BW_OK; k++) {
        if (p.at[k] == 0) status = cross_side(n, from, p.block, 2 * (size_t)k);
        if (p.at[k] == BW_TMESH_UNIT * n->mesh->atlas->extent[p.block][k] && status == BW_OK) status = cross_side(n, from, p.block, 2 * (size_t)k + 1);
    }
    return status;
}

static bw_status add_corners(numberer *n) {
    bw_status status = BW_OK;
    for (size_t c = 0; c < n->mesh->cell_count && status == BW_OK; c++)
        for (int i = 0; i < 8 && status == BW_OK; i++) {
            bw_tcell *cell = &n->mesh->cell[c];
            int64_t at[3];
            for (int k = 0; k < 3; k++) at[k] = i >> k & 1 ? cell->high[k] : cell->low[k];
            status = find_or_add(n, cell->block, at, &cell->corner[i]);
        }
    return status;
}

/* Numbers sets of points by their first one. */
static bw_status number_vertices(numberer *n) {
    bw_tmesh *mesh = n->mesh;
    mesh->vertex_place = bw_alloc(n->ctx, mesh->point_count, sizeof *mesh->vertex_place);
    mesh->vertex_flags = bw_alloc(n->ctx, mesh->point_count, 1);
    if (!mesh->vertex_place || !mesh->vertex_flags) return n->ctx->error.status;
    for (size_t i = 0; i < mesh->point_count; i++) {
        int32_t root = root_of(n, (int32_t)i);
        if (root == (int32_t)i) mesh->vertex_place[mesh->vertex_count++] = i;
        mesh->point[i].vertex = root == (int32_t)i ? (int32_t)mesh->vertex_count - 1 : mesh->point[root].vertex;
    }
    for (size_t c = 0; c < mesh->cell_count; c++)
        for (int i = 0; i < 8; i++) mesh->cell[c].corner[i] = mesh->point[mesh->cell[c].corner[i]].vertex;
    return BW_OK;
}

/* Vertices along extraordinary arcs, as the first block that has an arc sees them. */
static bw_status list_along(numberer *n) {
    bw_tmesh *mesh = n->mesh;
    const bw_atlas *atlas = mesh->atlas;
    const bw_complex *x = atlas->complex;
    bw_status status = BW_OK;
    mesh->arc_vertex = bw_alloc(n->ctx, mesh->cut_begin[x->arc_count] + 2 * x->arc_count, sizeof *mesh->arc_vertex);
    if (!mesh->arc_vertex) return n->ctx->error.status;
    for (bw_block b = (bw_block)x->block_count; b-- > 0;)
        for (size_t r = atlas->rib_begin[b + 1]; r-- > atlas->rib_begin[b];) {
            const bw_rib *rib = &atlas->rib[r];
            size_t count, begin = mesh->cut_begin[rib->arc];
            int32_t *to = &mesh->arc_vertex[begin + 2 * (size_t)rib->arc], point;
            if (!mesh->thickness[rib->arc]) continue;
            bw_tmesh_along(mesh, rib->arc, &count);
            for (size_t i = 0; i < count && status == BW_OK; i++) {
                int64_t low[3], high[3], along = !i ? 0 : i + 1 < count ? mesh->cut[begin + i - 1] : BW_TMESH_UNIT * atlas->length[rib->arc];
                bw_trib_ends(atlas, rib, low, high);
                low[rib->axis] = rib->reversed ? high[rib->axis] - along : low[rib->axis] + along;
                status = find_or_add(n, b, low, &point);
                if (status == BW_OK) to[i] = mesh->point[point].vertex;
            }
        }
    return status;
}

/* ---- flags --------------------------------------------------------------------------------------------------------- */

static unsigned flags_of(const bw_tmesh *mesh, const bw_tpoint *p) {
    const bw_atlas *atlas = mesh->atlas;
    const bw_complex *x = atlas->complex;
    unsigned flags = 0;
    for (size_t side = 0; side < 6; side++) {
        if (p->at[side >> 1] != (side & 1 ? BW_TMESH_UNIT * atlas->extent[p->block][side >> 1] : 0)) continue;
        size_t key = 6 * (size_t)p->block + side;
        for (size_t i = x->block_side_begin[key]; i < x->block_side_begin[key + 1]; i++)
            if (x->patch_block[x->block_side[i]][1] == BW_NONE && bw_tpatch_has(atlas, x->block_side[i], 0, p->at)) flags |= BW_TVERTEX_BOUNDARY;
    }
    for (size_t r = atlas->rib_begin[p->block]; r < atlas->rib_begin[p->block + 1]; r++) {
        int64_t low[3], high[3];
        if (!mesh->thickness[atlas->rib[r].arc]) continue;
        bw_trib_ends(atlas, &atlas->rib[r], low, high);
        if (p->at[0] >= low[0] && p->at[1] >= low[1] && p->at[2] >= low[2] && p->at[0] <= high[0] && p->at[1] <= high[1] && p->at[2] <= high[2])
            flags |= BW_TVERTEX_EXTRAORDINARY;
    }
    return flags;
}

/* ---- T-joints ------------------------------------------------------------------------------------------------------ */

/* Which axes of a cell a point is inside of; -1: not on the cell, or a corner of it. */
static int inside_of(const bw_tcell *cell, const int64_t at[3]) {
    int inside = 0;
    for (int k = 0; k < 3; k++) {
        if (at[k] < cell->low[k] || at[k] > cell->high[k]) return -1;
        if (at[k] > cell->low[k] && at[k] < cell->high[k]) inside |= 1 << k;
    }
    return inside ? inside : -1;
}

static bw_status find_joints(numberer *n) {
    bw_tmesh *mesh = n->mesh;
    for (size_t i = 0; i < mesh->point_count; i++) {
        const bw_tpoint *p = &mesh->point[i];
        if (i % OFTEN == 0 && bw_poll(n->ctx)) return n->ctx->error.status;
        for (size_t c = mesh->cell_begin[p->block]; c < mesh->cell_begin[p->block + 1]; c++) {
            int inside = inside_of(&mesh->cell[c], p->at);
            if (inside < 0) continue;
            bw_status status = bw_reserve(n->ctx, &mesh->joint, &n->joint_room, mesh->joint_count + 1);
            if (status != BW_OK) return status;
            mesh->joint[mesh->joint_count++] = (bw_tjoint){p->vertex, (int32_t)c, (uint8_t)inside};
        }
    }
    return BW_OK;
}

static int compare_joints(const void *a, const void *b) {
    const bw_tjoint *x = a, *y = b;
    if (x->vertex != y->vertex) return x->vertex < y->vertex ? -1 : 1;
    if (x->cell != y->cell) return x->cell < y->cell ? -1 : 1;
    return (x->inside > y->inside) - (x->inside < y->inside);
}

bw_status bw_tmesh_number(bw_context *ctx, bw_tmesh *mesh) {
    numberer n = {.ctx = ctx, .mesh = mesh};
    bw_status status = add_corners(&n);
    for (size_t i = 0; i < mesh->point_count && status == BW_OK; i++) {
        status = follow(&n, (int32_t)i);
        if (i % OFTEN == 0 && status == BW_OK) status = bw_poll(ctx);
    }
    if (status == BW_OK) status = number_vertices(&n);
    if (status == BW_OK) status = list_along(&n);
    if (status == BW_OK) status = find_joints(&n);
    if (status == BW_OK) {
        for (size_t i = 0; i < mesh->point_count; i++) mesh->vertex_flags[mesh->point[i].vertex] |= (uint8_t)flags_of(mesh, &mesh->point[i]);
        if (mesh->joint_count) qsort(mesh->joint, mesh->joint_count, sizeof *mesh->joint, compare_joints);
    }
    bw_free(ctx, n.slot), bw_free(ctx, n.parent);
    return status;
}
