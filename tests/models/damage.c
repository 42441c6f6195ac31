#include <math.h>
#include <string.h>

#include "models/build.h"

static bw_status append_tet(bw_context *ctx, bw_model *m) {
    int32_t(*tet)[4] = bw_resize(ctx, m->tet, m->tet_count + 1, sizeof *tet);
    if (tet) m->tet = tet;
    double(*parameter)[4][3] = tet ? bw_resize(ctx, m->parameter, m->tet_count + 1, sizeof *parameter) : NULL;
    if (!parameter) return ctx->error.status;
    m->parameter = parameter;
    m->tet_count++;
    return BW_OK;
}

/* Copies a tet behind the last one; its corners come in another order. */
static bw_status duplicate(bw_context *ctx, bw_model *m, size_t tet) {
    static const int order[4] = {1, 2, 0, 3};
    if (append_tet(ctx, m)) return ctx->error.status;
    for (int i = 0; i < 4; i++) {
        m->tet[m->tet_count - 1][i] = m->tet[tet][order[i]];
        memcpy(m->parameter[m->tet_count - 1][i], m->parameter[tet][order[i]], sizeof m->parameter[tet][i]);
    }
    return BW_OK;
}

/* A tet on a facet that has two already, with a new vertex as its fourth corner. */
static bw_status third_tet(bw_context *ctx, bw_model *m, size_t tet) {
    double(*position)[3] = bw_resize(ctx, m->position, m->vertex_count + 1, sizeof *position);
    if (!position) return ctx->error.status;
    m->position = position;
    if (duplicate(ctx, m, tet)) return ctx->error.status;
    int32_t *last = m->tet[m->tet_count - 1];
    for (int i = 0; i < 3; i++) {
        double centre = 0;
        for (int j = 0; j < 4; j++) centre += position[last[j]][i] / 4;
        position[m->vertex_count][i] = centre;
    }
    last[3] = (int32_t)m->vertex_count++;
    return BW_OK;
}

static bool same_facet(const int32_t *tet, const int32_t corner[3]) {
    for (int i = 0; i < 3; i++)
        if (tet[0] != corner[i] && tet[1] != corner[i] && tet[2] != corner[i] && tet[3] != corner[i])
            return false;
    return true;
}

static bool on_boundary(const bw_model *m, size_t tet, int opposite) {
    int32_t corner[3];
    for (int i = 0, n = 0; i < 4; i++)
        if (i != opposite) corner[n++] = m->tet[tet][i];
    for (size_t t = 0; t < m->tet_count; t++)
        if (t != tet && same_facet(m->tet[t], corner)) return false;
    return true;
}

static int local_corner(const int32_t *tet, int32_t vertex) {
    for (int i = 0; i < 4; i++)
        if (tet[i] == vertex) return i;
    return -1;
}

/* Do the charts of two tets agree in all vertices that the tets share? */
static bool charts_agree(const bw_model *m, size_t s, size_t t) {
    for (int i = 0; i < 4; i++) {
        int j = local_corner(m->tet[t], m->tet[s][i]);
        for (int a = 0; j >= 0 && a < 3; a++)
            if (fabs(m->parameter[s][i][a] - m->parameter[t][j][a]) > 1e-9) return false;
    }
    return true;
}

/* Do the charts of all tets around a vertex agree? */
static bool one_chart(const bw_model *m, int32_t vertex) {
    for (size_t s = 0; s < m->tet_count; s++)
        for (size_t t = 0; local_corner(m->tet[s], vertex) >= 0 && t < s; t++)
            if (local_corner(m->tet[t], vertex) >= 0 && !charts_agree(m, s, t)) return false;
    return true;
}

/* Moves a vertex of a boundary facet off its plane, in a place where all charts agree: no other fault arises.
 * There is no such place if every tet has a chart of its own; then only the facet's own tet changes. */
static void tilt(bw_model *m, size_t start) {
    size_t tet = start;
    int corner = 0, opposite = 1;
    for (size_t n = 0; n < 4 * m->tet_count; n++) {
        size_t t = (start + n / 4) % m->tet_count;
        int o = (int)(n % 4), c = (o + 1) % 4;
        if (!on_boundary(m, t, o)) continue;
        tet = t, corner = c, opposite = o;
        if (one_chart(m, m->tet[t][c])) break;
    }
    double old[3], step[3];
    memcpy(old, m->parameter[tet][corner], sizeof old);
    bool shared = one_chart(m, m->tet[tet][corner]);
    for (int i = 0; i < 3; i++) step[i] = 0.05 * (m->parameter[tet][opposite][i] - old[i]);
    for (size_t i = 0; i < 4 * m->tet_count; i++)
        if (m->tet[i / 4][i % 4] == m->tet[tet][corner] && (shared || i / 4 == tet))
            for (int a = 0; a < 3; a++) m->parameter[i / 4][i % 4][a] += step[a];
}

static size_t inner_tet(const bw_model *m, size_t start, int *facet) {
    for (size_t n = 0; n < m->tet_count; n++)
        for (*facet = 0; *facet < 4; ++*facet)
            if (!on_boundary(m, (start + n) % m->tet_count, *facet)) return (start + n) % m->tet_count;
    *facet = 3;
    return start;
}

static void swap_corners(bw_model *m, size_t tet, int a, int b) {
    int32_t v = m->tet[tet][a];
    double u[3];
    memcpy(u, m->parameter[tet][a], sizeof u);
    m->tet[tet][a] = m->tet[tet][b];
    memcpy(m->parameter[tet][a], m->parameter[tet][b], sizeof u);
    m->tet[tet][b] = v;
    memcpy(m->parameter[tet][b], u, sizeof u);
}

bw_status bw_model_damage(bw_context *ctx, bw_model *m, bw_model_damage_kind kind, uint64_t seed) {
    uint64_t state = seed;
    size_t tet = (size_t)(bw_random(&state) % m->tet_count);
    double(*u)[3] = m->parameter[tet];
    int facet;
    switch (kind) {
    case BW_DAMAGE_INVERT:
        swap_corners(m, tet, 2, 3);
        break;
    case BW_DAMAGE_DUPLICATE:
        return duplicate(ctx, m, tet);
    case BW_DAMAGE_NONMANIFOLD:
        tet = inner_tet(m, tet, &facet);
        if (facet != 3) { /* the copy keeps corner 3 last; two swaps leave the tet positive */
            swap_corners(m, tet, facet, 3);
            swap_corners(m, tet, (facet + 1) % 3, (facet + 2) % 3);
        }
        return third_tet(ctx, m, tet);
    case BW_DAMAGE_SEAM:
        for (int i = 0; i < 12; i++) u[i / 3][i % 3] *= 1.01;
        break;
    case BW_DAMAGE_TILT:
        tilt(m, tet);
        break;
    case BW_DAMAGE_INDEX:
        m->tet[tet][bw_random(&state) % 4] = (int32_t)m->vertex_count;
        break;
    case BW_DAMAGE_NAN:
        u[bw_random(&state) % 4][bw_random(&state) % 3] = NAN;
        break;
    default:
        return bw_fail(ctx, BW_E_USAGE, "there is no damage number %d", (int)kind);
    }
    return BW_OK;
}
