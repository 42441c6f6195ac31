#include "hex/skin.h"

#include <string.h>

const uint8_t bw_hex_face_corner[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
const uint8_t bw_hex_edge_corner[12][2] = {{0, 1}, {2, 3}, {4, 5}, {6, 7}, {0, 2}, {4, 6}, {1, 3}, {5, 7}, {0, 4}, {1, 5}, {2, 6}, {3, 7}};

/* Things sorted into buckets by their lowest vertex. */
typedef struct {
    uint32_t *begin; /* [vertex + 1] */
    uint32_t *item;
} buckets;

static bw_status buckets_init(bw_context *ctx, buckets *b, size_t vertex_count, size_t item_count) {
    b->begin = bw_alloc(ctx, vertex_count + 1, sizeof *b->begin);
    b->item = b->begin ? bw_alloc(ctx, item_count, sizeof *b->item) : NULL;
    return b->item ? BW_OK : ctx->error.status;
}

static void buckets_clear(bw_context *ctx, buckets *b) {
    bw_free(ctx, b->begin);
    bw_free(ctx, b->item);
    *b = (buckets){0};
}

/* begin[v] holds the number of items of v before, the end of its bucket after; each item then goes to --begin[v]. */
static void buckets_lay_out(buckets *b, size_t vertex_count) {
    uint32_t sum = 0;
    for (size_t v = 0; v < vertex_count; v++) b->begin[v] = sum += b->begin[v];
    b->begin[vertex_count] = sum;
}

/* ---- quads that are in one hex ------------------------------------------------------------------------------------- */

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

/* Clears the bit of every face that another hex has too. */
static void match_faces(const bw_hex_mesh *mesh, const buckets *b, uint8_t *open) {
    for (size_t v = 0; v < mesh->vertex_count; v++)
        for (uint32_t i = b->begin[v]; i < b->begin[v + 1]; i++) {
            uint32_t x = b->item[i];
            quad_key key = key_of(mesh->hex[x / 6], (int)(x % 6));
            for (uint32_t j = i + 1; j < b->begin[v + 1]; j++) {
                uint32_t y = b->item[j];
                quad_key other = key_of(mesh->hex[y / 6], (int)(y % 6));
                if (key.across != other.across || key.side[0] != other.side[0] || key.side[1] != other.side[1]) continue;
                open[x / 6] &= (uint8_t) ~(1u << x % 6);
                open[y / 6] &= (uint8_t) ~(1u << y % 6);
            }
        }
}

static bw_status list_quads(bw_context *ctx, const bw_hex_mesh *mesh, const uint8_t *open, bw_hex_skin *skin) {
    for (size_t h = 0; h < mesh->hex_count; h++) skin->quad_count += (size_t)__builtin_popcount(open[h]);
    skin->quad = bw_alloc(ctx, skin->quad_count, sizeof *skin->quad);
    if (!skin->quad) return ctx->error.status;
    size_t n = 0;
    for (size_t h = 0; h < mesh->hex_count; h++)
        for (int f = 0; f < 6; f++)
            if (open[h] >> f & 1) skin->quad[n++] = (bw_hex_quad){.hex = (bw_hex)h, .face = (uint8_t)f};
    return BW_OK;
}

static bw_status find_quads(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_skin *skin) {
    buckets b = {0};
    uint8_t *open = bw_alloc(ctx, mesh->hex_count, 1);
    bw_status status = open ? buckets_init(ctx, &b, mesh->vertex_count, 6 * mesh->hex_count) : ctx->error.status;
    if (status != BW_OK) goto out;
    memset(open, 63, mesh->hex_count);
    for (uint32_t x = 0; x < 6 * (uint32_t)mesh->hex_count; x++) b.begin[key_of(mesh->hex[x / 6], (int)(x % 6)).low]++;
    buckets_lay_out(&b, mesh->vertex_count);
    for (uint32_t x = 0; x < 6 * (uint32_t)mesh->hex_count; x++) b.item[--b.begin[key_of(mesh->hex[x / 6], (int)(x % 6)).low]] = x;
    match_faces(mesh, &b, open);
    status = list_quads(ctx, mesh, open, skin);
out:
    buckets_clear(ctx, &b);
    bw_free(ctx, open);
    return status;
}

/* ---- edges: how many hexes and quads of the boundary they have ----------------------------------------------------- */

static bw_hvertex low_of(const bw_hvertex end[2]) {
    return end[0] < end[1] ? end[0] : end[1];
}

static void ends_in_hex(const bw_hex_mesh *mesh, uint32_t x, bw_hvertex end[2]) {
    for (int i = 0; i < 2; i++) end[i] = mesh->hex[x / 12][bw_hex_edge_corner[x % 12][i]];
}

static void ends_in_quad(const bw_hex_mesh *mesh, const bw_hex_skin *skin, uint32_t x, bw_hvertex end[2]) {
    for (uint32_t i = 0; i < 2; i++) end[i] = bw_hex_quad_vertex(mesh, &skin->quad[x / 4], (int)((x + i) % 4));
}

/* Edges of hexes: items are their higher vertices, ascending in each bucket. */
static bw_status sort_edges(bw_context *ctx, const bw_hex_mesh *mesh, buckets *b) {
    bw_status status = buckets_init(ctx, b, mesh->vertex_count, 12 * mesh->hex_count);
    if (status != BW_OK) return status;
    bw_hvertex end[2];
    for (uint32_t x = 0; x < 12 * (uint32_t)mesh->hex_count; x++) ends_in_hex(mesh, x, end), b->begin[low_of(end)]++;
    buckets_lay_out(b, mesh->vertex_count);
    for (uint32_t x = 0; x < 12 * (uint32_t)mesh->hex_count; x++) {
        ends_in_hex(mesh, x, end);
        b->item[--b->begin[low_of(end)]] = (uint32_t)(end[0] < end[1] ? end[1] : end[0]);
    }
    for (size_t v = 0; v < mesh->vertex_count; v++)
        for (uint32_t i = b->begin[v] + 1; i < b->begin[v + 1]; i++) {
            uint32_t x = b->item[i], j = i;
            for (; j > b->begin[v] && b->item[j - 1] > x; j--) b->item[j] = b->item[j - 1];
            b->item[j] = x;
        }
    return BW_OK;
}

/* Edges of quads of the boundary: items are 4 * quad + side. */
static bw_status sort_sides(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, buckets *b) {
    bw_status status = buckets_init(ctx, b, mesh->vertex_count, 4 * skin->quad_count);
    if (status != BW_OK) return status;
    bw_hvertex end[2];
    for (uint32_t x = 0; x < 4 * (uint32_t)skin->quad_count; x++) ends_in_quad(mesh, skin, x, end), b->begin[low_of(end)]++;
    buckets_lay_out(b, mesh->vertex_count);
    for (uint32_t x = 4 * (uint32_t)skin->quad_count; x-- > 0;) ends_in_quad(mesh, skin, x, end), b->item[--b->begin[low_of(end)]] = x;
    return BW_OK;
}

static int32_t root_of(bw_hex_skin *skin, int32_t quad) {
    while (skin->quad[quad].surface != quad) quad = skin->quad[quad].surface = skin->quad[skin->quad[quad].surface].surface;
    return quad;
}

static void join(bw_hex_skin *skin, int32_t a, int32_t b) {
    a = root_of(skin, a), b = root_of(skin, b);
    if (a < b) skin->quad[b].surface = a;
    else skin->quad[a].surface = b;
}

/* The edge from v to `other`, which `valence` hexes have. */
static bw_status take_edge(bw_context *ctx, const bw_hex_mesh *mesh, const buckets *sides, size_t v, uint32_t other, int32_t valence, bw_hex_skin *skin, size_t *room) {
    int32_t quad[2], count = 0;
    for (uint32_t i = sides->begin[v]; i < sides->begin[v + 1]; i++) {
        bw_hvertex end[2];
        ends_in_quad(mesh, skin, sides->item[i], end);
        if ((uint32_t)end[0] + (uint32_t)end[1] != (uint32_t)v + other) continue;
        if (count < 2) quad[count] = (int32_t)(sides->item[i] / 4);
        count++;
    }
    if (count == 2 && valence == 2) join(skin, quad[0], quad[1]);
    if (valence == (count ? 2 : 4)) return BW_OK;
    bw_status status = bw_reserve(ctx, &skin->edge, room, skin->edge_count + 1);
    if (status == BW_OK)
        skin->edge[skin->edge_count++] = (bw_hex_edge){.vertex = {(bw_hvertex)v, (bw_hvertex)other}, .valence = valence, .boundary = count > 0};
    return status;
}

static void number_surfaces(bw_hex_skin *skin) {
    for (size_t q = 0; q < skin->quad_count; q++) {
        int32_t root = skin->quad[q].surface; /* not after its quad, and that one is numbered: stored as -1 - number */
        while (root >= 0 && root != (int32_t)q) root = skin->quad[root].surface;
        skin->quad[q].surface = root < 0 ? root : -1 - (int32_t)skin->surface_count++;
    }
    for (size_t q = 0; q < skin->quad_count; q++) skin->quad[q].surface = -1 - skin->quad[q].surface;
}

static bw_status find_edges(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_skin *skin) {
    buckets edges = {0}, sides = {0};
    size_t room = 0;
    bw_status status = sort_edges(ctx, mesh, &edges);
    if (status == BW_OK) status = sort_sides(ctx, mesh, skin, &sides);
    for (size_t q = 0; q < skin->quad_count; q++) skin->quad[q].surface = (int32_t)q;
    for (size_t v = 0; v < mesh->vertex_count && status == BW_OK; v++)
        for (uint32_t i = edges.begin[v], j; i < edges.begin[v + 1] && status == BW_OK; i = j) {
            for (j = i + 1; j < edges.begin[v + 1] && edges.item[j] == edges.item[i];) j++;
            status = take_edge(ctx, mesh, &sides, v, edges.item[i], (int32_t)(j - i), skin, &room);
        }
    number_surfaces(skin);
    buckets_clear(ctx, &edges);
    buckets_clear(ctx, &sides);
    return status;
}

bw_status bw_hex_skin_init(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_skin *skin) {
    *skin = (bw_hex_skin){0};
    if (mesh->hex_count > UINT32_MAX / 12) return bw_fail(ctx, BW_E_LIMIT, "more than 350 million hexes");
    bw_status status = find_quads(ctx, mesh, skin);
    return status == BW_OK ? find_edges(ctx, mesh, skin) : status;
}

void bw_hex_skin_clear(bw_context *ctx, bw_hex_skin *skin) {
    bw_free(ctx, skin->quad);
    bw_free(ctx, skin->edge);
    *skin = (bw_hex_skin){0};
}
