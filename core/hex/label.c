#include "hex/label.h"

#include <string.h>

#include "base/parallel.h"
#include "hex/incidence.h"

enum { LEAST = 4096 }; /* hexes per thread at least */

/* A critical node that is a vertex of the tet mesh, and a corner of a hex there. */
typedef struct {
    bw_node node;
    size_t first; /* into corner; the next one's is the end */
} anchor;

typedef struct {
    bw_context *ctx;
    const bw_hex_plan *plan;
    const bw_igm *igm;
    bw_hex_mesh *mesh;
    uint32_t *mate;
    bw_rotation *across;   /* [6 * hex + face] from the axes of its mate there to its own; BW_ROTATIONS if they do not share the face */
    uint8_t *compared;     /* [hex] its faces have been compared in this attempt */
    bw_rotation *turn;     /* [hex] from its axes to those of its block */
    uint32_t *cube_begin;  /* [block] */
    bw_hex *taken;         /* [cube] by which hex */
    bw_hex *queue;
    size_t queued, done;   /* hexes of the running attempt; hexes labelled before it */
    bw_rotation by_axes[9][8]; /* rotation in which axes 0, 1 come from these, with these signs; BW_ROTATIONS if there is none */
    anchor *anchor;        /* one more than there are */
    size_t anchor_count;
    uint64_t *corner;      /* 8 * hex + corner, by anchor */
    int32_t *patch_region, *facet_region; /* of boundary patches, and of the map's boundary facets; BW_NONE: not known */
    const char *fault;     /* what ended the last attempt, */
    const char *farthest;  /* and the one that got farthest: */
    size_t reached;        /* so many hexes */
} labels;

/* ---- from hex to hex ---- */

static void list_rotations(labels *l) {
    for (int i = 0; i < 72; i++) l->by_axes[i / 8][i % 8] = BW_ROTATIONS;
    for (bw_rotation r = 0; r < BW_ROTATIONS; r++) {
        int signs = 0;
        for (int k = 0; k < 3; k++) signs |= (bw_rotation_sign[r][k] > 0) << k;
        l->by_axes[3 * bw_rotation_axis[r][0] + bw_rotation_axis[r][1]][signs] = r;
    }
}

static int corner_of(const bw_hvertex *hex, bw_hvertex v) {
    int c = 0;
    while (c < 8 && hex[c] != v) c++;
    return c;
}

/* The rotation from the axes of one hex to those of its mate across a face; BW_ROTATIONS if the face is not the same square in both. */
static bw_rotation turn_between(const labels *l, uint32_t a, uint32_t b) {
    const bw_hvertex *x = l->mesh->hex[a / 6], *y = l->mesh->hex[b / 6];
    int f = (int)(a % 6), g = (int)(b % 6), axis[3], signs = 0, low = f & 1 ? 1 << f / 2 : 0, start = corner_of(y, x[low]);
    axis[g / 2] = f / 2;
    signs |= ((f & 1) != (g & 1)) << g / 2;
    for (int i = 1; i < 3; i++) {
        int k = (f / 2 + i) % 3, end = corner_of(y, x[low | 1 << k]), bit = start ^ end;
        if (start > 7 || end > 7 || (bit & (bit - 1)) || bit == 1 << g / 2) return BW_ROTATIONS;
        axis[bit >> 1] = k; /* bits 1, 2, 4 are axes 0, 1, 2 */
        signs |= ((end & bit) != 0) << (bit >> 1);
    }
    return axis[0] == axis[1] ? BW_ROTATIONS : l->by_axes[3 * axis[0] + axis[1]][signs];
}

static bw_status turn_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    labels *l = user;
    (void)ctx, (void)range;
    for (size_t x = 6 * begin; x < 6 * end; x++) {
        bw_rotation turn = l->mate[x] == BW_HEX_NO_MATE ? BW_ROTATIONS : turn_between(l, (uint32_t)x, l->mate[x]);
        l->across[x] = turn == BW_ROTATIONS ? BW_ROTATIONS : bw_rotation_inverse(turn);
    }
    return BW_OK;
}

static bw_plan_cube cube_of(const labels *l, bw_hex h) {
    bw_plan_cube c = {.block = l->mesh->block[h], .turn = l->turn[h]};
    for (int k = 0; k < 3; k++) c.centre[k] = 2 * (int64_t)l->mesh->ijk[h][k] + 1;
    return c;
}

static size_t slot_of(const labels *l, const bw_plan_cube *c) {
    const int64_t *n = l->plan->size[c->block];
    return l->cube_begin[c->block] + (size_t)(c->centre[0] / 2 + n[0] / 2 * (c->centre[1] / 2 + n[1] / 2 * (c->centre[2] / 2)));
}

static bool give(labels *l, bw_hex h, const bw_plan_cube *c) {
    bw_hex *slot = &l->taken[slot_of(l, c)];
    if (*slot != BW_NONE) {
        l->fault = "two hexes have one place in a block";
        return false;
    }
    *slot = h;
    l->mesh->block[h] = c->block;
    for (int k = 0; k < 3; k++) l->mesh->ijk[h][k] = (int32_t)(c->centre[k] / 2);
    l->turn[h] = c->turn;
    l->queue[l->queued++] = h;
    return true;
}

/* ---- the flood ---- */

/* Whether the vertices of a face of the boundary that lie inside a region are of the region of this patch. */
static bool same_region(const labels *l, bw_hex h, int face, bw_patch patch) {
    for (int i = 0; i < 4; i++) {
        bw_hvertex v = l->mesh->hex[h][bw_hex_face_corner[face][i]];
        if (l->mesh->held[v] != BW_HELD_SURFACE) continue;
        int32_t region = l->facet_region[l->mesh->carrier[v]];
        if (region != BW_NONE && l->patch_region[patch] != BW_NONE && region != l->patch_region[patch]) return false;
    }
    return true;
}

/* Across one face. What has been compared from the other side is so from this one: a plan's contacts are listed for both blocks. */
static bool go(labels *l, bw_hex h, int face) {
    uint32_t mate = l->mate[6 * (size_t)h + (size_t)face];
    if (mate != BW_HEX_NO_MATE && l->compared[mate / 6]) return true;
    bw_plan_cube here = cube_of(l, h), there;
    bw_patch patch = BW_NONE;
    bw_plan_step step = bw_hex_plan_step(l->plan, &here, face, &there, &patch);
    if (step == BW_PLAN_OUTSIDE && mate == BW_HEX_NO_MATE && !same_region(l, h, face, patch)) {
        l->fault = "a part of the boundary is where another should be";
        return false;
    }
    if (step == BW_PLAN_NOTHING || (step == BW_PLAN_OUTSIDE) != (mate == BW_HEX_NO_MATE)) {
        l->fault = "a boundary is where there should be none, or none where there should be one";
        return false;
    }
    if (step == BW_PLAN_OUTSIDE) return true;
    bw_hex next = (bw_hex)(mate / 6);
    bw_rotation turn = l->across[6 * (size_t)h + (size_t)face];
    if (turn == BW_ROTATIONS) {
        l->fault = "two hexes do not share a face";
        return false;
    }
    there.turn = bw_rotation_compose(there.turn, turn);
    if (l->mesh->block[next] == BW_NONE) return give(l, next, &there);
    if (l->taken[slot_of(l, &there)] == next && l->turn[next] == there.turn) return true;
    l->fault = "two ways to a hex disagree about its place";
    return false;
}

static void forget(labels *l) {
    for (size_t i = 0; i < l->queued; i++) {
        bw_plan_cube c = cube_of(l, l->queue[i]);
        l->taken[slot_of(l, &c)] = BW_NONE;
        l->mesh->block[l->queue[i]] = BW_NONE;
        l->compared[l->queue[i]] = 0;
    }
    l->queued = 0;
}

/* Where a corner of a hex is in its block, in half hexes. */
static void corner_place(const labels *l, uint64_t corner, int64_t out[3]) {
    bw_plan_cube c = cube_of(l, (bw_hex)(corner / 8));
    for (int k = 0; k < 3; k++) out[k] = corner >> k & 1 ? 1 : -1;
    bw_rotate(c.turn, out, out);
    for (int k = 0; k < 3; k++) out[k] += c.centre[k];
}

/* Whether a corner's place in its block is one of the node's. */
static bool at_node(const labels *l, bw_node node, uint64_t corner) {
    const bw_verifier *v = &l->plan->verifier;
    bw_block b = l->mesh->block[corner / 8];
    int64_t at[3], unit = 2 * (int64_t)l->plan->subdivide;
    corner_place(l, corner, at);
    for (size_t i = v->place_begin[b]; i < v->place_begin[b + 1]; i++) {
        const bw_pair *p = v->place[i].at;
        if (v->place[i].node == node && unit * p[0].q == at[0] && unit * p[1].q == at[1] && unit * p[2].q == at[2]) return true;
    }
    return false;
}

/* A cube with a corner at the node, and on which side of it, if a block with extent has one. */
static bool cube_at(const labels *l, bw_node node, bw_plan_cube *out, int64_t toward[3]) {
    const bw_verifier *v = &l->plan->verifier;
    for (size_t b = 0; b < v->x->block_count; b++)
        for (size_t i = v->place_begin[b]; i < v->place_begin[b + 1]; i++) {
            bool good = v->place[i].node == node;
            for (int k = 0; k < 3 && good; k++) {
                int64_t at = 2 * l->plan->subdivide * v->place[i].at[k].q, size = l->plan->size[b][k];
                good = size > 0 && at >= 0 && at <= size;
                toward[k] = at < size ? 1 : -1;
                out->centre[k] = at + toward[k];
            }
            out->block = (bw_block)b;
            if (good) return true;
        }
    return false;
}

/* Whether the hexes of this attempt have the critical nodes where they should be. */
static bool nodes_fit(labels *l) {
    bw_plan_cube cube;
    int64_t toward[3];
    for (size_t i = 0; i < l->anchor_count; i++) {
        const anchor *a = &l->anchor[i];
        bool found = l->mesh->block[l->corner[a->first] / 8] == BW_NONE || !cube_at(l, a->node, &cube, toward);
        for (size_t k = a->first; k < a[1].first && !found; k++) found = at_node(l, a->node, l->corner[k]);
        if (found) continue;
        l->fault = "a critical node is where another point should be";
        return false;
    }
    return true;
}

/* Floods the component of a hex; *good if it fits the plan, else nothing is changed. */
static bw_status attempt(labels *l, bw_hex hex, const bw_plan_cube *cube, bool *good) {
    *good = give(l, hex, cube);
    for (size_t i = 0; i < l->queued && *good; i++) {
        if (i % 65536 == 0 && bw_poll(l->ctx)) return l->ctx->error.status;
        for (int face = 0; face < 6 && *good; face++) *good = go(l, l->queue[i], face);
        l->compared[l->queue[i]] = 1;
    }
    *good = *good && nodes_fit(l);
    if (!*good && l->queued > l->reached) l->farthest = l->fault, l->reached = l->queued;
    if (!*good) forget(l);
    l->done += l->queued;
    l->queued = 0;
    return BW_OK;
}

/* ---- starts ---- */

/* Tries all hexes around a node for one cube that has a corner there. */
static bw_status start_at_node(labels *l, const anchor *a, bool *good) {
    bw_plan_cube cube;
    int64_t toward[3], from[3];
    *good = true;
    if (l->mesh->block[l->corner[a->first] / 8] != BW_NONE || !cube_at(l, a->node, &cube, toward)) return BW_OK;
    *good = false;
    for (size_t i = a->first; i < a[1].first && !*good; i++)
        for (bw_rotation r = 0; r < BW_ROTATIONS && !*good; r++) {
            for (int k = 0; k < 3; k++) from[k] = l->corner[i] >> k & 1 ? -1 : 1;
            bw_rotate(r, from, from);
            if (memcmp(from, toward, sizeof from)) continue;
            cube.turn = r;
            if (attempt(l, (bw_hex)(l->corner[i] / 8), &cube, good)) return l->ctx->error.status;
        }
    return BW_OK;
}

/* Tries all cubes for one hex. */
static bw_status start_anywhere(labels *l, bw_hex hex, bool *good) {
    size_t blocks = l->plan->verifier.x->block_count;
    *good = false;
    for (size_t b = 0; b < blocks && !*good; b++) {
        const int64_t *n = l->plan->size[b];
        bw_plan_cube c = {.block = (bw_block)b};
        for (c.centre[2] = 1; c.centre[2] < n[2] && !*good; c.centre[2] += 2)
            for (c.centre[1] = 1; c.centre[1] < n[1] && !*good; c.centre[1] += 2)
                for (c.centre[0] = 1; c.centre[0] < n[0] && !*good; c.centre[0] += 2)
                    for (c.turn = 0; c.turn < BW_ROTATIONS && !*good; c.turn++)
                        if (attempt(l, hex, &c, good)) return l->ctx->error.status;
    }
    return BW_OK;
}

static bw_status flood(labels *l) {
    bool good = true;
    for (size_t i = 0; i < l->anchor_count && good; i++)
        if (start_at_node(l, &l->anchor[i], &good)) return l->ctx->error.status;
    for (size_t h = 0; h < l->mesh->hex_count && good && l->done < l->mesh->hex_count; h++)
        if (l->mesh->block[h] == BW_NONE && start_anywhere(l, (bw_hex)h, &good)) return l->ctx->error.status;
    return good ? BW_OK : bw_fail(l->ctx, BW_E_CHECK, "the hex mesh is not the one that the quantization promised: %s", l->farthest);
}

/* ---- what is known beforehand: nodes ---- */

static uint64_t hash_position(const double p[3]) {
    uint64_t bits[3], h = 0;
    memcpy(bits, p, sizeof bits);
    for (int k = 0; k < 3; k++) h = (h ^ (bits[k] + (bits[k] >> 29))) * 0x9e3779b97f4a7c15u;
    return h ^ h >> 32;
}

/* The vertex of the tet mesh that a critical node is; BW_NONE if it is none of the map's mesh. */
static bw_vertex vertex_of_node(const labels *l, size_t node) {
    const bw_verifier *v = &l->plan->verifier;
    const bw_cell_vertex *at = &v->cells->vertex[v->x->node_vertex[node]];
    bool same = v->node_critical[node] && at->kind == BW_IN_VERTEX && (size_t)at->carrier < l->igm->mesh.vertex_count;
    return same && !memcmp(l->igm->mesh.position[at->carrier], v->cells->mesh->position[at->carrier], sizeof(double[3])) ? at->carrier : BW_NONE;
}

static bool is_at_node(const labels *l, const double p[3], bw_node node) {
    return !memcmp(p, l->igm->mesh.position[vertex_of_node(l, (size_t)node)], sizeof(double[3]));
}

enum { AMBIGUOUS = -2 };

/* [node] The only hex vertex at its position, BW_NONE if there is none; AMBIGUOUS if there are more, or other nodes there: the input may have been slit open, so that points of
 * several sides are in one place. All through a hash table of the nodes; *node_of is that of a hex vertex at one, or BW_NONE. */
static bw_status match_nodes(labels *l, int32_t *vertex_at, int32_t *node_of) {
    size_t nodes = l->plan->verifier.x->node_count, room = 16;
    while (room < 2 * nodes) room *= 2;
    int32_t *table = bw_alloc(l->ctx, room, sizeof *table);
    if (!table) return l->ctx->error.status;
    for (size_t i = 0; i < room; i++) table[i] = BW_NONE;
    for (size_t n = 0; n < nodes; n++) {
        bw_vertex v = vertex_of_node(l, n);
        vertex_at[n] = BW_NONE;
        if (v == BW_NONE) continue;
        size_t i = hash_position(l->igm->mesh.position[v]) & (room - 1);
        while (table[i] != BW_NONE && !is_at_node(l, l->igm->mesh.position[v], table[i])) i = (i + 1) & (room - 1);
        if (table[i] == BW_NONE) table[i] = (int32_t)n;
        else vertex_at[table[i]] = AMBIGUOUS;
    }
    for (size_t h = 0; h < l->mesh->vertex_count; h++) {
        size_t i = hash_position(l->mesh->position[h]) & (room - 1);
        while (table[i] != BW_NONE && !is_at_node(l, l->mesh->position[h], table[i])) i = (i + 1) & (room - 1);
        if ((node_of[h] = table[i]) != BW_NONE) vertex_at[table[i]] = vertex_at[table[i]] == BW_NONE ? (int32_t)h : AMBIGUOUS;
    }
    bw_free(l->ctx, table);
    return BW_OK;
}

/* Hex vertices that are known to be a critical node. What is ambiguous is none: then other nodes, or trying, tell where hexes belong. */
static bw_status find_anchors(labels *l, int32_t *anchor_of) {
    int32_t *vertex_at = bw_alloc(l->ctx, l->plan->verifier.x->node_count, sizeof *vertex_at);
    bw_status status = vertex_at ? match_nodes(l, vertex_at, anchor_of) : l->ctx->error.status;
    for (size_t h = 0; h < l->mesh->vertex_count && status == BW_OK; h++) {
        bw_node n = anchor_of[h];
        anchor_of[h] = BW_NONE;
        if (n == BW_NONE || vertex_at[n] != (int32_t)h) continue;
        anchor_of[h] = (int32_t)l->anchor_count;
        l->anchor[l->anchor_count++] = (anchor){.node = n};
    }
    bw_free(l->ctx, vertex_at);
    return status;
}

static bw_status list_corners(labels *l, const int32_t *anchor_of) {
    size_t count = 0;
    for (int fill = 0; fill < 2; fill++) {
        for (size_t i = 0; i < 8 * l->mesh->hex_count; i++) {
            int32_t a = anchor_of[l->mesh->hex[i / 8][i % 8]];
            if (a == BW_NONE) continue;
            if (fill) l->corner[l->anchor[a + 1].first++] = i;
            else if ((size_t)a + 2 <= l->anchor_count) l->anchor[a + 2].first++;
            count += !fill;
        }
        if (fill) break;
        for (size_t a = 2; a <= l->anchor_count; a++) l->anchor[a].first += l->anchor[a - 1].first;
        if (!(l->corner = bw_alloc(l->ctx, count, sizeof *l->corner))) return l->ctx->error.status;
    }
    return BW_OK;
}

/* ---- what is known beforehand: regions ---- */

static int32_t find(int32_t *parent, int32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

/* Boundary facets, joined across edges that are neither singular nor features: *region is the lowest facet of each one's region, BW_NONE inside. */
static bw_status find_regions(bw_context *ctx, const bw_tet_mesh *mesh, const bw_grid_map *map, int32_t **region) {
    int32_t *first = bw_alloc(ctx, mesh->edge_count, sizeof *first), *parent = *region = bw_alloc(ctx, mesh->facet_count, sizeof *parent);
    bw_status status = ctx->error.status;
    for (size_t e = 0; e < mesh->edge_count && status == BW_OK; e++) first[e] = BW_NONE;
    for (size_t f = 0; f < mesh->facet_count && status == BW_OK; f++) {
        bw_tet t = mesh->facet_tet[f][0];
        parent[f] = mesh->facet_tet[f][1] == BW_NONE ? (int32_t)f : BW_NONE;
        for (int i = 0; i < 3 && parent[f] != BW_NONE; i++) {
            bw_edge e = mesh->tet_edge[t][bw_tet_edge_of[bw_tet_corner(mesh, t, mesh->facet[f][i])][bw_tet_corner(mesh, t, mesh->facet[f][(i + 1) % 3])]];
            if (map->edge_flags[e] & (BW_EDGE_SINGULAR | BW_EDGE_FEATURE)) continue;
            if (first[e] == BW_NONE) first[e] = (int32_t)f;
            int32_t a = find(parent, first[e]), b = find(parent, (int32_t)f);
            parent[a > b ? a : b] = a > b ? b : a;
        }
    }
    for (size_t f = 0; f < mesh->facet_count && status == BW_OK; f++)
        if (parent[f] != BW_NONE) parent[f] = find(parent, (int32_t)f);
    bw_free(ctx, first);
    return status;
}

/* Names the regions of the map by those of the input, through facets that both have: one is enough for a region. */
static bw_status name_regions(labels *l) {
    const bw_verifier *v = &l->plan->verifier;
    const bw_tet_mesh *mesh = &l->igm->mesh;
    int32_t *own = NULL, *input = NULL, *name = bw_alloc(l->ctx, mesh->facet_count, sizeof *name);
    l->facet_region = bw_alloc(l->ctx, mesh->facet_count, sizeof *l->facet_region);
    l->patch_region = bw_alloc(l->ctx, v->x->patch_count, sizeof *l->patch_region);
    bw_status status = l->ctx->error.status;
    if (status == BW_OK) status = find_regions(l->ctx, mesh, &l->igm->map, &own);
    if (status == BW_OK) status = find_regions(l->ctx, v->cells->mesh, v->cells->map, &input);
    for (size_t f = 0; f < mesh->facet_count && status == BW_OK; f++) name[f] = BW_NONE;
    for (size_t f = 0; f < mesh->facet_count && status == BW_OK; f++) {
        bw_facet same = own[f] == BW_NONE || name[own[f]] != BW_NONE ? BW_NONE : bw_tet_mesh_find_facet(v->cells->mesh, mesh->facet[f]);
        if (same != BW_NONE) name[own[f]] = input[same];
    }
    for (size_t f = 0; f < mesh->facet_count && status == BW_OK; f++) l->facet_region[f] = own[f] == BW_NONE ? BW_NONE : name[own[f]];
    for (size_t p = 0; p < v->x->patch_count && status == BW_OK; p++) {
        const bw_cell_polygon *g = &v->cells->polygon[v->x->patch_polygon[v->x->patch_polygon_begin[p]]];
        l->patch_region[p] = g->kind == BW_IN_FACET ? input[g->carrier] : BW_NONE;
    }
    bw_free(l->ctx, own);
    bw_free(l->ctx, input);
    bw_free(l->ctx, name);
    return status;
}

/* ---- the whole ---- */

/* Corners by the axes of the block. */
static bw_status turn_corners(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    labels *l = user;
    (void)ctx, (void)range;
    for (size_t h = begin; h < end; h++) {
        bw_hvertex old[8];
        memcpy(old, l->mesh->hex[h], sizeof old);
        for (int c = 0; c < 8 && l->turn[h]; c++) {
            int64_t u[3] = {c & 1 ? 1 : -1, c & 2 ? 1 : -1, c & 4 ? 1 : -1};
            bw_rotate(l->turn[h], u, u);
            l->mesh->hex[h][(u[0] > 0) | (u[1] > 0) << 1 | (u[2] > 0) << 2] = old[c];
        }
    }
    return BW_OK;
}

static bw_status make_room(labels *l) {
    const bw_complex *x = l->plan->verifier.x;
    size_t n = l->mesh->hex_count;
    list_rotations(l);
    l->turn = bw_alloc(l->ctx, n, sizeof *l->turn);
    l->across = bw_alloc(l->ctx, n, 6 * sizeof *l->across);
    l->compared = bw_alloc(l->ctx, n, 1);
    l->taken = bw_alloc(l->ctx, n, sizeof *l->taken);
    l->queue = bw_alloc(l->ctx, n, sizeof *l->queue);
    l->cube_begin = bw_alloc(l->ctx, x->block_count + 1, sizeof *l->cube_begin);
    l->anchor = bw_alloc(l->ctx, x->node_count + 1, sizeof *l->anchor);
    if (l->ctx->error.status != BW_OK) return l->ctx->error.status;
    for (size_t h = 0; h < n; h++) l->taken[h] = l->mesh->block[h] = BW_NONE;
    for (size_t b = 0; b < x->block_count; b++) {
        const int64_t *size = l->plan->size[b];
        l->cube_begin[b + 1] = l->cube_begin[b] + (uint32_t)(size[0] / 2 * (size[1] / 2) * (size[2] / 2));
    }
    bw_status status = bw_hex_mates(l->ctx, l->mesh, &l->mate);
    return status == BW_OK ? bw_parallel(l->ctx, n, bw_parallel_ranges(l->ctx, n, LEAST), turn_range, l) : status;
}

bw_status bw_hex_label(bw_context *ctx, const bw_hex_plan *plan, const bw_igm *igm, bw_hex_mesh *mesh) {
    labels l = {.ctx = ctx, .plan = plan, .igm = igm, .mesh = mesh, .farthest = "it has other components"};
    int32_t *anchor_of = NULL;
    bw_status status = BW_OK;
    if (plan->cubes != mesh->hex_count)
        return bw_fail(ctx, BW_E_CHECK, "the hex mesh has %zu hexes, but the quantization promised %llu", mesh->hex_count, (unsigned long long)plan->cubes);
    status = make_room(&l);
    if (status == BW_OK && !(anchor_of = bw_alloc(ctx, mesh->vertex_count, sizeof *anchor_of))) status = ctx->error.status;
    if (status == BW_OK) status = find_anchors(&l, anchor_of);
    if (status == BW_OK) status = list_corners(&l, anchor_of);
    if (status == BW_OK) status = name_regions(&l);
    if (status == BW_OK) status = flood(&l);
    if (status == BW_OK) status = bw_parallel(ctx, mesh->hex_count, bw_parallel_ranges(ctx, mesh->hex_count, LEAST), turn_corners, &l);
    void *blocks[] = {anchor_of, l.mate, l.across, l.compared, l.turn, l.cube_begin, l.taken, l.queue, l.anchor, l.corner, l.patch_region, l.facet_region};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    return status;
}
