#include "models/survey.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "models/build.h"

/* A facet or edge of one tet; an edge has -1 as its first vertex. */
typedef struct {
    int32_t vertex[3]; /* ascending */
    int32_t tet;
    int8_t corner[3]; /* of vertex[] in tet */
} part;

typedef struct {
    part *facet, *edge, *rim; /* of every tet; rim: edges of boundary facets; each sorted by vertices */
    size_t facets, edges, rims;
} parts;

static int by_vertices(const void *x, const void *y) {
    const part *a = x, *b = y;
    for (int i = 0; i < 3; i++)
        if (a->vertex[i] != b->vertex[i]) return a->vertex[i] < b->vertex[i] ? -1 : 1;
    return 0;
}

static int by_vertices_and_tet(const void *x, const void *y) {
    int order = by_vertices(x, y);
    const part *a = x, *b = y;
    return order ? order : (a->tet > b->tet) - (a->tet < b->tet);
}

static part make_part(const bw_model *m, size_t tet, const int *corner, int count) {
    part p = {.vertex = {-1, -1, -1}, .tet = (int32_t)tet};
    for (int i = 0; i < count; i++) {
        int at = 3 - count + i;
        int32_t v = m->tet[tet][corner[i]];
        for (; at > 3 - count && v < p.vertex[at - 1]; at--) {
            p.vertex[at] = p.vertex[at - 1];
            p.corner[at] = p.corner[at - 1];
        }
        p.vertex[at] = v;
        p.corner[at] = (int8_t)corner[i];
    }
    return p;
}

/* How many entries from `at` on are the same part. */
static size_t run(const part *list, size_t count, size_t at) {
    size_t n = 1;
    while (at + n < count && !by_vertices(&list[at], &list[at + n])) n++;
    return n;
}

static bw_status collect(bw_context *ctx, const bw_model *m, parts *p) {
    *p = (parts){.facets = 4 * m->tet_count, .edges = 6 * m->tet_count};
    p->facet = bw_alloc(ctx, p->facets, sizeof *p->facet);
    p->edge = bw_alloc(ctx, p->edges, sizeof *p->edge);
    p->rim = bw_alloc(ctx, 3 * p->facets, sizeof *p->rim);
    if (ctx->error.status) return ctx->error.status;
    size_t f = 0, e = 0;
    for (size_t t = 0; t < m->tet_count; t++)
        for (int i = 0; i < 4; i++) {
            const int corner[3] = {(i + 1) % 4, (i + 2) % 4, (i + 3) % 4};
            p->facet[f++] = make_part(m, t, corner, 3);
            for (int j = 0; j < i; j++) {
                const int ends[2] = {i, j};
                p->edge[e++] = make_part(m, t, ends, 2);
            }
        }
    qsort(p->facet, p->facets, sizeof *p->facet, by_vertices_and_tet);
    qsort(p->edge, p->edges, sizeof *p->edge, by_vertices_and_tet);
    for (size_t i = 0, n; i < p->facets; i += n) {
        n = run(p->facet, p->facets, i);
        for (int k = 0; n == 1 && k < 3; k++) {
            const int ends[2] = {p->facet[i].corner[k], p->facet[i].corner[(k + 1) % 3]};
            p->rim[p->rims++] = make_part(m, (size_t)p->facet[i].tet, ends, 2);
        }
    }
    qsort(p->rim, p->rims, sizeof *p->rim, by_vertices_and_tet);
    return BW_OK;
}

static const double *parameter(const bw_model *m, const part *p, int i) {
    return m->parameter[p->tet][p->corner[i]];
}

/* How far the parameters of b's corners are from those of a's under one rotation and the translation that
 * fits the first corner; *moved: how far the translation is from none. */
static double difference(const bw_model *m, const part *a, const part *b, bw_turn turn, double *moved) {
    double worst = 0, shift[3], image[3];
    *moved = 0;
    for (int c = 0; c < 3; c++) {
        bw_turn_apply(turn, parameter(m, a, c), image);
        for (int i = 0; i < 3; i++) {
            double d = parameter(m, b, c)[i] - image[i];
            if (c == 0) {
                shift[i] = d;
                *moved = fmax(*moved, fabs(d));
            }
            worst = fmax(worst, fabs(d - shift[i]));
        }
    }
    return worst;
}

/* More than one rotation can fit a facet that has symmetries; the first that fits counts, and the identity is
 * first. */
static void look_at_seam(const bw_model *m, const part *a, const part *b, const bw_turn *turns,
                         bw_model_survey *s) {
    double moved = 0, best = INFINITY;
    int turn = 0;
    for (int r = 0; r < 24 && best > 0; r++) {
        double shift, d = difference(m, a, b, turns[r], &shift);
        if (r == 0) moved = shift;
        if (d < best - 1e-9) best = d, turn = r;
    }
    s->seam_defect = fmax(s->seam_defect, best);
    s->facets_inside++;
    s->facets_turned += turn != 0;
    s->facets_moved += turn != 0 || moved > 1e-9;
}

static double flatness(const bw_model *m, const part *f) {
    double best = INFINITY;
    for (int i = 0; i < 3; i++) {
        double p = parameter(m, f, 0)[i], q = parameter(m, f, 1)[i], r = parameter(m, f, 2)[i];
        best = fmin(best, fmax(fabs(q - p), fabs(r - p)));
    }
    return best;
}

static void look_at_facets(const bw_model *m, const parts *p, bw_model_survey *s) {
    bw_turn turns[24];
    for (int r = 0; r < 24; r++) turns[r] = bw_turn_number(r);
    for (size_t i = 0, n; i < p->facets; i += n) {
        n = run(p->facet, p->facets, i);
        s->facets++;
        if (n > s->facet_tets_max) s->facet_tets_max = n;
        if (n == 1) s->alignment_defect = fmax(s->alignment_defect, flatness(m, &p->facet[i]));
        if (n > 1) s->facets_flat += flatness(m, &p->facet[i]) < 1e-9;
        for (size_t k = 1; k < n; k++) look_at_seam(m, &p->facet[i], &p->facet[i + k], turns, s);
    }
}

static void look_at_tets(const bw_model *m, bw_model_survey *s) {
    s->space_volume_min = s->map_volume_min = INFINITY;
    for (size_t t = 0; t < m->tet_count; t++) {
        const int32_t *v = m->tet[t];
        double(*x)[3] = m->position, (*u)[3] = m->parameter[t];
        s->space_volume_min = fmin(s->space_volume_min, bw_volume6(x[v[0]], x[v[1]], x[v[2]], x[v[3]]));
        s->map_volume_min = fmin(s->map_volume_min, bw_volume6(u[0], u[1], u[2], u[3]));
    }
}

/* Angle in the map between the two facets of a tet at one of its edges, in quarters. */
static double quarters(const double (*u)[3], int a, int b) {
    double e[3], p[2][3], length = 0, pq = 0, pp = 0, qq = 0;
    for (int i = 0; i < 3; i++) e[i] = u[b][i] - u[a][i], length += e[i] * e[i];
    for (int corner = 0, k = 0; corner < 4; corner++) {
        if (corner == a || corner == b) continue;
        double along = 0;
        for (int i = 0; i < 3; i++) p[k][i] = u[corner][i] - u[a][i], along += p[k][i] * e[i];
        for (int i = 0; i < 3; i++) p[k][i] -= along / length * e[i];
        k++;
    }
    for (int i = 0; i < 3; i++) pq += p[0][i] * p[1][i], pp += p[0][i] * p[0][i], qq += p[1][i] * p[1][i];
    return acos(fmax(-1, fmin(1, pq / sqrt(pp * qq)))) / 1.57079632679489662;
}

static void look_at_edges(const bw_model *m, const parts *p, int *degree, bw_model_survey *s) {
    for (size_t i = 0, n; i < p->edges; i += n) {
        n = run(p->edge, p->edges, i);
        s->edges++;
        if (p->rims && bsearch(&p->edge[i], p->rim, p->rims, sizeof *p->rim, by_vertices)) continue;
        double angle = 0;
        for (size_t k = 0; k < n; k++) {
            const part *e = &p->edge[i + k];
            angle += quarters((const double(*)[3])m->parameter[e->tet], e->corner[1], e->corner[2]);
        }
        s->angle_defect = fmax(s->angle_defect, fabs(angle - round(angle)));
        if (fabs(angle - 4) < 0.5) continue;
        s->singular_edges++;
        degree[p->edge[i].vertex[1]]++;
        degree[p->edge[i].vertex[2]]++;
    }
    s->singular_curves = s->singular_edges; /* no model has a closed interior curve */
    for (size_t v = 0; v < m->vertex_count; v++) s->singular_curves -= degree[v] == 2;
}

bw_status bw_model_look(bw_context *ctx, const bw_model *model, bw_model_survey *out) {
    parts p = {0};
    memset(out, 0, sizeof *out);
    int *degree = bw_alloc(ctx, model->vertex_count, sizeof *degree);
    bw_status status = degree ? collect(ctx, model, &p) : ctx->error.status;
    if (status) goto out;
    look_at_tets(model, out);
    look_at_facets(model, &p, out);
    look_at_edges(model, &p, degree, out);
    out->euler =
        (int64_t)model->vertex_count - (int64_t)out->edges + (int64_t)out->facets - (int64_t)model->tet_count;
out:
    bw_free(ctx, degree);
    bw_free(ctx, p.facet);
    bw_free(ctx, p.edge);
    bw_free(ctx, p.rim);
    return status;
}
