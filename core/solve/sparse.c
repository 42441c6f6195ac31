#include "solve/sparse.h"

#include <stdlib.h>
#include <string.h>

#include <suitesparse/cholmod.h>

struct bw_sparse {
    cholmod_common common;
    cholmod_sparse *matrix; /* lower triangle */
    cholmod_factor *factor;
    cholmod_dense *right, *solved, *work[2];
    size_t count;
    int32_t *slot;    /* [term] its place in the matrix */
    int32_t *diagonal; /* [column] */
    size_t charged;   /* bytes of the library that count as used by the job */
};

/* The library takes memory by itself: what it holds is counted as the job's. */
static bw_status charge(bw_context *ctx, bw_sparse *s) {
    if (bw_charge(ctx, &s->charged, s->common.memory_inuse)) return ctx->error.status;
    if (s->common.status == CHOLMOD_OUT_OF_MEMORY)
        return bw_fail(ctx, BW_E_MEMORY, "no memory for a sparse factorization");
    return s->common.status < 0 ? bw_fail(ctx, BW_E_INTERNAL, "the sparse solver failed with status %d", s->common.status) : BW_OK;
}

void bw_sparse_free(bw_context *ctx, bw_sparse *s) {
    if (!s) return;
    cholmod_free_sparse(&s->matrix, &s->common);
    cholmod_free_factor(&s->factor, &s->common);
    cholmod_dense **dense[] = {&s->right, &s->solved, &s->work[0], &s->work[1]};
    for (size_t i = 0; i < sizeof dense / sizeof *dense; i++) cholmod_free_dense(dense[i], &s->common);
    cholmod_finish(&s->common);
    bw_charge(ctx, &s->charged, 0);
    bw_free(ctx, s->slot);
    bw_free(ctx, s->diagonal);
    bw_free(ctx, s);
}

typedef struct {
    int32_t row, column, term;
} entry;

static int compare_entries(const void *a, const void *b) {
    const entry *x = a, *y = b;
    if (x->column != y->column) return x->column < y->column ? -1 : 1;
    if (x->row != y->row) return x->row < y->row ? -1 : 1;
    return (x->term > y->term) - (x->term < y->term);
}

/* Merges sorted entries into compressed columns and remembers where each term went. The last n entries are the diagonal. */
static bw_status compress(bw_context *ctx, bw_sparse *s, size_t n, const entry *item, size_t items) {
    size_t filled = 0;
    for (size_t i = 0; i < items; i++) filled += i == 0 || item[i].column != item[i - 1].column || item[i].row != item[i - 1].row;
    s->matrix = cholmod_allocate_sparse(n, n, filled, 1, 1, -1, CHOLMOD_REAL, &s->common);
    if (charge(ctx, s)) return ctx->error.status;
    int *begin = s->matrix->p, *row = s->matrix->i, at = -1;
    for (size_t i = 0; i < items; i++) {
        if (i == 0 || item[i].column != item[i - 1].column || item[i].row != item[i - 1].row) {
            row[++at] = item[i].row;
            begin[item[i].column + 1] = at + 1;
        }
        if ((size_t)item[i].term < s->count) s->slot[item[i].term] = at;
        else s->diagonal[(size_t)item[i].term - s->count] = at;
    }
    begin[0] = 0; /* no column is empty: all have their diagonal */
    return BW_OK;
}

bw_status bw_sparse_new(bw_context *ctx, size_t n, size_t count, const int32_t *row, const int32_t *column, bw_sparse **out) {
    bw_sparse *s = bw_alloc(ctx, 1, sizeof *s);
    *out = s;
    if (!s) return ctx->error.status;
    cholmod_start(&s->common);
    s->common.supernodal = CHOLMOD_SIMPLICIAL;
    /* What costs fewer operations is taken: on large volumes nested dissection, by a factor of three. */
    s->common.nmethods = 2, s->common.method[0].ordering = CHOLMOD_AMD, s->common.method[1].ordering = CHOLMOD_METIS;
    s->common.final_ll = 0;
    s->common.print = 0;
    s->count = count;
    s->slot = bw_alloc(ctx, count, sizeof *s->slot);
    s->diagonal = bw_alloc(ctx, n, sizeof *s->diagonal);
    entry *item = bw_alloc(ctx, count + n, sizeof *item);
    bw_status status = ctx->error.status;
    if (status == BW_OK) {
        for (size_t i = 0; i < count; i++)
            item[i] = row[i] >= column[i] ? (entry){row[i], column[i], (int32_t)i} : (entry){column[i], row[i], (int32_t)i};
        for (size_t i = 0; i < n; i++) item[count + i] = (entry){(int32_t)i, (int32_t)i, (int32_t)(count + i)};
        qsort(item, count + n, sizeof *item, compare_entries);
        status = compress(ctx, s, n, item, count + n);
    }
    bw_free(ctx, item);
    if (status == BW_OK) {
        s->factor = cholmod_analyze(s->matrix, &s->common);
        s->right = cholmod_allocate_dense(n, 1, n, CHOLMOD_REAL, &s->common);
        status = charge(ctx, s);
    }
    if (status == BW_OK) return BW_OK;
    bw_sparse_free(ctx, s);
    *out = NULL;
    return status;
}

bw_status bw_sparse_factor(bw_context *ctx, bw_sparse *s, const double *value, double shift, bool *definite) {
    double *x = s->matrix->x;
    size_t n = s->matrix->ncol;
    memset(x, 0, s->matrix->nzmax * sizeof *x);
    for (size_t i = 0; i < s->count; i++) x[s->slot[i]] += value[i];
    for (size_t i = 0; i < n; i++) x[s->diagonal[i]] += shift;
    cholmod_factorize(s->matrix, s->factor, &s->common);
    *definite = s->common.status == CHOLMOD_OK && s->factor->minor == n;
    if (s->common.status == CHOLMOD_NOT_POSDEF) s->common.status = CHOLMOD_OK;
    /* LDL' also factors indefinite matrices: the pivots tell */
    if (*definite && !s->factor->is_ll) {
        const int *p = s->factor->p;
        const double *l = s->factor->x;
        for (size_t i = 0; i < n; i++) *definite = *definite && l[p[i]] > 0;
    }
    return charge(ctx, s);
}

bw_status bw_sparse_solve(bw_context *ctx, bw_sparse *s, const double *b, double *x) {
    size_t n = s->matrix->ncol;
    memcpy(s->right->x, b, n * sizeof *b);
    cholmod_solve2(CHOLMOD_A, s->factor, s->right, NULL, &s->solved, NULL, &s->work[0], &s->work[1], &s->common);
    if (charge(ctx, s)) return ctx->error.status;
    memcpy(x, s->solved->x, n * sizeof *x);
    return BW_OK;
}
