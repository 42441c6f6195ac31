#include "stage/sanitize_repair.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "mesh/gridmap.h"
#include "solve/untangle.h"

enum { FIRST_RING = 1 }; /* of the marks in mender.ring; 0: not near any defect */

/* Tets that are solved for together, and the vertices around which they lie. */
typedef struct {
    size_t vertex_count, tet_count, variable_count;
    bw_vertex *vertex;
    int32_t *variable; /* [vertex] its first variable; BW_NONE if it may not move */
    uint8_t *free;     /* [vertex] axes */
    bw_tet *tet;
    bw_untangle_tet *shape;
    double *x, *zero; /* [variable] the result; no change */
    double unit;      /* grid units */
    size_t vertex_room, variable_room, free_room, tet_room, shape_room, x_room;
    bool unclear;
} cluster;

typedef struct {
    bw_context *ctx;
    const bw_star_input *in;
    int64_t (*value)[4][3];
    bw_stars stars;
    uint8_t *verdict;    /* [tet] of tets that are to be repaired or made thicker */
    uint8_t *ring;       /* [vertex] FIRST_RING + edges to the nearest such tet */
    uint8_t *taken;      /* [vertex] in a cluster of this round */
    int32_t *local;      /* [tet] its place in the running cluster, or BW_NONE */
    int64_t (*moved)[3]; /* [vertex] in the chart of its star's first tet */
    bw_vertex *near;
    size_t near_count, near_room;
    cluster c;
} mender;

const char *bw_repair_verdict_text(bw_repair_verdict verdict) {
    static const char *const text[] = {
        [BW_REPAIR_DONE] = "they are repaired",
        [BW_REPAIR_UNCLEAR] = "it is not clear which transitions lead across their facets",
        [BW_REPAIR_HELD] = "the boundary, singular edges or features hold their vertices",
        [BW_REPAIR_LARGE] = "too many tets around them would have to change",
        [BW_REPAIR_TANGLED] = "no positions were found that make all tets around them positive",
    };
    return text[verdict];
}

/* ---- which vertices, and which of them together ---- */

static bw_status add_near(mender *m, bw_vertex v, int ring) {
    if (m->ring[v]) return BW_OK;
    if (bw_reserve(m->ctx, &m->near, &m->near_room, m->near_count + 1)) return m->ctx->error.status;
    m->ring[v] = (uint8_t)(FIRST_RING + ring);
    m->near[m->near_count++] = v;
    return BW_OK;
}

/* Lists the vertices up to `rings` edges away from the tets that are to be repaired. */
static bw_status find_near(mender *m, int rings) {
    const bw_tet_mesh *mesh = m->in->mesh;
    for (size_t i = 0; i < m->near_count; i++) m->ring[m->near[i]] = 0;
    m->near_count = 0;
    for (size_t t = 0; t < mesh->tet_count; t++)
        for (int c = 0; m->verdict[t] && c < 4; c++)
            if (add_near(m, mesh->tet[t][c], 0)) return m->ctx->error.status;
    size_t begin = 0;
    for (int ring = 1; ring <= rings; ring++) {
        size_t end = m->near_count;
        for (; begin < end; begin++)
            for (int32_t i = m->stars.first[m->near[begin]]; i < m->stars.first[m->near[begin] + 1]; i++)
                for (int c = 0; c < 4; c++)
                    if (add_near(m, mesh->tet[m->stars.corner[i] / 4][c], ring)) return m->ctx->error.status;
    }
    return BW_OK;
}

static int compare_vertices(const void *a, const void *b) {
    bw_vertex x = *(const bw_vertex *)a, y = *(const bw_vertex *)b;
    return (x > y) - (x < y);
}

static bw_status add_vertex(mender *m, bw_vertex v) {
    if (m->taken[v] || !m->ring[v]) return BW_OK;
    if (bw_reserve(m->ctx, &m->c.vertex, &m->c.vertex_room, m->c.vertex_count + 1))
        return m->ctx->error.status;
    m->taken[v] = 1;
    m->c.vertex[m->c.vertex_count++] = v;
    return BW_OK;
}

/* The near vertices that hang together with `seed` through common tets, ascending. */
static bw_status gather_vertices(mender *m, bw_vertex seed) {
    cluster *c = &m->c;
    c->vertex_count = c->tet_count = c->variable_count = 0;
    c->unclear = false;
    if (add_vertex(m, seed)) return m->ctx->error.status;
    for (size_t at = 0; at < c->vertex_count; at++)
        for (int32_t i = m->stars.first[c->vertex[at]]; i < m->stars.first[c->vertex[at] + 1]; i++)
            for (int k = 0; k < 4; k++)
                if (add_vertex(m, m->in->mesh->tet[m->stars.corner[i] / 4][k])) return m->ctx->error.status;
    qsort(c->vertex, c->vertex_count, sizeof *c->vertex, compare_vertices);
    return BW_OK;
}

/* ---- the problem ---- */

static bw_status add_tet(mender *m, bw_tet t) {
    cluster *c = &m->c;
    if (m->local[t] != BW_NONE) return BW_OK;
    if (bw_reserve(m->ctx, &c->tet, &c->tet_room, c->tet_count + 1) ||
        bw_reserve(m->ctx, &c->shape, &c->shape_room, c->tet_count + 1))
        return m->ctx->error.status;
    memset(&c->shape[c->tet_count], 0, sizeof *c->shape);
    memset(c->shape[c->tet_count].variable, -1, sizeof c->shape->variable);
    m->local[t] = (int32_t)c->tet_count;
    c->tet[c->tet_count++] = t;
    return BW_OK;
}

/* Gives a vertex its variables, one per free axis, and enters them in the corners of its star. */
static bw_status add_variables(mender *m, size_t at) {
    cluster *c = &m->c;
    int32_t variable[3];
    if (bw_stars_read(m->ctx, &m->stars, c->vertex[at])) return m->ctx->error.status;
    c->unclear = c->unclear || m->stars.unclear;
    c->free[at] = m->stars.free;
    c->variable[at] = m->stars.free ? (int32_t)c->variable_count : BW_NONE;
    if (!m->stars.free) return BW_OK;
    for (int k = 0; k < 3; k++) variable[k] = m->stars.free & 1 << k ? (int32_t)c->variable_count++ : BW_NONE;
    for (size_t i = 0; i < m->stars.count; i++) {
        const bw_star_item *item = &m->stars.item[i];
        if (add_tet(m, item->tet)) return m->ctx->error.status;
        bw_untangle_tet *shape = &c->shape[m->local[item->tet]];
        for (int k = 0; k < 3; k++) {
            shape->variable[item->corner][k] = variable[bw_rotation_axis[item->rotation][k]];
            shape->sign[item->corner][k] = bw_rotation_sign[item->rotation][k];
        }
    }
    return BW_OK;
}

static void edges_of(const bw_tet_mesh *mesh, bw_tet t,
                     double e[3][3]) { /* columns: edges from corner 0, in the model */
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++)
            e[k][i] = mesh->position[mesh->tet[t][i + 1]][k] - mesh->position[mesh->tet[t][0]][k];
}

static double det(double a[3][3]) {
    double sum = 0;
    for (int k = 0; k < 3; k++) {
        int l = (k + 1) % 3, n = (k + 2) % 3;
        sum += a[0][k] * (a[1][l] * a[2][n] - a[1][n] * a[2][l]);
    }
    return sum;
}

static void invert(double a[3][3], double out[3][3]) {
    double d = det(a);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            int i1 = (i + 1) % 3, i2 = (i + 2) % 3, k1 = (k + 1) % 3, k2 = (k + 2) % 3;
            out[k][i] = (a[i1][k1] * a[i2][k2] - a[i1][k2] * a[i2][k1]) / d;
        }
}

static double size_of(double e[3][3]) { /* cube of the mean length of the columns */
    double sum = 0;
    for (int i = 0; i < 3; i++) sum += sqrt(e[0][i] * e[0][i] + e[1][i] * e[1][i] + e[2][i] * e[2][i]);
    return sum * sum * sum / 27;
}

/* What the sound tets around a cluster say of the map: the metric that it gives the model, summed with the
 * tets' volumes as weights, and which way round the model lies. */
typedef struct {
    double metric[3][3], weight, orientation;
} surroundings;

static void add_surrounding(const mender *m, bw_tet t, surroundings *s) {
    double e[3][3], inverse[3][3], p[3][3], j[3][3];
    edges_of(m->in->mesh, t, e);
    double volume = det(e);
    if (!(fabs(volume) > 1e-9 * size_of(e))) return;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) p[k][i] = (double)(m->value[t][i + 1][k] - m->value[t][0][k]);
    invert(e, inverse);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            j[a][b] = p[a][0] * inverse[0][b] + p[a][1] * inverse[1][b] + p[a][2] * inverse[2][b];
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            s->metric[a][b] += fabs(volume) * (j[0][a] * j[0][b] + j[1][a] * j[1][b] + j[2][a] * j[2][b]);
    s->weight += fabs(volume);
    s->orientation += volume;
}

/* Tets that share a vertex with the cluster's but are not among them; if there are none, the cluster's own
 * sound tets. */
static void survey(const mender *m, surroundings *s) {
    const cluster *c = &m->c;
    *s = (surroundings){0};
    for (size_t i = 0; i < 4 * c->tet_count; i++) {
        bw_vertex v = m->in->mesh->tet[c->tet[i / 4]][i % 4];
        for (int32_t k = m->stars.first[v]; k < m->stars.first[v + 1]; k++) {
            bw_tet t = m->stars.corner[k] / 4;
            if (m->local[t] == BW_NONE && !m->verdict[t]) add_surrounding(m, t, s);
        }
    }
    for (size_t i = 0; i < c->tet_count && !(s->weight > 0); i++)
        if (!m->verdict[c->tet[i]]) add_surrounding(m, c->tet[i], s);
}

/* Upper triangle u with u^T u = metric, the first row mirrored if the model is; false if the metric is
 * degenerate. */
static bool root_of(const surroundings *s, double u[3][3]) {
    memset(u, 0, 9 * sizeof(double));
    for (int i = 0; i < 3; i++)
        for (int k = i; k < 3; k++) {
            double sum = s->metric[i][k] / s->weight;
            for (int l = 0; l < i; l++) sum -= u[l][i] * u[l][k];
            if (i == k && !(sum > 0)) return false;
            u[i][k] = i == k ? sqrt(sum) : sum / u[i][i];
        }
    for (int k = 0; k < 3 && s->orientation < 0; k++) u[0][k] = -u[0][k];
    return true;
}

/* The edges that a tet should have: the model's under the metric; a regular tet's of that size if the model's
 * tet is degenerate or lies the other way round. */
static void wanted_edges(const mender *m, bw_tet t, double root[3][3], double out[3][3]) {
    static const double regular[3][3] = {
        {1, 0.5, 0.5}, {0, 0.86602540378443865, 0.28867513459481288}, {0, 0, 0.81649658092772603}};
    double e[3][3];
    edges_of(m->in->mesh, t, e);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            out[a][b] = root[a][0] * e[0][b] + root[a][1] * e[1][b] + root[a][2] * e[2][b];
    double size = size_of(out);
    if (det(out) > 1e-6 * size) return;
    for (int i = 0; i < 9; i++) out[i / 3][i % 3] = (size > 0 ? cbrt(size) : 1) * regular[i / 3][i % 3];
}

/* Shapes and present places of all tets, in units of a wanted edge. */
static bool make_shapes(mender *m) {
    cluster *c = &m->c;
    surroundings s;
    double root[3][3], wanted[3][3], sum = 0;
    survey(m, &s);
    if (!(s.weight > 0) || !root_of(&s, root)) return false;
    for (size_t i = 0; i < c->tet_count; i++) {
        wanted_edges(m, c->tet[i], root, wanted);
        sum += det(wanted);
    }
    c->unit = cbrt(sum / (double)c->tet_count);
    for (size_t i = 0; i < c->tet_count; i++) {
        const int64_t(*u)[3] = (const int64_t(*)[3])m->value[c->tet[i]];
        wanted_edges(m, c->tet[i], root, wanted);
        for (int k = 0; k < 9; k++) wanted[k / 3][k % 3] /= c->unit;
        invert(wanted, c->shape[i].rest);
        for (int k = 0; k < 12; k++)
            c->shape[i].at[k / 3][k % 3] = (double)(u[k / 3][k % 3] - u[0][k % 3]) / c->unit;
    }
    return isfinite(c->unit) && c->unit > 0;
}

/* ---- the result ---- */

/* Adds the rounded result to the values of the cluster's tets (sense 1), or takes it away again (-1). */
static void move_values(mender *m, int sense) {
    const cluster *c = &m->c;
    for (size_t i = 0; i < 12 * c->tet_count; i++) {
        int32_t v = c->shape[i / 12].variable[i % 12 / 3][i % 3];
        if (v == BW_NONE) continue;
        m->value[c->tet[i / 12]][i % 12 / 3][i % 3] +=
            sense * c->shape[i / 12].sign[i % 12 / 3][i % 3] * llrint(c->x[v] * c->unit);
    }
}

static bool all_good(const mender *m) {
    for (size_t i = 0; i < m->c.tet_count; i++) {
        const int64_t(*u)[3] = (const int64_t(*)[3])m->value[m->c.tet[i]];
        if (bw_grid_tet_sign(u) <= 0) return false;
        for (int k = 0; k < 12; k++)
            if (llabs(u[k / 3][k % 3]) > BW_GRID_MAX) return false;
    }
    return true;
}

static bool within_grid(const cluster *c) {
    for (size_t v = 0; v < c->variable_count; v++)
        if (!(fabs(c->x[v] * c->unit) <= (double)BW_GRID_MAX)) return false;
    return true;
}

static void note_moves(mender *m) {
    cluster *c = &m->c;
    for (size_t i = 0; i < c->vertex_count; i++) {
        int32_t v = c->variable[i];
        for (int k = 0; k < 3 && v != BW_NONE; k++)
            if (c->free[i] & 1 << k) m->moved[c->vertex[i]][k] += llrint(c->x[v++] * c->unit);
    }
}

static double thinnest(const cluster *c, const double *x) { /* relative to the wanted volume */
    double least = INFINITY;
    for (size_t i = 0; i < c->tet_count; i++) least = fmin(least, bw_untangle_volume(&c->shape[i], x));
    return least;
}

/* Solves; true if the values were replaced by better ones. */
static bw_status solve(mender *m, bw_repair_verdict *verdict) {
    cluster *c = &m->c;
    bw_untangle_report found;
    *verdict = BW_REPAIR_TANGLED;
    if (bw_reserve(m->ctx, &c->x, &c->x_room, 2 * c->variable_count)) return m->ctx->error.status;
    memset(c->x, 0, 2 * c->variable_count * sizeof *c->x);
    c->zero = c->x + c->variable_count;
    if (!make_shapes(m)) return BW_OK;
    bool was_good = all_good(m); /* and only thin */
    double before = thinnest(c, c->zero);
    if (bw_untangle(m->ctx, c->shape, c->tet_count, c->variable_count, c->x, &found))
        return m->ctx->error.status;
    if (!(found.smallest > 0) || !within_grid(c)) return BW_OK;
    move_values(m, 1);
    if (!all_good(m) || (was_good && found.smallest <= before)) {
        move_values(m, -1);
        return BW_OK;
    }
    note_moves(m);
    *verdict = BW_REPAIR_DONE;
    return BW_OK;
}

/* Whether the repair left a tet too thin that was not so before. */
static bool became_thin(const cluster *c, size_t i, bool was_bad) {
    return bw_untangle_volume(&c->shape[i], c->x) < BW_REPAIR_THIN &&
           (was_bad || bw_untangle_volume(&c->shape[i], c->zero) >= BW_REPAIR_THIN);
}

/* Says of the cluster's tets what became of them. */
static void judge(mender *m, bw_repair_verdict verdict) {
    const cluster *c = &m->c;
    if (verdict == BW_REPAIR_TANGLED && c->unclear) verdict = BW_REPAIR_UNCLEAR;
    for (size_t i = 0; i < c->vertex_count; i++)
        for (int32_t k = m->stars.first[c->vertex[i]]; k < m->stars.first[c->vertex[i] + 1]; k++) {
            bw_tet t = m->stars.corner[k] / 4;
            if (m->verdict[t] && m->local[t] == BW_NONE)
                m->verdict[t] = c->unclear ? BW_REPAIR_UNCLEAR : BW_REPAIR_HELD;
            else if (m->verdict[t] && verdict != BW_REPAIR_DONE)
                m->verdict[t] = (uint8_t)verdict;
        }
    for (size_t i = 0; i < c->tet_count && verdict == BW_REPAIR_DONE; i++) {
        uint8_t *v = &m->verdict[c->tet[i]];
        *v = became_thin(c, i, *v) ? BW_REPAIR_TANGLED : BW_REPAIR_DONE;
    }
}

static bw_status repair_cluster(mender *m, bw_vertex seed) {
    cluster *c = &m->c;
    bw_repair_verdict verdict = BW_REPAIR_HELD;
    if (gather_vertices(m, seed) || bw_reserve(m->ctx, &c->variable, &c->variable_room, c->vertex_count) ||
        bw_reserve(m->ctx, &c->free, &c->free_room, c->vertex_count))
        return m->ctx->error.status;
    for (size_t i = 0; i < c->vertex_count && c->tet_count <= BW_REPAIR_TETS; i++)
        if (add_variables(m, i)) return m->ctx->error.status;
    if (c->tet_count > BW_REPAIR_TETS)
        verdict = BW_REPAIR_LARGE;
    else if (c->variable_count && solve(m, &verdict))
        return m->ctx->error.status;
    judge(m, verdict);
    for (size_t i = 0; i < c->tet_count; i++) m->local[c->tet[i]] = BW_NONE;
    return BW_OK;
}

/* ---- all of it ---- */

/* One round: every cluster of vertices up to so many edges away. */
static bw_status repair_round(mender *m, int rings, bool *left) {
    if (find_near(m, rings)) return m->ctx->error.status;
    qsort(m->near, m->near_count, sizeof *m->near, compare_vertices);
    memset(m->taken, 0, m->in->mesh->vertex_count);
    *left = false;
    for (size_t i = 0; i < m->near_count; i++)
        if (!m->taken[m->near[i]] && repair_cluster(m, m->near[i])) return m->ctx->error.status;
    for (size_t t = 0; t < m->in->mesh->tet_count; t++) *left = *left || m->verdict[t];
    return BW_OK;
}

static bw_status init(mender *m, const bw_defects *defects) {
    const bw_tet_mesh *mesh = m->in->mesh;
    m->verdict = bw_alloc(m->ctx, mesh->tet_count, 1);
    m->ring = bw_alloc(m->ctx, mesh->vertex_count, 1);
    m->taken = bw_alloc(m->ctx, mesh->vertex_count, 1);
    m->local = bw_alloc(m->ctx, mesh->tet_count, sizeof *m->local);
    m->moved = bw_alloc(m->ctx, mesh->vertex_count, sizeof *m->moved);
    if (m->ctx->error.status) return m->ctx->error.status;
    memset(m->local, -1, mesh->tet_count * sizeof *m->local);
    for (size_t i = 0; i < bw_defects_tets(defects); i++) m->verdict[defects->tet[i]] = BW_REPAIR_TANGLED;
    return bw_stars_init(m->ctx, &m->stars, m->in);
}

static void clear(mender *m) {
    void *blocks[] = {m->verdict,  m->ring,       m->taken,  m->local, m->moved,   m->near,
                      m->c.vertex, m->c.variable, m->c.free, m->c.tet, m->c.shape, m->c.x};
    bw_stars_clear(m->ctx, &m->stars);
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(m->ctx, blocks[i]);
}

static void count_moves(const mender *m, bw_repair_report *report) {
    for (size_t v = 0; v < m->in->mesh->vertex_count; v++) {
        bool any = false;
        for (int k = 0; k < 3; k++) {
            int64_t d = llabs(m->moved[v][k]);
            any = any || d;
            if (d > report->displacement) report->displacement = d;
        }
        report->vertices_moved += any;
    }
}

bw_status bw_repair(bw_context *ctx, const bw_star_input *input, const bw_defects *defects,
                    int64_t (*value)[4][3], bw_repair_verdict *verdict, bw_repair_report *report) {
    mender m = {.ctx = ctx, .in = input, .value = value};
    bool left = true;
    *report = (bw_repair_report){0};
    bw_status status = init(&m, defects);
    for (int rings = 0; status == BW_OK && left && rings <= BW_REPAIR_RINGS; rings++) {
        status = repair_round(&m, rings, &left);
        report->rings = rings;
    }
    for (size_t i = 0; status == BW_OK && i < bw_defects_tets(defects); i++) {
        bw_tet t = defects->tet[i];
        bool good = bw_grid_tet_sign((const int64_t(*)[3])value[t]) > 0; /* perhaps thin, but good */
        verdict[i] = good ? BW_REPAIR_DONE : (bw_repair_verdict)m.verdict[t];
    }
    if (status == BW_OK) count_moves(&m, report);
    clear(&m);
    return status;
}
