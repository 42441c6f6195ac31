#include "igm/assemble.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

static const int exponents[] = {20, 28, 36};

/* ---- values ---- */

static void set_values(const bw_frame *frame, const double *x, int exponent, int64_t (*value)[4][3]) {
    for (size_t i = 0; i < 12 * frame->tet_count; i++) {
        const bw_frame_tet *t = &frame->tet[i / 12];
        size_t c = i / 3 % 4, k = i % 3;
        int32_t v = t->variable[c][k];
        value[i / 12][c][k] = t->at[c][k] * ((int64_t)1 << exponent) + (v == BW_NONE ? 0 : t->sign[c][k] * llround(ldexp(x[v], exponent)));
    }
}

/* Whether all values fit onto the grid with that exponent. */
static bool fits(const bw_frame *frame, int exponent) {
    double most = 0;
    for (size_t i = 0; i < 12 * frame->tet_count; i++) most = fmax(most, fabs(frame->tet[i / 12].u[i / 3 % 4][i % 3]));
    return ldexp(most + 1, exponent) < (double)BW_GRID_MAX;
}

static bool all_positive(const bw_frame *frame, int64_t (*value)[4][3]) {
    for (size_t t = 0; t < frame->tet_count; t++)
        if (bw_grid_tet_sign((const int64_t(*)[3])value[t]) <= 0) return false;
    return true;
}

/* ---- features ---- */

typedef struct {
    bw_vertex v[3]; /* ascending; v[2] unused for edges */
} key;

static int compare_keys(const void *a, const void *b) {
    const key *x = a, *y = b;
    for (int i = 0; i < 3; i++)
        if (x->v[i] != y->v[i]) return x->v[i] < y->v[i] ? -1 : 1;
    return 0;
}

static void sort3(bw_vertex *v, int n) {
    for (int i = 1; i < n; i++)
        for (int j = i; j > 0 && v[j - 1] > v[j]; j--) {
            bw_vertex swap = v[j];
            v[j] = v[j - 1], v[j - 1] = swap;
        }
}

/* The feature edges (n = 2) or facets (n = 3) of all tets, each once, ascending. */
static bw_status list_features(bw_context *ctx, const bw_frame *frame, int n, key **out, size_t *count) {
    size_t room = 0, kept = 0;
    *count = 0;
    *out = NULL;
    for (size_t t = 0; t < frame->tet_count; t++)
        for (int i = 0; i < (n == 2 ? 6 : 4); i++) {
            const bw_frame_tet *f = &frame->tet[t];
            if (!((n == 2 ? f->feature_edges : f->feature_facets) >> i & 1)) continue;
            if (bw_reserve(ctx, out, &room, *count + 1)) return ctx->error.status;
            key *k = &(*out)[(*count)++];
            *k = (key){{0, 0, 0}};
            for (int c = 0, m = 0; c < 4; c++)
                if (n == 2 ? c == bw_tet_edge_corners[i][0] || c == bw_tet_edge_corners[i][1] : c != i) k->v[m++] = f->vertex[c];
            sort3(k->v, n);
        }
    if (*count) qsort(*out, *count, sizeof **out, compare_keys);
    for (size_t i = 0; i < *count; i++)
        if (!kept || compare_keys(&(*out)[kept - 1], &(*out)[i])) (*out)[kept++] = (*out)[i];
    *count = kept;
    return BW_OK;
}

static bw_status set_features(bw_context *ctx, const bw_tet_mesh *input, const bw_frame *frame, bw_tet_mesh *mesh) {
    key *edge = NULL, *facet = NULL;
    bw_status status = list_features(ctx, frame, 2, &edge, &mesh->feature_edge_count);
    if (status == BW_OK) status = list_features(ctx, frame, 3, &facet, &mesh->feature_facet_count);
    mesh->feature_vertex_count = input->feature_vertex_count;
    if (status == BW_OK) {
        mesh->feature_vertex = bw_alloc(ctx, mesh->feature_vertex_count, sizeof *mesh->feature_vertex);
        mesh->feature_edge = bw_alloc(ctx, mesh->feature_edge_count, sizeof *mesh->feature_edge);
        mesh->feature_facet = bw_alloc(ctx, mesh->feature_facet_count, sizeof *mesh->feature_facet);
        status = ctx->error.status;
    }
    if (status == BW_OK) {
        for (size_t i = 0; i < mesh->feature_vertex_count; i++) mesh->feature_vertex[i] = input->feature_vertex[i];
        for (size_t i = 0; i < mesh->feature_edge_count; i++) memcpy(mesh->feature_edge[i], edge[i].v, sizeof mesh->feature_edge[i]);
        for (size_t i = 0; i < mesh->feature_facet_count; i++) memcpy(mesh->feature_facet[i], facet[i].v, sizeof mesh->feature_facet[i]);
    }
    bw_free(ctx, edge);
    bw_free(ctx, facet);
    return status;
}

/* ---- the whole ---- */

static bw_status set_mesh(bw_context *ctx, const bw_tet_mesh *input, const bw_frame *frame, bw_tet_mesh *mesh) {
    mesh->vertex_count = frame->vertex_count, mesh->tet_count = frame->tet_count;
    mesh->mirrored = input->mirrored;
    mesh->position = bw_alloc(ctx, mesh->vertex_count, sizeof *mesh->position);
    mesh->tet = bw_alloc(ctx, mesh->tet_count, sizeof *mesh->tet);
    bw_status status = ctx->error.status;
    if (status != BW_OK) return status;
    memcpy(mesh->position, frame->position, mesh->vertex_count * sizeof *mesh->position);
    for (size_t t = 0; t < mesh->tet_count; t++) memcpy(mesh->tet[t], frame->tet[t].vertex, sizeof mesh->tet[t]);
    status = set_features(ctx, input, frame, mesh);
    return status == BW_OK ? bw_tet_mesh_connect(ctx, mesh) : status;
}

static bw_status fill(bw_context *ctx, const bw_tet_mesh *input, const bw_frame *frame, int exponent, int64_t (*value)[4][3], bw_igm *igm) {
    bw_status status = set_mesh(ctx, input, frame, &igm->mesh);
    if (status == BW_OK) {
        igm->map.exponent = exponent;
        igm->map.value = bw_alloc(ctx, frame->tet_count, sizeof *igm->map.value);
        igm->home = bw_alloc(ctx, frame->tet_count, sizeof *igm->home);
        status = ctx->error.status;
    }
    for (size_t t = 0; t < frame->tet_count && status == BW_OK; t++) { /* tet_id: where it was before the tets were put in order */
        memcpy(igm->map.value[t], value[igm->mesh.tet_id[t]], sizeof igm->map.value[t]);
        igm->home[t] = frame->tet[igm->mesh.tet_id[t]].home;
    }
    return status;
}

/* Whether the map winds around edges as it should; marks the tets where it does not. */
static bool winds_right(const bw_frame *frame, const bw_igm *igm, uint8_t *wound) {
    bool right = true;
    for (size_t i = 0; i < 6 * frame->tet_count; i++) {
        bw_tet tet = igm->mesh.tet_id[i / 6];
        if (igm->map.quarters[igm->mesh.tet_edge[i / 6][i % 6]] == frame->tet[tet].quarters[i % 6]) continue;
        wound[tet] = 1;
        right = false;
    }
    return right;
}

static bw_status make(bw_context *ctx, const bw_tet_mesh *input, const bw_frame *frame, int exponent, int64_t (*value)[4][3], bw_igm *igm, bool *valid, uint8_t *wound) {
    bw_status status = fill(ctx, input, frame, exponent, value, igm);
    if (status != BW_OK) return status;
    bw_context apart = *ctx; /* wrong turns around an edge are found here, and no failure of the job */
    status = bw_grid_map_derive(&apart, &igm->mesh, &igm->map);
    ctx->memory = apart.memory;
    *valid = (status == BW_OK || status == BW_E_SINGULAR) && winds_right(frame, igm, wound) && status == BW_OK; /* quarters are known in both cases */
    if (status == BW_E_SINGULAR || status == BW_E_NOT_ALIGNED || (status == BW_OK && !*valid)) {
        bw_log(ctx, "a map without inverted tets is refused: %s", status == BW_OK ? "it winds around an edge as in no map of the input" : apart.error.message);
        bw_igm_clear(ctx, igm);
        return BW_OK;
    }
    if (status != BW_OK) {
        ctx->error = apart.error;
        return status;
    }
    for (size_t t = 0; t < frame->tet_count; t++) igm->mesh.tet_id[t] = input->tet_id[frame->tet[igm->mesh.tet_id[t]].origin];
    return bw_igm_check(ctx, igm);
}

bw_status bw_igm_assemble(bw_context *ctx, const bw_tet_mesh *input, const bw_frame *frame, const double *x, bw_igm *igm, bool *valid, uint8_t *wound) {
    int64_t (*value)[4][3] = bw_alloc(ctx, frame->tet_count, sizeof *value);
    bw_status status = ctx->error.status;
    memset(igm, 0, sizeof *igm);
    *valid = false;
    for (size_t i = 0; i < sizeof exponents / sizeof *exponents && status == BW_OK && fits(frame, exponents[i]); i++) {
        set_values(frame, x, exponents[i], value);
        if (!all_positive(frame, value)) continue;
        status = make(ctx, input, frame, exponents[i], value, igm, valid, wound);
        break;
    }
    bw_free(ctx, value);
    if (status == BW_OK) return BW_OK;
    *valid = false;
    bw_igm_clear(ctx, igm);
    return status;
}
