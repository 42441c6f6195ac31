#include <stdlib.h>
#include <string.h>

#include "hex/incidence.h"

void bw_hex_mesh_clear(bw_context *ctx, bw_hex_mesh *mesh) {
    bw_free(ctx, mesh->position);
    bw_free(ctx, mesh->held);
    bw_free(ctx, mesh->carrier);
    bw_free(ctx, mesh->hex);
    bw_free(ctx, mesh->block);
    bw_free(ctx, mesh->ijk);
    memset(mesh, 0, sizeof *mesh);
}

/* ---- faces, grouped ---- */

/* A face by its vertices, ascending. */
typedef struct {
    bw_hvertex key[4];
    uint32_t face; /* 6 * hex + face */
} face_key;

/* Faces by their lowest vertex: those at v are face[begin[v]..begin[v + 1]), equal ones next to each other. */
typedef struct {
    uint32_t *begin;
    face_key *face;
} face_list;

static face_key key_of(const bw_hex_mesh *mesh, size_t item) {
    face_key f = {.face = (uint32_t)item};
    for (int i = 0, j; i < 4; i++) {
        bw_hvertex x = mesh->hex[item / 6][bw_hex_face_corner[item % 6][i]];
        for (j = i; j > 0 && f.key[j - 1] > x; j--) f.key[j] = f.key[j - 1];
        f.key[j] = x;
    }
    return f;
}

static int compare_faces(const void *a, const void *b) {
    const face_key *x = a, *y = b;
    for (int i = 0; i < 4; i++)
        if (x->key[i] != y->key[i]) return x->key[i] < y->key[i] ? -1 : 1;
    return x->face < y->face ? -1 : x->face > y->face;
}

static bool same_face(const face_key *a, const face_key *b) { return !memcmp(a->key, b->key, sizeof a->key); }

/* Around most vertices there are a dozen faces at most. */
static void sort_faces(face_key *face, size_t count) {
    if (count > 32) {
        qsort(face, count, sizeof *face, compare_faces);
        return;
    }
    for (size_t i = 1; i < count; i++) {
        face_key x = face[i];
        size_t j = i;
        for (; j > 0 && compare_faces(&face[j - 1], &x) > 0; j--) face[j] = face[j - 1];
        face[j] = x;
    }
}

static bw_status face_list_init(bw_context *ctx, face_list *l, const bw_hex_mesh *mesh) {
    size_t n = 6 * mesh->hex_count;
    *l = (face_list){0};
    if (n > UINT32_MAX) return bw_fail(ctx, BW_E_LIMIT, "the hex mesh has more faces than can be numbered");
    l->begin = bw_alloc(ctx, mesh->vertex_count + 2, sizeof *l->begin);
    l->face = bw_alloc(ctx, n, sizeof *l->face);
    if (!l->begin || !l->face) return ctx->error.status;
    for (size_t i = 0; i < n; i++) l->begin[key_of(mesh, i).key[0] + 2]++;
    for (size_t v = 2; v < mesh->vertex_count + 2; v++) l->begin[v] += l->begin[v - 1];
    for (size_t i = 0; i < n; i++) {
        face_key f = key_of(mesh, i);
        l->face[l->begin[f.key[0] + 1]++] = f;
    }
    for (size_t v = 0; v < mesh->vertex_count; v++) sort_faces(l->face + l->begin[v], l->begin[v + 1] - l->begin[v]);
    return BW_OK;
}

/* ---- invariant 1 ---- */

static void blame(bw_context *ctx, const bw_hex_mesh *mesh, size_t hex) { bw_fail_element(ctx, "hex", (int64_t)hex, mesh->position[mesh->hex[hex][0]]); }

static bw_status fail_hex(bw_context *ctx, const bw_hex_mesh *mesh, size_t hex, const char *what) {
    blame(ctx, mesh, hex);
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
    bool input;     /* what is wrong is the fault of a file, and has a status of its own */
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

/* Whether the faces, known to have the same vertices, are loops in the same sense. */
static bool same_loop(const bw_hex_mesh *mesh, uint64_t a, uint64_t b) {
    const uint8_t *p = bw_hex_face_corner[a % 6], *q = bw_hex_face_corner[b % 6];
    int shift = 0;
    while (mesh->hex[b / 6][q[shift]] != mesh->hex[a / 6][p[0]]) shift++;
    for (int i = 1; i < 4; i++)
        if (mesh->hex[b / 6][q[(shift + i) % 4]] != mesh->hex[a / 6][p[i]]) return false;
    return true;
}

static bool same_vertices(const bw_hvertex *a, const bw_hvertex *b) {
    int found = 0;
    for (int i = 0; i < 64; i++) found += a[i / 8] == b[i % 8];
    return found == 8;
}

/* Refuses `count` faces with the same vertices, known to be no two in opposite senses. */
static bw_status fail_faces(bw_context *ctx, const bw_hex_mesh *mesh, const face_key *face, size_t count, bool input) {
    bw_hex a = (bw_hex)(face[0].face / 6), b = (bw_hex)(face[1].face / 6);
    for (size_t i = 0; i < count; i++) blame(ctx, mesh, face[i].face / 6);
    if (input && same_vertices(mesh->hex[a], mesh->hex[b])) return bw_fail(ctx, BW_E_DUPLICATE, "hexes %d and %d have the same eight vertices", a, b);
    if (count > 2) return bw_fail(ctx, input ? BW_E_NONMANIFOLD : BW_E_CHECK, "hex %d shares a face with %zu others", a, count - 1);
    if (!input || same_loop(mesh, face[0].face, face[1].face))
        return bw_fail(ctx, input ? BW_E_INVERTED : BW_E_CHECK, "hexes %d and %d are on the same side of the face between them: one of them lists its corners the other way round", a, b);
    return bw_fail(ctx, BW_E_NONMANIFOLD, "hexes %d and %d share the corners of a face, but not its edges", a, b);
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
    face_list list;
    bw_status status = face_list_init(ctx, &list, mesh);
    for (size_t i = 0, j; i < 6 * mesh->hex_count && status == BW_OK; i = j) {
        const face_key *f = list.face + i;
        for (j = i + 1; j < 6 * mesh->hex_count && same_face(f, &list.face[j]);) j++;
        if (j - i > 2 || (j - i == 2 && !join_faces(mesh, f[0].face, f[1].face, l))) status = fail_faces(ctx, mesh, f, j - i, l->input);
        for (int k = 0; k < 4; k++) {
            l->euler[f->key[k]]--;
            l->boundary[f->key[k]] |= j - i == 1;
        }
    }
    bw_free(ctx, list.begin);
    bw_free(ctx, list.face);
    return status;
}

static bw_status read_edges(bw_context *ctx, const bw_hex_mesh *mesh, links *l) {
    bw_hex_edges edges;
    bw_status status = bw_hex_edges_init(ctx, mesh, &edges);
    for (size_t v = 0; v < mesh->vertex_count && status == BW_OK; v++)
        for (uint32_t e = edges.begin[v]; e < edges.begin[v + 1]; e++) l->euler[v]++, l->euler[edges.high[e]]++;
    bw_hex_edges_clear(ctx, &edges);
    return status;
}

static bw_status fail_pinched(bw_context *ctx, const bw_hex_mesh *mesh, size_t vertex) {
    bw_fail_element(ctx, "vertex", (int64_t)vertex, mesh->position[vertex]);
    for (size_t i = 0; i < 8 * mesh->hex_count; i++)
        if (mesh->hex[i / 8][i % 8] == (bw_hvertex)vertex) blame(ctx, mesh, i / 8);
    return bw_fail(ctx, BW_E_NONMANIFOLD, "the hexes around vertex %zu do not form one fan: the mesh is not a manifold there", vertex);
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
        if (!pieces[v]) continue; /* in no hex, which an input may have */
        if (pieces[v] != 1 || l->euler[v] != 2 - l->boundary[v])
            status = l->input ? fail_pinched(ctx, mesh, v) : fail_vertex(ctx, mesh, v, l->boundary[v] ? "is on the boundary, but its link is no disk" : "has a link that is no sphere");
        else if (l->input) continue;
        else if (mesh->held[v] > BW_HELD_NOT || (l->boundary[v] && mesh->held[v] == BW_HELD_NOT))
            status = fail_vertex(ctx, mesh, v, "is on the boundary, but not held there");
    }
    bw_free(ctx, pieces);
    return status;
}

static bw_status check_links(bw_context *ctx, const bw_hex_mesh *mesh, bool input) {
    links l = {bw_alloc(ctx, mesh->vertex_count, sizeof *l.euler), bw_alloc(ctx, mesh->vertex_count, 1),
               bw_alloc(ctx, 8 * mesh->hex_count, sizeof *l.piece), input};
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
    if (status == BW_OK) status = check_links(ctx, mesh, false);
    if (status == BW_OK) status = check_boxes(ctx, mesh);
    return status;
}

bw_status bw_hex_mesh_check_input(bw_context *ctx, const bw_hex_mesh *mesh) {
    size_t bad = 0;
    for (size_t h = 0; h < mesh->hex_count; h++) {
        bool repeats = false;
        for (int i = 0; i < 8; i++)
            for (int j = 0; j < i; j++) repeats = repeats || mesh->hex[h][i] == mesh->hex[h][j];
        if (!repeats) continue;
        bad++;
        blame(ctx, mesh, h);
    }
    if (bad) return bw_fail(ctx, BW_E_DUPLICATE, "%zu hexes repeat a vertex; the first is hex %lld", bad, (long long)ctx->error.elements[0].id);
    return check_links(ctx, mesh, true);
}
