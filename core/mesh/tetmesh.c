#include "mesh/tetmesh.h"

#include <stdlib.h>
#include <string.h>

const uint8_t bw_tet_edge_corners[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
const uint8_t bw_tet_edge_of[4][4] = {{0, 0, 1, 2}, {0, 0, 3, 4}, {1, 3, 0, 5}, {2, 4, 5, 0}};

/* A facet or an edge of one tet, on its way to being numbered: sorted vertices (key[2] unused for edges), tet and local number. */
typedef struct {
    bw_vertex key[3];
    int32_t tet;
    int32_t local;
} incidence;

static int compare(const void *a, const void *b) {
    const incidence *x = a, *y = b;
    for (int i = 0; i < 3; i++)
        if (x->key[i] != y->key[i]) return x->key[i] < y->key[i] ? -1 : 1;
    return x->tet != y->tet ? (x->tet < y->tet ? -1 : 1) : (x->local > y->local) - (x->local < y->local);
}

static bool same_key(const incidence *a, const incidence *b) { return !memcmp(a->key, b->key, sizeof a->key); }

static void sort_key(bw_vertex *key, int n) {
    for (int i = 1; i < n; i++)
        for (int j = i; j > 0 && key[j - 1] > key[j]; j--) {
            bw_vertex swap = key[j];
            key[j] = key[j - 1], key[j - 1] = swap;
        }
}

static incidence make_incidence(const bw_tet_mesh *mesh, bw_tet t, int local, int per_tet) {
    incidence x = {.key = {0, 0, 0}, .tet = t, .local = local};
    if (per_tet == 4)
        for (int i = 0, n = 0; i < 4; i++) {
            if (i != local) x.key[n++] = mesh->tet[t][i];
        }
    else
        for (int i = 0; i < 2; i++) x.key[i] = mesh->tet[t][bw_tet_edge_corners[local][i]];
    sort_key(x.key, per_tet == 4 ? 3 : 2);
    return x;
}

/* All facets (per_tet 4) or edges (6) of all tets, sorted: a counting sort by the first vertex, then each bucket. */
static incidence *sorted_incidences(bw_context *ctx, const bw_tet_mesh *mesh, int per_tet) {
    size_t n = mesh->tet_count * (size_t)per_tet;
    incidence *sorted = bw_alloc(ctx, n, sizeof *sorted);
    size_t *begin = bw_alloc(ctx, mesh->vertex_count + 2, sizeof *begin);
    if (!sorted || !begin) goto fail;
    for (size_t i = 0; i < n; i++)
        begin[make_incidence(mesh, (bw_tet)(i / (size_t)per_tet), (int)(i % (size_t)per_tet), per_tet).key[0] + 2]++;
    for (size_t v = 2; v < mesh->vertex_count + 2; v++) begin[v] += begin[v - 1];
    for (size_t i = 0; i < n; i++) {
        incidence x = make_incidence(mesh, (bw_tet)(i / (size_t)per_tet), (int)(i % (size_t)per_tet), per_tet);
        sorted[begin[x.key[0] + 1]++] = x;
    }
    for (size_t v = 0; v < mesh->vertex_count; v++)
        qsort(sorted + begin[v], begin[v + 1] - begin[v], sizeof *sorted, compare);
    bw_free(ctx, begin);
    return sorted;
fail:
    bw_free(ctx, sorted);
    bw_free(ctx, begin);
    return NULL;
}

static bw_status check_corners(bw_context *ctx, const bw_tet_mesh *mesh) {
    size_t bad = 0;
    for (size_t t = 0; t < mesh->tet_count; t++) {
        const bw_vertex *v = mesh->tet[t];
        bool repeats = false;
        for (int i = 0; i < 4; i++)
            for (int j = i + 1; j < 4; j++) repeats = repeats || v[i] == v[j];
        if (!repeats) continue;
        bad++;
        bw_fail_element(ctx, "tet", mesh->tet_id[t], mesh->position[v[0]]);
    }
    return bad ? bw_fail(ctx, BW_E_DUPLICATE, "%zu %s a vertex; the first is tet %lld", bad,
                         bw_words(bad, "tet repeats", "tets repeat"), (long long)ctx->error.elements[0].id)
               : BW_OK;
}

/* Tets that meet at one facet: all but two are at fault; two on the same side of it are the same tet. */
static bw_status check_facet(bw_context *ctx, const bw_tet_mesh *mesh, const incidence *at, size_t count) {
    for (size_t i = 0; i < count; i++)
        for (size_t j = i + 1; j < count; j++)
            if (mesh->tet[at[i].tet][at[i].local] == mesh->tet[at[j].tet][at[j].local]) {
                bw_fail_element(ctx, "tet", mesh->tet_id[at[i].tet], mesh->position[at[0].key[0]]);
                bw_fail_element(ctx, "tet", mesh->tet_id[at[j].tet], mesh->position[at[0].key[0]]);
                return bw_fail(ctx, BW_E_DUPLICATE, "tets %d and %d have the same four vertices", mesh->tet_id[at[i].tet],
                               mesh->tet_id[at[j].tet]);
            }
    for (size_t i = 0; i < count; i++) bw_fail_element(ctx, "tet", mesh->tet_id[at[i].tet], mesh->position[at[0].key[0]]);
    return bw_fail(ctx, BW_E_NONMANIFOLD, "the facet with vertices %d %d %d is shared by %zu tets", at[0].key[0],
                   at[0].key[1], at[0].key[2], count);
}

static size_t count_distinct(const incidence *sorted, size_t n) {
    size_t distinct = 0;
    for (size_t i = 0; i < n; i++) distinct += i == 0 || !same_key(&sorted[i - 1], &sorted[i]);
    return distinct;
}

static bw_status number_facets(bw_context *ctx, bw_tet_mesh *mesh) {
    size_t n = mesh->tet_count * 4;
    incidence *sorted = sorted_incidences(ctx, mesh, 4);
    if (!sorted) return ctx->error.status;
    bw_status status = BW_OK;
    size_t count = mesh->facet_count = count_distinct(sorted, n);
    mesh->tet_facet = bw_alloc(ctx, mesh->tet_count, sizeof *mesh->tet_facet);
    mesh->facet = bw_alloc(ctx, count, sizeof *mesh->facet);
    mesh->facet_tet = bw_alloc(ctx, count, sizeof *mesh->facet_tet);
    if (!mesh->tet_facet || !mesh->facet || !mesh->facet_tet) status = ctx->error.status;
    size_t f = 0;
    for (size_t i = 0, j; i < n && status == BW_OK; i = j, f++) {
        for (j = i + 1; j < n && same_key(&sorted[i], &sorted[j]);) j++;
        if (j - i > 2 || (j - i == 2 && mesh->tet[sorted[i].tet][sorted[i].local] ==
                                            mesh->tet[sorted[i + 1].tet][sorted[i + 1].local])) {
            status = check_facet(ctx, mesh, sorted + i, j - i);
            break;
        }
        memcpy(mesh->facet[f], sorted[i].key, sizeof mesh->facet[f]);
        mesh->facet_tet[f][0] = sorted[i].tet;
        mesh->facet_tet[f][1] = j - i == 2 ? sorted[i + 1].tet : BW_NONE;
        for (size_t k = i; k < j; k++) mesh->tet_facet[sorted[k].tet][sorted[k].local] = (bw_facet)f;
    }
    bw_free(ctx, sorted);
    return status;
}

static bw_status number_edges(bw_context *ctx, bw_tet_mesh *mesh) {
    size_t n = mesh->tet_count * 6;
    incidence *sorted = sorted_incidences(ctx, mesh, 6);
    if (!sorted) return ctx->error.status;
    bw_status status = BW_OK;
    size_t count = mesh->edge_count = count_distinct(sorted, n);
    mesh->tet_edge = bw_alloc(ctx, mesh->tet_count, sizeof *mesh->tet_edge);
    mesh->edge = bw_alloc(ctx, count, sizeof *mesh->edge);
    if (!mesh->tet_edge || !mesh->edge) status = ctx->error.status;
    for (size_t i = 0, e = 0; i < n && status == BW_OK; i++) {
        if (i > 0 && !same_key(&sorted[i - 1], &sorted[i])) e++;
        memcpy(mesh->edge[e], sorted[i].key, sizeof mesh->edge[e]);
        mesh->tet_edge[sorted[i].tet][sorted[i].local] = (bw_edge)e;
    }
    bw_free(ctx, sorted);
    return status;
}

/* A tet on its way to its place: sorted vertices, and its number in the input. */
typedef struct {
    bw_vertex key[4];
    bw_tet id;
} placed;

static int compare_placed(const void *a, const void *b) {
    const placed *x = a, *y = b;
    for (int i = 0; i < 4; i++)
        if (x->key[i] != y->key[i]) return x->key[i] < y->key[i] ? -1 : 1;
    return (x->id > y->id) - (x->id < y->id);
}

static void *permuted(bw_context *ctx, const void *items, size_t size, const placed *order, size_t count) {
    char *out = bw_alloc(ctx, count, size);
    for (size_t t = 0; t < count && out; t++) memcpy(out + t * size, (const char *)items + (size_t)order[t].id * size, size);
    return out;
}

bw_status bw_tet_mesh_order(bw_context *ctx, bw_tet_mesh *mesh) {
    size_t n = mesh->tet_count;
    placed *order = bw_alloc(ctx, n, sizeof *order);
    mesh->tet_id = bw_alloc(ctx, n, sizeof *mesh->tet_id);
    bw_status status = ctx->error.status;
    for (size_t t = 0; t < n && status == BW_OK; t++) {
        memcpy(order[t].key, mesh->tet[t], sizeof order[t].key);
        sort_key(order[t].key, 4);
        order[t].id = (bw_tet)t;
    }
    bool ordered = true;
    for (size_t t = 1; t < n && status == BW_OK; t++) ordered = ordered && compare_placed(&order[t - 1], &order[t]) < 0;
    if (status == BW_OK && !ordered) {
        qsort(order, n, sizeof *order, compare_placed);
        void *tet = permuted(ctx, mesh->tet, sizeof *mesh->tet, order, n);
        void *parameter = mesh->parameter ? permuted(ctx, mesh->parameter, sizeof *mesh->parameter, order, n) : NULL;
        status = ctx->error.status;
        void *old[] = {status == BW_OK ? (void *)mesh->tet : tet, status == BW_OK ? (void *)mesh->parameter : parameter};
        if (status == BW_OK) mesh->tet = tet, mesh->parameter = parameter;
        bw_free(ctx, old[0]), bw_free(ctx, old[1]);
    }
    for (size_t t = 0; t < n && status == BW_OK; t++) mesh->tet_id[t] = order[t].id;
    bw_free(ctx, order);
    return status;
}

bw_status bw_tet_mesh_connect(bw_context *ctx, bw_tet_mesh *mesh) {
    bw_status status = mesh->tet_id ? BW_OK : bw_tet_mesh_order(ctx, mesh);
    if (status == BW_OK) status = check_corners(ctx, mesh);
    if (status == BW_OK) status = number_facets(ctx, mesh);
    if (status == BW_OK) status = number_edges(ctx, mesh);
    return status;
}

static int compare_vertices(const bw_vertex *a, const bw_vertex *b, int n) {
    for (int i = 0; i < n; i++)
        if (a[i] != b[i]) return a[i] < b[i] ? -1 : 1;
    return 0;
}
static int compare_facets(const void *a, const void *b) { return compare_vertices(a, b, 3); }
static int compare_edges(const void *a, const void *b) { return compare_vertices(a, b, 2); }

bw_facet bw_tet_mesh_find_facet(const bw_tet_mesh *mesh, const bw_vertex vertex[3]) {
    bw_vertex key[3] = {vertex[0], vertex[1], vertex[2]};
    sort_key(key, 3);
    bw_vertex(*at)[3] = bsearch(key, mesh->facet, mesh->facet_count, sizeof key, compare_facets);
    return at ? (bw_facet)(at - mesh->facet) : BW_NONE;
}

bw_edge bw_tet_mesh_find_edge(const bw_tet_mesh *mesh, const bw_vertex vertex[2]) {
    bw_vertex key[2] = {vertex[0], vertex[1]};
    sort_key(key, 2);
    bw_vertex(*at)[2] = bsearch(key, mesh->edge, mesh->edge_count, sizeof key, compare_edges);
    return at ? (bw_edge)(at - mesh->edge) : BW_NONE;
}

void bw_tet_mesh_clear(bw_context *ctx, bw_tet_mesh *mesh) {
    void *blocks[] = {mesh->position, mesh->tet, mesh->parameter, mesh->tet_id, mesh->tet_facet, mesh->tet_edge,
                      mesh->facet, mesh->facet_tet, mesh->edge, mesh->wall, mesh->wall_distance,
                      mesh->feature_vertex, mesh->feature_edge, mesh->feature_facet, mesh->hex, mesh->feature_quad};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    memset(mesh, 0, sizeof *mesh);
}

static void centre(const bw_tet_mesh *mesh, const bw_vertex *vertex, int n, double out[3]) {
    for (int k = 0; k < 3; k++) {
        out[k] = 0;
        for (int i = 0; i < n; i++) out[k] += mesh->position[vertex[i]][k] / n;
    }
}

void bw_facet_centre(const bw_tet_mesh *mesh, bw_facet facet, double out[3]) { centre(mesh, mesh->facet[facet], 3, out); }
void bw_tet_centre(const bw_tet_mesh *mesh, bw_tet tet, double out[3]) { centre(mesh, mesh->tet[tet], 4, out); }
void bw_edge_centre(const bw_tet_mesh *mesh, bw_edge edge, double out[3]) { centre(mesh, mesh->edge[edge], 2, out); }
