#include "hex/plan.h"

#include <string.h>

void bw_hex_plan_clear(bw_context *ctx, bw_hex_plan *plan) {
    if (plan->verifier.ctx) bw_verify_close(&plan->verifier);
    bw_free(ctx, plan->size);
    bw_free(ctx, plan->square_begin);
    bw_free(ctx, plan->square);
    memset(plan, 0, sizeof *plan);
}

/* A contact as its first (slot 0) or second block sees it. Coordinates and shifts times `unit`. */
static bw_plan_square square_of(const bw_contact *c, int slot, int64_t unit) {
    bw_plan_square s = {.to = c->chart, .block = c->block[!slot], .patch = c->patch};
    int64_t low[3], high[3];
    memcpy(low, c->low, sizeof low), memcpy(high, c->high, sizeof high);
    if (slot) {
        bw_transition_apply(&c->chart, low, low), bw_transition_apply(&c->chart, high, high);
        s.to = bw_transition_inverse(&c->chart);
    }
    for (int k = 0; k < 3; k++) {
        s.low[k] = unit * (low[k] < high[k] ? low[k] : high[k]);
        s.high[k] = unit * (low[k] < high[k] ? high[k] : low[k]);
        s.to.shift[k] *= unit;
    }
    return s;
}

static bw_status list_squares(bw_context *ctx, bw_hex_plan *plan) {
    const bw_verifier *v = &plan->verifier;
    size_t sides = 6 * v->x->block_count;
    plan->square_begin = bw_alloc(ctx, sides + 2, sizeof *plan->square_begin);
    plan->square = bw_alloc(ctx, 2 * v->contact_count, sizeof *plan->square);
    if (!plan->square_begin || !plan->square) return ctx->error.status;
    for (int fill = 0; fill < 2; fill++) {
        for (size_t i = 0; i < v->contact_count; i++)
            for (int slot = 0; slot < 2; slot++) {
                const bw_contact *c = &v->contact[i];
                if (c->block[slot] == BW_NONE) continue;
                size_t side = 6 * (size_t)c->block[slot] + c->side[slot];
                if (fill) plan->square[plan->square_begin[side + 1]++] = square_of(c, slot, 2 * (int64_t)plan->subdivide);
                else plan->square_begin[side + 2]++;
            }
        for (size_t s = 2; s < sides + 2 && !fill; s++) plan->square_begin[s] += plan->square_begin[s - 1];
    }
    return BW_OK;
}

bw_status bw_hex_plan_limit(bw_context *ctx, uint64_t hexes, int32_t subdivide, uint64_t max_hexes) {
    __int128 all = (__int128)hexes * subdivide * subdivide * subdivide;
    if (all <= (__int128)max_hexes) return BW_OK;
    unsigned long long told = all > UINT64_MAX ? UINT64_MAX : (unsigned long long)all;
    return bw_fail(ctx, BW_E_LIMIT, "the hex mesh would have %llu hexes, more than %llu", told, (unsigned long long)max_hexes);
}

bw_status bw_hex_plan_init(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const int64_t *length, int32_t subdivide, bw_hex_plan *plan) {
    memset(plan, 0, sizeof *plan);
    plan->subdivide = subdivide;
    bw_status status = bw_verify_open(ctx, cells, complex, length, &plan->verdict, &plan->verifier);
    if (status == BW_OK && plan->verdict.fault != BW_VALID)
        status = bw_fail(ctx, BW_E_CHECK, "the quantization is not valid (%s): %s", bw_fault_name(plan->verdict.fault), plan->verdict.message);
    if (status == BW_OK && !(plan->size = bw_alloc(ctx, complex->block_count, sizeof *plan->size))) status = ctx->error.status;
    if (status != BW_OK) return status;
    for (size_t b = 0; b < complex->block_count; b++) {
        __int128 n = 1;
        for (int k = 0; k < 3; k++) {
            plan->size[b][k] = 2 * (int64_t)subdivide * plan->verifier.extent[b][k];
            n *= plan->size[b][k] / 2;
        }
        if (n > UINT32_MAX || plan->cubes + (uint64_t)n > UINT32_MAX) return bw_fail(ctx, BW_E_LIMIT, "the quantization has more hexes than can be numbered");
        plan->cubes += (uint64_t)n;
    }
    return list_squares(ctx, plan);
}

/* The square of a side in which a point of it lies; NULL if none. */
static const bw_plan_square *square_at(const bw_hex_plan *plan, bw_block block, int side, const int64_t p[3]) {
    size_t s = 6 * (size_t)block + (size_t)side;
    int u = (side / 2 + 1) % 3, v = (side / 2 + 2) % 3;
    for (size_t i = plan->square_begin[s]; i < plan->square_begin[s + 1]; i++) {
        const bw_plan_square *q = &plan->square[i];
        if (q->low[u] < p[u] && p[u] < q->high[u] && q->low[v] < p[v] && p[v] < q->high[v]) return q;
    }
    return NULL;
}

bw_plan_step bw_hex_plan_step(const bw_hex_plan *plan, const bw_plan_cube *from, int face, bw_plan_cube *to, bw_patch *patch) {
    int axis = bw_rotation_image[from->turn][face / 2];
    int sense = (face & 1 ? 1 : -1) * bw_rotation_sign[from->turn][axis];
    *to = *from;
    to->centre[axis] += 2 * sense;
    int64_t at = to->centre[axis], door[3];
    if (at > 0 && at < plan->size[to->block][axis]) return BW_PLAN_CUBE;
    memcpy(door, from->centre, sizeof door);
    door[axis] += sense;
    for (size_t steps = 0; steps <= 6 * plan->verifier.x->block_count; steps++) {
        const bw_plan_square *q = square_at(plan, to->block, 2 * axis + (sense > 0), door);
        if (!q) return BW_PLAN_NOTHING;
        if (q->block == BW_NONE) {
            *patch = q->patch;
            return BW_PLAN_OUTSIDE;
        }
        bw_transition_apply(&q->to, door, door);
        bw_transition_apply(&q->to, to->centre, to->centre);
        int next = bw_rotation_image[q->to.rotation][axis];
        sense *= bw_rotation_sign[q->to.rotation][next];
        axis = next;
        to->turn = bw_rotation_compose(q->to.rotation, to->turn);
        to->block = q->block;
        if (!plan->size[to->block][axis]) continue;
        for (int k = 0; k < 3; k++)
            if (to->centre[k] <= 0 || to->centre[k] >= plan->size[to->block][k]) return BW_PLAN_NOTHING;
        return BW_PLAN_CUBE;
    }
    return BW_PLAN_NOTHING;
}
