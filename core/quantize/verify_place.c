/* Verifier, 1: every block laid out under the quantization, in its own chart, from the rims of the patches on its surface.
 *
 * The surface of a block is a sphere of patches. Where opposite sides of each are equally long, lengths along any closed walk on it add up to nothing, so
 * the place of every node follows from that of the low corner.
 */
#include <stdlib.h>
#include <string.h>

#include "quantize/verify_parts.h"

/* An arc on the rim of a patch, as it lies on the surface of a block. */
typedef struct {
    int64_t low[3], high[3]; /* p */
    bw_node node[2];         /* at low and high */
    bw_rib rib;              /* of patch[0] and side[0] only */
} step;

typedef struct {
    bw_verifier *v;
    bw_block block;
    step *item;
    size_t count, room;
    uint8_t *known; /* [place of the block] */
    size_t known_room;
} layout;

static int compare_points(const int64_t a[3], const int64_t b[3]) {
    for (int k = 0; k < 3; k++)
        if (a[k] != b[k]) return a[k] < b[k] ? -1 : 1;
    return 0;
}

static int compare_places(const void *a, const void *b) {
    const bw_place *x = a, *y = b;
    int64_t p[3] = {x->at[0].p, x->at[1].p, x->at[2].p}, q[3] = {y->at[0].p, y->at[1].p, y->at[2].p};
    return compare_points(p, q);
}

static int compare_steps(const void *a, const void *b) {
    const step *x = a, *y = b;
    int c = compare_points(x->low, y->low);
    if (!c) c = compare_points(x->high, y->high);
    if (!c) c = (x->rib.side[0] > y->rib.side[0]) - (x->rib.side[0] < y->rib.side[0]);
    return c ? c : (x->rib.patch[0] > y->rib.patch[0]) - (x->rib.patch[0] < y->rib.patch[0]);
}

/* The low corner of a patch's plane, where its first side starts, in the chart of the block on one side. */
static void corner_of(const bw_verifier *v, bw_patch patch, int slot, int64_t out[3]) {
    memcpy(out, v->x->patch_low[patch], 3 * sizeof *out);
    if (slot) bw_transition_apply(&v->across[patch], out, out);
}

/* The direction of side i of a patch in that chart: axis, and 1 or -1. */
static int direction_of(const bw_verifier *v, bw_patch patch, int slot, int i, int *axis) {
    int64_t d[3] = {0, 0, 0};
    d[((v->x->patch_side[patch][0] >> 1) + 1 + (i & 1)) % 3] = i < 2 ? 1 : -1;
    if (slot) bw_rotate(v->across[patch].rotation, d, d);
    *axis = d[0] ? 0 : d[1] ? 1 : 2;
    return (int)d[*axis];
}

static bw_status add_rim(layout *l, bw_patch patch, int slot) {
    const bw_complex *x = l->v->x;
    int64_t at[3];
    corner_of(l->v, patch, slot, at);
    for (int i = 0; i < 4; i++) {
        int axis, sign = direction_of(l->v, patch, slot, i, &axis);
        size_t chain = 4 * (size_t)patch + (size_t)i, end = x->patch_chain_begin[chain + 1];
        for (size_t k = x->patch_chain_begin[chain]; k < end; k++) {
            bw_arc_use use = x->patch_chain[k];
            bw_status status = bw_reserve(l->v->ctx, &l->item, &l->room, l->count + 1);
            if (status != BW_OK) return status;
            step *s = &l->item[l->count++];
            bool back = sign < 0;
            memcpy(s->low, at, sizeof at);
            at[axis] += sign * x->arc_length[use >> 1];
            memcpy(s->high, at, sizeof at);
            if (back) memcpy(s->high, s->low, sizeof at), memcpy(s->low, at, sizeof at);
            s->node[back] = bw_arc_use_start(x, use), s->node[!back] = bw_arc_use_end(x, use);
            s->rib = (bw_rib){.arc = use >> 1, .patch = {patch, patch}, .axis = (uint8_t)axis,
                              .side = {x->patch_side[patch][slot], x->patch_side[patch][slot]}, .reversed = back != (use & 1)};
        }
    }
    return BW_OK;
}

static int32_t find_place(const bw_verifier *v, bw_block block, const int64_t at[3]) {
    const bw_place *first = &v->place[v->place_begin[block]];
    bw_place key = {{{0, at[0]}, {0, at[1]}, {0, at[2]}}, 0};
    const bw_place *found = bsearch(&key, first, v->place_begin[block + 1] - v->place_begin[block], sizeof key, compare_places);
    return found ? (int32_t)(found - v->place) : BW_NONE;
}

/* The places of a block, from both ends of its steps; q is not known yet. */
static bw_status list_places(layout *l) {
    bw_verifier *v = l->v;
    size_t begin = v->place_begin[l->block], end = begin;
    bw_status status = bw_reserve(v->ctx, &v->place, &v->place_room, begin + 2 * l->count);
    if (status != BW_OK) return status;
    for (size_t i = 0; i < l->count; i++)
        for (int e = 0; e < 2; e++) {
            const int64_t *at = e ? l->item[i].high : l->item[i].low;
            v->place[end++] = (bw_place){{{0, at[0]}, {0, at[1]}, {0, at[2]}}, l->item[i].node[e]};
        }
    qsort(&v->place[begin], end - begin, sizeof *v->place, compare_places);
    size_t kept = begin;
    for (size_t i = begin; i < end; i++) {
        if (kept > begin && !compare_places(&v->place[kept - 1], &v->place[i])) {
            if (v->place[kept - 1].node != v->place[i].node)
                return bw_fail(v->ctx, BW_E_CHECK, "two nodes lie in one place of block %d", l->block);
            continue;
        }
        v->place[kept++] = v->place[i];
    }
    v->place_begin[l->block + 1] = kept;
    return BW_OK;
}

/* Two steps with the same ends, of two patches, are one rib. */
static bw_status list_ribs(layout *l) {
    bw_verifier *v = l->v;
    size_t count = v->rib_begin[l->block];
    qsort(l->item, l->count, sizeof *l->item, compare_steps);
    bw_status status = bw_reserve(v->ctx, &v->rib, &v->rib_room, count + l->count / 2);
    if (status != BW_OK) return status;
    for (size_t i = 0; i < l->count; i += 2) {
        const step *s = &l->item[i];
        if (i + 1 == l->count || compare_points(s->low, s[1].low) || compare_points(s->high, s[1].high) || s->rib.arc != s[1].rib.arc)
            return bw_fail(v->ctx, BW_E_CHECK, "arc %d has not two patches on the surface of block %d", s->rib.arc, l->block);
        bw_rib *r = &v->rib[count++];
        *r = s->rib;
        r->patch[1] = s[1].rib.patch[0], r->side[1] = s[1].rib.side[0];
        r->place[0] = find_place(v, l->block, s->low), r->place[1] = find_place(v, l->block, s->high);
    }
    v->rib_begin[l->block + 1] = count;
    return BW_OK;
}

/* Carries q along the ribs from the low corner. Sweeps go up and down in turn: a few do. */
static bw_status carry_lengths(layout *l) {
    bw_verifier *v = l->v;
    size_t begin = v->place_begin[l->block], places = v->place_begin[l->block + 1] - begin, known = 1;
    size_t first = v->rib_begin[l->block], ribs = v->rib_begin[l->block + 1] - first;
    bw_status status = bw_reserve(v->ctx, &l->known, &l->known_room, places);
    if (status != BW_OK) return status;
    memset(l->known, 0, places);
    l->known[0] = 1; /* the least of all: the low corner */
    for (size_t before = 0, sweep = 0; known < places && before < known; sweep++) {
        before = known;
        for (size_t i = 0; i < ribs; i++) {
            const bw_rib *r = &v->rib[first + (sweep & 1 ? ribs - 1 - i : i)];
            size_t a = (size_t)r->place[0], b = (size_t)r->place[1];
            if (l->known[a - begin] == l->known[b - begin]) continue;
            bool up = l->known[a - begin];
            bw_place *to = &v->place[up ? b : a];
            const bw_place *from = &v->place[up ? a : b];
            for (int k = 0; k < 3; k++) to->at[k].q = from->at[k].q;
            to->at[r->axis].q += up ? v->length[r->arc] : -v->length[r->arc];
            l->known[up ? b - begin : a - begin] = 1;
            known++;
        }
    }
    if (known < places) return bw_fail(v->ctx, BW_E_CHECK, "the arcs on the surface of block %d are not connected", l->block);
    for (size_t i = first; i < first + ribs; i++) {
        const bw_rib *r = &v->rib[i];
        for (int k = 0; k < 3; k++) {
            int64_t d = v->place[r->place[1]].at[k].q - v->place[r->place[0]].at[k].q;
            if (d != (k == r->axis ? v->length[r->arc] : 0)) return bw_fail(v->ctx, BW_E_CHECK, "block %d does not close", l->block);
        }
    }
    return BW_OK;
}

/* The boxes of the patches of a block's side, from the places of two of their corners. */
static bw_status box_patch(bw_verifier *v, bw_patch patch, int slot) {
    bw_block block = v->x->patch_block[patch][slot];
    int64_t corner[2][3], d[3] = {0, 0, 0};
    int normal = v->x->patch_side[patch][0] >> 1;
    corner_of(v, patch, slot, corner[0]);
    d[(normal + 1) % 3] = v->x->patch_extent[patch][0], d[(normal + 2) % 3] = v->x->patch_extent[patch][1];
    if (slot) bw_rotate(v->across[patch].rotation, d, d);
    for (int k = 0; k < 3; k++) corner[1][k] = corner[0][k] + d[k];
    int32_t place[2] = {find_place(v, block, corner[0]), find_place(v, block, corner[1])};
    if (place[0] == BW_NONE || place[1] == BW_NONE) return bw_fail(v->ctx, BW_E_CHECK, "patch %d has no corners in block %d", patch, block);
    for (int k = 0; k < 3; k++) {
        bool turned = d[k] < 0;
        v->box[patch][slot].low[k] = v->place[place[turned]].at[k];
        v->box[patch][slot].high[k] = v->place[place[!turned]].at[k];
    }
    return BW_OK;
}

static bw_status place_block(layout *l) {
    bw_verifier *v = l->v;
    const bw_complex *x = v->x;
    bw_status status = BW_OK;
    l->count = 0;
    for (size_t side = 0; side < 6; side++) {
        size_t key = 6 * (size_t)l->block + side;
        for (size_t i = x->block_side_begin[key]; i < x->block_side_begin[key + 1] && status == BW_OK; i++) {
            bw_patch p = x->block_side[i];
            status = add_rim(l, p, x->patch_block[p][0] != l->block || x->patch_side[p][0] != side);
        }
    }
    if (status == BW_OK) status = list_places(l);
    if (status == BW_OK) status = list_ribs(l);
    if (status == BW_OK) status = carry_lengths(l);
    if (status != BW_OK) return status;
    const bw_place *far = &v->place[v->place_begin[l->block + 1] - 1];
    for (int k = 0; k < 3; k++) {
        v->extent[l->block][k] = far->at[k].q;
        if (far->at[k].q < 0) bw_verify_fault(v, BW_FAULT_EXTENT, "block", l->block, -1, "the extent of the block is negative");
    }
    return BW_OK;
}

static void check_rectangles(bw_verifier *v) {
    const bw_complex *x = v->x;
    for (size_t p = 0; p < x->patch_count; p++) {
        int64_t sum[4] = {0, 0, 0, 0};
        for (size_t s = 0; s < 4; s++)
            for (size_t i = x->patch_chain_begin[4 * p + s]; i < x->patch_chain_begin[4 * p + s + 1]; i++)
                sum[s] += v->length[x->patch_chain[i] >> 1];
        if (sum[0] != sum[2] || sum[1] != sum[3])
            bw_verify_fault(v, BW_FAULT_RECTANGLE, "patch", (int64_t)p, -1, "opposite sides of the patch are not equally long");
    }
}

bw_status bw_verify_place(bw_verifier *v) {
    const bw_complex *x = v->x;
    v->across = bw_alloc(v->ctx, x->patch_count, sizeof *v->across);
    v->box = bw_alloc(v->ctx, x->patch_count, sizeof *v->box);
    v->extent = bw_alloc(v->ctx, x->block_count, sizeof *v->extent);
    v->place_begin = bw_alloc(v->ctx, x->block_count + 1, sizeof *v->place_begin);
    v->rib_begin = bw_alloc(v->ctx, x->block_count + 1, sizeof *v->rib_begin);
    bw_status status = v->ctx->error.status;
    if (status != BW_OK) return status;
    check_rectangles(v);
    for (size_t p = 0; p < x->patch_count; p++) {
        if (x->patch_block[p][1] == BW_NONE) continue;
        bw_transition t = bw_complex_across(v->cells, x, (bw_patch)p);
        v->across[p] = bw_transition_inverse(&t);
    }
    layout l = {.v = v};
    for (size_t b = 0; b < x->block_count && bw_verify_going(v, status); b++) {
        l.block = (bw_block)b;
        status = place_block(&l);
    }
    bw_free(v->ctx, l.item);
    bw_free(v->ctx, l.known);
    for (size_t p = 0; p < x->patch_count && bw_verify_going(v, status); p++)
        for (int slot = 0; slot < 2 && x->patch_block[p][slot] != BW_NONE && status == BW_OK; slot++)
            status = box_patch(v, (bw_patch)p, slot);
    return status;
}
