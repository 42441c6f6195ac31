#include "quantize/validity.h"

#include <stdlib.h>
#include <string.h>

#include "quantize/flood.h"
#include "quantize/loops.h"

enum { LOOPS_AT_A_TIME = 8 };

/* Two entities and how far they lie apart in the input across both. Of all their meetings in a call the one counts that is apart in the
 * fewest directions along them: its cells face each other, and its constraint asks for no more than is needed. */
typedef struct {
    bw_critical_entity entity[2];
    int64_t across[3]; /* sizes, ascending */
    int64_t along;     /* sum of the gaps along */
    size_t constraint; /* in `separations` */
    int directions;    /* along which they are apart */
} encounter;

struct bw_validity {
    bw_context *ctx;
    const bw_complex *x;
    bw_surface surface;
    bw_critical critical;
    bw_loops loops;
    bw_flood flood;
    bw_corridor corridor;
    int32_t *loose; /* 4 * patch + side: sides of patches that must not be negative */
    size_t loose_count;
    unsigned left_out; /* bits of bw_rule */
    const int64_t *length; /* of the call */
    bw_constraint_list *out, step; /* out: `step`, what one step of the call finds */
    bw_constraint_list separations; /* one for each encounter, and others that better ones replaced */
    bw_constraint_list collapsed;   /* loops that floods found */
    uint8_t *flat;    /* [block]: has an extent of 0, or an arc without positive length */
    uint8_t *touched; /* [node]: by such a block */
    encounter *found;
    size_t found_count, found_room;
    bw_term *term;
    size_t term_room;
    int32_t *points, *others; /* ends of a path */
    size_t points_room, others_room;
    bw_validity_figures figures;
};

/* ---- setting up ---- */

static bool is_flat_at(const bw_surface *s, int32_t rim) {
    int quarters;
    bw_surface_rim_other(s, rim, &quarters);
    return quarters == 2;
}

/* Critical arcs that end a patch without being an edge of a block beside it. As a rule an arc that ends a patch is an edge of one of its two blocks, and may
 * change places with an arc that is one of the other (flood.h); these may not. */
static bw_status list_loose(bw_validity *v) {
    const bw_surface *s = &v->surface;
    const bw_complex *x = v->x;
    v->loose = bw_alloc(v->ctx, x->patch_chain_begin[4 * x->patch_count], sizeof *v->loose);
    for (size_t k = 0; k < 4 * x->patch_count && v->loose; k++)
        for (size_t i = x->patch_chain_begin[k]; i < x->patch_chain_begin[k + 1]; i++) {
            int32_t rim = 2 * (int32_t)i;
            if (v->critical.arc_link[x->patch_chain[i] >> 1] == BW_NONE || s->rim_edge[rim ^ 1] == BW_NONE) continue;
            if (is_flat_at(s, rim) && is_flat_at(s, rim ^ 1)) v->loose[v->loose_count++] = (int32_t)(k ^ 1); /* a side of the patch that leads away from it */
        }
    return v->ctx->error.status;
}

bw_status bw_validity_new(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_validity **out) {
    bw_validity *v = *out = bw_alloc(ctx, 1, sizeof *v);
    if (!v) return ctx->error.status;
    v->ctx = ctx, v->x = complex;
    bw_status status = bw_surface_init(ctx, cells, complex, &v->surface);
    if (status == BW_OK) status = bw_critical_init(ctx, cells, &v->surface, &v->critical);
    if (status == BW_OK) status = bw_loops_init(ctx, &v->surface, &v->critical, &v->loops);
    if (status == BW_OK) status = bw_flood_init(ctx, &v->surface, &v->critical, &v->loops, &v->flood);
    bw_corridor_init(ctx, &v->surface, &v->corridor);
    v->flat = bw_alloc(ctx, complex->block_count, 1);
    v->touched = bw_alloc(ctx, complex->node_count, 1);
    if (status == BW_OK) status = ctx->error.status;
    if (status == BW_OK) status = list_loose(v);
    v->figures = (bw_validity_figures){.links = v->critical.link_count, .regions = v->critical.region_count, .nodes = v->critical.node_count,
                                       .region_generators = v->loops.region.rank, .volume_generators = v->loops.volume.rank};
    if (status == BW_OK) return BW_OK;
    bw_validity_free(ctx, v);
    *out = NULL;
    return status;
}

void bw_validity_free(bw_context *ctx, bw_validity *v) {
    if (!v) return;
    bw_flood_clear(&v->flood);
    bw_corridor_clear(&v->corridor);
    bw_loops_clear(ctx, &v->loops);
    bw_critical_clear(ctx, &v->critical);
    bw_surface_clear(ctx, &v->surface);
    bw_constraint_clear(ctx, &v->separations);
    bw_constraint_clear(ctx, &v->collapsed);
    bw_constraint_clear(ctx, &v->step);
    void *blocks[] = {v->loose, v->flat, v->touched, v->found, v->term, v->points, v->others, v};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
}

bw_validity_figures bw_validity_count(const bw_validity *v) { return v->figures; }
const bw_surface *bw_validity_surface(const bw_validity *v) { return &v->surface; }
const bw_critical *bw_validity_critical(const bw_validity *v) { return &v->critical; }
const bw_loops *bw_validity_loops(const bw_validity *v) { return &v->loops; }

/* ---- chains: consistency and (i) ---- */

static bw_status add_chain(bw_validity *v, size_t *n, const bw_arc_use *chain, size_t begin, size_t end, int32_t factor) {
    if (bw_reserve(v->ctx, &v->term, &v->term_room, *n + end - begin)) return v->ctx->error.status;
    for (size_t i = begin; i < end; i++) v->term[(*n)++] = (bw_term){chain[i] >> 1, factor};
    return BW_OK;
}

static int64_t sum(const bw_validity *v, size_t n) {
    int64_t total = 0;
    for (size_t i = 0; i < n; i++) total += v->term[i].factor * v->length[v->term[i].arc];
    return total;
}

static bw_status separate_rectangles(bw_validity *v) {
    const bw_complex *x = v->x;
    for (size_t k = 0; k < 2 * x->patch_count; k++) {
        const size_t *begin = x->patch_chain_begin + 4 * (k / 2) + k % 2;
        size_t n = 0;
        if (add_chain(v, &n, x->patch_chain, begin[0], begin[1], 1) || add_chain(v, &n, x->patch_chain, begin[2], begin[3], -1))
            return v->ctx->error.status;
        if (sum(v, n) && bw_constraint_add(v->ctx, v->out, BW_RULE_RECTANGLE, BW_EQUAL, v->term, n, 0)) return v->ctx->error.status;
    }
    return BW_OK;
}

static bw_status separate_extents(bw_validity *v) {
    const bw_complex *x = v->x;
    for (size_t k = 0; k < 3 * x->block_count; k++) {
        size_t edge = 12 * (k / 3) + 4 * (k % 3), n = 0;
        if (add_chain(v, &n, x->block_edge, x->block_edge_begin[edge], x->block_edge_begin[edge + 1], 1)) return v->ctx->error.status;
        if (sum(v, n) < 0 && bw_constraint_add(v->ctx, v->out, BW_RULE_EXTENT, BW_AT_LEAST, v->term, n, 0)) return v->ctx->error.status;
    }
    return BW_OK;
}

/* Adds a side of a patch, 4 * patch + side, if it is negative. */
static bw_status separate_side(bw_validity *v, size_t side, bw_rule rule) {
    const bw_complex *x = v->x;
    size_t n = 0;
    if (add_chain(v, &n, x->patch_chain, x->patch_chain_begin[side], x->patch_chain_begin[side + 1], 1)) return v->ctx->error.status;
    return sum(v, n) < 0 ? bw_constraint_add(v->ctx, v->out, rule, BW_AT_LEAST, v->term, n, 0) : BW_OK;
}

/* Where arcs are negative patches may turn over, for blocks on the two sides of a wall may change places along it. Not so on the boundary, which has blocks on one
 * side only, nor beside loose arcs. */
static bw_status separate_patches(bw_validity *v) {
    for (size_t k = 0; k < 2 * v->x->patch_count; k++)
        if (v->critical.patch_region[k / 2] != BW_NONE && separate_side(v, 4 * (k / 2) + k % 2, BW_RULE_REGION)) return v->ctx->error.status;
    for (size_t i = 0; i < v->loose_count; i++)
        if (separate_side(v, (size_t)v->loose[i], BW_RULE_SEPARATION)) return v->ctx->error.status;
    return BW_OK;
}

static bw_status separate_links(bw_validity *v) {
    const bw_critical *c = &v->critical;
    for (size_t l = 0; l < c->link_count; l++) {
        size_t n = 0;
        if (add_chain(v, &n, c->link_arc, c->link_begin[l], c->link_begin[l + 1], 1)) return v->ctx->error.status;
        if (sum(v, n) < 1 && bw_constraint_add(v->ctx, v->out, BW_RULE_LINK, BW_AT_LEAST, v->term, n, 1)) return v->ctx->error.status;
    }
    return BW_OK;
}

/* ---- (ii) ---- */

/* Marks blocks that a point may be zero-connected through, or along; false if there is none. */
static bool mark_flat(bw_validity *v) {
    const bw_surface *s = &v->surface;
    bool any = false;
    memset(v->touched, 0, v->x->node_count);
    for (size_t b = 0; b < v->x->block_count; b++) {
        const int64_t *extent = v->flood.at[s->point_begin[b + 1] - 1];
        bool flat = !extent[0] || !extent[1] || !extent[2];
        for (size_t e = s->edge_begin[b]; e < s->edge_begin[b + 1] && !flat; e++) flat = v->length[s->edge[e].use >> 1] < 1;
        v->flat[b] = flat;
        any = any || flat;
        for (size_t p = s->point_begin[b]; p < s->point_begin[b + 1] && flat; p++) v->touched[s->point[p].node] = 1;
    }
    return any;
}

static bw_status list_points(bw_validity *v, bw_critical_cell cell, int32_t **list, size_t *room, size_t *n) {
    const bw_surface *s = &v->surface;
    *n = 0;
    if (cell.kind == BW_CELL_PATCH) {
        for (int32_t rim = bw_surface_first_rim(s, cell.place); rim < bw_surface_last_rim(s, cell.place); rim += 2) {
            if (bw_reserve(v->ctx, list, room, *n + 1)) return v->ctx->error.status;
            (*list)[(*n)++] = s->rim_point[rim];
        }
        return BW_OK;
    }
    if (bw_reserve(v->ctx, list, room, 2)) return v->ctx->error.status;
    *n = cell.kind == BW_CELL_ARC ? 2 : 1;
    for (size_t i = 0; i < *n; i++) (*list)[i] = cell.kind == BW_CELL_ARC ? s->edge[cell.place].point[i] : cell.place;
    return BW_OK;
}

/* Of the points of one of the two cells of a meeting those that look towards the other cell. */
static bw_status list_facing(bw_validity *v, const bw_meeting *m, bool other, int32_t **list, size_t *room, size_t *n) {
    size_t kept = 0;
    if (list_points(v, other ? m->cell : v->flood.seed, list, room, n)) return v->ctx->error.status;
    for (size_t i = 0; i < *n; i++)
        if (bw_flood_faces(&v->flood, m, other, (*list)[i])) (*list)[kept++] = (*list)[i];
    *n = kept;
    return BW_OK;
}

/* The slots on the way to a state of the flood, appended in order. */
static bw_status walk_to(bw_validity *v, int32_t state) {
    size_t first = v->corridor.count;
    int32_t slot;
    for (int32_t before; (before = bw_flood_before(&v->flood, state, &slot)) != BW_NONE; state = before)
        if (slot != BW_NONE && bw_corridor_cross(&v->corridor, slot)) return v->ctx->error.status;
    for (size_t i = first, j = v->corridor.count; i + 1 < j; i++) {
        int32_t swap = v->corridor.slot[i];
        v->corridor.slot[i] = v->corridor.slot[--j], v->corridor.slot[j] = swap;
    }
    return BW_OK;
}

static int compare_sizes(const void *a, const void *b) {
    const int64_t *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

static encounter describe(const bw_validity *v, const bw_meeting *m) {
    encounter e = {.entity = {bw_critical_cell_entity(&v->surface, &v->critical, v->flood.seed),
                              bw_critical_cell_entity(&v->surface, &v->critical, m->cell)}};
    if (e.entity[0] > e.entity[1]) e.entity[0] ^= e.entity[1], e.entity[1] ^= e.entity[0], e.entity[0] ^= e.entity[1];
    for (int k = 0; k < 3; k++) {
        bool along = m->along >> k & 1;
        (along ? &e.along : &e.across[k])[0] += llabs(m->gap[k]);
        e.directions += along;
    }
    qsort(e.across, 3, sizeof *e.across, compare_sizes);
    return e;
}

/* Whether a meeting is the best of its kind in this call so far; then *slot is where it is to be kept. */
static bw_status is_better(bw_validity *v, const encounter *e, encounter **slot) {
    *slot = NULL;
    for (size_t i = 0; i < v->found_count; i++) {
        encounter *f = &v->found[i];
        if (f->entity[0] != e->entity[0] || f->entity[1] != e->entity[1] || memcmp(f->across, e->across, sizeof f->across)) continue;
        if (e->directions < f->directions || (e->directions == f->directions && e->along < f->along)) *slot = f;
        return BW_OK;
    }
    if (bw_reserve(v->ctx, &v->found, &v->found_room, v->found_count + 1)) return v->ctx->error.status;
    *slot = &v->found[v->found_count];
    return BW_OK;
}

static bw_status separate_meeting(bw_validity *v, const bw_meeting *m) {
    size_t n, others;
    encounter e = describe(v, m), *slot;
    if (is_better(v, &e, &slot)) return v->ctx->error.status;
    if (!slot) return BW_OK;
    bw_corridor_start(&v->corridor, bw_critical_cell_block(&v->surface, v->flood.seed));
    if (walk_to(v, m->state) || list_facing(v, m, false, &v->points, &v->points_room, &n) ||
        list_facing(v, m, true, &v->others, &v->others_room, &others) || bw_corridor_find(&v->corridor, v->points, n, v->others, others))
        return v->ctx->error.status;
    int sign[3], used = 0;
    int64_t now[3];
    bw_corridor_displacement(&v->corridor, v->length, now);
    for (int k = 0; k < 3; k++) {
        sign[k] = (m->gap[k] > 0) - (m->gap[k] < 0);
        if (sign[k] * now[k] > 0) sign[k] = 0; /* along a cell that has turned around: its other end is the one that touches */
        used += sign[k] != 0;
    }
    if (!used) return BW_OK;
    e.constraint = v->separations.count;
    v->found_count += slot == v->found + v->found_count;
    *slot = e;
    return bw_corridor_constrain(&v->corridor, sign, 1, BW_RULE_SEPARATION, &v->separations);
}

static bw_status append_separations(bw_validity *v) {
    for (size_t i = 0; i < v->found_count; i++)
        if (bw_constraint_copy(v->ctx, v->out, &v->separations, v->found[i].constraint)) return v->ctx->error.status;
    v->found_count = 0;
    bw_constraint_clear(v->ctx, &v->separations);
    return BW_OK;
}

/* A direction that a rotation leaves as it is. */
static void axis_of(bw_rotation r, int axis[3]) {
    for (int code = 26; code > 13; code--) { /* the middle one is 0, those before are opposite */
        int64_t v[3] = {code / 9 - 1, code / 3 % 3 - 1, code % 3 - 1}, turned[3];
        bw_rotate(r, v, turned);
        for (int k = 0; k < 3; k++) axis[k] = (int)v[k];
        if (!memcmp(v, turned, sizeof v)) return;
    }
}

/* The corridor is a loop that returns to where it starts: its displacement must not be 0. If it turns its chart, the displacement along the axis is what all points
 * have in common; otherwise that in each direction, of which one must be left in the input's direction. */
static bw_status separate_loop(bw_validity *v, bw_rule rule) {
    const bw_surface *s = &v->surface;
    int32_t point = (int32_t)s->point_begin[v->corridor.block];
    int64_t input[3], sum = 0;
    bw_rotation turn = 0;
    int sign[3];
    if (bw_corridor_find(&v->corridor, &point, 1, &point, 1)) return v->ctx->error.status;
    bw_corridor_displacement(&v->corridor, v->x->arc_length, input);
    for (size_t i = 0; i < v->corridor.count; i++) turn = bw_rotation_compose(bw_surface_cross(s, v->corridor.slot[i]).rotation, turn);
    if (turn) axis_of(turn, sign);
    for (int k = 0; k < 3; k++) {
        if (!turn) sign[k] = (input[k] > 0) - (input[k] < 0);
        sum += sign[k] * input[k];
    }
    if (!sum) return BW_OK; /* no direction to ask for: what else collapses is told by other rules */
    for (int k = 0; k < 3 && sum < 0; k++) sign[k] = -sign[k];
    return bw_corridor_constrain(&v->corridor, sign, 1, rule, &v->collapsed);
}

/* The loop that the last flood found: there one way, back the other. A few of each rule are enough at a time. */
static bw_status collect_loop(bw_validity *v) {
    const int32_t *loop = v->flood.loop;
    bw_rule rule = v->flood.kind == BW_MEET_NOTHING ? BW_RULE_REGION : BW_RULE_VOLUME;
    size_t known = 0;
    for (size_t c = 0; c < v->collapsed.count; c++) known += v->collapsed.rule[c] == rule;
    if (loop[0] == BW_NONE || known >= LOOPS_AT_A_TIME) return BW_OK;
    bw_corridor_start(&v->corridor, bw_critical_cell_block(&v->surface, v->flood.seed));
    if (walk_to(v, loop[0]) || (loop[2] != BW_NONE && bw_corridor_cross(&v->corridor, loop[2]))) return v->ctx->error.status;
    int32_t slot, state = loop[1];
    for (int32_t before; (before = bw_flood_before(&v->flood, state, &slot)) != BW_NONE; state = before)
        if (slot != BW_NONE && bw_corridor_cross(&v->corridor, slot ^ 1)) return v->ctx->error.status;
    return separate_loop(v, rule);
}

static bw_status flood_from(bw_validity *v, bw_critical_cell seed, bw_meeting_kind kind) {
    if (bw_flood_run(&v->flood, seed, kind)) return v->ctx->error.status;
    v->figures.floods++, v->figures.states += v->flood.state_count;
    for (size_t i = 0; i < v->flood.meeting_count; i++)
        if (separate_meeting(v, &v->flood.meeting[i])) return v->ctx->error.status;
    return collect_loop(v);
}

static bw_status flood_from_cells(bw_validity *v, bw_meeting_kind kind) {
    const bw_critical *c = &v->critical;
    for (size_t i = 0; i < c->link_begin[c->link_count]; i++) {
        bw_arc a = c->link_arc[i] >> 1;
        if ((v->touched[v->x->arc_node[a][0]] || v->touched[v->x->arc_node[a][1]]) &&
            flood_from(v, (bw_critical_cell){BW_CELL_ARC, c->arc_edge[a]}, kind))
            return v->ctx->error.status;
    }
    for (size_t p = 0; p < v->x->patch_count; p++) {
        const bw_block *b = v->x->patch_block[p];
        if (c->patch_region[p] != BW_NONE && (v->flat[b[0]] || (b[1] != BW_NONE && v->flat[b[1]])) &&
            flood_from(v, (bw_critical_cell){BW_CELL_PATCH, 2 * (int32_t)p}, kind))
            return v->ctx->error.status;
    }
    return append_separations(v);
}

static bw_status separate_across(bw_validity *v) { return flood_from_cells(v, BW_MEET_ACROSS); }

static bw_status separate_apart(bw_validity *v) {
    bool negative = false;
    for (size_t a = 0; a < v->x->arc_count; a++) negative = negative || v->length[a] < 0;
    return negative ? flood_from_cells(v, BW_MEET_APART) : BW_OK;
}

/* A boundary region is held by the blocks it was traced on: each of its patches stays within the side it lies in, or part of it would be that of another block. */
static bw_status separate_sides(bw_validity *v) {
    const bw_surface *s = &v->surface;
    for (int32_t slot = 0; slot < 2 * (int32_t)v->x->patch_count; slot++) {
        bw_block b = bw_surface_slot_block(s, slot);
        if (v->critical.patch_region[slot >> 1] == BW_NONE || b == BW_NONE) continue;
        int32_t end[2] = {(int32_t)s->point_begin[b], (int32_t)s->point_begin[b + 1] - 1}; /* of the block, and of the patch */
        const int32_t *corner = s->slot_corner[slot];
        for (int k = 0; k < 6; k++) {
            int axis = k / 2, high = k % 2, sign[3] = {0, 0, 0};
            int32_t from = high ? corner[1] : end[0], to = high ? end[1] : corner[0];
            if (v->flood.at[to][axis] >= v->flood.at[from][axis]) continue;
            sign[axis] = 1;
            bw_corridor_start(&v->corridor, b);
            if (bw_corridor_find(&v->corridor, &from, 1, &to, 1) || bw_corridor_constrain(&v->corridor, sign, 0, BW_RULE_REGION, v->out))
                return v->ctx->error.status;
        }
    }
    return BW_OK;
}

/* One place of each node is enough. Without critical nodes, links and regions at all there are only loops to find: from any point. */
static bw_status separate_nodes(bw_validity *v) {
    const bw_surface *s = &v->surface;
    bool none = v->critical.node_count + v->critical.link_count + v->critical.region_count == 0;
    for (size_t p = 0; p < s->point_count; p++) {
        bw_node n = s->point[p].node;
        if (v->touched[n] != 1 || !(v->critical.node[n] || none)) continue;
        v->touched[n] = 2; /* once */
        if (flood_from(v, (bw_critical_cell){BW_CELL_NODE, (int32_t)p}, BW_MEET_NODES)) return v->ctx->error.status;
    }
    return append_separations(v);
}

/* ---- (iii) and (iv) ---- */

/* Loops of the volume were found by the floods before. */
static bw_status separate_loops(bw_validity *v) {
    const int32_t *region = v->critical.patch_region;
    for (size_t p = 0; p < v->x->patch_count && v->loops.region.rank; p++)
        if (region[p] != BW_NONE && v->flat[v->x->patch_block[p][0]] && flood_from(v, (bw_critical_cell){BW_CELL_PATCH, 2 * (int32_t)p}, BW_MEET_NOTHING))
            return v->ctx->error.status;
    for (size_t c = 0; c < v->collapsed.count; c++)
        if (bw_constraint_copy(v->ctx, v->out, &v->collapsed, c)) return v->ctx->error.status;
    return BW_OK;
}

/* ---- the order of Q 5.3.5 ---- */

void bw_validity_leave_out(bw_validity *v, unsigned rules) { v->left_out = rules; }

/* Takes one step and appends what it finds, but for rules left out. */
static bw_status take_step(bw_validity *v, bw_status (*step)(bw_validity *), bw_constraint_list *violated) {
    bw_constraint_clear(v->ctx, &v->step);
    if (step(v)) return v->ctx->error.status;
    for (size_t c = 0; c < v->step.count; c++)
        if (!(v->left_out >> v->step.rule[c] & 1) && bw_constraint_copy(v->ctx, violated, &v->step, c)) return v->ctx->error.status;
    return BW_OK;
}

bw_status bw_validity_separate(bw_validity *v, const int64_t *length, bw_constraint_list *violated) {
    static bw_status (*const first[])(bw_validity *) = {separate_rectangles, separate_extents, separate_links, separate_patches};
    static bw_status (*const later[])(bw_validity *) = {separate_sides, separate_across, separate_nodes, separate_apart, separate_loops};
    size_t before = violated->count;
    v->length = length, v->out = &v->step;
    v->figures.calls++;
    v->found_count = 0;
    for (size_t i = 0; i < sizeof first / sizeof *first; i++)
        if (take_step(v, first[i], violated) || violated->count > before) return v->ctx->error.status;
    bw_flood_lay_out(&v->flood, length);
    if (!mark_flat(v)) return BW_OK;
    bw_constraint_clear(v->ctx, &v->separations);
    bw_constraint_clear(v->ctx, &v->collapsed);
    for (size_t i = 0; i < sizeof later / sizeof *later; i++)
        if (take_step(v, later[i], violated) || violated->count > before) return v->ctx->error.status;
    return BW_OK;
}
