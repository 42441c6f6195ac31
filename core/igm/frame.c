#include "igm/frame.h"

#include <stdlib.h>
#include <string.h>

void bw_frame_clear(bw_context *ctx, bw_frame *frame) {
    bw_free(ctx, frame->position);
    bw_free(ctx, frame->tet);
    bw_free(ctx, frame->reference);
    memset(frame, 0, sizeof *frame);
}

void bw_frame_read(const bw_frame *frame, double *x) {
    for (size_t v = 0; v < frame->variable_count; v++) {
        int32_t corner = frame->reference[v][0];
        x[v] = frame->tet[corner / 4].u[corner % 4][frame->reference[v][1]];
    }
}

void bw_frame_write(bw_frame *frame, const double *x) {
    for (size_t i = 0; i < 12 * frame->tet_count; i++) {
        bw_frame_tet *t = &frame->tet[i / 12];
        size_t c = i / 3 % 4, k = i % 3;
        t->u[c][k] = (double)t->at[c][k] + (t->variable[c][k] == BW_NONE ? 0 : t->sign[c][k] * x[t->variable[c][k]]);
    }
}

/* ---- which tets share facets ---- */

typedef struct {
    bw_vertex vertex[3];
    int32_t side; /* 4 * tet + facet */
} facet_side;

static int compare_sides(const void *a, const void *b) {
    const facet_side *x = a, *y = b;
    for (int i = 0; i < 3; i++)
        if (x->vertex[i] != y->vertex[i]) return x->vertex[i] < y->vertex[i] ? -1 : 1;
    return (x->side > y->side) - (x->side < y->side);
}

static facet_side side_of(const bw_frame *frame, size_t tet, int facet) {
    facet_side s = {.side = (int32_t)(4 * tet) + facet};
    for (int i = 0, n = 0; i < 4; i++)
        if (i != facet) s.vertex[n++] = frame->tet[tet].vertex[i];
    for (int i = 0; i < 2; i++) /* three items: two passes sort them */
        for (int j = 0; j < 2; j++)
            if (s.vertex[j] > s.vertex[j + 1]) {
                bw_vertex v = s.vertex[j];
                s.vertex[j] = s.vertex[j + 1], s.vertex[j + 1] = v;
            }
    return s;
}

bw_status bw_frame_connect(bw_context *ctx, bw_frame *frame) {
    size_t count = 4 * frame->tet_count;
    facet_side *side = bw_alloc(ctx, count, sizeof *side);
    if (!side) return ctx->error.status;
    for (size_t i = 0; i < count; i++) side[i] = side_of(frame, i / 4, (int)(i % 4));
    qsort(side, count, sizeof *side, compare_sides);
    bw_status status = BW_OK;
    for (size_t i = 0; i < count && status == BW_OK;) {
        size_t n = 1;
        while (i + n < count && !memcmp(side[i].vertex, side[i + n].vertex, sizeof side->vertex)) n++;
        if (n > 2) status = bw_fail(ctx, BW_E_INTERNAL, "%zu tets share a facet", n);
        for (size_t k = 0; k < 2 && k < n; k++)
            frame->tet[side[i + k].side / 4].next[side[i + k].side % 4] = n == 2 ? side[i + 1 - k].side / 4 : BW_NONE;
        i += n;
    }
    bw_free(ctx, side);
    return status;
}

/* ---- unknowns ---- */

typedef struct {
    bw_context *ctx;
    bw_frame *frame;
    bw_transition *chart; /* [4 * tet + corner] from the chart of the star's first tet */
    uint8_t *reached;     /* [4 * tet + corner] */
    int32_t *star;        /* corners of the running star */
    size_t count, star_room;
    uint8_t mask; /* held axes, in the first tet's chart */
    int64_t hold[3];
} resolver;

static int corner_of(const bw_frame_tet *t, bw_vertex v) {
    for (int i = 0; i < 4; i++)
        if (t->vertex[i] == v) return i;
    return -1;
}

static bw_status blame(bw_context *ctx, const bw_frame_tet *t, int corner, const char *what) {
    bw_fail_element(ctx, "vertex", t->vertex[corner], NULL);
    return bw_fail(ctx, BW_E_CHECK, "the integers around vertex %d do not fit together: %s", t->vertex[corner], what);
}

/* Holds the reference in an axis. */
static bw_status hold(resolver *r, const bw_frame_tet *t, int corner, int axis, int64_t value) {
    if (r->mask & 1 << axis && r->hold[axis] != value) return blame(r->ctx, t, corner, "it is held in two places");
    r->mask |= (uint8_t)(1 << axis);
    r->hold[axis] = value;
    return BW_OK;
}

/* Walks the star of a corner: charts, and what is held. */
static bw_status walk(resolver *r, int32_t first) {
    bw_frame *f = r->frame;
    bw_vertex v = f->tet[first / 4].vertex[first % 4];
    bw_status status = bw_reserve(r->ctx, &r->star, &r->star_room, 64);
    r->count = 0, r->mask = 0;
    if (status != BW_OK) return status;
    r->chart[first] = (bw_transition){.rotation = 0};
    r->reached[first] = 1;
    r->star[r->count++] = first;
    for (size_t i = 0; i < r->count && status == BW_OK; i++) {
        int32_t at = r->star[i];
        const bw_frame_tet *t = &f->tet[at / 4];
        bw_transition back = bw_transition_inverse(&r->chart[at]);
        for (int k = 0; k < 3 && status == BW_OK; k++) {
            if (!(t->mask[at % 4] & 1 << k)) continue;
            bw_plane plane = bw_transition_plane(&back, (bw_plane){t->hold[at % 4][k], (int8_t)k});
            status = hold(r, t, at % 4, plane.axis, plane.value);
        }
        for (int i4 = 0; i4 < 4 && status == BW_OK; i4++) {
            if (i4 == at % 4 || t->next[i4] == BW_NONE) continue;
            int32_t to = 4 * t->next[i4] + corner_of(&f->tet[t->next[i4]], v);
            if (r->reached[to]) continue;
            if ((status = bw_reserve(r->ctx, &r->star, &r->star_room, r->count + 1))) break;
            r->chart[to] = bw_transition_compose(&t->across[i4], &r->chart[at]);
            r->reached[to] = 1;
            r->star[r->count++] = to;
        }
    }
    return status;
}

/* Whether every loop around the vertex leaves what is held alone, and nothing else is turned: singular edges hold what they turn. */
static bw_status check_loops(resolver *r) {
    bw_frame *f = r->frame;
    for (size_t i = 0; i < r->count; i++) {
        int32_t at = r->star[i];
        const bw_frame_tet *t = &f->tet[at / 4];
        for (int i4 = 0; i4 < 4; i4++) {
            if (i4 == at % 4 || t->next[i4] == BW_NONE) continue;
            int32_t to = 4 * t->next[i4] + corner_of(&f->tet[t->next[i4]], t->vertex[at % 4]);
            bw_transition chart = bw_transition_compose(&t->across[i4], &r->chart[at]), other = bw_transition_inverse(&r->chart[to]);
            bw_transition loop = bw_transition_compose(&other, &chart);
            if (bw_transition_is_identity(&loop)) continue;
            for (int k = 0; k < 3; k++) {
                bw_plane image = bw_transition_plane(&loop, (bw_plane){r->hold[k], (int8_t)k});
                bool held = r->mask & 1 << k;
                if (!held && image.axis == k && bw_rotation_sign[loop.rotation][k] > 0 && !loop.shift[k]) continue;
                if (!held || !(r->mask & 1 << image.axis) || image.value != r->hold[image.axis])
                    return blame(r->ctx, t, at % 4, "a way around it moves it");
            }
        }
    }
    return BW_OK;
}

static bw_status assign(resolver *r) {
    bw_frame *f = r->frame;
    int32_t variable[3];
    for (int k = 0; k < 3; k++) {
        variable[k] = BW_NONE;
        if (r->mask & 1 << k) continue;
        if (bw_reserve(r->ctx, &f->reference, &f->reference_room, f->variable_count + 1)) return r->ctx->error.status;
        f->reference[f->variable_count][0] = r->star[0], f->reference[f->variable_count][1] = k;
        variable[k] = (int32_t)f->variable_count++;
        r->hold[k] = 0;
    }
    for (size_t i = 0; i < r->count; i++) {
        bw_frame_tet *t = &f->tet[r->star[i] / 4];
        int c = r->star[i] % 4;
        const bw_transition *chart = &r->chart[r->star[i]];
        bw_transition_apply(chart, r->hold, t->at[c]);
        t->mask[c] = 0;
        for (int k = 0; k < 3; k++) {
            int axis = bw_rotation_axis[chart->rotation][k];
            t->variable[c][k] = variable[axis];
            t->sign[c][k] = variable[axis] == BW_NONE ? 0 : bw_rotation_sign[chart->rotation][k];
            t->hold[c][k] = 0;
            if (variable[axis] != BW_NONE) continue;
            t->mask[c] |= (uint8_t)(1 << k);
            t->hold[c][k] = t->at[c][k];
        }
    }
    return BW_OK;
}

bw_status bw_frame_resolve(bw_context *ctx, bw_frame *frame) {
    size_t corners = 4 * frame->tet_count;
    resolver r = {.ctx = ctx, .frame = frame, .chart = bw_alloc(ctx, corners, sizeof *r.chart), .reached = bw_alloc(ctx, corners, 1)};
    bw_status status = ctx->error.status;
    frame->variable_count = 0;
    for (size_t i = 0; i < corners && status == BW_OK; i++) {
        if (r.reached[i]) continue;
        status = walk(&r, (int32_t)i);
        if (status == BW_OK) status = check_loops(&r);
        if (status == BW_OK) status = assign(&r);
    }
    bw_free(ctx, r.chart);
    bw_free(ctx, r.reached);
    bw_free(ctx, r.star);
    return status;
}

/* ---- check --------------------------------------------------------------------------------------------------------- */

static bw_status check_facet(bw_context *ctx, const bw_frame *frame, size_t tet, int i) {
    const bw_frame_tet *t = &frame->tet[tet];
    for (int c = 0; c < 4 && t->plane[i] >= 0; c++)
        if (c != i && !(t->mask[c] & 1 << t->plane[i])) return blame(ctx, t, c, "an aligned facet does not hold it");
    for (int c = 0, first = i == 0; c < 4 && t->plane[i] >= 0; c++)
        if (c != i && t->hold[c][t->plane[i]] != t->hold[first][t->plane[i]]) return blame(ctx, t, c, "an aligned facet is not flat");
    if (t->next[i] == BW_NONE) return t->plane[i] >= 0 ? BW_OK : blame(ctx, t, !i, "a boundary facet is not aligned");
    const bw_frame_tet *n = &frame->tet[t->next[i]];
    for (int c = 0; c < 4; c++) {
        if (c == i) continue;
        int other = corner_of(n, t->vertex[c]), facet = -1;
        for (int k = 0; k < 4; k++)
            if (n->next[k] == (bw_tet)tet) facet = k;
        if (other < 0 || facet < 0) return blame(ctx, t, c, "tets are not joined both ways");
        bw_transition loop = bw_transition_compose(&n->across[facet], &t->across[i]);
        int64_t image[3];
        if (!bw_transition_is_identity(&loop)) return blame(ctx, t, c, "a facet has not the inverse transition on its other side");
        bw_transition_apply(&t->across[i], t->at[c], image);
        for (int k = 0; k < 3; k++) {
            int axis = bw_rotation_axis[t->across[i].rotation][k];
            if (n->variable[other][k] != t->variable[c][axis] ||
                n->sign[other][k] != bw_rotation_sign[t->across[i].rotation][k] * t->sign[c][axis] || n->at[other][k] != image[k])
                return blame(ctx, t, c, "its place is not carried across a facet");
        }
    }
    return BW_OK;
}

static bw_status check_line(bw_context *ctx, const bw_frame_tet *t, int line) {
    for (int k = 0; k < 3 && t->line[line] >= 0; k++) {
        int a = bw_tet_edge_corners[line][0], b = bw_tet_edge_corners[line][1];
        if (k == t->line[line]) continue;
        if (!(t->mask[a] & t->mask[b] & 1 << k) || t->hold[a][k] != t->hold[b][k]) return blame(ctx, t, a, "a line does not hold it");
    }
    return BW_OK;
}

bw_status bw_frame_check(bw_context *ctx, const bw_frame *frame) {
    bw_status status = BW_OK;
    for (size_t t = 0; t < frame->tet_count && status == BW_OK; t++) {
        for (int i = 0; i < 4 && status == BW_OK; i++) status = check_facet(ctx, frame, t, i);
        for (int i = 0; i < 6 && status == BW_OK; i++) status = check_line(ctx, &frame->tet[t], i);
    }
    return status;
}
