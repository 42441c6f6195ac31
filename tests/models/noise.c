/* Moves vertices off the grid, chooses the charts, and adds errors. */
#include <math.h>
#include <string.h>

#include "models/build.h"

typedef struct {
    bw_build *w;
    size_t *first;    /* [vertex + 1] into corner */
    int32_t *corner;  /* 4 * tet + local corner */
    double *smallest; /* [tet] volume in space below which no move may bring it */
} mover;

static const double kept = 0.1; /* of a tet's volume before noise, in space and in parameters */

static void mover_clear(mover *m) {
    bw_free(m->w->ctx, m->first);
    bw_free(m->w->ctx, m->corner);
    bw_free(m->w->ctx, m->smallest);
}

static double space_volume6(const bw_model *model, size_t tet) {
    const int32_t *t = model->tet[tet];
    return bw_volume6(model->position[t[0]], model->position[t[1]], model->position[t[2]],
                      model->position[t[3]]);
}

static double map_volume6(const bw_model *model, size_t tet) {
    double(*u)[3] = model->parameter[tet];
    return bw_volume6(u[0], u[1], u[2], u[3]);
}

static bw_status mover_init(mover *m, bw_build *w) {
    const bw_model *model = w->model;
    *m = (mover){.w = w};
    m->first = bw_alloc(w->ctx, model->vertex_count + 2, sizeof *m->first);
    m->corner = bw_alloc(w->ctx, 4 * model->tet_count, sizeof *m->corner);
    m->smallest = bw_alloc(w->ctx, model->tet_count, sizeof *m->smallest);
    if (w->ctx->error.status) return w->ctx->error.status;
    for (size_t i = 0; i < 4 * model->tet_count; i++) m->first[model->tet[i / 4][i % 4] + 2]++;
    for (size_t v = 0; v < model->vertex_count; v++) m->first[v + 2] += m->first[v + 1];
    for (size_t i = 0; i < 4 * model->tet_count; i++)
        m->corner[m->first[model->tet[i / 4][i % 4] + 1]++] = (int32_t)i;
    for (size_t t = 0; t < model->tet_count; t++) m->smallest[t] = kept * space_volume6(model, t);
    return BW_OK;
}

/* Size of a cell along each axis of the star's first chart: the smallest among the blocks of the star. */
static void cell_size(const bw_layout *l, const bw_star *star, double size[3]) {
    for (int i = 0; i < 3; i++) size[i] = INFINITY;
    for (size_t k = 0; k < star->count; k++) {
        const bw_spoke *s = &l->spoke[star->first + k];
        for (int i = 0; i < 3; i++) {
            double h = bw_layout_length(l, s->block, i) / bw_layout_cells(l, s->block, i);
            size[s->turn.axis[i]] = fmin(size[s->turn.axis[i]], h);
        }
    }
}

/* Point in space of parameters in the chart of a block that may have left its box: walks into the neighbours.
 */
static void point_at(const bw_layout *l, int32_t block, double u[3], double out[3]) {
    for (int step = 0; step < 8; step++) {
        int face = -1;
        for (int i = 0; i < 3 && face < 0; i++) {
            if (u[i] < 0) face = 2 * i;
            if (u[i] > bw_layout_length(l, block, i)) face = 2 * i + 1;
        }
        const bw_layout_face *f = face < 0 ? NULL : &l->face[l->block[block].face[face]];
        if (!f || f->block[1] < 0) break;
        bw_move across = bw_layout_across(l, block, face);
        block = f->block[f->block[0] == block];
        bw_move_apply(&across, u, u);
    }
    double local[3];
    for (int i = 0; i < 3; i++) local[i] = u[i] / bw_layout_length(l, block, i);
    bw_layout_point(l, block, local, out);
}

static void shift_corners(mover *m, int32_t vertex, const double delta[3]) {
    const bw_layout *l = &m->w->layout;
    const bw_star *star = &l->star[m->w->star[vertex]];
    for (size_t i = m->first[vertex]; i < m->first[vertex + 1]; i++) {
        int32_t tet = m->corner[i] / 4, c = m->corner[i] % 4;
        for (size_t k = 0; k < star->count; k++) {
            const bw_spoke *s = &l->spoke[star->first + k];
            if (s->block != m->w->tet_block[tet]) continue;
            double d[3];
            bw_turn_apply(s->turn, delta, d);
            for (int a = 0; a < 3; a++) m->w->model->parameter[tet][c][a] += d[a];
        }
    }
}

static bool all_positive(const mover *m, int32_t vertex) {
    const bw_build *w = m->w;
    for (size_t i = m->first[vertex]; i < m->first[vertex + 1]; i++) {
        size_t tet = (size_t)m->corner[i] / 4;
        double cell = 1;
        for (int a = 0; a < 3; a++)
            cell *= bw_layout_length(&w->layout, w->tet_block[tet], a) /
                    bw_layout_cells(&w->layout, w->tet_block[tet], a);
        if (map_volume6(w->model, tet) < kept * cell || space_volume6(w->model, tet) < m->smallest[tet])
            return false;
    }
    return true;
}

/* Tries a displacement, then halves of it; the vertex stays where it is if none is good. The parameters of
 * its corners are kept and restored, not computed back, so a vertex that stays is exactly where it was. */
static void move_vertex(mover *m, int32_t vertex, const double delta[3]) {
    bw_build *w = m->w;
    enum { TRIES = 4, MOST = 512 };
    size_t first = m->first[vertex], count = m->first[vertex + 1] - first;
    double(*parameter)[4][3] = w->model->parameter, saved[MOST][3], position[3];
    if (count > MOST) return;
    for (size_t i = 0; i < count; i++)
        memcpy(saved[i], parameter[m->corner[first + i] / 4][m->corner[first + i] % 4], sizeof saved[i]);
    memcpy(position, w->model->position[vertex], sizeof position);
    for (int try = 0; try < TRIES; try++) {
        double d[3], u[3];
        for (int i = 0; i < 3; i++) d[i] = bw_snap(ldexp(delta[i], -try)), u[i] = w->home[vertex][i] + d[i];
        shift_corners(m, vertex, d);
        point_at(&w->layout, w->layout.spoke[w->layout.star[w->star[vertex]].first].block, u,
                 w->model->position[vertex]);
        if (all_positive(m, vertex)) return;
        for (size_t i = 0; i < count; i++)
            memcpy(parameter[m->corner[first + i] / 4][m->corner[first + i] % 4], saved[i], sizeof saved[i]);
        memcpy(w->model->position[vertex], position, sizeof position);
    }
}

bw_status bw_noise_apply(bw_build *w) {
    mover m;
    bw_status status = mover_init(&m, w);
    if (status) goto out;
    for (size_t t = 0; t < w->model->tet_count; t++)
        if (m.smallest[t] <= 0) {
            status = bw_fail(w->ctx, BW_E_USAGE, "at size %d a tet of the model is inverted in space",
                             w->options->size);
            bw_fail_element(w->ctx, "tet", (int64_t)t, w->model->position[w->model->tet[t][0]]);
            goto out;
        }
    uint64_t state = w->options->seed ^ 0x6e6f697365;
    for (size_t v = 0; v < w->model->vertex_count && w->options->noise > 0; v++) {
        const bw_star *star = &w->layout.star[w->star[v]];
        double size[3], delta[3];
        cell_size(&w->layout, star, size);
        for (int i = 0; i < 3; i++)
            delta[i] = bw_random_signed(&state) * (star->free[i] ? 0.45 * w->options->noise * size[i] : 0);
        move_vertex(&m, (int32_t)v, delta);
    }
out:
    mover_clear(&m);
    return status;
}

/* --- folds --- */

static bool may_move(const bw_star *star) { return star->free[0] || star->free[1] || star->free[2]; }

/* Moves vertices past their neighbours in the parametrization, in all charts alike and along the axes along which they may
 * move: some tets around them are inverted then, and everything else stays as it was. */
bw_status bw_folds_apply(bw_build *w) {
    mover m = {.w = w};
    bw_status status = w->options->folds ? mover_init(&m, w) : BW_OK;
    uint64_t state = w->options->seed ^ 0x666f6c6473;
    for (int i = 0; i < w->options->folds && !status; i++) {
        size_t v = (size_t)(bw_random(&state) % w->model->vertex_count), tried = 0;
        while (!may_move(&w->layout.star[w->star[v]]) && ++tried < w->model->vertex_count)
            v = (v + 1) % w->model->vertex_count;
        const bw_star *star = &w->layout.star[w->star[v]];
        double size[3], delta[3];
        cell_size(&w->layout, star, size);
        for (int a = 0; a < 3; a++) {
            double reach = 1.2 + 0.3 * bw_random_signed(&state);
            delta[a] = star->free[a] ? bw_snap((bw_random(&state) % 2 ? reach : -reach) * size[a]) : 0;
        }
        shift_corners(&m, (int32_t)v, delta);
    }
    mover_clear(&m);
    return status;
}

/* --- charts --- */

static bw_move move_compose(const bw_move *after, const bw_move *before) {
    bw_move m = {.turn = bw_turn_compose(after->turn, before->turn)};
    bw_move_apply(after, before->shift, m.shift);
    return m;
}

static bw_move random_move(uint64_t *state, bool integral) {
    bw_move m = {.turn = bw_turn_number((int)(bw_random(state) % 24))};
    for (int i = 0; i < 3; i++) {
        double shift = 4 * bw_random_signed(state);
        m.shift[i] = integral ? round(shift) : bw_snap(shift);
    }
    return m;
}

/* Charts that agree across the faces of a spanning tree of the blocks, breadth first from block 0. */
static bw_status comb(const bw_layout *l, bool integral, bw_move *chart) {
    int32_t *queue = bw_alloc(l->ctx, l->block_count, sizeof *queue);
    bool *done = bw_alloc(l->ctx, l->block_count, sizeof *done);
    bw_status status = l->ctx->error.status;
    if (status) goto out;
    chart[0] = (bw_move){.turn = bw_turn_identity()};
    for (int i = 0; i < 3 && !integral; i++) chart[0].shift[i] = bw_snap(0.31830988618379067 - i * 0.36787944117144233);
    size_t count = 1;
    done[0] = true;
    for (size_t i = 0; i < count; i++)
        for (int k = 0; k < 6; k++) {
            const bw_layout_face *f = &l->face[l->block[queue[i]].face[k]];
            if (f->block[1] < 0) continue;
            int32_t other = f->block[f->block[0] == queue[i]];
            if (done[other]) continue;
            int back = 0;
            while (&l->face[l->block[other].face[back]] != f) back++;
            bw_move across = bw_layout_across(l, other, back);
            chart[other] = move_compose(&chart[queue[i]], &across);
            done[other] = true;
            queue[count++] = other;
        }
out:
    bw_free(l->ctx, queue);
    bw_free(l->ctx, done);
    return status;
}

bw_status bw_charts_apply(bw_build *w) {
    bw_model *m = w->model;
    bw_move *chart = bw_alloc(w->ctx, w->layout.block_count, sizeof *chart);
    bw_status status = chart ? comb(&w->layout, w->options->integral, chart) : w->ctx->error.status;
    uint64_t state = w->options->seed ^ 0x6368617274;
    bw_move group = {.turn = bw_turn_identity()};
    int scramble = w->options->scramble;
    for (size_t t = 0; !status && t < m->tet_count; t++) {
        bool next = scramble == BW_SCRAMBLE_TETS || t == 0 ||
                    (scramble == BW_SCRAMBLE_CELLS && w->tet_cell[t] != w->tet_cell[t - 1]) ||
                    (scramble == BW_SCRAMBLE_BLOCKS && w->tet_block[t] != w->tet_block[t - 1]);
        if (scramble && next) group = random_move(&state, w->options->integral);
        bw_move whole = move_compose(&group, &chart[w->tet_block[t]]);
        for (int c = 0; c < 4; c++) bw_move_apply(&whole, m->parameter[t][c], m->parameter[t][c]);
    }
    bw_free(w->ctx, chart);
    return status;
}

/* --- errors --- */

bw_status bw_perturb_apply(bw_build *w) {
    bw_model *m = w->model;
    if (w->options->perturb <= 0) return BW_OK;
    double shortest = INFINITY;
    for (size_t t = 0; t < m->tet_count; t++)
        for (int i = 0; i < 4; i++)
            for (int j = 0; j < i; j++) {
                const double *p = m->parameter[t][i], *q = m->parameter[t][j];
                shortest = fmin(shortest, hypot(hypot(p[0] - q[0], p[1] - q[1]), p[2] - q[2]));
            }
    uint64_t state = w->options->seed ^ 0x706572747572;
    for (size_t t = 0; t < m->tet_count; t++)
        for (int i = 0; i < 12; i++)
            m->parameter[t][i / 3][i % 3] += w->options->perturb * shortest * bw_random_signed(&state);
    return BW_OK;
}
