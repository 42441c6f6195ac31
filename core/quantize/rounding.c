#include "quantize/rounding.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Rows are integer forms on the free unknowns of the model. */
struct bw_rounding {
    bw_context *ctx;
    bw_validity *validity;
    const bw_quant_model *model;
    size_t unknowns, rows, classical; /* the first `classical` rows are those of the map, the others the unknowns themselves */
    int64_t *form;    /* [row * unknowns + unknown] */
    double *factor;   /* [unknown * unknowns + unknown]: lower triangle whose square are the weights */
    double *slope;    /* [row * unknowns + i]: form in coordinates in which the objective is a plain square */
    /* of a run: unknown = base + sum over i < left of basis[i] * integer */
    int64_t *base;    /* [unknown] */
    int64_t *basis;   /* [unknown * unknowns + i] */
    int64_t *reach;   /* [row * unknowns + i]: what the row takes from basis i */
    double *residual; /* [row * unknowns + i] slope less what is fixed */
    double *value;    /* [row] */
    int64_t *class_value;
};

/* ---- the integers of a map ---- */

typedef struct {
    bw_rounding *r;
    const bw_surface *s;
    const bw_critical *c;
    bw_rotation *turn;      /* [block] from its chart to that of the whole */
    int64_t (*origin)[3];   /* [block] for the lengths at hand: of its chart, in that of the whole */
    int32_t *parent;        /* [block] the slot by which it was reached; BW_NONE: root */
    bw_block *order;        /* blocks as they were reached */
    size_t reached;
    int64_t (*at)[3];       /* [point] for the lengths at hand */
    int64_t *length, *unknown; /* the lengths at hand */
    int32_t root;           /* the point that is the whole chart's origin */
    int64_t *out;           /* values of all rows for the lengths at hand; NULL: they are only counted */
    size_t count;
} survey;

static void place_in_whole(const survey *v, int32_t point, int64_t out[3]) {
    bw_block b = v->s->point[point].block;
    bw_rotate(v->turn[b], v->at[point], out);
    for (int k = 0; k < 3; k++) out[k] += v->origin[b][k];
}

/* A spanning tree of the blocks; where the complex has several parts, one of each. */
static void grow_tree(survey *v) {
    const bw_complex *x = v->s->complex;
    for (size_t b = 0; b < x->block_count; b++) v->parent[b] = BW_NONE - 1;
    for (size_t start = 0; start <= x->block_count; start++) {
        bw_block root = start ? (bw_block)start - 1 : v->s->point[v->root].block;
        if (v->parent[root] != BW_NONE - 1) continue;
        v->parent[root] = BW_NONE;
        v->order[v->reached++] = root;
        for (size_t i = v->reached - 1; i < v->reached; i++) {
            bw_block b = v->order[i];
            for (size_t k = v->s->slot_begin[b]; k < v->s->slot_begin[b + 1]; k++) {
                int32_t slot = v->s->slot[k];
                bw_block next = bw_surface_slot_block(v->s, slot ^ 1);
                if (next == BW_NONE || v->parent[next] != BW_NONE - 1) continue;
                bw_transition back = bw_surface_cross(v->s, slot ^ 1);
                v->parent[next] = slot ^ 1;
                v->turn[next] = bw_rotation_compose(v->turn[b], back.rotation);
                v->order[v->reached++] = next;
            }
        }
    }
}

/* Where all charts are in the whole for the lengths at hand. */
static void place_blocks(survey *v) {
    bw_surface_lay_out(v->s, v->length, v->at);
    for (size_t i = 0; i < v->reached; i++) {
        bw_block b = v->order[i];
        int64_t here[3], there[3] = {0, 0, 0};
        int32_t point = (int32_t)v->s->point_begin[b];
        memset(v->origin[b], 0, sizeof v->origin[b]);
        if (v->parent[b] != BW_NONE) {
            int32_t rim = bw_surface_first_rim(v->s, v->parent[b]);
            point = v->s->rim_point[rim];
            place_in_whole(v, v->s->rim_point[rim ^ 1], there);
        } else if (b == v->s->point[v->root].block) {
            point = v->root;
        }
        place_in_whole(v, point, here);
        for (int k = 0; k < 3; k++) v->origin[b][k] = there[k] - here[k];
    }
}

static void give(survey *v, int64_t value) {
    if (v->out) v->out[v->count] = value;
    v->count++;
}

/* Coordinates of links and regions across them, and of feature vertices that are on none. */
static void give_alignments(survey *v) {
    const bw_complex *x = v->s->complex;
    int64_t at[3];
    for (size_t a = 0; a < x->arc_count; a++) {
        if (v->c->arc_link[a] == BW_NONE) continue;
        const bw_surface_edge *e = &v->s->edge[v->c->arc_edge[a]];
        place_in_whole(v, e->point[0], at);
        int along = bw_rotation_image[v->turn[v->s->point[e->point[0]].block]][e->axis];
        give(v, at[(along + 1) % 3]), give(v, at[(along + 2) % 3]);
    }
    for (size_t p = 0; p < x->patch_count; p++) {
        if (v->c->patch_region[p] == BW_NONE) continue;
        place_in_whole(v, v->s->slot_corner[2 * p][0], at);
        give(v, at[bw_rotation_image[v->turn[x->patch_block[p][0]]][x->patch_side[p][0] >> 1]]);
    }
    for (size_t i = 0; i < v->s->point_count; i++) {
        if (!(x->node_flags[v->s->point[i].node] & BW_NODE_FEATURE)) continue;
        place_in_whole(v, (int32_t)i, at);
        for (int k = 0; k < 3; k++) give(v, at[k]);
    }
}

/* Translations of the transitions across the patches between blocks that are not neighbours in the tree. */
static void give_translations(survey *v) {
    const bw_complex *x = v->s->complex;
    for (size_t p = 0; p < x->patch_count; p++) {
        int32_t slot = 2 * (int32_t)p;
        bw_block a = x->patch_block[p][0], b = x->patch_block[p][1];
        if (b == BW_NONE || v->parent[a] == slot || v->parent[b] == slot + 1) continue;
        int64_t here[3], there[3];
        int32_t rim = bw_surface_first_rim(v->s, slot);
        place_in_whole(v, v->s->rim_point[rim], here);
        place_in_whole(v, v->s->rim_point[rim ^ 1], there);
        bw_rotation turn = bw_rotation_compose(bw_surface_cross(v->s, slot).rotation, bw_rotation_inverse(v->turn[a]));
        bw_rotate(bw_rotation_compose(v->turn[b], turn), here, here);
        for (int k = 0; k < 3; k++) give(v, there[k] - here[k]);
    }
}

static void give_all(survey *v, int64_t *out) {
    v->out = out, v->count = 0;
    give_alignments(v);
    give_translations(v);
}

/* The values of all rows for each unknown alone are their forms. */
static bw_status find_forms(survey *v) {
    bw_rounding *r = v->r;
    size_t n = r->unknowns;
    for (size_t f = 0; f < n; f++) {
        memset(v->unknown, 0, n * sizeof *v->unknown);
        v->unknown[f] = 1;
        bw_quant_model_expand(r->model, v->unknown, r->class_value);
        bw_quant_model_lengths(r->model, r->class_value, v->length);
        place_blocks(v);
        if (f == 0) {
            give_all(v, NULL);
            r->classical = v->count, r->rows = v->count + n;
            r->form = bw_alloc(r->ctx, r->rows * n, sizeof *r->form);
            v->out = bw_alloc(r->ctx, r->rows, sizeof *v->out);
            if (!r->form || !v->out) {
                bw_free(r->ctx, v->out);
                return r->ctx->error.status;
            }
        }
        int64_t *column = v->out;
        give_all(v, column);
        for (size_t i = 0; i < r->classical; i++) r->form[i * n + f] = column[i];
        r->form[(r->classical + f) * n + f] = 1;
    }
    bw_free(r->ctx, v->out);
    return BW_OK;
}

/* Forms that differ in their sign only, or are zero, once. */
static int compare_forms(const void *a, const void *b, void *size) { return memcmp(a, b, *(const size_t *)size); }

static void drop_equal_forms(bw_rounding *r) {
    size_t n = r->unknowns, bytes = n * sizeof *r->form, kept = 0;
    for (size_t i = 0; i < r->classical; i++) {
        int64_t *form = &r->form[i * n];
        size_t f = 0;
        while (f < n && !form[f]) f++;
        for (size_t k = f; k < n && form[f] < 0; k++) form[k] = k == f ? form[k] : -form[k];
        if (f < n && form[f] < 0) form[f] = -form[f];
    }
    qsort_r(r->form, r->classical, bytes, compare_forms, &bytes);
    for (size_t i = 0; i < r->classical; i++) {
        const int64_t *form = &r->form[i * n];
        bool zero = true;
        for (size_t f = 0; f < n && zero; f++) zero = !form[f];
        if (zero || (kept && !memcmp(form, form - n, bytes) && i > 0)) continue;
        memmove(&r->form[kept++ * n], form, bytes);
    }
    memmove(&r->form[kept * n], &r->form[r->classical * n], n * bytes);
    r->rows -= r->classical - kept, r->classical = kept;
}

static bw_status find_integers(bw_rounding *r) {
    const bw_surface *s = bw_validity_surface(r->validity);
    const bw_complex *x = s->complex;
    survey v = {.r = r, .s = s, .c = bw_validity_critical(r->validity)};
    v.turn = bw_alloc(r->ctx, x->block_count, sizeof *v.turn);
    v.origin = bw_alloc(r->ctx, x->block_count, sizeof *v.origin);
    v.parent = bw_alloc(r->ctx, x->block_count, sizeof *v.parent);
    v.order = bw_alloc(r->ctx, x->block_count, sizeof *v.order);
    v.at = bw_alloc(r->ctx, s->point_count, sizeof *v.at);
    v.length = bw_alloc(r->ctx, x->arc_count, sizeof *v.length);
    v.unknown = bw_alloc(r->ctx, r->unknowns, sizeof *v.unknown);
    bw_status status = r->ctx->error.status;
    if (status == BW_OK) {
        while (v.root + 1 < (int32_t)s->point_count && !v.c->node[s->point[v.root].node]) v.root++;
        if (!v.c->node[s->point[v.root].node]) v.root = 0;
        grow_tree(&v);
        status = find_forms(&v);
    }
    if (status == BW_OK) drop_equal_forms(r);
    void *blocks[] = {v.turn, v.origin, v.parent, v.order, v.at, v.length, v.unknown};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(r->ctx, blocks[i]);
    return status;
}

/* ---- the objective ---- */

/* Cholesky factor of the sum over classes of weight * form * form. */
static bw_status factorize(bw_rounding *r) {
    const bw_quant_model *m = r->model;
    size_t n = r->unknowns;
    double *f = r->factor;
    for (size_t c = 0; c < m->class_count; c++)
        for (size_t i = m->form_begin[c]; i < m->form_begin[c + 1]; i++)
            for (size_t j = m->form_begin[c]; j < m->form_begin[c + 1]; j++)
                f[(size_t)m->form[i].index * n + (size_t)m->form[j].index] += (double)m->class_weight[c] * m->form[i].factor * m->form[j].factor;
    for (size_t j = 0; j < n; j++) {
        for (size_t k = 0; k < j; k++) f[j * n + j] -= f[j * n + k] * f[j * n + k];
        if (f[j * n + j] <= 0) return bw_fail(r->ctx, BW_E_CHECK, "unknown %zu of the quantization is in no arc", j);
        f[j * n + j] = sqrt(f[j * n + j]);
        for (size_t i = j + 1; i < n; i++) {
            for (size_t k = 0; k < j; k++) f[i * n + j] -= f[i * n + k] * f[j * n + k];
            f[i * n + j] /= f[j * n + j];
        }
    }
    return BW_OK;
}

static void find_slopes(bw_rounding *r) {
    size_t n = r->unknowns;
    for (size_t row = 0; row < r->rows; row++)
        for (size_t i = 0; i < n; i++) {
            double sum = (double)r->form[row * n + i];
            for (size_t k = 0; k < i; k++) sum -= r->factor[i * n + k] * r->slope[row * n + k];
            r->slope[row * n + i] = sum / r->factor[i * n + i];
        }
}

bw_status bw_rounding_new(bw_context *ctx, bw_validity *validity, const bw_quant_model *model, bw_rounding **out) {
    bw_rounding *r = *out = bw_alloc(ctx, 1, sizeof *r);
    if (!r) return ctx->error.status;
    size_t n = model->free_count;
    *r = (bw_rounding){.ctx = ctx, .validity = validity, .model = model, .unknowns = n};
    r->factor = bw_alloc(ctx, n * n, sizeof *r->factor);
    r->base = bw_alloc(ctx, n, sizeof *r->base);
    r->basis = bw_alloc(ctx, n * n, sizeof *r->basis);
    r->class_value = bw_alloc(ctx, model->class_count, sizeof *r->class_value);
    bw_status status = ctx->error.status;
    if (status == BW_OK) status = find_integers(r);
    if (status == BW_OK) status = factorize(r);
    r->slope = bw_alloc(ctx, r->rows * n, sizeof *r->slope);
    r->residual = bw_alloc(ctx, r->rows * n, sizeof *r->residual);
    r->reach = bw_alloc(ctx, r->rows * n, sizeof *r->reach);
    r->value = bw_alloc(ctx, r->rows, sizeof *r->value);
    if (status == BW_OK) status = ctx->error.status;
    if (status == BW_OK) {
        find_slopes(r);
        return BW_OK;
    }
    bw_rounding_free(ctx, r);
    *out = NULL;
    return status;
}

void bw_rounding_free(bw_context *ctx, bw_rounding *r) {
    if (!r) return;
    void *blocks[] = {r->form, r->factor, r->slope, r->base, r->basis, r->reach, r->residual, r->value, r->class_value, r};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
}

/* ---- rounding ---- */

static void start(bw_rounding *r, double scale) {
    const bw_quant_model *m = r->model;
    size_t n = r->unknowns;
    memset(r->base, 0, n * sizeof *r->base);
    memset(r->basis, 0, n * n * sizeof *r->basis);
    for (size_t f = 0; f < n; f++) r->basis[f * n + f] = 1;
    memcpy(r->reach, r->form, r->rows * n * sizeof *r->reach);
    memcpy(r->residual, r->slope, r->rows * n * sizeof *r->residual);
    for (size_t row = 0; row < r->rows; row++) {
        r->value[row] = 0;
        for (size_t f = 0; f < n; f++)
            r->value[row] += (double)r->form[row * n + f] * scale * ((double)m->class_length[m->free_class[f]] / m->unit);
    }
}

static int64_t gcd(int64_t a, int64_t b) {
    while (b) {
        int64_t rest = a % b;
        a = b, b = rest;
    }
    return a < 0 ? -a : a;
}

/* Greatest common divisor of what a row takes from the directions that are left: the distance between the values it may have; 0: it has no choice. */
static int64_t stride_of(const bw_rounding *r, size_t row, size_t left) {
    int64_t g = 0;
    for (size_t i = 0; i < left && g != 1; i++) g = gcd(g, r->reach[row * r->unknowns + i]);
    return g;
}

static int64_t settled_part(const bw_rounding *r, size_t row) {
    int64_t sum = 0;
    for (size_t f = 0; f < r->unknowns; f++) sum += r->form[row * r->unknowns + f] * r->base[f];
    return sum;
}

/* The value next to a row's that it may have. */
static int64_t round_row(const bw_rounding *r, size_t row, int64_t stride) {
    int64_t settled = settled_part(r, row);
    return settled + stride * (int64_t)floor((r->value[row] - (double)settled) / (double)stride + 0.5);
}

/* The row nearest to a value that it may have; r->rows if none has a choice. */
static size_t nearest(const bw_rounding *r, size_t left, int64_t *stride, int64_t *value) {
    size_t best = r->rows;
    double least = INFINITY;
    for (size_t row = 0; row < r->rows; row++) {
        if (row == r->classical && best < r->rows) break; /* the rest only when the map has no choice any more */
        int64_t g = stride_of(r, row, left);
        if (!g) continue;
        int64_t to = round_row(r, row, g);
        double away = fabs(r->value[row] - (double)to);
        if (away >= least) continue;
        best = row, least = away, *stride = g, *value = to;
    }
    return best;
}

/* Direction i less `times` direction j, in the basis and in all rows. */
static bool subtract(int64_t *matrix, size_t rows, size_t n, size_t i, size_t j, int64_t times) {
    for (size_t row = 0; row < rows; row++) {
        int64_t product;
        if (__builtin_mul_overflow(times, matrix[row * n + j], &product) ||
            __builtin_sub_overflow(matrix[row * n + i], product, &matrix[row * n + i]))
            return false;
    }
    return true;
}

static void swap_directions(int64_t *matrix, size_t rows, size_t n, size_t i, size_t j) {
    for (size_t row = 0; row < rows; row++) {
        int64_t keep = matrix[row * n + i];
        matrix[row * n + i] = matrix[row * n + j], matrix[row * n + j] = keep;
    }
}

/* Changes the directions so that only the last of those left has a part in the row, by Euclid's algorithm: the lattice stays the same. */
static bw_status gather(bw_rounding *r, size_t row, size_t left) {
    size_t n = r->unknowns, last = left - 1;
    const int64_t *reach = &r->reach[row * n];
    for (;;) {
        size_t least = n, others = 0;
        for (size_t i = 0; i < left; i++) {
            if (!reach[i]) continue;
            others++;
            if (least == n || llabs(reach[i]) < llabs(reach[least])) least = i;
        }
        if (least != last) {
            swap_directions(r->basis, n, n, least, last);
            swap_directions(r->reach, r->rows, n, least, last);
        }
        if (others == 1) return BW_OK;
        for (size_t i = 0; i < last; i++) {
            int64_t times = reach[i] / reach[last];
            if (times && !(subtract(r->basis, n, n, i, last, times) && subtract(r->reach, r->rows, n, i, last, times)))
                return bw_fail(r->ctx, BW_E_RANGE, "numbers of the rounding grow too large");
        }
    }
}

/* Moves all rows to where the objective is least with `row` at a value from now on. */
static void relax(bw_rounding *r, size_t row, double by) {
    size_t n = r->unknowns;
    double square = 0, *fixed = &r->residual[row * n];
    for (size_t i = 0; i < n; i++) square += fixed[i] * fixed[i];
    for (size_t other = 0; other < r->rows; other++) {
        double *slope = &r->residual[other * n], product = 0;
        if (other == row) continue;
        for (size_t i = 0; i < n; i++) product += slope[i] * fixed[i];
        if (product == 0) continue;
        product /= square;
        r->value[other] += by * product;
        for (size_t i = 0; i < n; i++) slope[i] -= product * fixed[i];
    }
    r->value[row] += by;
    memset(fixed, 0, n * sizeof *fixed);
}

static bw_status round_all(bw_rounding *r, size_t *integers) {
    size_t n = r->unknowns;
    *integers = 0;
    for (size_t left = n; left > 0; left--) {
        int64_t stride = 0, value = 0;
        size_t row = nearest(r, left, &stride, &value);
        *integers += row < r->classical;
        bw_status status = gather(r, row, left);
        if (status != BW_OK) return status;
        int64_t steps = (value - settled_part(r, row)) / r->reach[row * n + left - 1];
        for (size_t f = 0; f < n; f++) r->base[f] += steps * r->basis[f * n + left - 1];
        relax(r, row, (double)value - r->value[row]);
        status = bw_poll(r->ctx);
        if (status != BW_OK) return status;
    }
    return BW_OK;
}

static double objective_of(const bw_quant_model *m, const int64_t *class_value, double scale) {
    double sum = 0;
    for (size_t c = 0; c < m->class_count; c++) {
        double away = (double)class_value[c] - scale * ((double)m->class_length[c] / m->unit);
        sum += m->class_weight[c] * away * away;
    }
    return sum;
}

bw_status bw_rounding_run(bw_rounding *r, double scale, int64_t *length, bw_rounding_result *result) {
    bw_constraint_list broken = {0};
    *result = (bw_rounding_result){.scale = scale};
    start(r, scale);
    bw_status status = round_all(r, &result->integers);
    if (status != BW_OK) return status;
    bw_quant_model_expand(r->model, r->base, r->class_value);
    bw_quant_model_lengths(r->model, r->class_value, length);
    result->objective = objective_of(r->model, r->class_value, scale);
    status = bw_validity_separate(r->validity, length, &broken);
    for (size_t c = 0; c < broken.count; c++) result->broken[broken.rule[c]]++;
    result->conflicts = broken.count;
    result->valid = status == BW_OK && !broken.count;
    if (result->valid) result->hexes = (uint64_t)bw_quant_model_hexes(r->model, r->class_value);
    bw_constraint_clear(r->ctx, &broken);
    return status;
}

bw_status bw_rounding_coarsest(bw_rounding *r, int steps, int64_t *length, bw_rounding_result *result) {
    const bw_quant_model *m = r->model;
    int64_t shortest = INT64_MAX;
    for (size_t c = 0; c < m->class_count; c++)
        if (m->class_weight[c] && m->class_length[c] < shortest) shortest = m->class_length[c];
    double low = 0, high = 0, longest = 1e-9;
    for (size_t c = 0; c < m->class_count; c++) longest = fmax(longest, (double)m->class_length[c] / m->unit);
    bw_status status = BW_OK;
    *result = (bw_rounding_result){0};
    for (high = 0.5 / longest; status == BW_OK && !result->valid && high <= 1024 * m->unit / (double)shortest; high *= 2) {
        low = high / 2;
        status = bw_rounding_run(r, high, length, result);
    }
    if (status != BW_OK || !result->valid) return status;
    high /= 2;
    bw_rounding_result tried;
    for (int i = 0; i < steps && status == BW_OK; i++) {
        double mid = (low + high) / 2;
        status = bw_rounding_run(r, mid, length, &tried);
        if (tried.valid) high = mid, *result = tried;
        else low = mid;
    }
    return status == BW_OK ? bw_rounding_run(r, result->scale, length, result) : status;
}
