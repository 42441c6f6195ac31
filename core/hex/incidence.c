#include "hex/incidence.h"

#include <stdlib.h>
#include <string.h>

#include "base/parallel.h"

enum { FEW = 64 }; /* items at a vertex, up to which the simplest way is the fastest */

const uint8_t bw_hex_face_corner[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
const uint8_t bw_hex_edge_corner[12][2] = {{0, 1}, {2, 3}, {4, 5}, {6, 7}, {0, 2}, {4, 6}, {1, 3}, {5, 7}, {0, 4}, {1, 5}, {2, 6}, {3, 7}};

/* Buckets by lowest vertex, filled by threads that have a range of vertices each and look at all hexes: what is in a bucket, and its order, does not depend on their
 * number. begin[v] holds the number of items of v before lay_out, the end of its bucket after; each item then goes to --begin[v]. */
static void lay_out(uint32_t *begin, size_t vertex_count) {
    uint32_t sum = 0;
    for (size_t v = 0; v < vertex_count; v++) begin[v] = sum += begin[v];
    begin[vertex_count] = sum;
}

enum { LEAST = 4096 }; /* vertices per thread at least */

static bw_status check_size(bw_context *ctx, const bw_hex_mesh *mesh) {
    return mesh->hex_count <= UINT32_MAX / 12 - 1 ? BW_OK : bw_fail(ctx, BW_E_LIMIT, "more than 350 million hexes");
}

/* ---- mates --------------------------------------------------------------------------------------------------------- */

/* A quad's vertices, ascending, and the one across from the lowest: the same for both hexes that share it. */
typedef struct {
    bw_hvertex vertex[4], across;
} quad_key;

static quad_key key_of(const bw_hvertex *hex, int face) {
    const uint8_t *c = bw_hex_face_corner[face];
    int at = 0;
    for (int i = 1; i < 4; i++)
        if (hex[c[i]] < hex[c[at]]) at = i;
    bw_hvertex a = hex[c[(at + 1) & 3]], b = hex[c[(at + 3) & 3]], across = hex[c[at ^ 2]], low = a < b ? a : b, high = a < b ? b : a;
    return (quad_key){{hex[c[at]], across < low ? across : low, across < low ? low : across < high ? across : high, across < high ? high : across}, across};
}

static bool same_quad(const quad_key *a, const quad_key *b) { return a->vertex[1] == b->vertex[1] && a->vertex[2] == b->vertex[2] && a->vertex[3] == b->vertex[3]; }

typedef struct {
    const bw_hex_mesh *mesh;
    uint32_t *begin, *item, *mate;
    uint32_t crowd[BW_PARALLEL_MOST]; /* [range] the lowest face in a crowd */
} matching;

/* Pairs quads in order. Those that find more than one with the same vertices, or one with other edges between them, are a crowd. */
static void match_few(matching *w, const uint32_t *item, size_t count, uint32_t *crowd) {
    quad_key key[FEW];
    for (size_t i = 0; i < count; i++) key[i] = key_of(w->mesh->hex[item[i] / 6], (int)(item[i] % 6));
    for (size_t i = 0; i < count; i++)
        for (size_t j = i + 1; j < count; j++) {
            uint32_t x = item[i], y = item[j];
            if (!same_quad(&key[i], &key[j])) continue;
            if (key[i].across == key[j].across && w->mate[x] == BW_HEX_NO_MATE && w->mate[y] == BW_HEX_NO_MATE) w->mate[x] = y, w->mate[y] = x;
            else if (x < *crowd) *crowd = x;
        }
}

typedef struct {
    quad_key key;
    uint32_t item;
} keyed;

static int by_quad(const void *a, const void *b) {
    const keyed *x = a, *y = b;
    for (int i = 1; i < 4; i++)
        if (x->key.vertex[i] != y->key.vertex[i]) return x->key.vertex[i] < y->key.vertex[i] ? -1 : 1;
    return (x->item > y->item) - (x->item < y->item);
}

static bw_status match_many(bw_context *ctx, matching *w, const uint32_t *item, size_t count, uint32_t *crowd) {
    keyed *list = bw_alloc(ctx, count, sizeof *list);
    if (!list) return ctx->error.status;
    for (size_t i = 0; i < count; i++) list[i] = (keyed){key_of(w->mesh->hex[item[i] / 6], (int)(item[i] % 6)), item[i]};
    qsort(list, count, sizeof *list, by_quad);
    for (size_t i = 0, j; i < count; i = j) {
        for (j = i + 1; j < count && same_quad(&list[i].key, &list[j].key);) j++;
        bool pair = j - i > 1 && list[i].key.across == list[i + 1].key.across;
        if (pair) w->mate[list[i].item] = list[i + 1].item, w->mate[list[i + 1].item] = list[i].item;
        if ((j - i > 2 || (j - i == 2 && !pair)) && list[i].item < *crowd) *crowd = list[i].item;
    }
    bw_free(ctx, list);
    return BW_OK;
}

static void lowest_of_quads(const bw_hvertex *h, bw_hvertex low[6]) {
    for (int f = 0; f < 6; f++) {
        const uint8_t *c = bw_hex_face_corner[f];
        bw_hvertex a = h[c[0]] < h[c[1]] ? h[c[0]] : h[c[1]], b = h[c[2]] < h[c[3]] ? h[c[2]] : h[c[3]];
        low[f] = a < b ? a : b;
    }
}

static bw_status count_quads(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    matching *w = user;
    (void)ctx, (void)range;
    for (size_t h = 0; h < w->mesh->hex_count; h++) {
        bw_hvertex low[6];
        lowest_of_quads(w->mesh->hex[h], low);
        for (int f = 0; f < 6; f++)
            if ((size_t)low[f] >= begin && (size_t)low[f] < end) w->begin[low[f]]++;
    }
    return BW_OK;
}

static bw_status list_quads(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    matching *w = user;
    (void)ctx, (void)range;
    for (size_t h = w->mesh->hex_count; h-- > 0;) {
        bw_hvertex low[6];
        lowest_of_quads(w->mesh->hex[h], low);
        for (int f = 6; f-- > 0;)
            if ((size_t)low[f] >= begin && (size_t)low[f] < end) w->item[--w->begin[low[f]]] = (uint32_t)(6 * h) + (uint32_t)f;
    }
    return BW_OK;
}

static bw_status match_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    matching *w = user;
    (void)ctx;
    for (size_t v = begin; v < end; v++) {
        size_t count = w->begin[v + 1] - w->begin[v];
        if (count <= FEW) match_few(w, w->item + w->begin[v], count, &w->crowd[range]);
    }
    return BW_OK;
}

static bw_status match_all(bw_context *ctx, matching *w) {
    size_t n = w->mesh->vertex_count;
    int ranges = bw_parallel_ranges(ctx, n, LEAST);
    for (int i = 0; i < ranges; i++) w->crowd[i] = BW_HEX_NO_MATE;
    if (bw_parallel(ctx, n, ranges, count_quads, w) || bw_poll(ctx)) return ctx->error.status;
    lay_out(w->begin, n);
    if (bw_parallel(ctx, n, ranges, list_quads, w) || bw_poll(ctx) || bw_parallel(ctx, n, ranges, match_range, w)) return ctx->error.status;
    for (int i = 1; i < ranges; i++)
        if (w->crowd[i] < w->crowd[0]) w->crowd[0] = w->crowd[i];
    for (size_t v = 0; v < n; v++) { /* these allocate */
        size_t count = w->begin[v + 1] - w->begin[v];
        if (count > FEW && match_many(ctx, w, w->item + w->begin[v], count, &w->crowd[0])) return ctx->error.status;
    }
    return BW_OK;
}

bw_status bw_hex_mates_and_crowd(bw_context *ctx, const bw_hex_mesh *mesh, uint32_t **mate, uint32_t *crowd) {
    size_t count = 6 * mesh->hex_count;
    matching w = {.mesh = mesh, .crowd = {BW_HEX_NO_MATE}};
    *mate = NULL;
    bw_status status = check_size(ctx, mesh);
    if (status != BW_OK) return status;
    w.begin = bw_alloc(ctx, mesh->vertex_count + 1, sizeof *w.begin);
    w.item = w.begin ? bw_alloc(ctx, count, sizeof *w.item) : NULL;
    *mate = w.mate = w.item ? bw_alloc(ctx, count, sizeof *w.mate) : NULL;
    status = w.mate ? BW_OK : ctx->error.status;
    if (w.mate) memset(w.mate, 0xff, count * sizeof *w.mate);
    if (status == BW_OK) status = match_all(ctx, &w);
    *crowd = w.crowd[0];
    if (status != BW_OK) bw_free(ctx, w.mate), *mate = NULL;
    bw_free(ctx, w.begin);
    bw_free(ctx, w.item);
    return status;
}

bw_status bw_hex_mates(bw_context *ctx, const bw_hex_mesh *mesh, uint32_t **mate) {
    uint32_t crowd;
    return bw_hex_mates_and_crowd(ctx, mesh, mate, &crowd);
}

/* ---- edges --------------------------------------------------------------------------------------------------------- */

static int ascending(const void *a, const void *b) {
    const bw_hvertex *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

static void sort(bw_hvertex *item, uint32_t count) {
    if (count > FEW) {
        qsort(item, count, sizeof *item, ascending);
        return;
    }
    for (uint32_t i = 1; i < count; i++) {
        bw_hvertex x = item[i];
        uint32_t j = i;
        for (; j && item[j - 1] > x; j--) item[j] = item[j - 1];
        item[j] = x;
    }
}

typedef struct {
    const bw_hex_mesh *mesh;
    bw_hex_edges *edges;
    uint32_t first[BW_PARALLEL_MOST + 1], used[BW_PARALLEL_MOST]; /* [range] of its edges: where they begin, and how many there are in the end */
    size_t vertex[BW_PARALLEL_MOST];                              /* [range] its first */
} counting;

static bw_status count_edges(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    counting *w = user;
    (void)ctx;
    w->vertex[range] = begin;
    for (size_t h = 0; h < w->mesh->hex_count; h++)
        for (int e = 0; e < 12; e++) {
            bw_hvertex a = w->mesh->hex[h][bw_hex_edge_corner[e][0]], b = w->mesh->hex[h][bw_hex_edge_corner[e][1]], low = a < b ? a : b;
            if ((size_t)low >= begin && (size_t)low < end) w->edges->begin[low]++;
        }
    return BW_OK;
}

static bw_status list_edges(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    counting *w = user;
    (void)ctx, (void)range;
    for (size_t h = 0; h < w->mesh->hex_count; h++)
        for (int e = 0; e < 12; e++) {
            bw_hvertex a = w->mesh->hex[h][bw_hex_edge_corner[e][0]], b = w->mesh->hex[h][bw_hex_edge_corner[e][1]], low = a < b ? a : b;
            if ((size_t)low >= begin && (size_t)low < end) w->edges->high[--w->edges->begin[low]] = a < b ? b : a;
        }
    return BW_OK;
}

/* An edge as often as it has hexes -> once, with its valence; those of a range at its beginning. */
static bw_status count_equal(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    counting *w = user;
    bw_hex_edges *g = w->edges;
    uint32_t n = w->first[range], from = n;
    (void)ctx;
    for (size_t v = begin; v < end; v++) {
        uint32_t to = v + 1 < end ? g->begin[v + 1] : w->first[range + 1], i = from;
        sort(g->high + from, to - from);
        for (g->begin[v] = n; i < to; i++) {
            if (n == g->begin[v] || g->high[i] != g->high[n - 1]) g->high[n] = g->high[i], g->valence[n++] = 0;
            g->valence[n - 1]++;
        }
        from = to;
    }
    w->used[range] = n - w->first[range];
    return BW_OK;
}

/* Takes the gaps between ranges away. */
static void close_up(counting *w, int ranges) {
    bw_hex_edges *g = w->edges;
    uint32_t n = w->used[0];
    for (int r = 1; r < ranges; r++) {
        uint32_t gap = w->first[r] - n;
        memmove(g->high + n, g->high + w->first[r], w->used[r] * sizeof *g->high);
        memmove(g->valence + n, g->valence + w->first[r], w->used[r] * sizeof *g->valence);
        for (size_t v = w->vertex[r], end = r + 1 < ranges ? w->vertex[r + 1] : w->mesh->vertex_count; v < end; v++) g->begin[v] -= gap;
        n += w->used[r];
    }
    g->begin[w->mesh->vertex_count] = n;
}

bw_status bw_hex_edges_init(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_edges *edges) {
    counting w = {.mesh = mesh, .edges = edges};
    size_t n = mesh->vertex_count, count = 12 * mesh->hex_count;
    int ranges = bw_parallel_ranges(ctx, n, LEAST);
    *edges = (bw_hex_edges){0};
    if (check_size(ctx, mesh)) return ctx->error.status;
    edges->begin = bw_alloc(ctx, n + 1, sizeof *edges->begin);
    edges->high = edges->begin ? bw_alloc(ctx, count, sizeof *edges->high) : NULL;
    edges->valence = edges->high ? bw_alloc(ctx, count, sizeof *edges->valence) : NULL;
    if (!edges->valence || bw_parallel(ctx, n, ranges, count_edges, &w)) return ctx->error.status;
    lay_out(edges->begin, n);
    if (bw_parallel(ctx, n, ranges, list_edges, &w)) return ctx->error.status;
    for (int r = 0; r < ranges; r++) w.first[r] = edges->begin[w.vertex[r]];
    w.first[ranges] = (uint32_t)count;
    if (bw_parallel(ctx, n, ranges, count_equal, &w)) return ctx->error.status;
    close_up(&w, ranges);
    return BW_OK;
}

void bw_hex_edges_clear(bw_context *ctx, bw_hex_edges *edges) {
    bw_free(ctx, edges->begin);
    bw_free(ctx, edges->high);
    bw_free(ctx, edges->valence);
    *edges = (bw_hex_edges){0};
}
