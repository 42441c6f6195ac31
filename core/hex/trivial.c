#include "hex/trivial.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "hex/carrier.h"
#include "hex/incidence.h"

enum { TETS_MAX = 1 << 28, GRID_BITS = 44 };

/* Where a hex is in its chart: corner 0, and for each axis of the hex the axis of the chart that it runs along, counted from 1, negative if backwards. */
typedef struct {
    int32_t origin[3];
    int8_t along[3];
} placement;

/* A vertex that is added: the centre of a face (item = 6 * hex + face) or of a hex (item = hex), by the vertices around it, ascending. */
typedef struct {
    bw_vertex key[8]; /* of a face the last four are INT32_MAX */
    uint32_t item;
    bw_vertex vertex;
} centre;

typedef struct {
    bw_context *ctx;
    bw_tet_mesh *mesh;
    bw_hex_mesh *source;
    bw_trivial_report *report;
    uint32_t *mate; /* [6 * hex + face] */
    placement *place;
    uint8_t *crossed; /* [6 * hex + face], likewise for both mates */
    uint8_t *centred; /* [hex] */
    centre *added;
    size_t added_count, added_room;
    bw_vertex *face_centre; /* [6 * hex + face]; NULL if no face is crossed */
    bw_vertex *hex_centre;  /* [hex]; NULL if none is centred */
    bw_hex *hex_of;         /* [tet] before they are ordered */
} maker;

/* ---- the hexes ------------------------------------------------------------------------------------------------------ */

static void number_used(const bw_tet_mesh *mesh, bw_vertex *number, size_t *used) {
    for (size_t i = 0; i < 8 * mesh->hex_count; i++) number[mesh->hex[i / 8][i % 8]] = 1;
    *used = 0;
    for (size_t v = 0; v < mesh->vertex_count; v++) number[v] = number[v] ? (bw_vertex)(*used)++ : BW_NONE;
}

static bw_status renumber_features(bw_context *ctx, bw_tet_mesh *mesh, const bw_vertex *number) {
    size_t kept = 0;
    for (size_t i = 0; i < mesh->feature_vertex_count; i++)
        if (number[mesh->feature_vertex[i]] != BW_NONE) mesh->feature_vertex[kept++] = number[mesh->feature_vertex[i]];
    mesh->feature_vertex_count = kept;
    for (size_t i = 0; i < 2 * mesh->feature_edge_count; i++) {
        bw_vertex *v = &mesh->feature_edge[i / 2][i % 2];
        if (number[*v] == BW_NONE) return bw_fail(ctx, BW_E_INDEX, "feature edge %zu is no edge of the mesh", i / 2);
        *v = number[*v];
    }
    for (size_t i = 0; i < 4 * mesh->feature_quad_count; i++) {
        bw_vertex *v = &mesh->feature_quad[i / 4][i % 4];
        if (number[*v] == BW_NONE) return bw_fail(ctx, BW_E_INDEX, "feature quad %zu is no face of the mesh", i / 4);
        *v = number[*v];
    }
    return BW_OK;
}

/* Takes vertices away that are in no hex, and says in *kept which were left; NULL if all. */
static bw_status drop_unused(bw_context *ctx, bw_tet_mesh *mesh, bw_vertex **kept) {
    size_t used;
    bw_vertex *number = bw_alloc(ctx, mesh->vertex_count, sizeof *number);
    *kept = NULL;
    if (!number) return ctx->error.status;
    number_used(mesh, number, &used);
    bw_status status = used == mesh->vertex_count ? BW_OK : renumber_features(ctx, mesh, number);
    if (status == BW_OK && used < mesh->vertex_count && (*kept = bw_alloc(ctx, used, sizeof **kept))) {
        for (size_t v = 0; v < mesh->vertex_count; v++) {
            if (number[v] == BW_NONE) continue;
            (*kept)[number[v]] = (bw_vertex)v;
            memcpy(mesh->position[number[v]], mesh->position[v], sizeof mesh->position[v]);
        }
        for (size_t i = 0; i < 8 * mesh->hex_count; i++) mesh->hex[i / 8][i % 8] = number[mesh->hex[i / 8][i % 8]];
        mesh->vertex_count = used;
    }
    bw_free(ctx, number);
    return ctx->error.status;
}

static bw_status take_hexes(maker *m) {
    bw_hex_mesh *s = m->source;
    bw_tet_mesh *mesh = m->mesh;
    s->vertex_count = mesh->vertex_count, s->hex_count = mesh->hex_count, s->subdivide = 1;
    s->hex = mesh->hex;
    mesh->hex = NULL, mesh->hex_count = 0, mesh->of_hexes = 1;
    s->position = bw_alloc(m->ctx, s->vertex_count, sizeof *s->position);
    s->held = bw_alloc(m->ctx, s->vertex_count, sizeof *s->held);
    s->carrier = bw_alloc(m->ctx, s->vertex_count, sizeof *s->carrier);
    s->block = bw_alloc(m->ctx, s->hex_count, sizeof *s->block);
    s->ijk = bw_alloc(m->ctx, s->hex_count, sizeof *s->ijk);
    if (m->ctx->error.status != BW_OK) return m->ctx->error.status;
    memcpy(s->position, mesh->position, s->vertex_count * sizeof *s->position);
    for (size_t h = 0; h < s->hex_count; h++) s->block[h] = BW_NONE;
    return BW_OK;
}

/* Six times the volume that the boundary encloses: the sign of it tells the handedness of all corners. Faces are taken as both their pairs of triangles. */
static double enclosed(const maker *m) {
    const bw_hex_mesh *s = m->source;
    const double *origin = s->position[s->hex[0][0]];
    double sum = 0;
    for (size_t x = 0; x < 6 * s->hex_count; x++) {
        if (m->mate[x] != BW_HEX_NO_MATE) continue;
        for (int i = 0; i < 4; i++) {
            double p[3][3];
            for (int j = 0; j < 3; j++)
                for (int k = 0; k < 3; k++) p[j][k] = s->position[s->hex[x / 6][bw_hex_face_corner[x % 6][(i + j) & 3]]][k] - origin[k];
            for (int k = 0; k < 3; k++) {
                int a = (k + 1) % 3, b = (k + 2) % 3;
                sum += p[0][k] * (p[1][a] * p[2][b] - p[1][b] * p[2][a]) / 2;
            }
        }
    }
    return sum;
}

static void mirror(maker *m) {
    bw_hex_mesh *s = m->source;
    for (size_t h = 0; h < s->hex_count; h++)
        for (int c = 0; c < 8; c += 2) {
            bw_hvertex v = s->hex[h][c];
            s->hex[h][c] = s->hex[h][c + 1], s->hex[h][c + 1] = v;
        }
    for (size_t h = 0; h < s->hex_count; h++) { /* faces 0 and 1 have changed places */
        uint32_t *mate = m->mate + 6 * h, low = mate[0];
        mate[0] = mate[1], mate[1] = low;
        for (int f = 0; f < 6; f++)
            if (mate[f] != BW_HEX_NO_MATE && mate[f] % 6 < 2) mate[f] ^= 1;
    }
}

/* ---- charts --------------------------------------------------------------------------------------------------------- */

static void place_corner(const placement *p, int corner, int32_t out[3]) {
    memcpy(out, p->origin, sizeof p->origin);
    for (int k = 0; k < 3; k++)
        if (corner >> k & 1) out[abs(p->along[k]) - 1] += p->along[k] > 0 ? 1 : -1;
}

static int corner_of(const bw_hex_mesh *mesh, size_t hex, bw_hvertex vertex) {
    int c = 0;
    while (c < 8 && mesh->hex[hex][c] != vertex) c++;
    return c;
}

/* Places the hex across face x of one that has a place, in the same chart. */
static void place_across(const maker *m, uint32_t x, uint32_t y) {
    const bw_hex_mesh *s = m->source;
    const placement *from = &m->place[x / 6];
    placement *to = &m->place[y / 6];
    int32_t base[3], end[3];
    int corner = bw_hex_face_corner[y % 6][0], across = (int)(y % 6) / 2, axis = (int)(x % 6) / 2;
    place_corner(from, corner_of(s, x / 6, s->hex[y / 6][corner]), base);
    for (int k = 0; k < 3; k++) {
        if (k == across) continue;
        place_corner(from, corner_of(s, x / 6, s->hex[y / 6][corner ^ 1 << k]), end);
        for (int i = 0; i < 3; i++)
            if (end[i] != base[i]) to->along[k] = (int8_t)((i + 1) * (end[i] - base[i]) * (corner >> k & 1 ? -1 : 1));
    }
    bool out = x & 1, in_low = !(y & 1); /* x ^ face parity: x % 6 and x agree modulo 2 */
    to->along[across] = (int8_t)(out == in_low ? from->along[axis] : -from->along[axis]);
    memcpy(to->origin, base, sizeof base);
    for (int k = 0; k < 3; k++)
        if (corner >> k & 1) to->origin[abs(to->along[k]) - 1] -= to->along[k] > 0 ? 1 : -1;
}

static void sort_vertices(bw_vertex *v, int n) {
    for (int i = 1; i < n; i++)
        for (int j = i; j > 0 && v[j - 1] > v[j]; j--) {
            bw_vertex swap = v[j];
            v[j] = v[j - 1], v[j - 1] = swap;
        }
}

static void sorted_corners(const bw_hex_mesh *s, size_t hex, bw_vertex out[8]) {
    memcpy(out, s->hex[hex], 8 * sizeof *out);
    sort_vertices(out, 8);
}

static bool comes_before(const bw_hex_mesh *s, size_t a, size_t b) {
    bw_vertex x[8], y[8];
    sorted_corners(s, a, x), sorted_corners(s, b, y);
    for (int i = 0; i < 8; i++)
        if (x[i] != y[i]) return x[i] < y[i];
    return false;
}

/* Breadth first from `root` over the hexes that are not at `mark` yet; each gets it. With `place` they get places too. Returns how many; they are in queue[0..]. */
static size_t flood(const maker *m, uint32_t root, uint8_t mark, uint8_t *seen, uint32_t *queue, bool place) {
    size_t head = 0, tail = 0;
    queue[tail++] = root;
    seen[root] = mark;
    while (head < tail) {
        uint32_t h = queue[head++];
        for (uint32_t x = 6 * h; x < 6 * h + 6; x++) {
            uint32_t y = m->mate[x];
            if (y == BW_HEX_NO_MATE || seen[y / 6] == mark) continue;
            if (place) place_across(m, x, y);
            seen[y / 6] = mark;
            queue[tail++] = y / 6;
        }
    }
    return tail;
}

static bw_status place_hexes(maker *m) {
    size_t n = m->source->hex_count;
    m->place = bw_alloc(m->ctx, n, sizeof *m->place);
    uint8_t *seen = bw_alloc(m->ctx, n, 1);
    uint32_t *queue = bw_alloc(m->ctx, n, sizeof *queue);
    for (uint32_t h = 0; h < n && m->ctx->error.status == BW_OK; h++) {
        if (seen[h]) continue;
        size_t count = flood(m, h, 1, seen, queue, false);
        uint32_t root = h;
        for (size_t i = 1; i < count; i++)
            if (comes_before(m->source, queue[i], root)) root = queue[i];
        m->place[root] = (placement){.along = {1, 2, 3}};
        flood(m, root, 2, seen, queue, true);
    }
    bw_free(m->ctx, seen);
    bw_free(m->ctx, queue);
    return m->ctx->error.status;
}

/* ---- which faces cannot be halved ------------------------------------------------------------------------------------ */

/* Local number, within bw_hex_face_corner, of the lowest vertex of a face: it is halved from there. */
static int lowest_of_face(const bw_hex_mesh *s, size_t x) {
    const uint8_t *c = bw_hex_face_corner[x % 6];
    int at = 0;
    for (int i = 1; i < 4; i++)
        if (s->hex[x / 6][c[i]] < s->hex[x / 6][c[at]]) at = i;
    return at;
}

static int lowest_of_hex(const bw_hex_mesh *s, size_t hex) {
    int at = 0;
    for (int i = 1; i < 8; i++)
        if (s->hex[hex][i] < s->hex[hex][at]) at = i;
    return at;
}

static bool is_first(const maker *m, size_t x) { return m->mate[x] == BW_HEX_NO_MATE || x < m->mate[x]; }

/* A diagonal: of a face (item = 6 * hex + face) or of a hex (item = 6 * hexes + hex). */
typedef struct {
    bw_vertex high;
    uint32_t item;
} diagonal;

static bw_vertex ends_of(const maker *m, size_t item, bw_vertex *high) {
    const bw_hex_mesh *s = m->source;
    bw_vertex a, b;
    if (item < 6 * s->hex_count) {
        int at = lowest_of_face(s, item);
        a = s->hex[item / 6][bw_hex_face_corner[item % 6][at]], b = s->hex[item / 6][bw_hex_face_corner[item % 6][at ^ 2]];
    } else {
        size_t h = item - 6 * s->hex_count;
        int at = lowest_of_hex(s, h);
        a = s->hex[h][at], b = s->hex[h][7 ^ at];
    }
    *high = b;
    return a; /* the lowest of its face or hex */
}

static void give_up(maker *m, uint32_t item) {
    size_t faces = 6 * m->source->hex_count;
    if (item >= faces) {
        m->centred[item - faces] = 1;
        return;
    }
    m->crossed[item] = m->centred[item / 6] = 1;
    if (m->mate[item] != BW_HEX_NO_MATE) m->crossed[m->mate[item]] = m->centred[m->mate[item] / 6] = 1;
}

static int by_high(const void *a, const void *b) {
    const diagonal *x = a, *y = b;
    return (x->high > y->high) - (x->high < y->high);
}

/* Among the diagonals at one lowest vertex: those with the same other end as another one, or as an edge. `edge`: the other ends of its edges, ascending. */
static void judge_diagonals(maker *m, diagonal *list, size_t count, const bw_hvertex *edge, size_t edge_count) {
    qsort(list, count, sizeof *list, by_high);
    for (size_t i = 0, e = 0; i < count; i++) {
        while (e < edge_count && edge[e] < list[i].high) e++;
        bool twice = (i > 0 && list[i - 1].high == list[i].high) || (i + 1 < count && list[i + 1].high == list[i].high);
        if (twice || (e < edge_count && edge[e] == list[i].high)) give_up(m, list[i].item);
    }
}

static bw_status judge_all(maker *m, const bw_hex_edges *edges) {
    size_t n = m->source->vertex_count, items = 7 * m->source->hex_count, faces = 6 * m->source->hex_count;
    size_t *begin = bw_alloc(m->ctx, n + 2, sizeof *begin);
    bw_vertex high;
    diagonal *list = NULL;
    for (size_t i = 0; i < items && begin; i++)
        if (i >= faces || is_first(m, i)) begin[ends_of(m, i, &high) + 2]++;
    for (size_t v = 2; v < n + 2 && begin; v++) begin[v] += begin[v - 1];
    if (begin) list = bw_alloc(m->ctx, begin[n + 1], sizeof *list);
    for (size_t i = 0; i < items && list; i++) {
        if (i < faces && !is_first(m, i)) continue;
        bw_vertex low = ends_of(m, i, &high);
        list[begin[low + 1]++] = (diagonal){high, (uint32_t)i};
    }
    for (size_t v = 0; v < n && list; v++)
        judge_diagonals(m, list + begin[v], begin[v + 1] - begin[v], edges->high + edges->begin[v], edges->begin[v + 1] - edges->begin[v]);
    bw_free(m->ctx, begin);
    bw_free(m->ctx, list);
    return m->ctx->error.status;
}

/* Hexes that share three faces at a corner would share tets too. */
static void judge_neighbours(maker *m) {
    for (size_t h = 0; h < m->source->hex_count; h++)
        for (size_t i = 0; i < 6; i++)
            for (size_t j = 0; j < i; j++) {
                uint32_t a = m->mate[6 * h + i], b = m->mate[6 * h + j];
                if (a != BW_HEX_NO_MATE && b != BW_HEX_NO_MATE && a / 6 == b / 6) m->centred[h] = 1;
            }
}

static int by_key(const void *a, const void *b) {
    const centre *x = a, *y = b;
    for (int i = 0; i < 8; i++)
        if (x->key[i] != y->key[i]) return x->key[i] < y->key[i] ? -1 : 1;
    return 0;
}

static bw_status add_centre(maker *m, size_t hex, int face) {
    bw_status status = bw_reserve(m->ctx, &m->added, &m->added_room, m->added_count + 1);
    if (status != BW_OK) return status;
    centre *c = &m->added[m->added_count++];
    c->item = (uint32_t)(face < 0 ? hex : 6 * hex + (size_t)face);
    for (int i = 0; i < 8; i++) c->key[i] = face < 0 ? m->source->hex[hex][i] : i < 4 ? m->source->hex[hex][bw_hex_face_corner[face][i]] : INT32_MAX;
    sort_vertices(c->key, 8);
    return BW_OK;
}

static void put_centre(maker *m, const centre *c) {
    bool of_face = c->key[4] == INT32_MAX;
    double *p = m->mesh->position[c->vertex];
    int n = of_face ? 4 : 8;
    for (int k = 0; k < 3; k++) {
        p[k] = 0;
        for (int i = 0; i < n; i++) p[k] += m->mesh->position[c->key[i]][k] / n;
    }
    if (!of_face) {
        m->hex_centre[c->item] = c->vertex;
        return;
    }
    m->face_centre[c->item] = c->vertex;
    if (m->mate[c->item] != BW_HEX_NO_MATE) m->face_centre[m->mate[c->item]] = c->vertex;
}

/* Adds the vertices of all centres, in the order of the vertices around them. */
static bw_status add_centres(maker *m) {
    bw_tet_mesh *mesh = m->mesh;
    size_t n = m->source->hex_count, room = mesh->vertex_count;
    bw_status status = BW_OK;
    for (size_t h = 0; h < n && status == BW_OK; h++) {
        if (!m->centred[h]) continue;
        status = add_centre(m, h, -1), m->report->centred++;
        for (int f = 0; f < 6 && status == BW_OK; f++)
            if (m->crossed[6 * h + (size_t)f] && is_first(m, 6 * h + (size_t)f)) status = add_centre(m, h, f), m->report->crossed++;
    }
    if (status != BW_OK || !m->added_count) return status;
    qsort(m->added, m->added_count, sizeof *m->added, by_key);
    m->face_centre = bw_alloc(m->ctx, 6 * n, sizeof *m->face_centre);
    m->hex_centre = bw_alloc(m->ctx, n, sizeof *m->hex_centre);
    if (!m->face_centre || !m->hex_centre || mesh->vertex_count + m->added_count > INT32_MAX ||
        bw_reserve(m->ctx, &mesh->position, &room, mesh->vertex_count + m->added_count))
        return bw_fail(m->ctx, BW_E_LIMIT, "the tets of the mesh have more vertices than can be numbered");
    for (size_t i = 0; i < m->added_count; i++) m->added[i].vertex = (bw_vertex)mesh->vertex_count++, put_centre(m, &m->added[i]);
    return BW_OK;
}

static bw_status judge_faces(maker *m) {
    bw_hex_edges edges = {0};
    m->crossed = bw_alloc(m->ctx, 6 * m->source->hex_count, 1);
    m->centred = bw_alloc(m->ctx, m->source->hex_count, 1);
    bw_status status = m->crossed && m->centred ? bw_hex_edges_init(m->ctx, m->source, &edges) : m->ctx->error.status;
    if (status == BW_OK) status = judge_all(m, &edges);
    bw_hex_edges_clear(m->ctx, &edges);
    if (status == BW_OK) judge_neighbours(m), status = add_centres(m);
    return status;
}

/* ---- tets ------------------------------------------------------------------------------------------------------------ */

/* Triangles of a face, counter-clockwise seen from outside; how many. */
static int face_triangles(const maker *m, size_t x, bw_vertex out[4][3]) {
    const uint8_t *c = bw_hex_face_corner[x % 6];
    const bw_hvertex *v = m->source->hex[x / 6];
    if (m->crossed[x]) {
        for (int i = 0; i < 4; i++) out[i][0] = m->face_centre[x], out[i][1] = v[c[i]], out[i][2] = v[c[(i + 1) & 3]];
        return 4;
    }
    int at = lowest_of_face(m->source, x);
    for (int i = 0; i < 2; i++) out[i][0] = v[c[at]], out[i][1] = v[c[(at + 1 + i) & 3]], out[i][2] = v[c[(at + 2 + i) & 3]];
    return 2;
}

/* The tets of a hex: the apex joined to the faces that do not have it. Returns how many; out may be NULL. */
static int hex_tets(const maker *m, size_t hex, bw_vertex (*out)[4]) {
    int lowest = lowest_of_hex(m->source, hex), count = 0;
    for (int f = 0; f < 6; f++) {
        bw_vertex triangle[4][3];
        if (!m->centred[hex] && (lowest >> f / 2 & 1) == (f & 1)) continue;
        int n = face_triangles(m, 6 * hex + (size_t)f, triangle);
        for (int i = 0; i < n && out; i++) {
            out[count + i][0] = m->centred[hex] ? m->hex_centre[hex] : m->source->hex[hex][lowest];
            memcpy(out[count + i] + 1, triangle[i], sizeof triangle[i]);
        }
        count += n;
    }
    return count;
}

static bw_status make_tets(maker *m) {
    bw_tet_mesh *mesh = m->mesh;
    size_t count = 0;
    for (size_t h = 0; h < m->source->hex_count; h++) count += (size_t)hex_tets(m, h, NULL);
    if (count > TETS_MAX) return bw_fail(m->ctx, BW_E_LIMIT, "%zu hexes are too many: they have more than %d tets", m->source->hex_count, TETS_MAX);
    mesh->tet = bw_alloc(m->ctx, count, sizeof *mesh->tet);
    m->hex_of = bw_alloc(m->ctx, count, sizeof *m->hex_of);
    if (!mesh->tet || !m->hex_of) return m->ctx->error.status;
    for (size_t h = 0; h < m->source->hex_count; h++) {
        int n = hex_tets(m, h, mesh->tet + mesh->tet_count);
        for (int i = 0; i < n; i++) m->hex_of[mesh->tet_count++] = (bw_hex)h;
    }
    if (bw_tet_mesh_order(m->ctx, mesh) != BW_OK) return m->ctx->error.status;
    for (size_t t = 0; t < count; t++) mesh->tet_id[t] = m->hex_of[mesh->tet_id[t]];
    return BW_OK;
}

/* Twice the coordinates of a vertex of a hex, or of a centre. */
static void doubled(const maker *m, size_t hex, bw_vertex v, int64_t out[3]) {
    int a = corner_of(m->source, hex, v), b = a;
    if (a == 8) {
        a = 0, b = 7;
        for (int f = 0; f < 6; f++)
            if (m->face_centre[6 * hex + (size_t)f] == v) a = bw_hex_face_corner[f][0], b = bw_hex_face_corner[f][2];
    }
    int32_t x[3], y[3];
    place_corner(&m->place[hex], a, x), place_corner(&m->place[hex], b, y);
    for (int k = 0; k < 3; k++) out[k] = (int64_t)x[k] + y[k];
}

static bw_status make_values(maker *m, bw_grid_map *map) {
    int32_t most = 1, corner[3];
    for (size_t i = 0; i < 8 * m->source->hex_count; i++) {
        place_corner(&m->place[i / 8], (int)(i % 8), corner);
        for (int k = 0; k < 3; k++)
            if (abs(corner[k]) > most) most = abs(corner[k]);
    }
    int bits;
    frexp((double)most, &bits);
    map->exponent = GRID_BITS - bits;
    map->value = bw_alloc(m->ctx, m->mesh->tet_count, sizeof *map->value);
    if (!map->value) return m->ctx->error.status;
    for (size_t t = 0; t < m->mesh->tet_count; t++)
        for (int i = 0; i < 4; i++) {
            doubled(m, (size_t)m->mesh->tet_id[t], m->mesh->tet[t][i], map->value[t][i]);
            for (int k = 0; k < 3; k++) map->value[t][i][k] *= (int64_t)1 << (map->exponent - 1);
        }
    return BW_OK;
}

/* ---- features -------------------------------------------------------------------------------------------------------- */

/* The centre of a face that is cut into four; BW_NONE if it is halved, or no face. */
static bw_vertex centre_of_quad(const maker *m, const bw_vertex quad[4]) {
    centre key = {.key = {quad[0], quad[1], quad[2], quad[3], INT32_MAX, INT32_MAX, INT32_MAX, INT32_MAX}};
    sort_vertices(key.key, 4);
    const centre *at = m->added_count ? bsearch(&key, m->added, m->added_count, sizeof key, by_key) : NULL;
    return at ? at->vertex : BW_NONE;
}

static bw_status split_features(maker *m) {
    bw_tet_mesh *mesh = m->mesh;
    size_t n = mesh->feature_quad_count, count = 0;
    if (!n) return BW_OK;
    mesh->feature_facet = bw_alloc(m->ctx, 4 * n, sizeof *mesh->feature_facet);
    if (!mesh->feature_facet) return m->ctx->error.status;
    for (size_t i = 0; i < n; i++) {
        const bw_vertex *q = mesh->feature_quad[i];
        bw_vertex middle = centre_of_quad(m, q);
        int at = 0;
        for (int k = 1; k < 4; k++)
            if (q[k] < q[at]) at = k;
        for (int k = 0; k < (middle == BW_NONE ? 2 : 4); k++) {
            bw_vertex *f = mesh->feature_facet[count++];
            f[0] = middle == BW_NONE ? q[at] : middle;
            for (int j = 0; j < 2; j++) f[1 + j] = q[(at + k + j + (middle == BW_NONE)) & 3];
        }
    }
    mesh->feature_facet_count = count;
    bw_free(m->ctx, mesh->feature_quad);
    mesh->feature_quad = NULL, mesh->feature_quad_count = 0;
    return BW_OK;
}

bw_status bw_trivial_map(bw_context *ctx, bw_tet_mesh *mesh, bw_grid_map *map, bw_hex_mesh *source, bw_vertex **source_vertex, bw_trivial_report *report) {
    maker m = {.ctx = ctx, .mesh = mesh, .source = source, .report = report};
    bw_hex_mesh as_read = {.vertex_count = mesh->vertex_count, .hex_count = mesh->hex_count, .position = mesh->position, .hex = mesh->hex};
    *report = (bw_trivial_report){0};
    memset(source, 0, sizeof *source);
    *source_vertex = NULL;
    if (!mesh->hex_count) return bw_fail(ctx, BW_E_EMPTY, "the input has no hexes");
    if (bw_hex_mesh_check_input(ctx, &as_read) || drop_unused(ctx, mesh, source_vertex) || take_hexes(&m) || bw_hex_mates(ctx, source, &m.mate) || bw_poll(ctx)) goto out;
    report->mirrored = enclosed(&m) < 0;
    if (report->mirrored) mirror(&m);
    bw_progress(ctx, 0.3);
    if (place_hexes(&m) || judge_faces(&m) || bw_poll(ctx)) goto out;
    bw_progress(ctx, 0.5);
    if (make_tets(&m) || bw_poll(ctx) || make_values(&m, map)) goto out;
    split_features(&m);
out:
    bw_free(ctx, m.mate), bw_free(ctx, m.place), bw_free(ctx, m.crossed), bw_free(ctx, m.centred), bw_free(ctx, m.added);
    bw_free(ctx, m.face_centre), bw_free(ctx, m.hex_centre), bw_free(ctx, m.hex_of);
    return ctx->error.status;
}

/* ---- labels ---------------------------------------------------------------------------------------------------------- */

typedef struct {
    size_t *begin; /* [hex + 1] into tet */
    bw_tet *tet;
} hex_index;

static bw_status index_tets(bw_context *ctx, const bw_tet_mesh *mesh, size_t hexes, hex_index *index) {
    index->begin = bw_alloc(ctx, hexes + 2, sizeof *index->begin);
    index->tet = bw_alloc(ctx, mesh->tet_count, sizeof *index->tet);
    if (!index->begin || !index->tet) return ctx->error.status;
    for (size_t t = 0; t < mesh->tet_count; t++) index->begin[mesh->tet_id[t] + 2]++;
    for (size_t h = 2; h < hexes + 2; h++) index->begin[h] += index->begin[h - 1];
    for (size_t t = 0; t < mesh->tet_count; t++) index->tet[index->begin[mesh->tet_id[t] + 1]++] = (bw_tet)t;
    return BW_OK;
}

static bw_status fail_split(bw_context *ctx, const bw_hex_mesh *source, size_t hex) {
    bw_fail_element(ctx, "hex", (int64_t)hex, source->position[source->hex[hex][0]]);
    return bw_fail(ctx, BW_E_CHECK, "a wall runs through hex %zu", hex);
}

/* Corners of a hex in its block, in grid units: those of the tet's four and what follows for the rest is known from any tets that have corners 0, 1, 2 and 4. */
static bw_status label_hex(bw_context *ctx, const bw_cells *cells, const bw_complex *x, const hex_index *index, bw_hex_mesh *source, size_t hex) {
    const bw_tet_mesh *mesh = cells->mesh;
    int64_t at[8][3], unit = (int64_t)1 << cells->map->exponent, low[3];
    bw_tet first = index->tet[index->begin[hex]];
    const bw_transition *chart = bw_complex_chart(x, first);
    unsigned known = 0;
    for (size_t i = index->begin[hex]; i < index->begin[hex + 1]; i++) {
        bw_tet t = index->tet[i];
        if (x->cell_block[t] != x->cell_block[first] || !bw_transition_equal(bw_complex_chart(x, t), chart)) return fail_split(ctx, source, hex);
        for (int k = 0; k < 4; k++) {
            int c = corner_of(source, hex, mesh->tet[t][k]);
            if (c < 8 && !(known >> c & 1)) bw_transition_apply(chart, cells->map->value[t][k], at[c]), known |= 1u << c;
        }
    }
    bw_hvertex turned[8];
    memcpy(low, at[0], sizeof low);
    for (int i = 0; i < 24; i++)
        if (at[i / 3][i % 3] < low[i % 3]) low[i % 3] = at[i / 3][i % 3];
    for (int c = 0; c < 8; c++) {
        int bits = 0;
        for (int k = 0; k < 3; k++) bits |= (at[c][k] > low[k]) << k;
        turned[bits] = source->hex[hex][c];
    }
    memcpy(source->hex[hex], turned, sizeof turned);
    source->block[hex] = x->cell_block[first];
    for (int k = 0; k < 3; k++) source->ijk[hex][k] = (int32_t)(low[k] / unit);
    return BW_OK;
}

bw_status bw_trivial_label(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_hex_mesh *source) {
    hex_index index = {0};
    if (cells->cell_count > cells->mesh->tet_count) return fail_split(ctx, source, (size_t)cells->mesh->tet_id[cells->cut_from[0]]);
    bw_status status = index_tets(ctx, cells->mesh, source->hex_count, &index);
    for (size_t h = 0; h < source->hex_count && status == BW_OK; h++) status = label_hex(ctx, cells, complex, &index, source, h);
    bw_free(ctx, index.begin);
    bw_free(ctx, index.tet);
    return status;
}

bw_status bw_trivial_hold(bw_context *ctx, const bw_tet_mesh *mesh, const bw_grid_map *map, bw_hex_mesh *source) {
    bw_carriers carriers = {0};
    bw_status status = bw_carriers_init(ctx, mesh, map, &carriers);
    for (size_t v = 0; v < source->vertex_count && status == BW_OK; v++) {
        bw_hold hold = bw_carriers_hold(&carriers, BW_IN_VERTEX, (int32_t)v, carriers.vertex_tet[v]);
        source->held[v] = hold.held, source->carrier[v] = hold.carrier;
    }
    bw_carriers_clear(ctx, &carriers);
    return status;
}

/* The face of a hex that a polygon of one of its tets lies in, by its plane in the block. */
static size_t face_of_polygon(const bw_cells *cells, const bw_complex *complex, const bw_hex_mesh *source, bw_polygon p, int slot) {
    bw_tet t = bw_cells_tet(cells, cells->polygon[p].cell[slot]);
    bw_plane plane = bw_transition_plane(bw_complex_chart(complex, t), bw_cells_polygon_plane(cells, p, t));
    size_t hex = (size_t)cells->mesh->tet_id[t];
    bool high = plane.value > (int64_t)source->ijk[hex][plane.axis] << cells->map->exponent;
    return 6 * hex + 2 * (size_t)plane.axis + high;
}

bw_status bw_trivial_walls(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const bw_hex_mesh *source, uint8_t **wall) {
    *wall = bw_alloc(ctx, 6 * source->hex_count, 1);
    if (!*wall) return ctx->error.status;
    for (size_t p = 0; p < cells->polygon_count; p++) {
        const bw_cell_polygon *polygon = &cells->polygon[p];
        if (!bw_cells_polygon_is_leaf(cells, (bw_polygon)p) || (polygon->flags & (BW_WALL | BW_BOUNDARY)) != BW_WALL) continue;
        size_t a = face_of_polygon(cells, complex, source, (bw_polygon)p, 0), b = face_of_polygon(cells, complex, source, (bw_polygon)p, 1);
        (*wall)[a < b ? a : b] = 1;
    }
    return BW_OK;
}
