#include "hex/incidence.h"

#include <stdlib.h>
#include <string.h>

enum { FEW = 64 }; /* items at a vertex, up to which the simplest way is the fastest */

const uint8_t bw_hex_face_corner[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
const uint8_t bw_hex_edge_corner[12][2] = {{0, 1}, {2, 3}, {4, 5}, {6, 7}, {0, 2}, {4, 6}, {1, 3}, {5, 7}, {0, 4}, {1, 5}, {2, 6}, {3, 7}};

/* begin[v] holds the number of items of v before, the end of its bucket after; each item then goes to --begin[v]. */
static void lay_out(uint32_t *begin, size_t vertex_count) {
    uint32_t sum = 0;
    for (size_t v = 0; v < vertex_count; v++) begin[v] = sum += begin[v];
    begin[vertex_count] = sum;
}

static bw_status check_size(bw_context *ctx, const bw_hex_mesh *mesh) {
    return mesh->hex_count <= UINT32_MAX / 12 - 1 ? BW_OK : bw_fail(ctx, BW_E_LIMIT, "more than 350 million hexes");
}

/* ---- mates --------------------------------------------------------------------------------------------------------- */

/* Lowest vertex, the one across, the others in order: the same for both hexes of a quad. */
typedef struct {
    bw_hvertex low, across, side[2];
} quad_key;

static quad_key key_of(const bw_hvertex *hex, int face) {
    const uint8_t *c = bw_hex_face_corner[face];
    int at = 0;
    for (int i = 1; i < 4; i++)
        if (hex[c[i]] < hex[c[at]]) at = i;
    bw_hvertex a = hex[c[(at + 1) & 3]], b = hex[c[(at + 3) & 3]];
    return (quad_key){hex[c[at]], hex[c[at ^ 2]], {a < b ? a : b, a < b ? b : a}};
}

static bool same_quad(const quad_key *a, const quad_key *b) { return a->across == b->across && a->side[0] == b->side[0] && a->side[1] == b->side[1]; }

static void match_few(const bw_hex_mesh *mesh, const uint32_t *item, size_t count, uint32_t *mate) {
    for (size_t i = 0; i < count; i++) {
        uint32_t x = item[i];
        quad_key key = key_of(mesh->hex[x / 6], (int)(x % 6));
        for (size_t j = i + 1; j < count && mate[x] == BW_HEX_NO_MATE; j++) {
            uint32_t y = item[j];
            quad_key other = key_of(mesh->hex[y / 6], (int)(y % 6));
            if (mate[y] != BW_HEX_NO_MATE || !same_quad(&key, &other)) continue;
            mate[x] = y, mate[y] = x;
        }
    }
}

typedef struct {
    quad_key key;
    uint32_t item;
} keyed;

static int by_quad(const void *a, const void *b) {
    const keyed *x = a, *y = b;
    if (x->key.across != y->key.across) return x->key.across < y->key.across ? -1 : 1;
    for (int i = 0; i < 2; i++)
        if (x->key.side[i] != y->key.side[i]) return x->key.side[i] < y->key.side[i] ? -1 : 1;
    return (x->item > y->item) - (x->item < y->item);
}

static bw_status match_many(bw_context *ctx, const bw_hex_mesh *mesh, const uint32_t *item, size_t count, uint32_t *mate) {
    keyed *list = bw_alloc(ctx, count, sizeof *list);
    if (!list) return ctx->error.status;
    for (size_t i = 0; i < count; i++) list[i] = (keyed){key_of(mesh->hex[item[i] / 6], (int)(item[i] % 6)), item[i]};
    qsort(list, count, sizeof *list, by_quad);
    for (size_t i = 0; i + 1 < count; i++) {
        uint32_t x = list[i].item, y = list[i + 1].item;
        if (mate[x] == BW_HEX_NO_MATE && same_quad(&list[i].key, &list[i + 1].key)) mate[x] = y, mate[y] = x;
    }
    bw_free(ctx, list);
    return BW_OK;
}

static bw_status match(bw_context *ctx, const bw_hex_mesh *mesh, const uint32_t *begin, const uint32_t *item, uint32_t *mate) {
    bw_status status = BW_OK;
    for (size_t v = 0; v < mesh->vertex_count && status == BW_OK; v++) {
        size_t count = begin[v + 1] - begin[v];
        if (count <= FEW) match_few(mesh, item + begin[v], count, mate);
        else status = match_many(ctx, mesh, item + begin[v], count, mate);
    }
    return status;
}

bw_status bw_hex_mates(bw_context *ctx, const bw_hex_mesh *mesh, uint32_t **mate) {
    uint32_t *begin = NULL, *item = NULL, count = 6 * (uint32_t)mesh->hex_count;
    *mate = NULL;
    bw_status status = check_size(ctx, mesh);
    if (status != BW_OK) return status;
    begin = bw_alloc(ctx, mesh->vertex_count + 1, sizeof *begin);
    item = begin ? bw_alloc(ctx, count, sizeof *item) : NULL;
    *mate = item ? bw_alloc(ctx, count, sizeof **mate) : NULL;
    if (!*mate) {
        status = ctx->error.status;
        goto out;
    }
    memset(*mate, 0xff, count * sizeof **mate);
    for (uint32_t x = 0; x < count; x++) begin[key_of(mesh->hex[x / 6], (int)(x % 6)).low]++;
    lay_out(begin, mesh->vertex_count);
    for (uint32_t x = count; x-- > 0;) item[--begin[key_of(mesh->hex[x / 6], (int)(x % 6)).low]] = x;
    status = match(ctx, mesh, begin, item, *mate);
out:
    bw_free(ctx, begin);
    bw_free(ctx, item);
    return status;
}

/* ---- edges --------------------------------------------------------------------------------------------------------- */

static bw_hvertex low_of(const bw_hex_mesh *mesh, uint32_t x, bw_hvertex *high) {
    const uint8_t *c = bw_hex_edge_corner[x % 12];
    bw_hvertex a = mesh->hex[x / 12][c[0]], b = mesh->hex[x / 12][c[1]];
    *high = a < b ? b : a;
    return a < b ? a : b;
}

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

/* An edge as often as it has hexes -> once, with its valence. */
static bw_status count_equal(bw_context *ctx, size_t vertex_count, bw_hex_edges *edges) {
    uint32_t n = 0, from = 0;
    uint32_t *begin = edges->begin;
    edges->valence = bw_alloc(ctx, begin[vertex_count], sizeof *edges->valence);
    if (!edges->valence) return ctx->error.status;
    for (size_t v = 0; v < vertex_count; v++) {
        uint32_t to = begin[v + 1], i = from;
        for (begin[v] = n; i < to; i++) {
            if (n == begin[v] || edges->high[i] != edges->high[n - 1]) edges->high[n] = edges->high[i], edges->valence[n++] = 0;
            edges->valence[n - 1]++;
        }
        from = to;
    }
    begin[vertex_count] = n;
    return BW_OK;
}

bw_status bw_hex_edges_init(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_edges *edges) {
    *edges = (bw_hex_edges){0};
    bw_status status = check_size(ctx, mesh);
    if (status != BW_OK) return status;
    uint32_t count = 12 * (uint32_t)mesh->hex_count;
    bw_hvertex high;
    edges->begin = bw_alloc(ctx, mesh->vertex_count + 1, sizeof *edges->begin);
    edges->high = edges->begin ? bw_alloc(ctx, count, sizeof *edges->high) : NULL;
    if (!edges->high) return ctx->error.status;
    for (uint32_t x = 0; x < count; x++) edges->begin[low_of(mesh, x, &high)]++;
    lay_out(edges->begin, mesh->vertex_count);
    for (uint32_t x = 0; x < count; x++) {
        bw_hvertex low = low_of(mesh, x, &high);
        edges->high[--edges->begin[low]] = high;
    }
    for (size_t v = 0; v < mesh->vertex_count; v++) sort(edges->high + edges->begin[v], edges->begin[v + 1] - edges->begin[v]);
    return count_equal(ctx, mesh->vertex_count, edges);
}

void bw_hex_edges_clear(bw_context *ctx, bw_hex_edges *edges) {
    bw_free(ctx, edges->begin);
    bw_free(ctx, edges->high);
    bw_free(ctx, edges->valence);
    *edges = (bw_hex_edges){0};
}
