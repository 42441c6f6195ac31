#include "explore/cost.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "explore/grids.h"

enum { WEIGHT_SHIFT = 16 }; /* weights are multiples of 2^-16 */
enum { FLATTEST = 1 << 24 }; /* ratio of sides beyond which a box is as bad as can be: maps may have walls a grid unit apart, 2^45 units long */

typedef struct {
    uint64_t hash;
    int64_t cost;             /* what is a sum over boxes, weighted */
    bw_predict_errors errors; /* if bits with common entropies count */
} price;

struct bw_pricer {
    const bw_space *space;
    const bw_block_grids *grids;
    int64_t weight[BW_COST_TERMS]; /* in units of 2^-WEIGHT_SHIFT */
    bool counts, tallied, coded;   /* only blocks; bits with common entropies; bits at all */
    bw_box_layout layout;
    bw_grid_filler filler;
    bw_predictor predictor;
    bw_predict_tally all, one;
    price *list;
    size_t count, room, bytes;
    int32_t *table; /* by hash, open addressing; 0: free, else 1 + index */
    size_t table_size;
    __int128 sum; /* thousands of the worst boxes are more than 64 bits */
};

/* ---- terms --------------------------------------------------------------------------------------------------------- */

static int64_t one_each(const bw_pricer *p, const bw_block_box *box) {
    (void)p, (void)box;
    return (int64_t)1 << BW_COST_SHIFT;
}

/* Bits of the box whose errors stand in p->one, with entropies of its own. */
static int64_t bits_apart(const bw_pricer *p, const bw_block_box *box) {
    (void)box;
    return bw_predict_tally_cost(&p->one) / (int64_t)p->grids->mesh->vertex_count;
}

static int64_t longest_by_shortest(const bw_pricer *p, const bw_block_box *box) {
    int64_t low = box->extent[0], high = box->extent[0];
    (void)p;
    for (int k = 1; k < 3; k++) {
        if (box->extent[k] < low) low = box->extent[k];
        if (box->extent[k] > high) high = box->extent[k];
    }
    bool flattest = low <= 0 || high / low >= FLATTEST;
    return flattest ? (int64_t)FLATTEST << BW_COST_SHIFT : (int64_t)(((__int128)high << BW_COST_SHIFT) / low);
}

/* A term's function of a box; NULL: kept as a tally. */
static const struct {
    const char *name;
    int64_t (*of_box)(const bw_pricer *p, const bw_block_box *box);
    bool coded;
} terms[BW_COST_TERMS] = {
    [BW_COST_BLOCKS] = {"blocks", one_each, false},
    [BW_COST_BITS] = {"bits", NULL, true},
    [BW_COST_BITS_BY_BLOCK] = {"bits-by-block", bits_apart, true},
    [BW_COST_CUBES] = {"cubes", longest_by_shortest, false},
};

static int64_t weighted(int64_t weight, int64_t cost) { return (int64_t)(((__int128)weight * cost) >> WEIGHT_SHIFT); }

/* ---- a pricer ------------------------------------------------------------------------------------------------------ */

static bw_status prepare(bw_context *ctx, bw_pricer *p) {
    bw_status status = bw_reserve(ctx, &p->list, &p->room, 256);
    if (status != BW_OK || p->counts) return status;
    status = bw_box_layout_init(ctx, p->space, &p->layout);
    if (status != BW_OK || !p->coded) return status;
    const bw_hex_mesh *mesh = p->grids->mesh;
    status = bw_predictor_init(ctx, (const double (*)[3])mesh->position, mesh->vertex_count, BW_PREDICT_BITS, &p->predictor);
    if (status == BW_OK) status = bw_predict_tally_init(ctx, BW_PREDICT_BITS, &p->all);
    if (status == BW_OK) status = bw_predict_tally_init(ctx, BW_PREDICT_BITS, &p->one);
    return status;
}

bw_status bw_pricer_new(bw_context *ctx, const bw_space *space, const double weight[BW_COST_TERMS], const bw_block_grids *grids, bw_pricer **out) {
    bw_pricer *p = *out = bw_alloc(ctx, 1, sizeof *p);
    if (!p) return ctx->error.status;
    p->space = space, p->grids = grids;
    p->counts = true;
    for (int i = 0; i < BW_COST_TERMS; i++) {
        p->weight[i] = llround(weight[i] * (1 << WEIGHT_SHIFT));
        p->counts = p->counts && (i == BW_COST_BLOCKS) == (p->weight[i] != 0);
        p->coded = p->coded || (terms[i].coded && p->weight[i]);
        p->tallied = p->tallied || (!terms[i].of_box && p->weight[i]);
    }
    bw_status status = prepare(ctx, p);
    if (status == BW_OK && p->counts) { /* one price for all */
        p->list[p->count++] = (price){.cost = weighted(p->weight[BW_COST_BLOCKS], (int64_t)1 << BW_COST_SHIFT)};
    }
    if (status != BW_OK) bw_pricer_free(ctx, p), *out = NULL;
    return status;
}

static void clear_prices(bw_context *ctx, bw_pricer *p) {
    for (size_t i = 0; i < p->count; i++) bw_predict_errors_clear(ctx, &p->list[i].errors);
    p->count = p->bytes = 0;
}

void bw_pricer_free(bw_context *ctx, bw_pricer *p) {
    if (!p) return;
    clear_prices(ctx, p);
    bw_free(ctx, p->list), bw_free(ctx, p->table);
    bw_box_layout_clear(ctx, &p->layout);
    bw_grid_filler_clear(ctx, &p->filler);
    bw_predictor_clear(ctx, &p->predictor);
    bw_predict_tally_clear(ctx, &p->all), bw_predict_tally_clear(ctx, &p->one);
    bw_free(ctx, p);
}

bool bw_pricer_counts(const bw_pricer *p) { return p->counts; }
size_t bw_pricer_bytes(const bw_pricer *p) { return p->bytes + p->room * sizeof *p->list + p->table_size * sizeof *p->table; }

void bw_pricer_empty(bw_pricer *p) {
    p->sum = 0;
    if (p->tallied) bw_predict_tally_empty(&p->all);
}

void bw_pricer_forget(bw_context *ctx, bw_pricer *p) {
    bw_pricer_empty(p);
    if (p->counts) return;
    clear_prices(ctx, p);
    if (p->table) memset(p->table, 0, p->table_size * sizeof *p->table);
}

/* ---- prices -------------------------------------------------------------------------------------------------------- */

static bw_status grow_table(bw_context *ctx, bw_pricer *p) {
    size_t size = p->table_size ? 2 * p->table_size : 1024;
    int32_t *table = bw_alloc(ctx, size, sizeof *table);
    if (!table) return ctx->error.status;
    for (size_t i = 0; i < p->count; i++) {
        size_t at = p->list[i].hash & (size - 1);
        while (table[at]) at = (at + 1) & (size - 1);
        table[at] = (int32_t)i + 1;
    }
    bw_free(ctx, p->table);
    p->table = table, p->table_size = size;
    return BW_OK;
}

/* Works out what a box costs, as seen from the lowest of its blocks, so that it does not matter who asks. */
static bw_status work_out(bw_context *ctx, bw_pricer *p, const uint8_t *wall, bw_block from, price *out) {
    const bw_block_box *box = bw_box_lay_out(p->space, wall, from, &p->layout);
    bw_block lowest = from;
    for (size_t i = 0; i < box->count; i++)
        if (box->block[i] < lowest) lowest = box->block[i];
    if (lowest != from) box = bw_box_lay_out(p->space, wall, lowest, &p->layout);
    if (p->coded) {
        uint32_t n[3];
        const bw_hvertex *vertex;
        bw_status status = bw_grid_fill(ctx, p->grids, p->space, box, &p->filler, n, &vertex);
        if (status != BW_OK) return status;
        bw_predict_tally_empty(&p->one);
        bw_predict_tally_block(&p->predictor, n, vertex, &p->one);
    }
    for (int i = 0; i < BW_COST_TERMS; i++)
        if (p->weight[i] && terms[i].of_box) out->cost += weighted(p->weight[i], terms[i].of_box(p, box));
    return p->tallied ? bw_predict_errors_init(ctx, &p->one, &out->errors) : BW_OK;
}

bw_status bw_pricer_price(bw_context *ctx, bw_pricer *p, uint64_t hash, const uint8_t *wall, bw_block from, int32_t *number) {
    *number = 0;
    if (p->counts) return BW_OK;
    if (2 * (p->count + 1) > p->table_size) {
        bw_status status = grow_table(ctx, p);
        if (status != BW_OK) return status;
    }
    size_t at = hash & (p->table_size - 1);
    for (; p->table[at]; at = (at + 1) & (p->table_size - 1))
        if (p->list[p->table[at] - 1].hash == hash) {
            *number = p->table[at] - 1;
            return BW_OK;
        }
    price found = {.hash = hash};
    bw_status status = work_out(ctx, p, wall, from, &found);
    if (status == BW_OK) status = bw_reserve(ctx, &p->list, &p->room, p->count + 1);
    if (status != BW_OK) {
        bw_predict_errors_clear(ctx, &found.errors);
        return status;
    }
    p->bytes += found.errors.count * sizeof *found.errors.list;
    *number = (int32_t)p->count;
    p->list[p->count++] = found;
    p->table[at] = (int32_t)p->count;
    return BW_OK;
}

void bw_pricer_add(bw_pricer *p, int32_t number) {
    p->sum += p->list[number].cost;
    if (p->tallied) bw_predict_tally_add(&p->all, &p->list[number].errors);
}

void bw_pricer_remove(bw_pricer *p, int32_t number) {
    p->sum -= p->list[number].cost;
    if (p->tallied) bw_predict_tally_remove(&p->all, &p->list[number].errors);
}

int64_t bw_pricer_total(const bw_pricer *p) {
    const __int128 most = INT64_MAX / 4; /* a search adds to it */
    int64_t sum = (int64_t)(p->sum < most ? p->sum : most);
    if (!p->tallied) return sum;
    return sum + weighted(p->weight[BW_COST_BITS], bw_predict_tally_cost(&p->all) / (int64_t)p->grids->mesh->vertex_count);
}

/* ---- words --------------------------------------------------------------------------------------------------------- */

void bw_cost_print(const double weight[BW_COST_TERMS], char out[120]) {
    size_t used = 0;
    int only = -1, several = 0;
    for (int i = 0; i < BW_COST_TERMS; i++)
        if (weight[i] > 0) only = i, several++;
    out[0] = 0;
    if (several == 1 && weight[only] <= 1 && weight[only] >= 1) {
        snprintf(out, 120, "%s", terms[only].name);
        return;
    }
    for (int i = 0; i < BW_COST_TERMS && used < 100; i++)
        if (weight[i] > 0) used += (size_t)snprintf(out + used, 120 - used, "%s%s=%g", used ? "," : "", terms[i].name, weight[i]);
}
