#include "quantize/heuristic.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PAIRS_MAX = 20000, SWEEPS_MAX = 1000, RETRIES_MAX = 200, PRICES = 6, EXCURSIONS = 80 };

/* ---- moves ---- */

/* A basis of the solutions of the equalities, as short as pairwise steps make it: vector i is what becomes of the classes when its coefficient grows by one.
 * Lengths are taken in the norm of the objective (classes by weight), where they say what a move costs. */
typedef struct {
    size_t count, classes;
    int32_t *entry; /* [vector * classes + class] */
    int64_t *gram;  /* [vector * count + vector] inner products */
} basis;

static bw_status basis_open(bw_context *ctx, const bw_quant_model *m, basis *b) {
    size_t n = m->free_count, classes = m->class_count;
    *b = (basis){.count = n, .classes = classes};
    b->entry = bw_alloc(ctx, n * classes, sizeof *b->entry);
    b->gram = bw_alloc(ctx, n * n, sizeof *b->gram);
    if (!b->entry || !b->gram) return ctx->error.status;
    for (size_t c = 0; c < classes; c++)
        for (size_t i = m->form_begin[c]; i < m->form_begin[c + 1]; i++)
            b->entry[(size_t)m->form[i].index * classes + c] = m->form[i].factor;
    for (size_t c = 0; c < classes; c++)
        for (size_t i = m->form_begin[c]; i < m->form_begin[c + 1]; i++)
            for (size_t j = m->form_begin[c]; j < m->form_begin[c + 1]; j++)
                b->gram[(size_t)m->form[i].index * n + (size_t)m->form[j].index] +=
                    (int64_t)m->class_weight[c] * m->form[i].factor * m->form[j].factor;
    return BW_OK;
}

static void basis_close(bw_context *ctx, basis *b) {
    bw_free(ctx, b->entry);
    bw_free(ctx, b->gram);
}

/* Vector i -= times * vector j. */
static void shorten(basis *b, size_t i, size_t j, int64_t times) {
    size_t n = b->count;
    for (size_t c = 0; c < b->classes; c++) b->entry[i * b->classes + c] -= (int32_t)(times * b->entry[j * b->classes + c]);
    b->gram[i * n + i] += times * (times * b->gram[j * n + j] - 2 * b->gram[i * n + j]);
    for (size_t k = 0; k < n; k++)
        if (k != i) b->gram[k * n + i] = b->gram[i * n + k] -= times * b->gram[j * n + k];
}

/* Every step makes a vector shorter, so it ends. */
static bw_status basis_reduce(bw_context *ctx, basis *b) {
    size_t n = b->count;
    for (bool changed = true; changed;) {
        changed = false;
        if (bw_poll(ctx)) return ctx->error.status;
        for (size_t i = 0; i < n; i++)
            for (size_t j = 0; j < n; j++) {
                int64_t product = b->gram[i * n + j], square = b->gram[j * n + j];
                if (i == j || 2 * llabs(product) <= square || !square) continue;
                int64_t times = (2 * llabs(product) + square - 1) / (2 * square); /* nearest, halves towards zero */
                shorten(b, i, j, product < 0 ? -times : times);
                changed = true;
            }
    }
    return BW_OK;
}

/* Appends vector i + sign * vector j (sign 0: i alone) as a move. */
static bw_status add_move(bw_context *ctx, const basis *b, size_t i, size_t j, int32_t sign, bw_quant_moves *moves) {
    size_t k = moves->begin[moves->count];
    if (bw_reserve(ctx, &moves->term, &moves->term_room, k + b->classes)) return ctx->error.status;
    if (bw_reserve(ctx, &moves->begin, &moves->begin_room, moves->count + 2)) return ctx->error.status;
    for (size_t c = 0; c < b->classes; c++) {
        int32_t factor = b->entry[i * b->classes + c] + sign * b->entry[j * b->classes + c];
        if (factor) moves->term[k++] = (bw_quant_term){(int32_t)c, factor};
    }
    if (k > moves->begin[moves->count]) moves->begin[++moves->count] = k;
    return BW_OK;
}

static bw_status add_moves(bw_context *ctx, const basis *b, bw_quant_moves *moves) {
    size_t n = b->count, pairs = n * (n + 1), most = moves->count + PAIRS_MAX;
    bw_status status = BW_OK;
    for (size_t i = 0; i < n && status == BW_OK; i++) status = add_move(ctx, b, i, i, 0, moves);
    for (size_t i = 0; i < n && status == BW_OK && moves->count < most; i++)
        for (size_t j = i + 1; j < n && status == BW_OK; j++) {
            if (pairs > PAIRS_MAX && !b->gram[i * n + j]) continue; /* moving both is hardly more than moving each */
            int32_t sign = b->gram[i * n + j] > 0 ? -1 : 1;         /* the shorter one first */
            status = add_move(ctx, b, i, j, sign, moves);
            if (status == BW_OK) status = add_move(ctx, b, i, j, -sign, moves);
        }
    return status;
}

bw_status bw_quant_moves_init(bw_context *ctx, const bw_quant_model *m, bw_quant_moves *moves) {
    basis b;
    *moves = (bw_quant_moves){0};
    bw_status status = basis_open(ctx, m, &b);
    if (status == BW_OK) status = bw_reserve(ctx, &moves->begin, &moves->begin_room, 1);
    if (status == BW_OK) status = add_moves(ctx, &b, moves); /* the free unknowns: few classes, mostly of one sign */
    if (status == BW_OK) status = basis_reduce(ctx, &b);
    if (status == BW_OK) status = add_moves(ctx, &b, moves);
    basis_close(ctx, &b);
    if (status != BW_OK) bw_quant_moves_clear(ctx, moves);
    return status;
}

void bw_quant_moves_clear(bw_context *ctx, bw_quant_moves *moves) {
    bw_free(ctx, moves->begin);
    bw_free(ctx, moves->term);
    *moves = (bw_quant_moves){0};
}

/* ---- descent ---- */

typedef struct {
    const bw_quant_problem *p;
    int64_t *value, *activity; /* [class], [row] */
    size_t *use_begin;         /* [class + 1]: rows that have it */
    bw_quant_term *use;        /* row, factor */
    int64_t *gain;             /* [row] of the move at hand; zero between moves */
    int32_t *touched;
    size_t touched_count;
} descent;

static bw_status descent_open(bw_context *ctx, const bw_quant_problem *p, int64_t *value, descent *d) {
    const bw_constraint_list *l = &p->rows;
    size_t classes = p->model->class_count, terms = l->count ? l->begin[l->count] : 0;
    *d = (descent){.p = p, .value = value};
    d->activity = bw_alloc(ctx, l->count, sizeof *d->activity);
    d->use_begin = bw_alloc(ctx, classes + 2, sizeof *d->use_begin);
    d->use = bw_alloc(ctx, terms, sizeof *d->use);
    d->gain = bw_alloc(ctx, l->count, sizeof *d->gain);
    d->touched = bw_alloc(ctx, terms, sizeof *d->touched);
    if (!d->activity || !d->use_begin || !d->use || !d->gain || !d->touched) return ctx->error.status;
    for (size_t r = 0; r < l->count; r++) d->activity[r] = bw_constraint_value(l, r, value);
    for (size_t i = 0; i < terms; i++) d->use_begin[l->term[i].arc + 2]++;
    for (size_t c = 0; c < classes; c++) d->use_begin[c + 2] += d->use_begin[c + 1];
    for (size_t r = 0; r < l->count; r++)
        for (size_t i = l->begin[r]; i < l->begin[r + 1]; i++)
            d->use[d->use_begin[l->term[i].arc + 1]++] = (bw_quant_term){(int32_t)r, l->term[i].factor};
    return BW_OK;
}

static void descent_close(bw_context *ctx, descent *d) {
    bw_free(ctx, d->activity);
    bw_free(ctx, d->use_begin);
    bw_free(ctx, d->use);
    bw_free(ctx, d->gain);
    bw_free(ctx, d->touched);
}

/* room / slope, rounded towards zero, as a limit on the number of steps. */
static void restrict_steps(int64_t room, int64_t slope, int64_t *low, int64_t *high) {
    if (slope < 0 && room / -slope < *high) *high = room / -slope;
    if (slope > 0 && -(room / slope) > *low) *low = -(room / slope);
}

/* How often a move may be made, backwards and forwards. Leaves its effect on rows in gain[]. */
static void find_limits(descent *d, const bw_quant_term *move, size_t n, int64_t *low, int64_t *high) {
    const bw_quant_problem *p = d->p;
    *low = -((int64_t)1 << 40), *high = (int64_t)1 << 40;
    d->touched_count = 0;
    for (size_t i = 0; i < n; i++) {
        size_t c = (size_t)move[i].index;
        int64_t least = bw_quant_problem_least(p, c);
        if (least != INT64_MIN) restrict_steps(d->value[c] - least, move[i].factor, low, high);
        for (size_t u = d->use_begin[c]; u < d->use_begin[c + 1]; u++) {
            int32_t r = d->use[u].index;
            int64_t add = (int64_t)d->use[u].factor * move[i].factor;
            if (!d->gain[r] && add) d->touched[d->touched_count++] = r; /* may come twice if it was zero between */
            d->gain[r] += add;
        }
    }
    for (size_t i = 0; i < d->touched_count; i++) {
        int32_t r = d->touched[i];
        int64_t room = d->activity[r] - p->rows.bound[r];
        restrict_steps(room, d->gain[r], low, high);
        if (p->rows.relation[r] == BW_EQUAL && d->gain[r]) *low = *high = 0;
    }
}

static void forget_gains(descent *d) {
    for (size_t i = 0; i < d->touched_count; i++) d->gain[d->touched[i]] = 0;
}

static void take_steps(descent *d, const bw_quant_term *move, size_t n, int64_t steps) {
    for (size_t i = 0; i < n; i++) {
        size_t c = (size_t)move[i].index;
        d->value[c] += steps * move[i].factor;
        for (size_t u = d->use_begin[c]; u < d->use_begin[c + 1]; u++)
            d->activity[d->use[u].index] += steps * d->use[u].factor * move[i].factor;
    }
}

/* Makes a move as often as it pays; whether it did. */
static bool try_move(descent *d, const bw_quant_term *move, size_t n) {
    double curve = 0, slope = 0;
    for (size_t i = 0; i < n; i++) {
        size_t c = (size_t)move[i].index;
        double w = d->p->model->class_weight[c], f = move[i].factor;
        curve += w * f * f;
        slope += w * f * ((double)d->value[c] - d->p->target[c]);
    }
    if (curve <= 0) return false;
    int64_t steps = llround(-slope / curve), low, high;
    if (!steps) return false;
    find_limits(d, move, n, &low, &high);
    forget_gains(d);
    if (steps < low) steps = low;
    if (steps > high) steps = high;
    double k = (double)steps;
    if (!(k * (k * curve + 2 * slope) < -1e-9 * (1 + curve))) return false;
    take_steps(d, move, n, steps);
    return true;
}

bw_status bw_quant_descend(bw_context *ctx, const bw_quant_problem *p, const bw_quant_moves *moves, int64_t *value) {
    descent d;
    bw_status status = descent_open(ctx, p, value, &d);
    size_t quiet = 0; /* moves tried in a row that did not pay */
    for (int sweep = 0; sweep < SWEEPS_MAX && quiet < moves->count && status == BW_OK; sweep++) {
        status = bw_poll(ctx);
        for (size_t k = 0; k < moves->count && quiet < moves->count; k++) {
            size_t n = moves->begin[k + 1] - moves->begin[k];
            quiet = try_move(&d, moves->term + moves->begin[k], n) ? 0 : quiet + 1;
        }
    }
    descent_close(ctx, &d);
    return status;
}

/* ---- through invalid values ---- */

static double shortage(int64_t have, int64_t want, bool equal) {
    return have < want ? (double)(want - have) : equal ? (double)(have - want) : 0;
}

/* By how much values miss range and constraints, in all. */
static double all_shortage(const descent *d) {
    const bw_quant_problem *p = d->p;
    double sum = 0;
    for (size_t c = 0; c < p->model->class_count; c++) {
        int64_t least = bw_quant_problem_least(p, c);
        if (least != INT64_MIN) sum += shortage(d->value[c], least, false);
    }
    for (size_t r = 0; r < p->rows.count; r++) sum += shortage(d->activity[r], p->rows.bound[r], p->rows.relation[r] == BW_EQUAL);
    return sum;
}

/* How that changes with one step of a move. */
static double shortage_change(descent *d, const bw_quant_term *move, size_t n, int sign) {
    const bw_quant_problem *p = d->p;
    double sum = 0;
    d->touched_count = 0;
    for (size_t i = 0; i < n; i++) {
        size_t c = (size_t)move[i].index;
        int64_t least = bw_quant_problem_least(p, c), to = d->value[c] + sign * move[i].factor;
        if (least != INT64_MIN) sum += shortage(to, least, false) - shortage(d->value[c], least, false);
        for (size_t u = d->use_begin[c]; u < d->use_begin[c + 1]; u++) {
            int32_t r = d->use[u].index;
            int64_t add = (int64_t)sign * d->use[u].factor * move[i].factor;
            if (!d->gain[r] && add) d->touched[d->touched_count++] = r;
            d->gain[r] += add;
        }
    }
    for (size_t i = 0; i < d->touched_count; i++) {
        int32_t r = d->touched[i];
        bool equal = p->rows.relation[r] == BW_EQUAL;
        sum += shortage(d->activity[r] + d->gain[r], p->rows.bound[r], equal) - shortage(d->activity[r], p->rows.bound[r], equal);
        d->gain[r] = 0;
    }
    return sum;
}

static bool try_priced(descent *d, const bw_quant_term *move, size_t n, double price) {
    double curve = 0, slope = 0;
    for (size_t i = 0; i < n; i++) {
        size_t c = (size_t)move[i].index;
        double w = d->p->model->class_weight[c], f = move[i].factor;
        curve += w * f * f;
        slope += w * f * ((double)d->value[c] - d->p->target[c]);
    }
    for (int sign = -1; sign <= 1; sign += 2) {
        double change = curve + 2 * sign * slope;
        change += price * shortage_change(d, move, n, sign);
        if (!(change < -1e-9 * (1 + curve))) continue;
        take_steps(d, move, n, sign);
        return true;
    }
    return false;
}

/* Descent with missing constraints at a price. */
static bw_status descend_priced(bw_context *ctx, descent *d, const bw_quant_moves *moves, double price) {
    size_t quiet = 0;
    for (int sweep = 0; sweep < SWEEPS_MAX && quiet < moves->count; sweep++) {
        if (bw_poll(ctx)) return ctx->error.status;
        for (size_t k = 0; k < moves->count && quiet < moves->count; k++) {
            size_t n = moves->begin[k + 1] - moves->begin[k];
            quiet = try_priced(d, moves->term + moves->begin[k], n, price) ? 0 : quiet + 1;
        }
    }
    return BW_OK;
}

/* Leaves the allowed values and comes back by a price that rises until nothing is missing. */
static bw_status excursion(bw_context *ctx, const bw_quant_problem *p, const bw_quant_moves *moves, double price, int64_t *value) {
    descent d;
    bw_status status = descent_open(ctx, p, value, &d);
    for (int level = 0; level < 24 && status == BW_OK; level++, price *= 2) {
        status = descend_priced(ctx, &d, moves, price);
        if (all_shortage(&d) <= 0) break;
    }
    descent_close(ctx, &d);
    return status;
}

/* A few moves at random, from a fixed seed. */
static void kick(const bw_quant_moves *moves, uint64_t *seed, int64_t *value) {
    for (int i = 0; i < 3; i++) {
        *seed = *seed * 6364136223846793005u + 1442695040888963407u;
        size_t k = (size_t)(*seed >> 33) % moves->count;
        int sign = *seed >> 32 & 1 ? 1 : -1;
        for (size_t t = moves->begin[k]; t < moves->begin[k + 1]; t++) value[moves->term[t].index] += sign * moves->term[t].factor;
    }
}

/* How many excursions are affordable: all together look at about this many terms of moves. */
static int excursions(const bw_quant_moves *moves) {
    size_t terms = moves->begin[moves->count] + 1, most = 20000000 / terms;
    return (int)(most < PRICES ? PRICES : most > EXCURSIONS ? EXCURSIONS : most);
}

/* Excursions from allowed values at several first prices, then from kicked values; the best allowed values that any of them ends at. */
static bw_status improve(bw_context *ctx, const bw_quant_problem *p, const bw_quant_moves *moves, int64_t *value) {
    size_t n = p->model->class_count;
    int64_t *other = bw_alloc(ctx, n, sizeof *other);
    bw_status status = other ? BW_OK : ctx->error.status;
    double best = bw_quant_problem_objective(p, value), first = (double)p->model->arc_count / (double)(n ? n : 1);
    uint64_t seed = 1;
    int tries = moves->count ? excursions(moves) : 0;
    for (int k = 0; k < tries && status == BW_OK; k++) {
        memcpy(other, value, n * sizeof *value);
        if (k >= PRICES) kick(moves, &seed, other);
        status = excursion(ctx, p, moves, first * pow(4, k % PRICES - 2), other);
        if (status != BW_OK || !bw_quant_problem_allows(p, other)) continue;
        status = bw_quant_descend(ctx, p, moves, other);
        double objective = bw_quant_problem_objective(p, other);
        if (status != BW_OK || objective >= best - 1e-9 * (1 + best)) continue;
        memcpy(value, other, n * sizeof *value);
        best = objective;
    }
    bw_free(ctx, other);
    return status;
}

/* ---- start ---- */

/* Values that follow from free unknowns rounded at some enlargement. */
static void enlarge(const bw_quant_problem *p, double factor, int64_t *unknown, int64_t *value) {
    const bw_quant_model *m = p->model;
    for (size_t f = 0; f < m->free_count; f++) unknown[f] = llround(factor * ((double)m->class_length[m->free_class[f]] / m->unit));
    bw_quant_model_expand(m, unknown, value);
}

static double first_enlargement(const bw_quant_problem *p) {
    const bw_quant_model *m = p->model;
    double shortest = INFINITY;
    for (size_t c = 0; c < m->class_count; c++)
        if (m->class_weight[c]) shortest = fmin(shortest, (double)m->class_length[c] / m->unit);
    return p->scale > 0 ? p->scale : 0.25 / shortest;
}

/* The smallest of a row of enlargements that is valid. The last one is the input on its grid: all its lengths are positive and every
 * valid constraint holds for it. */
static bw_status find_start(bw_context *ctx, bw_quant_problem *p, bw_quant_oracle *oracle, int64_t *unknown, int64_t *value) {
    bool valid = false;
    for (double factor = first_enlargement(p); !valid; factor *= 1.5) {
        if (bw_poll(ctx)) return ctx->error.status;
        bool last = factor >= p->model->unit;
        enlarge(p, last ? p->model->unit : factor, unknown, value);
        if (bw_quant_problem_allows(p, value) && bw_quant_problem_separate(ctx, p, oracle, value, &valid)) return ctx->error.status;
        if (last && !valid) return bw_fail(ctx, BW_E_ALGORITHM, "the lengths of the input themselves are no valid quantization");
    }
    return BW_OK;
}

/* Descends from values that are valid until the end is valid as well. What is learnt where it is not keeps the next attempt away; it may exclude the values it
 * began at, too (constraints are sufficient, not necessary), and then others are found that are nearer to the input. */
static bw_status descend_validly(bw_context *ctx, bw_quant_problem *p, const bw_quant_moves *moves, bw_quant_oracle *oracle, bool thorough,
                                 int64_t *unknown, int64_t *next, int64_t *value) {
    size_t n = p->model->class_count;
    for (int retry = 0; retry < RETRIES_MAX; retry++) {
        bool valid;
        if (bw_poll(ctx)) return ctx->error.status;
        if (!bw_quant_problem_allows(p, value) && find_start(ctx, p, oracle, unknown, value)) return ctx->error.status;
        memcpy(next, value, n * sizeof *value);
        if (bw_quant_descend(ctx, p, moves, next)) return ctx->error.status;
        if (thorough && improve(ctx, p, moves, next)) return ctx->error.status;
        if (bw_quant_problem_separate(ctx, p, oracle, next, &valid)) return ctx->error.status;
        if (!valid) continue;
        memcpy(value, next, n * sizeof *value);
        break;
    }
    return BW_OK;
}

bw_status bw_quant_heuristic(bw_context *ctx, bw_quant_problem *p, const bw_quant_moves *moves, bw_quant_oracle *oracle,
                             bool thorough, const int64_t *start, int64_t *value) {
    size_t n = p->model->class_count;
    int64_t *first = bw_alloc(ctx, n, sizeof *first), *next = bw_alloc(ctx, n, sizeof *next);
    int64_t *unknown = bw_alloc(ctx, p->model->free_count, sizeof *unknown);
    bw_status status = first && next && unknown ? BW_OK : ctx->error.status;
    if (status == BW_OK && start) {
        memcpy(first, start, n * sizeof *value);
        memmove(value, start, n * sizeof *value);
    } else if (status == BW_OK) {
        status = find_start(ctx, p, oracle, unknown, value);
    }
    if (status == BW_OK) status = descend_validly(ctx, p, moves, oracle, thorough, unknown, next, value);
    if (status == BW_OK && start && bw_quant_problem_objective(p, first) < bw_quant_problem_objective(p, value))
        memcpy(value, first, n * sizeof *value);
    bw_free(ctx, first);
    bw_free(ctx, next);
    bw_free(ctx, unknown);
    return status;
}
