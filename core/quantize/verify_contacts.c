/* Verifier, 3: which blocks touch, and where, once they have their lengths under the quantization.
 *
 * A wall is a plane of sides of blocks that face each other across patches. Where no patch of it has a negative extent, its blocks touch just in the patches,
 * which tile both sides. A negative extent says that a block has slid past the end of another, and may touch blocks now that it has
 * no patch with, and no longer some that it has.
 *
 * Take a point of the wall's plane in general position (in q + epsilon p, and nudged), laid out along patches. Let every patch that covers the point carry one unit of flow
 * from one of its blocks to the other, from the second to the first if it is inverted (one extent negative). The rim of a side's box is the boundary of
 * the signed sum of the side's patches. So as much flow leaves a side as boxes of it cover the point: one or none; of the sides facing it, one or none is where it ends. The
 * flow therefore leads from each block that has the point on its side to one opposite that has it too: these two touch there. Where all lengths are positive that is the
 * patch itself, and moving lengths on from there slides boxes, but does not cut the flow.
 */
#include <string.h>

#include "quantize/verify_parts.h"

/* A flow meets a few patches, and so does what lies flat around one on the boundary. Where planes spiral through the blocks it may be any number. */
enum { FLOW_MOST = 1 << 12 };

/* A change of chart in both measures. */
typedef struct {
    bw_transition p, q;
} change;

static change change_compose(const change *after, const change *before) {
    return (change){bw_transition_compose(&after->p, &before->p), bw_transition_compose(&after->q, &before->q)};
}

static change change_inverse(const change *c) {
    return (change){bw_transition_inverse(&c->p), bw_transition_inverse(&c->q)};
}

static void change_apply(const change *c, const bw_pair in[3], bw_pair out[3]) {
    int64_t p[3] = {in[0].p, in[1].p, in[2].p}, q[3] = {in[0].q, in[1].q, in[2].q};
    bw_transition_apply(&c->p, p, p);
    bw_transition_apply(&c->q, q, q);
    for (int k = 0; k < 3; k++) out[k] = (bw_pair){q[k], p[k]};
}

/* Completes a change of chart of which p is known and one point in both charts. */
static void change_anchor(change *c, const bw_pair from[3], const bw_pair to[3]) {
    int64_t q[3] = {from[0].q, from[1].q, from[2].q};
    c->q = (bw_transition){{0, 0, 0}, c->p.rotation};
    bw_transition_apply(&c->q, q, q);
    for (int k = 0; k < 3; k++) c->q.shift[k] = to[k].q - q[k];
}

/* From the chart of patch_block[slot] to that of the other block of a patch. */
static change change_across(const bw_verifier *v, bw_patch patch, int slot) {
    const bw_box *box = v->box[patch];
    change c = {.p = v->across[patch]};
    bw_pair to[3];
    int64_t p[3] = {box[0].low[0].p, box[0].low[1].p, box[0].low[2].p};
    bw_transition_apply(&c.p, p, p);
    for (int k = 0; k < 3; k++) to[k] = p[k] == box[1].low[k].p ? box[1].low[k] : box[1].high[k];
    change_anchor(&c, box[0].low, to);
    return slot ? change_inverse(&c) : c;
}

/* ---- points in general position ---- */

/* A point of a side's plane, a little off any line through it: towards nudge along each axis. */
typedef struct {
    bw_pair at[3];
    int64_t nudge[3];
} spot;

static spot carry(const change *c, const spot *s) {
    spot out;
    change_apply(c, s->at, out.at);
    bw_rotate(c->p.rotation, s->nudge, out.nudge);
    return out;
}

static bool above(const spot *s, int axis, bw_pair line) {
    int c = bw_pair_compare(s->at[axis], line);
    return c > 0 || (c == 0 && s->nudge[axis] > 0);
}

/* How often a box of a plane covers a point of it: 0, 1, or -1 if the box is inverted. */
static int cover(const bw_box *box, int normal, const spot *s) {
    int sign = 1;
    for (int k = 0; k < 3; k++) {
        if (k == normal) continue;
        bool low = above(s, k, box->low[k]), high = above(s, k, box->high[k]);
        if (low == high) return 0;
        if (high) sign = -sign;
    }
    return sign;
}

static bw_box box_of_block(const bw_verifier *v, bw_block block) {
    bw_box box;
    for (int k = 0; k < 3; k++) {
        box.low[k] = (bw_pair){0, 0};
        box.high[k] = (bw_pair){v->extent[block][k], v->x->block_extent[block][k]};
    }
    return box;
}

/* ---- following the flow ---- */

typedef struct {
    bw_patch patch;
    bw_pair at[3]; /* in the chart of patch_block[0] */
} crossing;

typedef struct {
    bw_verifier *v;
    crossing *used, *reached; /* patches that carried the flow; boundary patches a search has seen, in the chart of their block */
    size_t used_count, used_room, reached_count, reached_room;
    /* where the flow is */
    bw_block block; /* BW_NONE: outside */
    uint8_t side;
    spot at;
    change back;        /* from the chart of `block` (outside: of the last block) to that of the first */
    bw_patch patch;     /* first patch, or the critical one */
    int critical;       /* critical patches crossed, with their signs */
    bw_pair limit[3];   /* in the first chart: the same holds for all points up to there */
    spot start;
} flow;

static bool same_crossing(const crossing *a, const crossing *b) {
    return a->patch == b->patch && !bw_pair_compare(a->at[0], b->at[0]) && !bw_pair_compare(a->at[1], b->at[1]) &&
           !bw_pair_compare(a->at[2], b->at[2]);
}

static crossing crossing_at(const bw_verifier *v, bw_patch patch, int slot, const spot *s) {
    crossing c = {.patch = patch};
    if (slot) {
        change home = change_across(v, patch, 1);
        change_apply(&home, s->at, c.at);
    } else {
        memcpy(c.at, s->at, sizeof c.at);
    }
    return c;
}

/* Points of the first side beyond a line of the box may fare differently. */
static void limit(flow *f, const bw_box *box) {
    bw_pair end[2][3];
    change_apply(&f->back, box->low, end[0]);
    change_apply(&f->back, box->high, end[1]);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++)
            if (!above(&f->start, k, end[i][k]) && bw_pair_compare(end[i][k], f->limit[k]) < 0) f->limit[k] = end[i][k];
}

static int slot_of(const bw_verifier *v, bw_patch patch, bw_block block, uint8_t side) {
    return v->x->patch_block[patch][0] != block || v->x->patch_side[patch][0] != side;
}

/* How a patch of the side where the flow is covers the point. */
static int cover_of(const flow *f, bw_patch p) {
    return cover(&f->v->box[p][slot_of(f->v, p, f->block, f->side)], f->side >> 1, &f->at);
}

/* The direction, 1 or -1 along an axis, in which a point lies beyond a block; 0 if it does not. */
static int beyond(const bw_verifier *v, bw_block block, int axis, const spot *s) {
    bw_box box = box_of_block(v, block);
    return above(s, axis, box.high[axis]) ? 1 : above(s, axis, box.low[axis]) ? 0 : -1;
}

/* An inverted patch of the side where the flow is: the axis along which it is, and the direction along it in which the side goes on to the patch that takes up
 * its flow. A fold: beyond the end of one of its blocks, the other goes on. */
static int fold_of(const flow *f, bw_patch p, int *axis) {
    const bw_verifier *v = f->v;
    int slot = slot_of(v, p, f->block, f->side), direction;
    const bw_box *box = &v->box[p][slot];
    *axis = ((f->side >> 1) + 1) % 3;
    if (bw_pair_compare(box->low[*axis], box->high[*axis]) < 0) *axis = ((f->side >> 1) + 2) % 3;
    direction = -beyond(v, f->block, *axis, &f->at);
    if (direction || v->x->patch_block[p][1] == BW_NONE) return direction;
    change c = change_across(v, p, slot); /* the point is on this block: it is the other that ends */
    spot there = carry(&c, &f->at);
    int other = bw_rotation_image[c.p.rotation][*axis];
    return beyond(v, v->x->patch_block[p][!slot], other, &there) * bw_rotation_sign[c.p.rotation][other];
}

/* The patch of the side that takes up the flow of an inverted one: the nearest in its direction that covers the point and is not inverted. */
static bw_patch partner_of(const flow *f, bw_patch inverted) {
    const bw_verifier *v = f->v;
    size_t key = 6 * (size_t)f->block + f->side;
    int axis, direction = fold_of(f, inverted, &axis);
    const bw_box *box = &v->box[inverted][slot_of(v, inverted, f->block, f->side)];
    bw_patch best = BW_NONE;
    int64_t least = 0;
    for (size_t i = v->x->block_side_begin[key]; i < v->x->block_side_begin[key + 1]; i++) {
        bw_patch p = v->x->block_side[i];
        const bw_box *other = &v->box[p][slot_of(v, p, f->block, f->side)];
        int64_t gap = direction > 0 ? other->low[axis].p - box->high[axis].p : box->low[axis].p - other->high[axis].p;
        if (!direction || gap < 0 || cover_of(f, p) <= 0 || (best != BW_NONE && gap >= least)) continue;
        best = p, least = gap;
    }
    return best;
}

/* Whether the flow that came by `from` onto a side that the point lies on goes on: an inverted patch takes it up, and another flow ends here. */
static bool passes(const flow *f, bw_patch from) {
    const bw_verifier *v = f->v;
    size_t key = 6 * (size_t)f->block + f->side;
    for (size_t i = v->x->block_side_begin[key]; i < v->x->block_side_begin[key + 1]; i++) {
        bw_patch p = v->x->block_side[i];
        if (cover_of(f, p) < 0 && partner_of(f, p) == from) return true;
    }
    return false;
}

static bool is_used(const flow *f, bw_patch p) {
    crossing c = crossing_at(f->v, p, slot_of(f->v, p, f->block, f->side), &f->at);
    for (size_t k = 0; k < f->used_count; k++)
        if (same_crossing(&f->used[k], &c)) return true;
    return false;
}

/* The patch of the side where the flow is through which it goes on: it covers the point with the sign wanted. `from`: the patch it came by, BW_NONE where
 * it begins. Mostly there is only one. Around a singular arc several pass the side, each by an inverted patch and its partner; then these
 * belong together, and what begins here takes what is left. */
static bw_patch way_out(const flow *f, int sign, bw_patch from) {
    const bw_verifier *v = f->v;
    size_t key = 6 * (size_t)f->block + f->side, begin = v->x->block_side_begin[key], end = v->x->block_side_begin[key + 1];
    bw_patch found = BW_NONE;
    int count = 0;
    for (size_t i = begin; i < end; i++) {
        bw_patch p = v->x->block_side[i];
        if (cover_of(f, p) != sign || is_used(f, p)) continue;
        found = count++ ? found : p;
    }
    if (count < 2) return found;
    if (sign > 0 && from != BW_NONE) return partner_of(f, from);
    for (size_t i = begin; i < end; i++) {
        bw_patch p = v->x->block_side[i];
        if (cover_of(f, p) != sign || is_used(f, p)) continue;
        if (sign < 0 ? partner_of(f, p) == from : !passes(f, p)) return p;
    }
    return found;
}

static bool too_long(const flow *f, size_t count) {
    if (count < FLOW_MOST) return false;
    bw_verify_fault(f->v, BW_UNDECIDED, "block", f->block, -1, "what lies beside the block is too many patches away");
    return true;
}

static bw_status mark_used(flow *f, bw_patch p, int slot, int sign) {
    bw_status status = bw_poll(f->v->ctx);
    if (status != BW_OK || too_long(f, f->used_count)) return status;
    status = bw_reserve(f->v->ctx, &f->used, &f->used_room, f->used_count + 1);
    if (status != BW_OK) return status;
    f->used[f->used_count++] = crossing_at(f->v, p, slot, &f->at);
    limit(f, &f->v->box[p][slot]);
    if (f->v->surface[p]) f->critical += sign;
    if (f->patch == BW_NONE || f->v->surface[p]) f->patch = p;
    return BW_OK;
}

/* The change of chart across a flat arc of the boundary, from rib r of one block to rib s of another. */
static bool unfold(const bw_verifier *v, const bw_rib *r, uint8_t side, const bw_rib *s, uint8_t other, change *out) {
    int64_t along[2][3] = {{0, 0, 0}, {0, 0, 0}}, up[2][3] = {{0, 0, 0}, {0, 0, 0}};
    along[0][r->axis] = r->reversed ? -1 : 1, along[1][s->axis] = s->reversed ? -1 : 1;
    up[0][side >> 1] = side & 1 ? 1 : -1, up[1][other >> 1] = other & 1 ? 1 : -1;
    for (bw_rotation t = 0; t < BW_ROTATIONS; t++) {
        int64_t a[3], u[3];
        bw_rotate(t, along[0], a), bw_rotate(t, up[0], u);
        if (memcmp(a, along[1], sizeof a) || memcmp(u, up[1], sizeof u)) continue;
        const bw_pair *from = v->place[r->place[r->reversed]].at, *to = v->place[s->place[s->reversed]].at;
        int64_t p[3] = {from[0].p, from[1].p, from[2].p};
        out->p = (bw_transition){{0, 0, 0}, t};
        bw_transition_apply(&out->p, p, p);
        for (int k = 0; k < 3; k++) out->p.shift[k] = to[k].p - p[k];
        change_anchor(out, from, to);
        return true;
    }
    return false;
}

typedef struct {
    crossing here;
    spot at;
    change back;
} visit;

/* The boundary patches beside one, across flat arcs. */
static bw_status spread(flow *f, const visit *from, visit **list, size_t *count, size_t *room) {
    const bw_verifier *v = f->v;
    bw_patch p = from->here.patch;
    bw_block a = v->x->patch_block[p][0];
    uint8_t side = v->x->patch_side[p][0];
    visit start = *from;
    for (size_t i = v->rib_begin[a]; i < v->rib_begin[a + 1]; i++) {
        const bw_rib *r = &v->rib[i];
        if ((r->patch[0] != p && r->patch[1] != p) || v->arc_link[r->arc] != BW_NONE || v->arc_surfaces[r->arc] != 2) continue;
        bw_patch next = v->arc_surface[r->arc][v->arc_surface[r->arc][0] == p];
        bw_block b = v->x->patch_block[next][0];
        for (size_t j = v->rib_begin[b]; j < v->rib_begin[b + 1]; j++) {
            const bw_rib *s = &v->rib[j];
            change c;
            if (s->arc != r->arc || (s->patch[0] != next && s->patch[1] != next) || s == r) continue;
            if (!unfold(v, r, side, s, v->x->patch_side[next][0], &c)) continue;
            change home = change_inverse(&c);
            visit n = {.at = carry(&c, &start.at), .back = change_compose(&start.back, &home)};
            n.here = (crossing){.patch = next};
            memcpy(n.here.at, n.at.at, sizeof n.here.at);
            bool seen = false;
            for (size_t k = 0; k < *count && !seen; k++) seen = same_crossing(&(*list)[k].here, &n.here);
            if (seen) continue;
            bw_status status = bw_reserve(v->ctx, list, room, *count + 1);
            if (status != BW_OK) return status;
            (*list)[(*count)++] = n;
        }
    }
    return BW_OK;
}

/* Outside, reached across *patch with a sign: the flow ends there (sign 1) unless a boundary patch of the same plane with the other sign takes it in again:
 * *patch then. */
static bw_status go_outside(flow *f, bw_patch *patch, int sign) {
    bw_verifier *v = f->v;
    visit *list = NULL;
    size_t count = 0, room = 0;
    bw_status status = bw_reserve(v->ctx, &list, &room, 1);
    if (status == BW_OK) {
        list[count++] = (visit){{*patch, {f->at.at[0], f->at.at[1], f->at.at[2]}}, f->at, f->back};
        f->block = BW_NONE;
    }
    for (size_t i = 0; i < count && status == BW_OK && !too_long(f, count); i++) {
        visit here = list[i];
        bw_patch p = here.here.patch;
        uint8_t side = v->x->patch_side[p][0];
        bool used = false;
        for (size_t k = 0; k < f->used_count && !used; k++) used = same_crossing(&f->used[k], &here.here);
        if (!used && cover(&v->box[p][0], side >> 1, &here.at) == -sign) {
            f->block = v->x->patch_block[p][0], f->side = side, f->at = here.at, f->back = here.back;
            status = mark_used(f, p, 0, -sign);
            *patch = p;
            break;
        }
        status = spread(f, &here, &list, &count, &room);
    }
    bw_free(v->ctx, list);
    return status;
}

static void cross(flow *f, bw_patch p, int slot) {
    change c = change_across(f->v, p, slot), home = change_inverse(&c);
    f->at = carry(&c, &f->at);
    f->back = change_compose(&f->back, &home);
    f->block = f->v->x->patch_block[p][!slot], f->side = f->v->x->patch_side[p][!slot];
}

/* Follows the flow from a point of a block's side to where it ends; *found is false if it does not. */
static bw_status follow(flow *f, bw_block block, uint8_t side, const spot *start, bool *found) {
    const bw_verifier *v = f->v;
    f->block = block, f->side = side, f->at = f->start = *start;
    f->back = (change){.p = {{0, 0, 0}, 0}};
    f->used_count = 0, f->critical = 0, f->patch = BW_NONE;
    bw_box box = box_of_block(v, block);
    memcpy(f->limit, box.high, sizeof f->limit);
    *found = false;
    bw_patch p = BW_NONE;
    for (int sign = 1; f->block != BW_NONE && bw_verify_going(v, BW_OK);) {
        p = way_out(f, sign, p);
        if (p == BW_NONE) return BW_OK;
        int slot = slot_of(v, p, f->block, f->side);
        bw_status status = mark_used(f, p, slot, sign);
        if (status == BW_OK && v->x->patch_block[p][1] != BW_NONE) cross(f, p, slot);
        else if (status == BW_OK) status = go_outside(f, &p, sign), sign = f->block == BW_NONE ? sign : -sign;
        if (status != BW_OK) return status;
        if (f->block == BW_NONE) {
            if (sign < 0) return BW_OK;
            break;
        }
        box = box_of_block(v, f->block);
        limit(f, &box);
        if (sign > 0 && cover(&box, f->side >> 1, &f->at) > 0 && !passes(f, p)) break;
        sign = -sign;
    }
    *found = bw_verify_going(v, BW_OK) && (f->critical == 0 || f->critical == 1);
    return BW_OK;
}

/* ---- contacts ---- */

static bw_status add_contact(bw_verifier *v, bw_contact c) {
    bw_status status = bw_reserve(v->ctx, &v->contact, &v->contact_room, v->contact_count + 1);
    if (status == BW_OK) v->contact[v->contact_count++] = c;
    return status;
}

static bw_status contact_of_patch(bw_verifier *v, bw_patch p) {
    const bw_complex *x = v->x;
    bw_contact c = {.block = {x->patch_block[p][0], x->patch_block[p][1]}, .side = {x->patch_side[p][0], x->patch_side[p][1]},
                    .patch = p, .critical = v->surface[p] != BW_SURFACE_NONE};
    if (c.block[1] != BW_NONE) c.chart = change_across(v, p, 0).q;
    for (int k = 0; k < 3; k++) c.low[k] = v->box[p][0].low[k].q, c.high[k] = v->box[p][0].high[k].q;
    return add_contact(v, c);
}

static bw_status tangled(bw_verifier *v, bw_block block) {
    bw_verify_fault(v, BW_FAULT_TOPOLOGY, "block", block, -1, "what lies beside the block cannot be told: blocks overlap");
    return BW_OK;
}

/* The contact at the low corner of `part` of a side, and how far it reaches: part->high becomes that. */
static bw_status touch(flow *f, bw_block block, uint8_t side, bw_box *part) {
    bw_verifier *v = f->v;
    spot start = {.nudge = {1, 1, 1}};
    bool found, again = true;
    memcpy(start.at, part->low, sizeof start.at);
    bw_status status = follow(f, block, side, &start, &found);
    if (status != BW_OK) return status;
    if (!found) return tangled(v, block);
    for (int k = 0; k < 3; k++)
        if (k != side >> 1 && bw_pair_compare(f->limit[k], part->high[k]) < 0) part->high[k] = f->limit[k];
    change out = change_inverse(&f->back);
    bw_contact c = {.block = {block, f->block}, .side = {side, f->side}, .chart = out.q, .patch = f->patch, .critical = f->critical};
    for (int k = 0; k < 3; k++) c.low[k] = part->low[k].q, c.high[k] = part->high[k].q;
    if (f->block != BW_NONE) { /* the other block must say the same */
        spot there = f->at;
        status = follow(f, c.block[1], c.side[1], &there, &found);
        if (status != BW_OK) return status;
        change_apply(&out, start.at, there.at);
        again = found && f->block == block && f->side == side;
        for (int k = 0; k < 3 && again; k++) again = !bw_pair_compare(f->at.at[k], start.at[k]);
    }
    if (!again) return tangled(v, block);
    bool first = c.block[1] == BW_NONE || 6 * block + side < 6 * c.block[1] + c.side[1];
    return first ? add_contact(v, c) : BW_OK; /* it comes from both sides */
}

/* All contacts of a side of a wall in which something has slid, from the low corner on. */
static bw_status touch_all(flow *f, bw_block block, uint8_t side) {
    int u = ((side >> 1) + 1) % 3, w = ((side >> 1) + 2) % 3;
    bw_box *part = NULL, whole = box_of_block(f->v, block);
    size_t count = 0, room = 0;
    bw_status status = bw_reserve(f->v->ctx, &part, &room, 1);
    if (status != BW_OK) return status;
    (side & 1 ? whole.low : whole.high)[side >> 1] = (side & 1 ? whole.high : whole.low)[side >> 1];
    part[count++] = whole;
    while (count && bw_verify_going(f->v, status)) {
        bw_box rest = part[--count], here = rest;
        status = touch(f, block, side, &here);
        if (!bw_verify_going(f->v, status)) break;
        status = bw_reserve(f->v->ctx, &part, &room, count + 2);
        bw_box beside = rest, over = rest;
        beside.low[u] = here.high[u];
        over.high[u] = here.high[u], over.low[w] = here.high[w];
        if (status == BW_OK && bw_pair_compare(beside.low[u], beside.high[u]) < 0) part[count++] = beside;
        if (status == BW_OK && bw_pair_compare(over.low[w], over.high[w]) < 0) part[count++] = over;
    }
    bw_free(f->v->ctx, part);
    return status;
}

/* ---- walls ---- */

static size_t root_of(size_t *parent, size_t s) {
    while (parent[s] != s) s = parent[s] = parent[parent[s]];
    return s;
}

static size_t side_of(const bw_verifier *v, size_t patch, int slot) {
    return 6 * (size_t)v->x->patch_block[patch][slot] + v->x->patch_side[patch][slot];
}

static bool is_inverted(const bw_verifier *v, size_t patch) {
    const bw_box *box = v->box[patch];
    return box->high[0].q < box->low[0].q || box->high[1].q < box->low[1].q || box->high[2].q < box->low[2].q;
}

/* Marks the sides of walls that have a patch with a negative extent. */
static bw_status find_slid_walls(bw_verifier *v) {
    uint8_t *slid = v->slid;
    size_t sides = 6 * v->x->block_count, *parent = bw_alloc(v->ctx, sides, sizeof *parent);
    if (!parent) return v->ctx->error.status;
    for (size_t s = 0; s < sides; s++) parent[s] = s;
    for (size_t p = 0; p < v->x->patch_count; p++)
        if (v->x->patch_block[p][1] != BW_NONE) parent[root_of(parent, side_of(v, p, 0))] = root_of(parent, side_of(v, p, 1));
    for (size_t a = 0; a < v->x->arc_count; a++) /* the boundary joins sides as well: the outside is one */
        if (v->arc_link[a] == BW_NONE && v->arc_surfaces[a] == 2 && v->surface[v->arc_surface[a][0]] == BW_SURFACE_BOUNDARY)
            parent[root_of(parent, side_of(v, (size_t)v->arc_surface[a][0], 0))] = root_of(parent, side_of(v, (size_t)v->arc_surface[a][1], 0));
    for (size_t p = 0; p < v->x->patch_count; p++)
        if (is_inverted(v, p)) slid[root_of(parent, side_of(v, p, 0))] = 1;
    for (size_t s = 0; s < sides; s++) slid[s] |= slid[root_of(parent, s)];
    bw_free(v->ctx, parent);
    return BW_OK;
}

bw_status bw_verify_contacts(bw_verifier *v) {
    v->slid = bw_alloc(v->ctx, 6 * v->x->block_count, 1);
    bw_status status = v->slid ? find_slid_walls(v) : v->ctx->error.status;
    flow f = {.v = v};
    for (size_t p = 0; p < v->x->patch_count && bw_verify_going(v, status); p++)
        if (!v->slid[side_of(v, p, 0)]) status = contact_of_patch(v, (bw_patch)p);
    for (size_t s = 0; s < 6 * v->x->block_count && bw_verify_going(v, status); s++)
        if (v->slid[s]) status = touch_all(&f, (bw_block)(s / 6), (uint8_t)(s % 6));
    bw_free(v->ctx, f.used);
    return status;
}
