/* Branch and cut on the relaxations of program.c. See program.h.
 *
 * A node is one changed bound and its parent; its program is reached by setting the bounds on the way from the root. Nodes wait (frontier.h); from a node
 * taken out the search dives: of two children one is gone on with, from the basis that is there, the other waits.
 */
#include <math.h>
#include <string.h>

#include "solve/frontier.h"
#include "solve/program.h"

typedef struct {
    int32_t parent, column; /* -1, -1: the root */
    double lower, upper;    /* new bounds of the column */
    double bound;
    unsigned char *basis;   /* of the parent's relaxation; NULL once the node is taken */
    size_t basis_size;
} node;

typedef struct {
    double sum[2]; /* gain of the bound per unit of rounding: down, up */
    int32_t count[2];
} pseudo_cost;

typedef struct {
    bw_context *ctx;
    bw_program *program;
    const bw_branch_options *how;
    bw_branch_result *result;
    node *nodes;
    size_t node_count, node_room;
    bw_frontier waiting;
    double *lower, *upper; /* of all columns at the root */
    pseudo_cost *gain;
    double *trial;         /* solution kept while children are tried */
    unsigned char *basis;
    size_t basis_room;
    double cutoff, start;
} search;

enum { TRIALS = 8, TRIAL_STEPS = 30, RELIABLE = 2, LOOKS = 200 };

/* The smallest value that is not worth looking at. */
static double limit(const search *s) {
    double slack = BW_PROGRAM_EPSILON * (1 + fabs(s->cutoff));
    if (s->cutoff >= BW_PROGRAM_INFINITY) return BW_PROGRAM_INFINITY;
    return s->how->step > slack ? s->cutoff - s->how->step + slack : s->cutoff - slack;
}

/* ---- one node ---- */

static void set_path(search *s, int32_t n) {
    size_t columns = bw_program_columns(s->program);
    for (size_t c = 0; c < columns; c++) bw_program_set_bounds(s->program, c, s->lower[c], s->upper[c]);
    for (; s->nodes[n].parent >= 0; n = s->nodes[n].parent) { /* the deepest change of a column is the tightest: keep it */
        const node *x = &s->nodes[n];
        double lower, upper;
        bw_program_get_bounds(s->program, (size_t)x->column, &lower, &upper);
        bw_program_set_bounds(s->program, (size_t)x->column, fmax(lower, x->lower), fmin(upper, x->upper));
    }
}

/* Whether a column ought to be an integer and is not. */
static bool is_broken(const search *s, const double *x, size_t c) {
    return bw_program_is_integer(s->program, c) && fabs(x[c] - round(x[c])) > BW_PROGRAM_EPSILON;
}

static bool is_integral(const search *s, const double *x) {
    size_t columns = bw_program_columns(s->program);
    for (size_t c = 0; c < columns; c++)
        if (is_broken(s, x, c)) return false;
    return true;
}

/* Relaxes and lets the callback look until it adds nothing more. *open: the node is neither cut off nor settled. */
static bw_status settle(search *s, double *value, bool *open) {
    double last = -BW_PROGRAM_INFINITY;
    *open = false;
    for (int looks = 0;; looks++) {
        bw_program_status status;
        if (bw_poll(s->ctx)) return s->ctx->error.status;
        if (bw_program_relax(s->ctx, s->program, limit(s), &status, value)) return s->ctx->error.status;
        s->result->relaxations++;
        if (status == BW_PROGRAM_INFEASIBLE) return BW_OK;
        if (status == BW_PROGRAM_UNBOUNDED) return bw_fail(s->ctx, BW_E_ALGORITHM, "an integer program is unbounded");
        if (status == BW_PROGRAM_STOPPED) return bw_fail(s->ctx, BW_E_ALGORITHM, "a linear program was given up for numerical trouble");
        if (*value >= limit(s)) return BW_OK;
        const double *x = bw_program_solution(s->program);
        bool integral = is_integral(s, x);
        size_t rows = bw_program_rows(s->program);
        double cutoff = s->cutoff;
        bw_status result = s->how->look(s->how->user, s->program, x, *value, integral, &cutoff);
        if (result != BW_OK) return result;
        s->cutoff = fmin(s->cutoff, cutoff);
        bool grew = bw_program_rows(s->program) > rows;
        if (!grew && integral) return BW_OK;
        bool stalls = looks >= 5 && *value < last + 1e-4 * fabs(last); /* rather branch than add what changes little */
        if (!integral && (!grew || looks >= LOOKS || stalls)) break;
        if (bw_seconds_now() - s->start > s->how->seconds) break;
        last = *value;
    }
    *open = *value < limit(s);
    return BW_OK;
}

/* ---- which column to branch on ---- */

static double fraction(double x) { return x - floor(x); }

static double mean_gain(const search *s, size_t c, int up) {
    const pseudo_cost *g = &s->gain[c];
    return g->count[up] ? g->sum[up] / g->count[up] : 1;
}

static double score(double down, double up) { return fmax(down, 1e-7) * fmax(up, 1e-7); }

static void note_gain(search *s, size_t c, int up, double gain, double distance) {
    s->gain[c].sum[up] += fmax(gain, 0) / fmax(distance, 1e-3);
    s->gain[c].count[up]++;
}

/* A few steps into one child; BW_PROGRAM_INFINITY if it is cut off. */
static bw_status try_child(search *s, size_t c, int up, double x, double value, double *gain) {
    double lower, upper, reached;
    bw_program_status status;
    bw_program_get_bounds(s->program, c, &lower, &upper);
    bw_program_set_bounds(s->program, c, up ? ceil(x) : lower, up ? upper : floor(x));
    bw_status result = bw_program_try(s->ctx, s->program, TRIAL_STEPS, limit(s), &status, &reached);
    bw_program_set_bounds(s->program, c, lower, upper);
    if (result != BW_OK) return result;
    *gain = status == BW_PROGRAM_INFEASIBLE ? BW_PROGRAM_INFINITY : status == BW_PROGRAM_UNBOUNDED ? 0 : fmax(reached - value, 0);
    if (*gain < BW_PROGRAM_INFINITY) note_gain(s, c, up, *gain, up ? 1 - fraction(x) : fraction(x));
    return bw_program_set_basis(s->ctx, s->program, s->basis, bw_program_basis_size(s->program));
}

typedef struct {
    size_t column;
    double score, gain[2];
} choice;

/* The columns of highest expected gain first; up to TRIALS of them. */
static size_t candidates(const search *s, const double *x, choice *list) {
    size_t n = 0, columns = bw_program_columns(s->program);
    for (size_t c = 0; c < columns; c++) {
        double f = fraction(x[c]);
        if (!is_broken(s, x, c)) continue;
        choice k = {c, 0, {f * mean_gain(s, c, 0), (1 - f) * mean_gain(s, c, 1)}};
        k.score = score(k.gain[0], k.gain[1]);
        size_t i = n < TRIALS ? n++ : TRIALS;
        for (; i && list[i - 1].score < k.score; i--)
            if (i < TRIALS) list[i] = list[i - 1];
        if (i < TRIALS) list[i] = k;
    }
    return n;
}

/* Chooses a column; trial steps for those whose gains are not known well. best->gain is BW_PROGRAM_INFINITY for a child found empty. */
static bw_status choose(search *s, const double *x, double value, choice *best) {
    choice list[TRIALS + 1];
    size_t n = candidates(s, x, list), size = bw_program_basis_size(s->program);
    if (bw_reserve(s->ctx, &s->basis, &s->basis_room, size)) return s->ctx->error.status;
    bw_program_get_basis(s->program, s->basis);
    best->score = -1;
    for (size_t i = 0; i < n; i++) {
        choice *k = &list[i];
        for (int up = 0; up < 2; up++)
            if (s->gain[k->column].count[up] < RELIABLE &&
                try_child(s, k->column, up, x[k->column], value, &k->gain[up]))
                return s->ctx->error.status;
        k->score = score(fmin(k->gain[0], 1e9), fmin(k->gain[1], 1e9));
        if (k->score > best->score) *best = *k;
        if (k->gain[0] >= BW_PROGRAM_INFINITY || k->gain[1] >= BW_PROGRAM_INFINITY) break; /* free progress */
    }
    return BW_OK;
}

/* ---- the tree ---- */

static bw_status add_node(search *s, int32_t parent, size_t column, double lower, double upper, double bound, int32_t *out) {
    if (bw_reserve(s->ctx, &s->nodes, &s->node_room, s->node_count + 1)) return s->ctx->error.status;
    *out = (int32_t)s->node_count++;
    s->nodes[*out] = (node){parent, (int32_t)column, lower, upper, bound, NULL, 0};
    return BW_OK;
}

static bw_status make_wait(search *s, int32_t n) {
    node *x = &s->nodes[n];
    x->basis_size = bw_program_basis_size(s->program);
    x->basis = bw_alloc(s->ctx, x->basis_size, 1);
    if (!x->basis) return s->ctx->error.status;
    memcpy(x->basis, s->basis, x->basis_size);
    return bw_frontier_push(s->ctx, &s->waiting, n, x->bound);
}

/* Splits node n, whose relaxation has just been solved. *next: the child to go on with, -1 if both are empty. */
static bw_status split(search *s, int32_t n, double value, int32_t *next) {
    choice best = {0, -1, {0, 0}};
    size_t columns = bw_program_columns(s->program);
    memcpy(s->trial, bw_program_solution(s->program), columns * sizeof *s->trial);
    *next = -1;
    if (choose(s, s->trial, value, &best)) return s->ctx->error.status;
    double x = s->trial[best.column], lower, upper;
    bw_program_get_bounds(s->program, best.column, &lower, &upper);
    int first = best.gain[1] < best.gain[0] || (best.gain[1] == best.gain[0] && fraction(x) > 0.5); /* the cheaper side */
    for (int k = 0; k < 2; k++) {
        int up = k ? !first : first;
        if (best.gain[up] >= BW_PROGRAM_INFINITY) continue;
        int32_t child;
        if (add_node(s, n, best.column, up ? ceil(x) : lower, up ? upper : floor(x), value, &child)) return s->ctx->error.status;
        if (*next < 0) *next = child;
        else if (make_wait(s, child)) return s->ctx->error.status;
    }
    return BW_OK;
}

static bool out_of_time(const search *s) {
    return s->result->nodes >= s->how->node_limit || bw_seconds_now() - s->start > s->how->seconds;
}

/* Dives from node n, whose bounds and basis are set, until there is nothing left below. *unfinished: the bound of what was left over for lack of time. */
static bw_status dive(search *s, int32_t n, double *unfinished) {
    double parent_value = 0, x = 0;
    bool child = false;
    while (n >= 0) {
        double value;
        bool open;
        if (out_of_time(s)) {
            *unfinished = fmin(*unfinished, s->nodes[n].bound);
            return BW_OK;
        }
        s->result->nodes++;
        if (settle(s, &value, &open)) return s->ctx->error.status;
        if (child && open) {
            int up = s->nodes[n].lower > x;
            note_gain(s, (size_t)s->nodes[n].column, up, value - parent_value, up ? 1 - fraction(x) : fraction(x));
        }
        if (!open) return BW_OK;
        if (out_of_time(s)) {
            *unfinished = fmin(*unfinished, value);
            return BW_OK;
        }
        if (is_integral(s, bw_program_solution(s->program))) { /* only for lack of time */
            *unfinished = fmin(*unfinished, value);
            return BW_OK;
        }
        int32_t next;
        if (split(s, n, value, &next)) return s->ctx->error.status;
        if (next >= 0) {
            x = s->trial[s->nodes[next].column];
            bw_program_set_bounds(s->program, (size_t)s->nodes[next].column, s->nodes[next].lower, s->nodes[next].upper);
        }
        parent_value = value, child = true, n = next;
    }
    return BW_OK;
}

static bw_status run(search *s, double *unfinished) {
    int32_t root;
    if (add_node(s, -1, 0, 0, 0, -BW_PROGRAM_INFINITY, &root)) return s->ctx->error.status;
    if (dive(s, root, unfinished)) return s->ctx->error.status;
    while (s->waiting.count && !out_of_time(s)) {
        int32_t n = bw_frontier_pop(&s->waiting);
        node *x = &s->nodes[n];
        if (x->bound < limit(s)) {
            set_path(s, n);
            if (bw_program_set_basis(s->ctx, s->program, x->basis, x->basis_size)) return s->ctx->error.status;
            bw_free(s->ctx, x->basis);
            x->basis = NULL;
            if (dive(s, n, unfinished)) return s->ctx->error.status;
        } else {
            bw_free(s->ctx, x->basis);
            x->basis = NULL;
        }
    }
    return BW_OK;
}

static void close_search(search *s, double unfinished) {
    bw_branch_result *r = s->result;
    if (s->waiting.count) unfinished = fmin(unfinished, s->waiting.item[0].bound);
    r->cutoff = s->cutoff;
    r->exhausted = unfinished >= limit(s);
    r->bound = r->exhausted ? s->cutoff : fmin(unfinished, s->cutoff);
    for (size_t i = 0; i < s->node_count; i++) bw_free(s->ctx, s->nodes[i].basis);
    size_t columns = bw_program_columns(s->program);
    for (size_t c = 0; s->lower && s->upper && c < columns; c++) bw_program_set_bounds(s->program, c, s->lower[c], s->upper[c]);
    bw_free(s->ctx, s->nodes);
    bw_frontier_clear(s->ctx, &s->waiting);
    bw_free(s->ctx, s->lower);
    bw_free(s->ctx, s->upper);
    bw_free(s->ctx, s->gain);
    bw_free(s->ctx, s->trial);
    bw_free(s->ctx, s->basis);
}

bw_status bw_program_branch(bw_context *ctx, bw_program *program, const bw_branch_options *how, bw_branch_result *result) {
    search s = {.ctx = ctx, .program = program, .how = how, .result = result, .cutoff = how->cutoff, .start = bw_seconds_now()};
    size_t columns = bw_program_columns(program);
    double unfinished = BW_PROGRAM_INFINITY;
    *result = (bw_branch_result){.cutoff = how->cutoff};
    s.lower = bw_alloc(ctx, columns, sizeof *s.lower);
    s.upper = bw_alloc(ctx, columns, sizeof *s.upper);
    s.gain = bw_alloc(ctx, columns, sizeof *s.gain);
    s.trial = bw_alloc(ctx, columns, sizeof *s.trial);
    bw_status status = ctx->error.status;
    if (s.lower && s.upper && s.gain && s.trial) {
        for (size_t c = 0; c < columns; c++) bw_program_get_bounds(program, c, &s.lower[c], &s.upper[c]);
        status = run(&s, &unfinished);
    } else {
        bw_free(ctx, s.lower), bw_free(ctx, s.upper); /* close_search must not read half of them */
        s.lower = s.upper = NULL;
    }
    close_search(&s, unfinished);
    return status;
}
