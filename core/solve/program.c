#include "solve/program.h"

#include <math.h>
#include <string.h>

/* The library's header is not free of the warnings that are errors here. */
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wstrict-prototypes"
#include <Clp_C_Interface.h>
#pragma GCC diagnostic pop

struct bw_program {
    Clp_Simplex *model;
    uint8_t *integer;
    size_t columns, integer_room;
    double *row_lower, *row_upper, *factor; /* rows not handed over yet: many small additions are slow */
    int *row_begin, *row_column;
    size_t row_lower_room, row_upper_room, factor_room, row_begin_room, row_column_room;
    size_t pending, pending_terms;
    bool fresh; /* never solved */
};

bw_status bw_program_new(bw_context *ctx, bw_program **out) {
    *out = NULL;
    bw_program *p = bw_alloc(ctx, 1, sizeof *p);
    if (!p) return ctx->error.status;
    p->model = Clp_newModel();
    if (!p->model) {
        bw_free(ctx, p);
        return bw_fail(ctx, BW_E_MEMORY, "no memory for a linear program");
    }
    Clp_setLogLevel(p->model, 0);
    Clp_setPerturbation(p->model, 100); /* never: values stay those of the program as stated */
    Clp_setPrimalTolerance(p->model, 1e-8);
    Clp_setDualTolerance(p->model, 1e-8);
    p->fresh = true;
    *out = p;
    return BW_OK;
}

void bw_program_free(bw_context *ctx, bw_program *p) {
    if (!p) return;
    Clp_deleteModel(p->model);
    bw_free(ctx, p->integer);
    bw_free(ctx, p->row_lower);
    bw_free(ctx, p->row_upper);
    bw_free(ctx, p->factor);
    bw_free(ctx, p->row_begin);
    bw_free(ctx, p->row_column);
    bw_free(ctx, p);
}

bw_status bw_program_add_column(bw_context *ctx, bw_program *p, double lower, double upper, double cost, bool integer) {
    if (bw_reserve(ctx, &p->integer, &p->integer_room, p->columns + 1)) return ctx->error.status;
    const CoinBigIndex starts[2] = {0, 0};
    Clp_addColumns(p->model, 1, &lower, &upper, &cost, starts, NULL, NULL);
    p->integer[p->columns++] = integer;
    return BW_OK;
}

bw_status bw_program_add_row(bw_context *ctx, bw_program *p, size_t n, const int *column, const double *factor, double lower,
                             double upper) {
    size_t r = p->pending, t = p->pending_terms;
    if (bw_reserve(ctx, &p->row_lower, &p->row_lower_room, r + 1)) return ctx->error.status;
    if (bw_reserve(ctx, &p->row_upper, &p->row_upper_room, r + 1)) return ctx->error.status;
    if (bw_reserve(ctx, &p->row_begin, &p->row_begin_room, r + 2)) return ctx->error.status;
    if (bw_reserve(ctx, &p->row_column, &p->row_column_room, t + n + 1)) return ctx->error.status;
    if (bw_reserve(ctx, &p->factor, &p->factor_room, t + n + 1)) return ctx->error.status;
    p->row_lower[r] = lower, p->row_upper[r] = upper;
    memcpy(p->row_column + t, column, n * sizeof *column);
    memcpy(p->factor + t, factor, n * sizeof *factor);
    p->row_begin[0] = 0;
    p->row_begin[r + 1] = (int)(t + n);
    p->pending = r + 1, p->pending_terms = t + n;
    return BW_OK;
}

static void hand_over(bw_program *p) {
    if (p->pending)
        Clp_addRows(p->model, (int)p->pending, p->row_lower, p->row_upper, p->row_begin, p->row_column, p->factor);
    p->pending = p->pending_terms = 0;
}

size_t bw_program_columns(const bw_program *p) { return p->columns; }
size_t bw_program_rows(const bw_program *p) { return (size_t)Clp_numberRows(p->model) + p->pending; }
bool bw_program_is_integer(const bw_program *p, size_t column) { return p->integer[column]; }

void bw_program_get_bounds(const bw_program *p, size_t column, double *lower, double *upper) {
    *lower = Clp_columnLower(p->model)[column];
    *upper = Clp_columnUpper(p->model)[column];
}

void bw_program_set_bounds(bw_program *p, size_t column, double lower, double upper) {
    Clp_columnLower(p->model)[column] = lower;
    Clp_columnUpper(p->model)[column] = upper;
}

void bw_program_set_cost(bw_program *p, size_t column, double cost) { Clp_objective(p->model)[column] = cost; }

bw_status bw_program_try(bw_context *ctx, bw_program *p, int steps, double cutoff, bw_program_status *status, double *value) {
    (void)ctx;
    hand_over(p);
    Clp_setDualObjectiveLimit(p->model, cutoff);
    Clp_setMaximumIterations(p->model, steps);
    if (p->fresh) Clp_initialDualSolve(p->model);
    else Clp_dual(p->model, 0);
    p->fresh = false;
    *value = Clp_objectiveValue(p->model);
    switch (Clp_status(p->model)) {
    case 0: *status = *value > cutoff ? BW_PROGRAM_INFEASIBLE : BW_PROGRAM_OPTIMAL; break;
    case 1: *status = BW_PROGRAM_INFEASIBLE; break;
    case 2: *status = BW_PROGRAM_UNBOUNDED; break;
    default: *status = BW_PROGRAM_STOPPED;
    }
    return BW_OK;
}

bw_status bw_program_relax(bw_context *ctx, bw_program *p, double cutoff, bw_program_status *status, double *value) {
    bw_status result = bw_program_try(ctx, p, 1000000, cutoff, status, value);
    if (result != BW_OK || *status != BW_PROGRAM_STOPPED) return result;
    Clp_primal(p->model, 0); /* numerical trouble: the other algorithm usually finds its way */
    int code = Clp_status(p->model);
    *value = Clp_objectiveValue(p->model);
    if (code == 0) *status = *value > cutoff ? BW_PROGRAM_INFEASIBLE : BW_PROGRAM_OPTIMAL;
    if (code == 1) *status = BW_PROGRAM_INFEASIBLE;
    if (code == 2) *status = BW_PROGRAM_UNBOUNDED;
    return BW_OK;
}

const double *bw_program_solution(const bw_program *p) { return Clp_getColSolution(p->model); }

size_t bw_program_basis_size(const bw_program *p) { return p->columns + (size_t)Clp_numberRows(p->model); }

void bw_program_get_basis(const bw_program *p, unsigned char *basis) {
    memcpy(basis, Clp_statusArray(p->model), bw_program_basis_size(p));
}

bw_status bw_program_set_basis(bw_context *ctx, bw_program *p, const unsigned char *basis, size_t size) {
    enum { BASIC = 1 };
    hand_over(p);
    size_t all = bw_program_basis_size(p);
    unsigned char *full = bw_alloc(ctx, all, 1);
    if (!full) return ctx->error.status;
    memset(full, BASIC, all);
    memcpy(full, basis, size);
    Clp_copyinStatus(p->model, full);
    bw_free(ctx, full);
    return BW_OK;
}
