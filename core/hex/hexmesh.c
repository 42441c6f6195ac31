#include <stdlib.h>
#include <string.h>

#include "hex/skin.h"

void bw_hex_mesh_clear(bw_context *ctx, bw_hex_mesh *mesh) {
    bw_free(ctx, mesh->position);
    bw_free(ctx, mesh->held);
    bw_free(ctx, mesh->carrier);
    bw_free(ctx, mesh->hex);
    bw_free(ctx, mesh->block);
    bw_free(ctx, mesh->ijk);
    memset(mesh, 0, sizeof *mesh);
}

/* ---- faces and edges, grouped ---- */

/* Faces (per_hex 6) or edges (12) of all hexes as hex * per_hex + local, by their lowest vertex: those at v are item[begin[v]..begin[v + 1]). */
typedef struct {
    const bw_hex_mesh *mesh;
    size_t per_hex;
    size_t *begin;
    uint64_t *item;
} parts;

/* The vertices of a part, ascending; the second two of an edge are -1. */
static void part_key(const parts *p, uint64_t item, bw_hvertex key[4]) {
    const bw_hvertex *v = p->mesh->hex[item / p->per_hex];
    size_t local = item % p->per_hex;
    int n = p->per_hex == 6 ? 4 : 2;
    key[2] = key[3] = -1;
    for (int i = 0; i < n; i++) {
        bw_hvertex x = v[n == 4 ? bw_hex_face_corner[local][i] : bw_hex_edge_corner[local][i]];
        int j = i;
        for (; j > 0 && key[j - 1] > x; j--) key[j] = key[j - 1];
        key[j] = x;
    }
}

static int compare_parts(const parts *p, uint64_t a, uint64_t b) {
    bw_hvertex x[4], y[4];
    part_key(p, a, x), part_key(p, b, y);
    for (int i = 0; i < 4; i++)
        if (x[i] != y[i]) return x[i] < y[i] ? -1 : 1;
    return a < b ? -1 : a > b;
}

static int compare_user(const void *a, const void *b, void *user) {
    return compare_parts(user, *(const uint64_t *)a, *(const uint64_t *)b);
}

static bool same_part(const parts *p, uint64_t a, uint64_t b) {
    bw_hvertex x[4], y[4];
    part_key(p, a, x), part_key(p, b, y);
    return !memcmp(x, y, sizeof x);
}

static void parts_clear(bw_context *ctx, parts *p) {
    bw_free(ctx, p->begin);
    bw_free(ctx, p->item);
    memset(p, 0, sizeof *p);
}

static bw_status parts_init(bw_context *ctx, parts *p, const bw_hex_mesh *mesh, size_t per_hex) {
    size_t n = mesh->hex_count * per_hex;
    bw_hvertex key[4];
    *p = (parts){.mesh = mesh, .per_hex = per_hex};
    p->begin = bw_alloc(ctx, mesh->vertex_count + 2, sizeof *p->begin);
    p->item = bw_alloc(ctx, n, sizeof *p->item);
    if (!p->begin || !p->item) return ctx->error.status;
    for (size_t i = 0; i < n; i++) part_key(p, i, key), p->begin[key[0] + 2]++;
    for (size_t v = 2; v < mesh->vertex_count + 2; v++) p->begin[v] += p->begin[v - 1];
    for (size_t i = 0; i < n; i++) part_key(p, i, key), p->item[p->begin[key[0] + 1]++] = i;
    for (size_t v = 0; v < mesh->vertex_count; v++)
        qsort_r(p->item + p->begin[v], p->begin[v + 1] - p->begin[v], sizeof *p->item, compare_user, p);
    return BW_OK;
}

/* ---- invariant 1 ---- */

static bw_status fail_hex(bw_context *ctx, const bw_hex_mesh *mesh, size_t hex, const char *what) {
    bw_fail_element(ctx, "hex", (int64_t)hex, mesh->position[mesh->hex[hex][0]]);
    return bw_fail(ctx, BW_E_CHECK, "hex %zu %s", hex, what);
}

static bw_status fail_vertex(bw_context *ctx, const bw_hex_mesh *mesh, size_t vertex, const char *what) {
    bw_fail_element(ctx, "hexvertex", (int64_t)vertex, mesh->position[vertex]);
    return bw_fail(ctx, BW_E_CHECK, "vertex %zu of the hex mesh %s", vertex, what);
}

static bw_status check_corners(bw_context *ctx, const bw_hex_mesh *mesh) {
    uint8_t *used = bw_alloc(ctx, mesh->vertex_count, 1);
    bw_status status = ctx->error.status;
    for (size_t h = 0; h < mesh->hex_count && status == BW_OK; h++) {
        const bw_hvertex *v = mesh->hex[h];
        for (int i = 0; i < 8 && status == BW_OK; i++) {
            if (v[i] < 0 || (size_t)v[i] >= mesh->vertex_count) {
                status = bw_fail(ctx, BW_E_CHECK, "hex %zu has a corner that is no vertex", h);
                continue;
            }
            used[v[i]] = 1;
            for (int j = 0; j < i; j++)
                if (v[i] == v[j]) status = fail_hex(ctx, mesh, h, "repeats a vertex");
        }
    }
    for (size_t v = 0; v < mesh->vertex_count && status == BW_OK; v++)
        if (!used[v]) status = fail_vertex(ctx, mesh, v, "is in no hex");
    bw_free(ctx, used);
    return status;
}

/* ---- invariants 2 and 3: links ---- */

/* Of the link of a vertex, a surface whose triangles are the corners there: its vertices, edges and triangles are the edges, faces and hexes of
 * the mesh at the vertex. Pieces are joined across edges only, so one piece of Euler characteristic 2 without a boundary is a sphere, one of
 * characteristic 1 with a boundary a disk: a pinched vertex, or more than one boundary, would only make it smaller. */
typedef struct {
    int32_t *euler;
    uint8_t *boundary;
    int64_t *piece; /* [8 * hex + corner] union-find */
} links;

static int64_t find(int64_t *piece, int64_t i) {
    while (piece[i] != i) i = piece[i] = piece[piece[i]];
    return i;
}

static void join(int64_t *piece, int64_t i, int64_t j) {
    i = find(piece, i), j = find(piece, j);
    if (i < j) piece[j] = i;
    else piece[i] = j;
}

/* Whether the faces, known to have the same vertices, are loops in opposite senses. Joins their corners. */
static bool join_faces(const bw_hex_mesh *mesh, uint64_t a, uint64_t b, links *l) {
    const uint8_t *p = bw_hex_face_corner[a % 6], *q = bw_hex_face_corner[b % 6];
    const bw_hvertex *x = mesh->hex[a / 6], *y = mesh->hex[b / 6];
    int shift = 0;
    while (shift < 4 && y[q[shift]] != x[p[0]]) shift++;
    for (int i = 0; i < 4; i++) {
        int j = (shift - i + 4) % 4;
        if (y[q[j]] != x[p[i]]) return false;
        join(l->piece, (int64_t)(a / 6 * 8 + p[i]), (int64_t)(b / 6 * 8 + q[j]));
    }
    return true;
}

static bw_status read_faces(bw_context *ctx, const bw_hex_mesh *mesh, links *l) {
    parts faces;
    bw_status status = parts_init(ctx, &faces, mesh, 6);
    for (size_t i = 0, j; i < 6 * mesh->hex_count && status == BW_OK; i = j) {
        for (j = i + 1; j < 6 * mesh->hex_count && same_part(&faces, faces.item[i], faces.item[j]);) j++;
        const uint64_t *item = faces.item + i;
        if (j - i > 2) status = fail_hex(ctx, mesh, item[0] / 6, "shares a face with more than one other");
        else if (j - i == 2 && !join_faces(mesh, item[0], item[1], l))
            status = fail_hex(ctx, mesh, item[0] / 6, "and another are on the same side of the face between them");
        for (int k = 0; k < 4; k++) {
            bw_hvertex v = mesh->hex[item[0] / 6][bw_hex_face_corner[item[0] % 6][k]];
            l->euler[v]--;
            l->boundary[v] |= j - i == 1;
        }
    }
    parts_clear(ctx, &faces);
    return status;
}

static bw_status read_edges(bw_context *ctx, const bw_hex_mesh *mesh, links *l) {
    parts edges;
    bw_status status = parts_init(ctx, &edges, mesh, 12);
    for (size_t i = 0; i < 12 * mesh->hex_count && status == BW_OK; i++) {
        if (i && same_part(&edges, edges.item[i - 1], edges.item[i])) continue;
        for (int k = 0; k < 2; k++) l->euler[mesh->hex[edges.item[i] / 12][bw_hex_edge_corner[edges.item[i] % 12][k]]]++;
    }
    parts_clear(ctx, &edges);
    return status;
}

static bw_status judge_links(bw_context *ctx, const bw_hex_mesh *mesh, const links *l) {
    uint8_t *pieces = bw_alloc(ctx, mesh->vertex_count, 1);
    bw_status status = ctx->error.status;
    for (size_t i = 0; i < 8 * mesh->hex_count && status == BW_OK; i++) {
        bw_hvertex v = mesh->hex[i / 8][i % 8];
        l->euler[v]++;
        if (l->piece[i] == (int64_t)i && pieces[v] < 2) pieces[v]++;
    }
    for (size_t v = 0; v < mesh->vertex_count && status == BW_OK; v++) {
        if (pieces[v] != 1 || l->euler[v] != 2 - l->boundary[v])
            status = fail_vertex(ctx, mesh, v, l->boundary[v] ? "is on the boundary, but its link is no disk" : "has a link that is no sphere");
        else if (mesh->held[v] > BW_HELD_NOT || (l->boundary[v] && mesh->held[v] == BW_HELD_NOT))
            status = fail_vertex(ctx, mesh, v, "is on the boundary, but not held there");
    }
    bw_free(ctx, pieces);
    return status;
}

static bw_status check_links(bw_context *ctx, const bw_hex_mesh *mesh) {
    links l = {bw_alloc(ctx, mesh->vertex_count, sizeof *l.euler), bw_alloc(ctx, mesh->vertex_count, 1),
               bw_alloc(ctx, 8 * mesh->hex_count, sizeof *l.piece)};
    bw_status status = ctx->error.status;
    for (size_t i = 0; i < 8 * mesh->hex_count && status == BW_OK; i++) l.piece[i] = (int64_t)i;
    if (status == BW_OK) status = read_faces(ctx, mesh, &l);
    if (status == BW_OK) status = read_edges(ctx, mesh, &l);
    if (status == BW_OK) status = judge_links(ctx, mesh, &l);
    bw_free(ctx, l.euler);
    bw_free(ctx, l.boundary);
    bw_free(ctx, l.piece);
    return status;
}

/* ---- invariant 4: every block is a full box ---- */

typedef struct {
    size_t count;
    int32_t (*size)[3]; /* [block] */
    size_t *begin;      /* [block + 1] into hex: that of i, j, k is begin + i + size[0] * (j + size[1] * k) */
    bw_hex *hex;
} boxes;

static bw_status measure_boxes(bw_context *ctx, const bw_hex_mesh *mesh, boxes *b) {
    for (size_t h = 0; h < mesh->hex_count; h++) {
        if (mesh->block[h] < 0) return fail_hex(ctx, mesh, h, "is in no block, others are");
        if ((size_t)mesh->block[h] >= b->count) b->count = (size_t)mesh->block[h] + 1;
    }
    b->size = bw_alloc(ctx, b->count, sizeof *b->size);
    b->begin = bw_alloc(ctx, b->count + 1, sizeof *b->begin);
    b->hex = bw_alloc(ctx, mesh->hex_count, sizeof *b->hex);
    if (!b->size || !b->begin || !b->hex) return ctx->error.status;
    for (size_t h = 0; h < mesh->hex_count; h++) {
        b->begin[mesh->block[h] + 1]++;
        for (int k = 0; k < 3; k++) {
            int32_t at = mesh->ijk[h][k], *size = &b->size[mesh->block[h]][k];
            if (at < 0 || at == INT32_MAX) return fail_hex(ctx, mesh, h, "has a place outside its block");
            if (at >= *size) *size = at + 1;
        }
        b->hex[h] = BW_NONE;
    }
    for (size_t i = 0; i < b->count; i++) {
        const int32_t *n = b->size[i];
        if ((__int128)n[0] * n[1] * n[2] != (__int128)b->begin[i + 1])
            return bw_fail(ctx, BW_E_CHECK, "block %zu of %d x %d x %d hexes has %zu", i, n[0], n[1], n[2], b->begin[i + 1]);
        b->begin[i + 1] += b->begin[i];
    }
    return BW_OK;
}

static size_t box_slot(const boxes *b, bw_block block, const int32_t ijk[3]) {
    const int32_t *n = b->size[block];
    return b->begin[block] + (size_t)ijk[0] + (size_t)n[0] * ((size_t)ijk[1] + (size_t)n[1] * (size_t)ijk[2]);
}

/* Whether the hex next to h along an axis, if there is one in its block, has the same face there. */
static bool meets_next(const bw_hex_mesh *mesh, const boxes *b, size_t h, int axis) {
    int32_t at[3] = {mesh->ijk[h][0], mesh->ijk[h][1], mesh->ijk[h][2]};
    if (++at[axis] == b->size[mesh->block[h]][axis]) return true;
    const bw_hvertex *x = mesh->hex[h], *y = mesh->hex[b->hex[box_slot(b, mesh->block[h], at)]];
    bool same = true;
    for (int c = 0; c < 8; c++)
        if (c >> axis & 1) same = same && x[c] == y[c ^ 1 << axis];
    return same;
}

static bw_status check_boxes(bw_context *ctx, const bw_hex_mesh *mesh) {
    boxes b = {0};
    bool labelled = mesh->hex_count && mesh->block && mesh->block[0] != BW_NONE;
    for (size_t h = 0; h < mesh->hex_count && mesh->block; h++) labelled = labelled || mesh->block[h] != BW_NONE;
    if (!labelled) return BW_OK;
    bw_status status = measure_boxes(ctx, mesh, &b);
    for (size_t h = 0; h < mesh->hex_count && status == BW_OK; h++) {
        bw_hex *slot = &b.hex[box_slot(&b, mesh->block[h], mesh->ijk[h])];
        if (*slot != BW_NONE) status = fail_hex(ctx, mesh, h, "has the place of another in its block");
        *slot = (bw_hex)h;
    }
    for (size_t h = 0; h < mesh->hex_count && status == BW_OK; h++)
        for (int axis = 0; axis < 3 && status == BW_OK; axis++)
            if (!meets_next(mesh, &b, h, axis)) status = fail_hex(ctx, mesh, h, "does not meet the next one in its block");
    bw_free(ctx, b.size);
    bw_free(ctx, b.begin);
    bw_free(ctx, b.hex);
    return status;
}

bw_status bw_hex_mesh_check(bw_context *ctx, const bw_hex_mesh *mesh) {
    bw_status status = check_corners(ctx, mesh);
    if (status == BW_OK) status = check_links(ctx, mesh);
    if (status == BW_OK) status = check_boxes(ctx, mesh);
    return status;
}
