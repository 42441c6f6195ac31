#include "mesh/seams.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    bw_context *ctx;
    const bw_tet_mesh *mesh;
    const bw_hinges *hinges;
    const int64_t (*value)[4][3];
    const uint8_t *unsure;
    double tolerance;
    bw_seams *seams;
    bw_rotation product[BW_ROTATIONS][BW_ROTATIONS], inverse[BW_ROTATIONS];
} finder;

void bw_seams_clear(bw_context *ctx, bw_seams *seams) {
    bw_free(ctx, seams->rotation);
    bw_free(ctx, seams->align);
    bw_free(ctx, seams->quarters);
    bw_free(ctx, seams->line);
    memset(seams, 0, sizeof *seams);
}

static void blame(finder *w, const char *kind, int32_t id) {
    double centre[3];
    if (*kind == 'f')
        bw_facet_centre(w->mesh, id, centre);
    else
        bw_edge_centre(w->mesh, id, centre);
    bw_fail_element(w->ctx, kind, id, centre);
}

static bool is_unsure(const finder *w, bw_tet t) { return w->unsure && t != BW_NONE && w->unsure[t]; }

static bool facet_unsure(const finder *w, bw_facet f) {
    return is_unsure(w, w->mesh->facet_tet[f][0]) || is_unsure(w, w->mesh->facet_tet[f][1]);
}

static bool hinge_unsure(const finder *w, bw_hinge h) {
    const bw_ring *ring = &w->hinges->ring[h];
    for (int32_t i = ring->begin; w->unsure && i < ring->end; i++)
        if (w->unsure[w->hinges->tet[i]]) return true;
    return false;
}

static double length(const int64_t d[3]) {
    double x = (double)d[0], y = (double)d[1], z = (double)d[2];
    return sqrt(x * x + y * y + z * z);
}

/* The three edge vectors of a facet in the chart of one of its tets: from vertex i to vertex i + 1. */
static void facet_edges(const finder *w, bw_facet f, bw_tet t, int64_t out[3][3]) {
    const int64_t *p[3];
    for (int i = 0; i < 3; i++) p[i] = w->value[t][bw_tet_corner(w->mesh, t, w->mesh->facet[f][i])];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) out[i][k] = p[(i + 1) % 3][k] - p[i][k];
}

/* Sum of squared differences between the turned edges and the other tet's; gives up (infinity) beyond
 * `limit`. */
static double mismatch(bw_rotation r, int64_t from[3][3], int64_t to[3][3], double limit) {
    double sum = 0;
    for (int i = 0; i < 3; i++) {
        int64_t turned[3];
        bw_rotate(r, from[i], turned);
        for (int k = 0; k < 3; k++) sum += (double)(turned[k] - to[i][k]) * (double)(turned[k] - to[i][k]);
        if (sum >= limit) return INFINITY;
    }
    return sum;
}

static bw_rotation nearest_rotation(int64_t from[3][3], int64_t to[3][3]) {
    bw_rotation best = 0;
    double least = mismatch(0, from, to, INFINITY);
    for (bw_rotation r = 1; r < BW_ROTATIONS && least > 0; r++) {
        double sum = mismatch(r, from, to, least);
        if (sum < least) least = sum, best = r;
    }
    return best;
}

/* Largest defect of the transition: in grid units (added to the total) and relative to the shorter version of
 * the edge (returned). */
static double transition_defect(finder *w, bw_rotation r, int64_t from[3][3], int64_t to[3][3]) {
    double relative = 0;
    for (int i = 0; i < 3; i++) {
        int64_t turned[3], off = 0;
        bw_rotate(r, from[i], turned);
        for (int k = 0; k < 3; k++)
            if (llabs(turned[k] - to[i][k]) > off) off = llabs(turned[k] - to[i][k]);
        if (off > w->seams->defect) w->seams->defect = off;
        if (off) relative = fmax(relative, (double)off / fmin(length(from[i]), length(to[i])));
    }
    return relative;
}

static bw_status find_rotations(finder *w) {
    size_t bad = 0;
    for (size_t f = 0; f < w->mesh->facet_count; f++) {
        const bw_tet *t = w->mesh->facet_tet[f];
        int64_t from[3][3], to[3][3];
        if (t[1] == BW_NONE) continue;
        facet_edges(w, (bw_facet)f, t[0], from);
        facet_edges(w, (bw_facet)f, t[1], to);
        w->seams->rotation[f] = nearest_rotation(from, to);
        if (facet_unsure(w, (bw_facet)f)) continue;
        double defect = transition_defect(w, w->seams->rotation[f], from, to);
        w->seams->seamless = fmax(w->seams->seamless, defect);
        if (defect <= w->tolerance) continue;
        blame(w, "facet", (int32_t)f);
        bad++;
    }
    return bad ? bw_fail(w->ctx, BW_E_NOT_SEAMLESS,
                         "the transitions of %zu %s are off by up to %.3g of an edge; %.3g is tolerated",
                         bad, bw_words(bad, "facet", "facets"), w->seams->seamless, w->tolerance)
               : BW_OK;
}

/* Chooses the axis in which a facet varies least; returns its largest defect relative to an edge. */
static double find_axis(finder *w, bw_facet f) {
    int64_t edge[3][3], least = INT64_MAX;
    facet_edges(w, f, w->mesh->facet_tet[f][0], edge);
    for (int8_t k = 0; k < 3; k++) {
        int64_t spread = 0;
        for (int i = 0; i < 3; i++)
            if (llabs(edge[i][k]) > spread) spread = llabs(edge[i][k]);
        if (spread < least) least = spread, w->seams->align[f] = k;
    }
    double relative = 0;
    for (int i = 0; i < 3; i++) {
        int64_t off = llabs(edge[i][w->seams->align[f]]);
        if (off) relative = fmax(relative, (double)off / length(edge[i]));
    }
    return relative;
}

static size_t align_facet(finder *w, bw_facet f) {
    double defect = find_axis(w, f);
    if (facet_unsure(w, f)) return 0;
    w->seams->alignment = fmax(w->seams->alignment, defect);
    if (defect <= w->tolerance) return 0;
    blame(w, "facet", f);
    return 1;
}

static bw_status find_alignment(finder *w) {
    size_t bad = 0;
    for (size_t f = 0; f < w->mesh->facet_count; f++) {
        w->seams->align[f] = -1;
        if (w->mesh->facet_tet[f][1] == BW_NONE) bad += align_facet(w, (bw_facet)f);
    }
    for (size_t i = 0; i < w->mesh->feature_facet_count; i++) {
        bw_facet f = bw_tet_mesh_find_facet(w->mesh, w->mesh->feature_facet[i]);
        if (f == BW_NONE) return bw_fail(w->ctx, BW_E_INDEX, "feature facet %zu is no facet of the mesh", i);
        if (w->seams->align[f] < 0) bad += align_facet(w, f);
    }
    return bad ? bw_fail(w->ctx, BW_E_NOT_ALIGNED,
                         "%zu boundary or feature facets are off their coordinate plane by up to %.3g of an "
                         "edge; %.3g is tolerated",
                         bad, w->seams->alignment, w->tolerance)
               : BW_OK;
}

/* The edge vector of a hinge in the chart of its first tet. */
static void hinge_vector(const finder *w, bw_hinge h, int64_t out[3]) {
    const bw_ring *ring = &w->hinges->ring[h];
    bw_tet t = w->hinges->tet[ring->begin];
    const bw_vertex *v = w->mesh->edge[ring->edge];
    const int64_t *a = w->value[t][bw_tet_corner(w->mesh, t, v[0])],
                  *b = w->value[t][bw_tet_corner(w->mesh, t, v[1])];
    for (int k = 0; k < 3; k++) out[k] = b[k] - a[k];
}

/* Parametric dihedral angle of a positive tet at the edge from corner c[0] to c[1]: the normals of its two
 * facets there have the cross product volume * edge. With `sign` the angle of an inverted tet is negative. */
static double wedge_angle(const int64_t value[4][3], const int c[4], bool sign) {
    double d[3][3], n[2][3];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) d[i][k] = (double)(value[c[i + 1]][k] - value[c[0]][k]);
    for (int i = 0; i < 2; i++)
        for (int k = 0; k < 3; k++)
            n[i][k] = d[0][(k + 1) % 3] * d[i + 1][(k + 2) % 3] - d[0][(k + 2) % 3] * d[i + 1][(k + 1) % 3];
    double dot = 0, volume = 0, edge = 0;
    for (int k = 0; k < 3; k++) {
        dot += n[0][k] * n[1][k];
        volume += n[0][k] * d[2][k];
        edge += d[0][k] * d[0][k];
    }
    return atan2((sign ? volume : fabs(volume)) * sqrt(edge), dot);
}

static long hinge_quarters(const finder *w, bw_hinge h) {
    const bw_ring *ring = &w->hinges->ring[h];
    double sum = 0;
    for (int32_t i = ring->begin; i < ring->end; i++) {
        bw_tet t = w->hinges->tet[i];
        int local = 0, c[4];
        while (w->mesh->tet_edge[t][local] != ring->edge) local++;
        bw_hinge_corners(w->mesh, t, local, c);
        sum += wedge_angle(w->value[t], c, is_unsure(w, t));
    }
    return lround(sum / (M_PI / 2));
}

/* Composition of the rotations met on the way from the first tet of the ring to the last one, and back to it
 * if closed. */
static bw_rotation monodromy(const finder *w, bw_hinge h) {
    const bw_ring *ring = &w->hinges->ring[h];
    bw_rotation total = 0;
    for (int32_t i = ring->begin; i < ring->end - ring->open; i++) {
        bw_facet f = w->hinges->exit[i];
        bw_rotation r = w->seams->rotation[f];
        if (w->mesh->facet_tet[f][0] != w->hinges->tet[i]) r = w->inverse[r];
        total = w->product[r][total];
    }
    return total;
}

/* Quarter turn, counterclockwise, about the coordinate axis with the given sense. */
static void quarter_turn(int axis, int sense, int64_t u[3]) {
    int i = (axis + 1) % 3, j = (axis + 2) % 3;
    int64_t old = u[i];
    u[i] = -sense * u[j];
    u[j] = sense * old;
}

/* A closed hinge of q quarter turns: unfolded in the first tet's chart the ring closes after a turn by q
 * quarters, so its monodromy is the opposite turn, about a coordinate axis that is the edge's unless it is
 * the identity. */
static bool closed_agrees(const bw_rotation around, long q, int axis, const int64_t vector[3]) {
    if (q % 4 == 0) return around == 0;
    if (around == 0 || bw_rotation_fixed_axis(around) != axis) return false;
    for (int k = 0; k < 3; k++) {
        int64_t u[3] = {k == 0, k == 1, k == 2}, turned[3];
        bw_rotate(around, u, turned);
        for (long i = 0; i < q % 4; i++) quarter_turn(axis, vector[axis] > 0 ? 1 : -1, turned);
        if (memcmp(u, turned, sizeof u)) return false;
    }
    return true;
}

/* Outward unit normal of a boundary facet in the chart of its tet. */
static void outward(const finder *w, bw_facet f, int64_t out[3]) {
    bw_tet t = w->mesh->facet_tet[f][0];
    int apex = 0, k = w->seams->align[f];
    while (w->mesh->tet_facet[t][apex] != f) apex++;
    const int64_t *on = w->value[t][(apex + 1) % 4];
    memset(out, 0, 3 * sizeof *out);
    out[k] = on[k] > w->value[t][apex][k] ? 1 : -1;
}

/* An open hinge of q quarter turns: turning the inward normal of its first facet by them gives the outward
 * normal of its last. */
static bool open_agrees(const finder *w, bw_hinge h, bw_rotation across, long q, const int64_t vector[3]) {
    const bw_ring *ring = &w->hinges->ring[h];
    int64_t first[3], last[3];
    outward(w, ring->entry, first);
    outward(w, w->hinges->exit[ring->end - 1], last);
    bw_rotate(w->inverse[across], last, last);
    int64_t turned[3] = {-first[0], -first[1], -first[2]};
    if (q % 4 == 2)
        for (int k = 0; k < 3; k++) turned[k] = -turned[k];
    if (q % 2) {
        int axis = 0;
        while (axis < 3 && (first[axis] || last[axis])) axis++;
        if (axis == 3 || !memcmp(first, last, sizeof first)) return false;
        for (long i = 0; i < q % 4; i++) quarter_turn(axis, vector[axis] > 0 ? 1 : -1, turned);
    }
    return !memcmp(turned, last, sizeof turned);
}

/* The axis an edge vector is closest to, and how far it is off it, relative to its length. */
static int nearest_axis(const int64_t d[3], double *defect) {
    int axis = 0;
    int64_t off = 0;
    for (int k = 1; k < 3; k++)
        if (llabs(d[k]) > llabs(d[axis])) axis = k;
    for (int k = 0; k < 3; k++)
        if (k != axis && llabs(d[k]) > off) off = llabs(d[k]);
    *defect = off ? (double)off / length(d) : 0;
    return axis;
}

/* Decides one hinge; false if it cannot be part of a seamless map. */
static bool find_turns(finder *w, bw_hinge h) {
    bool open = w->hinges->ring[h].open;
    int64_t vector[3];
    double defect;
    hinge_vector(w, h, vector);
    int axis = nearest_axis(vector, &defect);
    long q = hinge_quarters(w, h);
    bw_rotation around = monodromy(w, h);
    w->seams->line[h] = -1;
    if (hinge_unsure(w, h)) {
        w->seams->quarters[h] = (uint16_t)(q < 0 || q > UINT16_MAX ? 0 : q);
        return true;
    }
    if (q <= 0 || q > UINT16_MAX) return false;
    w->seams->quarters[h] = (uint16_t)q;
    if (!(open ? open_agrees(w, h, around, q, vector) : closed_agrees(around, q, axis, vector))) return false;
    bw_edge e = w->hinges->ring[h].edge;
    bool manifold = w->hinges->first[e + 1] - w->hinges->first[e] == 1;
    if (manifold && bw_seams_regular(w->seams, w->hinges, h)) return true;
    if (q % (open ? 2 : 4) == 0) w->seams->line[h] = (int8_t)axis;
    w->seams->alignment = fmax(w->seams->alignment, defect);
    return defect <= w->tolerance;
}

static bw_status find_hinges(finder *w) {
    size_t bad = 0;
    for (size_t h = 0; h < w->hinges->count; h++) {
        if (find_turns(w, (bw_hinge)h)) continue;
        blame(w, "edge", w->hinges->ring[h].edge);
        bad++;
    }
    return bad ? bw_fail(w->ctx, BW_E_SINGULAR,
                         "%zu %s singular but not aligned, or of an angle that the transitions around do not agree with",
                         bad, bw_words(bad, "edge is", "edges are"))
               : BW_OK;
}

static bw_status find_feature_edges(finder *w) {
    size_t bad = 0;
    for (size_t i = 0; i < w->mesh->feature_edge_count; i++) {
        bw_edge e = bw_tet_mesh_find_edge(w->mesh, w->mesh->feature_edge[i]);
        if (e == BW_NONE) return bw_fail(w->ctx, BW_E_INDEX, "feature edge %zu is no edge of the mesh", i);
        for (bw_hinge h = w->hinges->first[e]; h < w->hinges->first[e + 1]; h++) {
            int64_t vector[3];
            double defect;
            hinge_vector(w, h, vector);
            w->seams->line[h] = (int8_t)nearest_axis(vector, &defect);
            if (hinge_unsure(w, h)) continue;
            w->seams->alignment = fmax(w->seams->alignment, defect);
            if (defect <= w->tolerance) continue;
            blame(w, "edge", e);
            bad++;
        }
    }
    return bad ? bw_fail(w->ctx, BW_E_NOT_ALIGNED, "%zu feature edges run along no coordinate axis", bad)
               : BW_OK;
}

bw_status bw_seams_init(bw_context *ctx, bw_seams *seams, const bw_tet_mesh *mesh, const bw_hinges *hinges,
                        const int64_t (*value)[4][3], const uint8_t *unsure, double tolerance) {
    finder w = {.ctx = ctx, .mesh = mesh, .hinges = hinges, .value = value, .unsure = unsure, .tolerance = tolerance,
                .seams = seams};
    for (bw_rotation a = 0; a < BW_ROTATIONS; a++) {
        w.inverse[a] = bw_rotation_inverse(a);
        for (bw_rotation b = 0; b < BW_ROTATIONS; b++) w.product[a][b] = bw_rotation_compose(a, b);
    }
    *seams = (bw_seams){0};
    seams->rotation = bw_alloc(ctx, mesh->facet_count, sizeof *seams->rotation);
    seams->align = bw_alloc(ctx, mesh->facet_count, sizeof *seams->align);
    seams->quarters = bw_alloc(ctx, hinges->count, sizeof *seams->quarters);
    seams->line = bw_alloc(ctx, hinges->count, sizeof *seams->line);
    bw_status status = ctx->error.status;
    if (status == BW_OK) status = find_rotations(&w);
    if (status == BW_OK) status = find_alignment(&w);
    if (status == BW_OK) status = find_hinges(&w);
    if (status == BW_OK) status = find_feature_edges(&w);
    seams->exact = seams->defect == 0 && seams->alignment == 0;
    return status;
}

/* ---- facets next to unsure tets ---- */

int64_t bw_seams_reach(const bw_tet_mesh *mesh, const int64_t (*value)[4][3], bw_facet f) {
    int64_t most = 0;
    for (int i = 0; i < 2 && mesh->facet_tet[f][i] != BW_NONE; i++)
        for (int e = 0; e < 6; e++)
            for (int k = 0; k < 3; k++) {
                const int64_t(*u)[3] = value[mesh->facet_tet[f][i]];
                int64_t d = llabs(u[bw_tet_edge_corners[e][0]][k] - u[bw_tet_edge_corners[e][1]][k]);
                if (d > most) most = d;
            }
    return most;
}

static int64_t misfit(bw_rotation r, int64_t from[3][3], int64_t to[3][3]) {
    int64_t most = 0;
    for (int i = 0; i < 3; i++) {
        int64_t turned[3];
        bw_rotate(r, from[i], turned);
        for (int k = 0; k < 3; k++)
            if (llabs(turned[k] - to[i][k]) > most) most = llabs(turned[k] - to[i][k]);
    }
    return most;
}

/* Largest difference between what the two tets of a facet say about its corners. */
static int64_t chart_difference(const finder *w, bw_facet f) {
    const bw_tet *t = w->mesh->facet_tet[f];
    int64_t most = 0;
    for (int i = 0; i < 3; i++) {
        const int64_t *a = w->value[t[0]][bw_tet_corner(w->mesh, t[0], w->mesh->facet[f][i])];
        const int64_t *b = w->value[t[1]][bw_tet_corner(w->mesh, t[1], w->mesh->facet[f][i])];
        for (int k = 0; k < 3; k++)
            if (llabs(a[k] - b[k]) > most) most = llabs(a[k] - b[k]);
    }
    return most;
}

bw_seams_clarity bw_seams_facet_clear(const bw_seams *seams, const bw_tet_mesh *mesh, const int64_t (*value)[4][3],
                                      bw_facet f, double tolerance) {
    const finder w = {.mesh = mesh, .value = value};
    const bw_tet *t = mesh->facet_tet[f];
    int64_t from[3][3], to[3][3], second = INT64_MAX;
    bw_rotation best = seams->rotation[f];
    facet_edges(&w, f, t[0], from);
    facet_edges(&w, f, t[1], to);
    int64_t defect = misfit(best, from, to);
    if ((double)defect > tolerance * (double)bw_seams_reach(mesh, value, f)) return BW_SEAM_TORN;
    for (bw_rotation r = 0; r < BW_ROTATIONS; r++) {
        int64_t other = r == best ? INT64_MAX : misfit(r, from, to);
        if (other < second) second = other;
    }
    int64_t noise = 16 * (1 + (defect > seams->defect ? defect : seams->defect));
    return second > noise || (best == 0 && chart_difference(&w, f) <= noise) ? BW_SEAM_CLEAR : BW_SEAM_AMBIGUOUS;
}
