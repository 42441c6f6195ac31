#include "igm/overlay_points.h"

#include <string.h>

void bw_exact_points_clear(bw_context *ctx, bw_exact_points *p) {
    for (size_t i = 0; i < p->ready; i++) mpq_clears(p->point[i].x[0], p->point[i].x[1], p->point[i].x[2], NULL);
    bw_free(ctx, p->point), bw_free(ctx, p->slot);
    bw_charge(ctx, &p->charged, 0);
    memset(p, 0, sizeof *p);
}

void bw_exact_points_empty(bw_exact_points *p) {
    p->count = 0;
    for (size_t i = 0; i < p->slots; i++) p->slot[i] = BW_NONE;
}

static uint64_t hash_of(int32_t group, const double at[3]) {
    uint64_t h = (uint64_t)group * 0x9e3779b97f4a7c15u;
    for (int k = 0; k < 3; k++) {
        uint64_t bits;
        double x = at[k] == 0 ? 0 : at[k];
        memcpy(&bits, &x, sizeof bits);
        h = (h ^ bits) * 0xff51afd7ed558ccdu;
        h ^= h >> 32;
    }
    return h;
}

static bool same(const bw_exact_point *a, int32_t group, const mpq_t x[3], const double at[3]) {
    for (int k = 0; k < 3; k++)
        if (a->at[k] != at[k]) return false;
    return a->group == group && mpq_equal(a->x[0], x[0]) && mpq_equal(a->x[1], x[1]) && mpq_equal(a->x[2], x[2]);
}

/* Bytes on the heap: every block has a word more and is a multiple of two words, of four at least. */
static size_t held_by(const mpz_t z) {
    size_t words = (size_t)z->_mp_alloc;
    return words == 0 ? 0 : words < 3 ? 4 * sizeof(mp_limb_t) : (words + 2) / 2 * 2 * sizeof(mp_limb_t);
}

static size_t held_by_point(const bw_exact_point *p) {
    size_t sum = 0;
    for (int k = 0; k < 3; k++) sum += held_by(mpq_numref(p->x[k])) + held_by(mpq_denref(p->x[k]));
    return sum;
}

static bw_status grow(bw_context *ctx, bw_exact_points *p) {
    size_t slots = p->slots ? 2 * p->slots : 1024;
    int32_t *slot = bw_resize(ctx, p->slot, slots, sizeof *slot);
    if (!slot) return ctx->error.status;
    p->slot = slot, p->slots = slots;
    for (size_t i = 0; i < slots; i++) slot[i] = BW_NONE;
    for (size_t i = 0; i < p->count; i++) {
        size_t h = (size_t)hash_of(p->point[i].group, p->point[i].at) & (slots - 1);
        while (slot[h] != BW_NONE) h = (h + 1) & (slots - 1);
        slot[h] = (int32_t)i;
    }
    return BW_OK;
}

bw_status bw_exact_points_find(bw_context *ctx, bw_exact_points *p, int32_t group, const mpq_t x[3], int32_t *out) {
    double at[3] = {mpq_get_d(x[0]), mpq_get_d(x[1]), mpq_get_d(x[2])};
    bw_status status = 2 * p->count >= p->slots ? grow(ctx, p) : BW_OK;
    if (status == BW_OK) status = bw_reserve(ctx, &p->point, &p->room, p->count + 1);
    if (status != BW_OK) return status;
    size_t h = (size_t)hash_of(group, at) & (p->slots - 1);
    for (; p->slot[h] != BW_NONE; h = (h + 1) & (p->slots - 1))
        if (same(&p->point[p->slot[h]], group, x, at)) {
            *out = p->slot[h];
            return BW_OK;
        }
    bw_exact_point *n = &p->point[p->count];
    for (; p->ready <= p->count; p->ready++) {
        bw_exact_point *fresh = &p->point[p->ready];
        mpq_inits(fresh->x[0], fresh->x[1], fresh->x[2], NULL);
        p->held += held_by_point(fresh);
    }
    p->held -= held_by_point(n);
    for (int k = 0; k < 3; k++) mpq_set(n->x[k], x[k]), n->at[k] = at[k];
    n->group = group, n->item = BW_NONE;
    *out = p->slot[h] = (int32_t)p->count++;
    p->held += held_by_point(n);
    return bw_charge(ctx, &p->charged, p->held);
}
