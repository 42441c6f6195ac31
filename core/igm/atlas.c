#include "igm/atlas.h"

#include <stdlib.h>
#include <string.h>

void bw_atlas_clear(bw_context *ctx, bw_atlas *atlas) {
    void *blocks[] = {atlas->extent, atlas->across, atlas->integer, atlas->box, atlas->place_begin, atlas->place, atlas->rib_begin, atlas->rib};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    memset(atlas, 0, sizeof *atlas);
}

static int compare_at(const void *a, const void *b) {
    const int64_t *p = a;
    const bw_place *place = b;
    for (int k = 0; k < 3; k++)
        if (p[k] != place->at[k].p) return p[k] < place->at[k].p ? -1 : 1;
    return 0;
}

int32_t bw_atlas_find(const bw_atlas *atlas, bw_block block, const int64_t p[3]) {
    const bw_place *first = &atlas->place[atlas->place_begin[block]];
    const bw_place *found = bsearch(p, first, atlas->place_begin[block + 1] - atlas->place_begin[block], sizeof *first, compare_at);
    return found ? (int32_t)(found - atlas->place) : BW_NONE;
}

static void place_p(const bw_place *place, int64_t out[3]) {
    for (int k = 0; k < 3; k++) out[k] = place->at[k].p;
}

static void place_q(const bw_place *place, int64_t out[3]) {
    for (int k = 0; k < 3; k++) out[k] = place->at[k].q;
}

/* Whether a point in grid units is in the rectangle of a patch. */
static bool is_on(const bw_box *box, const bw_place *place) {
    for (int k = 0; k < 3; k++)
        if (place->at[k].p < box->low[k].p || place->at[k].p > box->high[k].p) return false;
    return true;
}

int bw_atlas_slot(const bw_atlas *atlas, bw_block block, const bw_rib *rib, int i) {
    const bw_complex *x = atlas->complex;
    bw_patch patch = rib->patch[i];
    bool fits[2];
    for (int s = 0; s < 2; s++)
        fits[s] = x->patch_block[patch][s] == block && x->patch_side[patch][s] == rib->side[i] &&
                  is_on(&atlas->box[patch][s], &atlas->place[rib->place[0]]) && is_on(&atlas->box[patch][s], &atlas->place[rib->place[1]]);
    return fits[0] && fits[1] ? i : !fits[0]; /* both: a block that is folded onto itself around the rib */
}

/* The place of a patch's low corner, where its first side starts, in the chart of one of its blocks. */
static int32_t corner_of(const bw_atlas *atlas, bw_patch patch, int slot) {
    int64_t p[3];
    memcpy(p, atlas->complex->patch_low[patch], sizeof p);
    if (slot) bw_transition_apply(&atlas->across[patch], p, p);
    return bw_atlas_find(atlas, atlas->complex->patch_block[patch][slot], p);
}

static bw_status join(bw_context *ctx, bw_atlas *atlas, bw_patch patch) {
    int32_t place[2] = {corner_of(atlas, patch, 0), corner_of(atlas, patch, 1)};
    int64_t from[3], to[3];
    if (place[0] == BW_NONE || place[1] == BW_NONE) return bw_fail(ctx, BW_E_CHECK, "the low corner of patch %d has no place", patch);
    place_q(&atlas->place[place[0]], from), place_q(&atlas->place[place[1]], to);
    bw_transition *t = &atlas->integer[patch];
    t->rotation = atlas->across[patch].rotation;
    bw_rotate(t->rotation, from, from);
    for (int k = 0; k < 3; k++) t->shift[k] = to[k] - from[k];
    return BW_OK;
}

/* The verifier of quantizations lays out blocks as well: its first step is taken over, with what it made. */
bw_status bw_atlas_init(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const int64_t *length, bw_atlas *atlas) {
    bw_verdict verdict = {.fault = BW_VALID};
    bw_verifier v = {.ctx = ctx, .cells = cells, .x = complex, .length = length, .verdict = &verdict};
    bw_status status = bw_verify_place(&v);
    *atlas = (bw_atlas){.cells = cells, .complex = complex, .length = length, .extent = v.extent, .across = v.across, .box = v.box,
                        .place_begin = v.place_begin, .place = v.place, .rib_begin = v.rib_begin, .rib = v.rib};
    if (status == BW_OK && verdict.fault != BW_VALID)
        status = bw_fail(ctx, BW_E_CHECK, "%s (%s %lld)", verdict.message, verdict.kind, (long long)verdict.id);
    atlas->integer = bw_alloc(ctx, complex->patch_count, sizeof *atlas->integer);
    if (!atlas->integer) status = ctx->error.status;
    for (size_t p = 0; p < complex->patch_count && status == BW_OK; p++)
        if (complex->patch_block[p][1] != BW_NONE) status = join(ctx, atlas, (bw_patch)p);
    if (status != BW_OK) bw_atlas_clear(ctx, atlas);
    return status;
}

/* ---- check --------------------------------------------------------------------------------------------------------- */

static bw_status check_places(bw_context *ctx, const bw_atlas *atlas, bw_block block) {
    for (size_t i = atlas->place_begin[block]; i < atlas->place_begin[block + 1]; i++) {
        const bw_place *a = &atlas->place[i];
        int64_t p[3];
        place_p(a, p);
        if (i > atlas->place_begin[block] && compare_at(p, a - 1) <= 0)
            return bw_fail(ctx, BW_E_CHECK, "the places of block %d are not sorted", block);
        for (int k = 0; k < 3; k++) {
            int64_t extent = atlas->complex->block_extent[block][k];
            if (p[k] < 0 || p[k] > extent)
                return bw_fail(ctx, BW_E_CHECK, "node %d lies outside of block %d", a->node, block);
            if ((p[k] == 0 && a->at[k].q != 0) || (p[k] == extent && a->at[k].q != atlas->extent[block][k]))
                return bw_fail(ctx, BW_E_CHECK, "node %d is not on the side of block %d", a->node, block);
        }
    }
    for (size_t i = atlas->rib_begin[block]; i < atlas->rib_begin[block + 1]; i++) {
        const bw_rib *r = &atlas->rib[i];
        const bw_place *low = &atlas->place[r->place[0]], *high = &atlas->place[r->place[1]];
        for (int k = 0; k < 3; k++)
            if (high->at[k].q - low->at[k].q != (k == r->axis ? atlas->length[r->arc] : 0))
                return bw_fail(ctx, BW_E_CHECK, "arc %d is not as long as it should be in block %d", r->arc, block);
    }
    return BW_OK;
}

/* One node on the rim of a patch, at p in the chart of side 0. */
static bw_status check_joint(bw_context *ctx, const bw_atlas *atlas, bw_patch patch, const int64_t p[3], bw_node node) {
    const bw_complex *x = atlas->complex;
    int64_t other[3], q[2][3];
    bw_transition_apply(&atlas->across[patch], p, other);
    int32_t a = bw_atlas_find(atlas, x->patch_block[patch][0], p), b = bw_atlas_find(atlas, x->patch_block[patch][1], other);
    if (a == BW_NONE || b == BW_NONE || atlas->place[a].node != node || atlas->place[b].node != node)
        return bw_fail(ctx, BW_E_CHECK, "node %d on the rim of patch %d has not a place in both blocks", node, patch);
    place_q(&atlas->place[a], q[0]), place_q(&atlas->place[b], q[1]);
    bw_transition_apply(&atlas->integer[patch], q[0], q[0]);
    if (memcmp(q[0], q[1], sizeof q[0])) return bw_fail(ctx, BW_E_CHECK, "the transition of patch %d does not carry node %d", patch, node);
    return BW_OK;
}

static bw_status check_patch(bw_context *ctx, const bw_atlas *atlas, bw_patch patch) {
    const bw_complex *x = atlas->complex;
    int64_t p[3];
    bw_status status = BW_OK;
    if (atlas->integer[patch].rotation != atlas->across[patch].rotation)
        return bw_fail(ctx, BW_E_CHECK, "the transition of patch %d turns otherwise than in the map", patch);
    memcpy(p, x->patch_low[patch], sizeof p);
    for (size_t i = 0; i < 4; i++) {
        size_t chain = 4 * (size_t)patch + i;
        int axis = ((x->patch_side[patch][0] >> 1) + 1 + (int)(i & 1)) % 3;
        for (size_t k = x->patch_chain_begin[chain]; k < x->patch_chain_begin[chain + 1] && status == BW_OK; k++) {
            status = check_joint(ctx, atlas, patch, p, bw_arc_use_start(x, x->patch_chain[k]));
            p[axis] += (i < 2 ? 1 : -1) * x->arc_length[x->patch_chain[k] >> 1];
        }
    }
    return status;
}

/* The rib of `block` on an arc between two places, in either sense. O(ribs of the block). */
static const bw_rib *find_rib(const bw_atlas *atlas, bw_block block, bw_arc arc, int32_t a, int32_t b) {
    for (size_t i = atlas->rib_begin[block]; i < atlas->rib_begin[block + 1]; i++) {
        const bw_rib *r = &atlas->rib[i];
        if (r->arc == arc && ((r->place[0] == a && r->place[1] == b) || (r->place[0] == b && r->place[1] == a))) return r;
    }
    return NULL;
}

/* Goes from a rib through its patch[exit] to the same arc's rib in the block there; *exit becomes the patch to go on through. */
static const bw_rib *step(const bw_atlas *atlas, bw_block *block, const bw_rib *rib, int *exit, bw_transition *total) {
    const bw_complex *x = atlas->complex;
    bw_patch patch = rib->patch[*exit];
    int slot = bw_atlas_slot(atlas, *block, rib, *exit);
    bw_transition t = slot ? bw_transition_inverse(&atlas->across[patch]) : atlas->across[patch], q = bw_atlas_out(atlas, patch, slot);
    bw_block to = x->patch_block[patch][1 - slot];
    int32_t place[2];
    for (int e = 0; e < 2; e++) {
        int64_t p[3];
        place_p(&atlas->place[rib->place[e]], p);
        bw_transition_apply(&t, p, p);
        place[e] = bw_atlas_find(atlas, to, p);
    }
    const bw_rib *next = find_rib(atlas, to, rib->arc, place[0], place[1]);
    if (!next) return NULL;
    int enter = next->patch[0] == patch && bw_atlas_slot(atlas, to, next, 0) == 1 - slot ? 0 : 1;
    *block = to, *exit = 1 - enter;
    *total = bw_transition_compose(&q, total);
    return next;
}

static bw_status check_around(bw_context *ctx, const bw_atlas *atlas, bw_block block, const bw_rib *rib) {
    bw_transition total = {.rotation = 0};
    bw_block at = block;
    const bw_rib *r = rib;
    int exit = 1, quarters = 0;
    do {
        quarters += r->side[0] == r->side[1] ? 2 : 1;
        r = quarters > atlas->complex->arc_quarters[rib->arc] ? NULL : step(atlas, &at, r, &exit, &total);
        if (!r) return bw_fail(ctx, BW_E_CHECK, "the blocks around arc %d do not close", rib->arc);
    } while (r != rib || exit != 1);
    if (quarters != atlas->complex->arc_quarters[rib->arc])
        return bw_fail(ctx, BW_E_CHECK, "there are %d quarter turns of blocks around arc %d", quarters, rib->arc);
    for (int e = 0; e < 2; e++) {
        int64_t q[3], image[3];
        place_q(&atlas->place[rib->place[e]], q);
        bw_transition_apply(&total, q, image);
        if (memcmp(q, image, sizeof q)) return bw_fail(ctx, BW_E_CHECK, "the way around arc %d moves it", rib->arc);
    }
    if (quarters == 4 && !bw_transition_is_identity(&total))
        return bw_fail(ctx, BW_E_CHECK, "the transitions around arc %d do not compose to the identity", rib->arc);
    return BW_OK;
}

bw_status bw_atlas_check(bw_context *ctx, const bw_atlas *atlas) {
    const bw_complex *x = atlas->complex;
    bw_status status = BW_OK;
    for (size_t b = 0; b < x->block_count && status == BW_OK; b++) status = check_places(ctx, atlas, (bw_block)b);
    for (size_t p = 0; p < x->patch_count && status == BW_OK; p++)
        if (x->patch_block[p][1] != BW_NONE) status = check_patch(ctx, atlas, (bw_patch)p);
    for (size_t b = 0; b < x->block_count && status == BW_OK; b++)
        for (size_t i = atlas->rib_begin[b]; i < atlas->rib_begin[b + 1] && status == BW_OK; i++)
            if (!(x->arc_flags[atlas->rib[i].arc] & BW_ARC_BOUNDARY)) status = check_around(ctx, atlas, (bw_block)b, &atlas->rib[i]);
    return status;
}
