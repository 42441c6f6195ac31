#include <stdlib.h>
#include <string.h>

#include "base/parallel.h"
#include "hex/incidence.h"

enum { LEAST = 4096, OFTEN = 65536 }; /* hexes or vertices per thread at least; between questions whether to go on */

void bw_hex_mesh_clear(bw_context *ctx, bw_hex_mesh *mesh) {
    bw_free(ctx, mesh->position);
    bw_free(ctx, mesh->held);
    bw_free(ctx, mesh->carrier);
    bw_free(ctx, mesh->hex);
    bw_free(ctx, mesh->block);
    bw_free(ctx, mesh->ijk);
    memset(mesh, 0, sizeof *mesh);
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

static bw_status check_corner_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const bw_hex_mesh *mesh = user;
    (void)range;
    for (size_t h = begin; h < end; h++) {
        const bw_hvertex *v = mesh->hex[h];
        bool repeats = false;
        for (int i = 0; i < 8; i++) {
            if (v[i] < 0 || (size_t)v[i] >= mesh->vertex_count) return bw_fail(ctx, BW_E_CHECK, "hex %zu has a corner that is no vertex", h);
            for (int j = 0; j < i; j++) repeats |= v[i] == v[j];
        }
        if (repeats) return fail_hex(ctx, mesh, h, "repeats a vertex");
    }
    return BW_OK;
}

static bw_status check_corners(bw_context *ctx, const bw_hex_mesh *mesh) {
    if (bw_parallel(ctx, mesh->hex_count, bw_parallel_ranges(ctx, mesh->hex_count, LEAST), check_corner_range, (void *)mesh)) return ctx->error.status;
    uint8_t *used = bw_alloc(ctx, mesh->vertex_count, 1);
    bw_status status = ctx->error.status;
    for (size_t i = 0; i < 8 * mesh->hex_count && status == BW_OK; i++) used[mesh->hex[i / 8][i % 8]] = 1;
    for (size_t v = 0; v < mesh->vertex_count && status == BW_OK; v++)
        if (!used[v]) status = fail_vertex(ctx, mesh, v, "is in no hex");
    bw_free(ctx, used);
    return status;
}

/* ---- invariants 2 and 3: faces ---- */

typedef struct {
    const bw_hex_mesh *mesh;
    bool input;        /* what is wrong is the fault of a file, and has a status of its own */
    uint32_t *mate;
    uint32_t *corner;  /* [vertex] 8 * hex + corner of one of its corners */
    uint32_t *corners; /* [vertex] how many it has */
    uint8_t *seen;     /* [8 * hex + corner] */
    uint32_t bad[BW_PARALLEL_MOST]; /* [range] lowest face that does not meet its mate */
} checking;

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
static bw_status fail_faces(bw_context *ctx, const bw_hex_mesh *mesh, const uint32_t *face, size_t count, bool input) {
    bw_hex a = (bw_hex)(face[0] / 6), b = (bw_hex)(face[1] / 6);
    for (size_t i = 0; i < count; i++) blame(ctx, mesh, face[i] / 6);
    if (input && same_vertices(mesh->hex[a], mesh->hex[b])) return bw_fail(ctx, BW_E_DUPLICATE, "hexes %d and %d have the same eight vertices", a, b);
    if (count > 2) return bw_fail(ctx, input ? BW_E_NONMANIFOLD : BW_E_CHECK, "hex %d shares a face with %zu others", a, count - 1);
    if (!input || same_loop(mesh, face[0], face[1]))
        return bw_fail(ctx, input ? BW_E_INVERTED : BW_E_CHECK, "hexes %d and %d are on the same side of the face between them: one of them lists its corners the other way round", a, b);
    return bw_fail(ctx, BW_E_NONMANIFOLD, "hexes %d and %d share the corners of a face, but not its edges", a, b);
}

static bool same_corners(const bw_hex_mesh *mesh, size_t a, size_t b) {
    int found = 0;
    for (int i = 0; i < 16; i++)
        found += mesh->hex[a / 6][bw_hex_face_corner[a % 6][i / 4]] == mesh->hex[b / 6][bw_hex_face_corner[b % 6][i % 4]];
    return found == 4;
}

/* Refuses the faces that are equal to one. */
static bw_status fail_equal(bw_context *ctx, const checking *w, uint32_t face) {
    size_t count = 0, room = 0;
    uint32_t *list = NULL;
    for (size_t x = 0; x < 6 * w->mesh->hex_count; x++) {
        if (!same_corners(w->mesh, face, x)) continue;
        if (bw_reserve(ctx, &list, &room, count + 1)) break;
        list[count++] = (uint32_t)x;
    }
    if (ctx->error.status == BW_OK) fail_faces(ctx, w->mesh, list, count, w->input);
    bw_free(ctx, list);
    return ctx->error.status;
}

/* Whether two faces, known to have the same vertices, are loops in opposite senses. */
static bool faces_meet(const bw_hex_mesh *mesh, uint32_t a, uint32_t b) {
    const uint8_t *p = bw_hex_face_corner[a % 6], *q = bw_hex_face_corner[b % 6];
    const bw_hvertex *x = mesh->hex[a / 6], *y = mesh->hex[b / 6];
    int shift = 0;
    while (shift < 4 && y[q[shift]] != x[p[0]]) shift++;
    for (int i = 0; i < 4; i++)
        if (y[q[(shift - i + 4) % 4]] != x[p[i]]) return false;
    return true;
}

static bw_status compare_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    checking *w = user;
    (void)ctx;
    w->bad[range] = BW_HEX_NO_MATE;
    for (size_t x = 6 * begin; x < 6 * end; x++)
        if (w->mate[x] != BW_HEX_NO_MATE && w->mate[x] > x && w->bad[range] == BW_HEX_NO_MATE && !faces_meet(w->mesh, (uint32_t)x, w->mate[x]))
            w->bad[range] = (uint32_t)x;
    return BW_OK;
}

static bw_status check_faces(bw_context *ctx, checking *w) {
    size_t n = w->mesh->hex_count;
    int ranges = bw_parallel_ranges(ctx, n, LEAST);
    uint32_t bad;
    if (bw_hex_mates_and_crowd(ctx, w->mesh, &w->mate, &bad) || bw_poll(ctx) || bw_parallel(ctx, n, ranges, compare_range, w)) return ctx->error.status;
    for (int r = 0; r < ranges; r++)
        if (w->bad[r] < bad) bad = w->bad[r];
    return bad == BW_HEX_NO_MATE ? BW_OK : fail_equal(ctx, w, bad);
}

/* ---- invariants 2 and 3: links ---- */

/* The link of a vertex is a surface whose triangles are the corners there: its vertices, edges and triangles are the edges, faces and hexes of
 * the mesh at the vertex. Only what can be reached across edges from one corner is counted, so if these are all corners, Euler characteristic 2 without a boundary tells a sphere, 1
 * with a boundary a disk: a pinched vertex, or more than one boundary, would only make it smaller. */
typedef struct {
    size_t corners, boundary, neighbours; /* triangles; edges of one triangle; vertices */
} vertex_link;

enum { FEW = 64 }; /* corners at a vertex for which there is room without asking */

/* Room for the corners of one vertex, and for three times as many neighbours. */
typedef struct {
    uint32_t *corner;
    bw_hvertex *near;
} link_room;

static int ascending(const void *a, const void *b) {
    const bw_hvertex *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

static size_t count_different(bw_hvertex *item, size_t count) {
    size_t n = 0;
    if (count > 3 * FEW) {
        qsort(item, count, sizeof *item, ascending);
        for (size_t i = 0; i < count; i++) n += !i || item[i] != item[i - 1];
        return n;
    }
    for (size_t i = 0, j; i < count; i++) {
        for (j = 0; j < n && item[j] != item[i];) j++;
        if (j == n) item[n++] = item[i];
    }
    return n;
}

static vertex_link read_link(checking *w, bw_hvertex v, link_room room) {
    const bw_hex_mesh *mesh = w->mesh;
    vertex_link found = {.corners = 1};
    room.corner[0] = w->corner[v];
    w->seen[w->corner[v]] = 1;
    for (size_t i = 0; i < found.corners; i++) {
        uint32_t h = room.corner[i] / 8, c = room.corner[i] % 8;
        for (uint32_t k = 0; k < 3; k++) {
            uint32_t mate = w->mate[6 * h + 2 * k + (c >> k & 1)], other = 0;
            room.near[3 * i + k] = mesh->hex[h][c ^ 1u << k];
            found.boundary += mate == BW_HEX_NO_MATE;
            if (mate == BW_HEX_NO_MATE) continue;
            while (mesh->hex[mate / 6][other] != v) other++;
            other += mate / 6 * 8;
            if (!w->seen[other]) w->seen[other] = 1, room.corner[found.corners++] = other;
        }
    }
    found.neighbours = count_different(room.near, 3 * found.corners);
    return found;
}

static bw_status fail_pinched(bw_context *ctx, const bw_hex_mesh *mesh, size_t vertex) {
    bw_fail_element(ctx, "vertex", (int64_t)vertex, mesh->position[vertex]);
    for (size_t i = 0; i < 8 * mesh->hex_count; i++)
        if (mesh->hex[i / 8][i % 8] == (bw_hvertex)vertex) blame(ctx, mesh, i / 8);
    return bw_fail(ctx, BW_E_NONMANIFOLD, "the hexes around vertex %zu do not form one fan: the mesh is not a manifold there", vertex);
}

static bw_status judge_link(bw_context *ctx, checking *w, size_t v, link_room room) {
    vertex_link found = read_link(w, (bw_hvertex)v, room);
    size_t edges = (3 * found.corners + found.boundary) / 2;
    if (found.corners != w->corners[v] || found.neighbours + found.corners != edges + (found.boundary ? 1 : 2))
        return w->input ? fail_pinched(ctx, w->mesh, v)
                        : fail_vertex(ctx, w->mesh, v, found.boundary ? "is on the boundary, but its link is no disk" : "has a link that is no sphere");
    if (w->input) return BW_OK;
    if (w->mesh->held[v] > BW_HELD_NOT) return fail_vertex(ctx, w->mesh, v, "is held by nothing that there is");
    return found.boundary && w->mesh->held[v] == BW_HELD_NOT ? fail_vertex(ctx, w->mesh, v, "is on the boundary, but not held there") : BW_OK;
}

static bw_status judge_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    checking *w = user;
    uint32_t corner[FEW];
    bw_hvertex near[3 * FEW];
    (void)range;
    for (size_t v = begin; v < end; v++) {
        if ((v - begin) % OFTEN == 0 && bw_poll(ctx)) return ctx->error.status;
        if (w->corners[v] && w->corners[v] <= FEW && judge_link(ctx, w, v, (link_room){corner, near})) return ctx->error.status;
    }
    return BW_OK;
}

/* Vertices with very many hexes, after the others. */
static bw_status judge_large(bw_context *ctx, checking *w) {
    for (size_t v = 0; v < w->mesh->vertex_count; v++) {
        if (w->corners[v] <= FEW) continue;
        if (bw_poll(ctx)) return ctx->error.status;
        link_room room = {bw_alloc(ctx, w->corners[v], sizeof *room.corner), bw_alloc(ctx, w->corners[v], 3 * sizeof *room.near)};
        if (room.corner && room.near) judge_link(ctx, w, v, room);
        bw_free(ctx, room.corner), bw_free(ctx, room.near);
        if (ctx->error.status != BW_OK) return ctx->error.status;
    }
    return BW_OK;
}

static bw_status check_links(bw_context *ctx, const bw_hex_mesh *mesh, bool input) {
    checking w = {.mesh = mesh, .input = input};
    size_t n = mesh->vertex_count;
    w.corner = bw_alloc(ctx, n, sizeof *w.corner), w.corners = bw_alloc(ctx, n, sizeof *w.corners), w.seen = bw_alloc(ctx, mesh->hex_count, 8);
    if (ctx->error.status == BW_OK && !check_faces(ctx, &w)) {
        for (size_t i = 0; i < 8 * mesh->hex_count; i++) w.corner[mesh->hex[i / 8][i % 8]] = (uint32_t)i, w.corners[mesh->hex[i / 8][i % 8]]++;
        if (!bw_parallel(ctx, n, bw_parallel_ranges(ctx, n, LEAST), judge_range, &w)) judge_large(ctx, &w);
    }
    bw_free(ctx, w.mate), bw_free(ctx, w.corner), bw_free(ctx, w.corners), bw_free(ctx, w.seen);
    return ctx->error.status;
}

/* ---- invariant 4: every block is a full box ---- */

typedef struct {
    size_t count;       /* rows, one for each block */
    bw_block *block;    /* [row] ascending; NULL: the row is the block's id */
    int32_t (*size)[3]; /* [row] */
    size_t *begin;      /* [row + 1] into hex: that of i, j, k is begin + i + size[0] * (j + size[1] * k) */
    bw_hex *hex;
} boxes;

static int by_id(const void *a, const void *b) {
    const bw_block *x = a, *y = b;
    return (*x > *y) - (*x < *y);
}

static size_t row_of(const boxes *b, bw_block block) {
    const bw_block *found = b->block ? bsearch(&block, b->block, b->count, sizeof block, by_id) : NULL;
    return found ? (size_t)(found - b->block) : (size_t)block;
}

/* Rows for as many blocks as there are, and no more than hexes: ids of a mesh that was read may be anything. */
static bw_status count_boxes(bw_context *ctx, const bw_hex_mesh *mesh, boxes *b) {
    for (size_t h = 0; h < mesh->hex_count; h++) {
        if (mesh->block[h] < 0) return fail_hex(ctx, mesh, h, "is in no block, others are");
        if ((size_t)mesh->block[h] >= b->count) b->count = (size_t)mesh->block[h] + 1;
    }
    if (b->count <= mesh->hex_count) return BW_OK;
    if (!(b->block = bw_alloc(ctx, mesh->hex_count, sizeof *b->block))) return ctx->error.status;
    memcpy(b->block, mesh->block, mesh->hex_count * sizeof *b->block);
    qsort(b->block, mesh->hex_count, sizeof *b->block, by_id);
    b->count = 0;
    for (size_t h = 0; h < mesh->hex_count; h++)
        if (!h || b->block[h] != b->block[b->count - 1]) b->block[b->count++] = b->block[h];
    return BW_OK;
}

static bw_status measure_boxes(bw_context *ctx, const bw_hex_mesh *mesh, boxes *b) {
    if (count_boxes(ctx, mesh, b)) return ctx->error.status;
    b->size = bw_alloc(ctx, b->count, sizeof *b->size);
    b->begin = bw_alloc(ctx, b->count + 1, sizeof *b->begin);
    b->hex = bw_alloc(ctx, mesh->hex_count, sizeof *b->hex);
    if (!b->size || !b->begin || !b->hex) return ctx->error.status;
    for (size_t h = 0; h < mesh->hex_count; h++) {
        size_t row = row_of(b, mesh->block[h]);
        b->begin[row + 1]++;
        for (int k = 0; k < 3; k++) {
            int32_t at = mesh->ijk[h][k], *size = &b->size[row][k];
            if (at < 0 || at == INT32_MAX) return fail_hex(ctx, mesh, h, "has a place outside its block");
            if (at >= *size) *size = at + 1;
        }
        b->hex[h] = BW_NONE;
    }
    for (size_t i = 0; i < b->count; i++) {
        const int32_t *n = b->size[i];
        if ((__int128)n[0] * n[1] * n[2] != (__int128)b->begin[i + 1])
            return bw_fail(ctx, BW_E_CHECK, "block %zu of %d x %d x %d hexes has %zu", b->block ? (size_t)b->block[i] : i, n[0], n[1], n[2], b->begin[i + 1]);
        b->begin[i + 1] += b->begin[i];
    }
    return bw_poll(ctx);
}

static size_t box_slot(const boxes *b, size_t row, const int32_t ijk[3]) {
    const int32_t *n = b->size[row];
    return b->begin[row] + (size_t)ijk[0] + (size_t)n[0] * ((size_t)ijk[1] + (size_t)n[1] * (size_t)ijk[2]);
}

/* Whether the hex next to h along an axis, if there is one in its block, has the same face there. */
static bool meets_next(const bw_hex_mesh *mesh, const boxes *b, size_t h, int axis) {
    int32_t at[3] = {mesh->ijk[h][0], mesh->ijk[h][1], mesh->ijk[h][2]};
    size_t row = row_of(b, mesh->block[h]);
    if (++at[axis] == b->size[row][axis]) return true;
    const bw_hvertex *x = mesh->hex[h], *y = mesh->hex[b->hex[box_slot(b, row, at)]];
    bool same = true;
    for (int c = 0; c < 8; c++)
        if (c >> axis & 1) same = same && x[c] == y[c ^ 1 << axis];
    return same;
}

typedef struct {
    const bw_hex_mesh *mesh;
    const boxes *boxes;
} box_check;

static bw_status meet_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const box_check *w = user;
    (void)range;
    for (size_t h = begin; h < end; h++)
        for (int axis = 0; axis < 3; axis++)
            if (!meets_next(w->mesh, w->boxes, h, axis)) return fail_hex(ctx, w->mesh, h, "does not meet the next one in its block");
    return BW_OK;
}

static bw_status check_boxes(bw_context *ctx, const bw_hex_mesh *mesh) {
    boxes b = {0};
    bool labelled = mesh->hex_count && mesh->block && mesh->block[0] != BW_NONE;
    for (size_t h = 0; h < mesh->hex_count && mesh->block && !labelled; h++) labelled = mesh->block[h] != BW_NONE;
    if (!labelled) return BW_OK;
    bw_status status = measure_boxes(ctx, mesh, &b);
    for (size_t h = 0; h < mesh->hex_count && status == BW_OK; h++) {
        bw_hex *slot = &b.hex[box_slot(&b, row_of(&b, mesh->block[h]), mesh->ijk[h])];
        if (*slot != BW_NONE) status = fail_hex(ctx, mesh, h, "has the place of another in its block");
        *slot = (bw_hex)h;
    }
    if (status == BW_OK) status = bw_parallel(ctx, mesh->hex_count, bw_parallel_ranges(ctx, mesh->hex_count, LEAST), meet_range, &(box_check){mesh, &b});
    bw_free(ctx, b.block);
    bw_free(ctx, b.size);
    bw_free(ctx, b.begin);
    bw_free(ctx, b.hex);
    return status;
}

bw_status bw_hex_mesh_check(bw_context *ctx, const bw_hex_mesh *mesh) {
    bw_status status = check_corners(ctx, mesh);
    if (status == BW_OK) status = bw_poll(ctx);
    if (status == BW_OK) status = check_links(ctx, mesh, false);
    if (status == BW_OK) status = bw_poll(ctx);
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
    if (bad) return bw_fail(ctx, BW_E_DUPLICATE, "%zu %s a vertex; the first is hex %lld", bad, bw_words(bad, "hex repeats", "hexes repeat"), (long long)ctx->error.elements[0].id);
    return check_links(ctx, mesh, true);
}
