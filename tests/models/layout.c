#include "models/layout.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

double bw_snap(double value) {
    return floor(value * 0x1p32 + 0.5) * 0x1p-32;
}

bw_turn bw_turn_identity(void) {
    return (bw_turn){{0, 1, 2}, {1, 1, 1}};
}

bw_turn bw_turn_compose(bw_turn after, bw_turn before) {
    bw_turn t;
    for (int i = 0; i < 3; i++) {
        t.axis[i] = before.axis[after.axis[i]];
        t.sign[i] = (int8_t)(after.sign[i] * before.sign[after.axis[i]]);
    }
    return t;
}

static bw_turn turn_inverse(bw_turn t) {
    bw_turn r = bw_turn_identity();
    for (int i = 0; i < 3; i++) {
        r.axis[t.axis[i]] = (int8_t)i;
        r.sign[t.axis[i]] = t.sign[i];
    }
    return r;
}

static int turn_determinant(bw_turn t) {
    bool even = (t.axis[0] + 1) % 3 == t.axis[1];
    return (even ? 1 : -1) * t.sign[0] * t.sign[1] * t.sign[2];
}

/* The 8 combinations of signs of each of the 6 permutations, less those that mirror. */
bw_turn bw_turn_number(int number) {
    for (int p = 0; p < 6; p++)
        for (int s = 0; s < 8; s++) {
            int first = p % 3, step = p < 3 ? 1 : 2;
            bw_turn t;
            for (int i = 0; i < 3; i++) {
                t.axis[i] = (int8_t)((first + i * step) % 3);
                t.sign[i] = s >> i & 1 ? -1 : 1;
            }
            if (turn_determinant(t) > 0 && number-- == 0) return t;
        }
    return bw_turn_identity();
}

void bw_turn_apply(bw_turn turn, const double u[3], double out[3]) {
    double v[3];
    for (int i = 0; i < 3; i++) v[i] = turn.sign[i] * u[turn.axis[i]];
    memcpy(out, v, sizeof v);
}

void bw_move_apply(const bw_move *move, const double u[3], double out[3]) {
    bw_turn_apply(move->turn, u, out);
    for (int i = 0; i < 3; i++) out[i] += move->shift[i];
}

void bw_layout_init(bw_context *ctx, bw_layout *layout) {
    memset(layout, 0, sizeof *layout);
    layout->ctx = ctx;
}

void bw_layout_clear(bw_layout *layout) {
    bw_context *ctx = layout->ctx;
    bw_free(ctx, layout->block);
    bw_free(ctx, layout->face);
    bw_free(ctx, layout->edge);
    bw_free(ctx, layout->sheet);
    bw_free(ctx, layout->star);
    bw_free(ctx, layout->spoke);
    bw_free(ctx, layout->key);
    bw_free(ctx, layout->arc);
    bw_layout_init(ctx, layout);
}

static int32_t find_key(const bw_layout *l, int64_t key) {
    for (size_t i = 0; i < l->key_count; i++)
        if (l->key[i].key == key) return l->key[i].node;
    return -1;
}

static void name_node(bw_layout *l, int64_t key, int32_t node) {
    if (bw_reserve(l->ctx, &l->key, &l->key_capacity, l->key_count + 1)) return;
    l->key[l->key_count++] = (struct bw_layout_key){key, node};
}

static int32_t node_of(bw_layout *l, int64_t key) {
    int32_t node = find_key(l, key);
    if (node >= 0) return node;
    name_node(l, key, (int32_t)l->node_count);
    return (int32_t)l->node_count++;
}

void bw_layout_alias(bw_layout *l, int64_t key, int64_t other) {
    if (l->ctx->error.status) return;
    name_node(l, key, node_of(l, other));
}

void bw_layout_block_add(bw_layout *l, const int64_t key[8], const double point[8][3], int tag) {
    if (l->ctx->error.status || bw_reserve(l->ctx, &l->block, &l->block_capacity, l->block_count + 1)) return;
    bw_layout_block *b = &l->block[l->block_count++];
    for (int i = 0; i < 8; i++) b->corner[i] = node_of(l, key[i]);
    memcpy(b->point, point, sizeof b->point);
    b->tag = tag;
}

void bw_layout_arc(bw_layout *l, int64_t from, int64_t to, const double centre[3], int axis) {
    if (l->ctx->error.status || bw_reserve(l->ctx, &l->arc, &l->arc_capacity, l->arc_count + 1)) return;
    int32_t a = node_of(l, from), b = node_of(l, to);
    bw_layout_edge *e = &l->arc[l->arc_count++];
    *e = (bw_layout_edge){.node = {a < b ? a : b, a < b ? b : a}, .axis = axis, .curved = true};
    memcpy(e->centre, centre, sizeof e->centre);
}

/* --- geometry --- */

/* Point of an edge at s from p to q; an arc interpolates radius and angle, and the third coordinate as it is.
 */
static void edge_point(const bw_layout_edge *e, const double p[3], const double q[3], double s,
                       double out[3]) {
    for (int i = 0; i < 3; i++) out[i] = p[i] + s * (q[i] - p[i]);
    if (!e->curved) return;
    int u = (e->axis + 1) % 3, v = (e->axis + 2) % 3;
    double pu = p[u] - e->centre[u], pv = p[v] - e->centre[v], qu = q[u] - e->centre[u],
           qv = q[v] - e->centre[v];
    double angle = atan2(pv, pu), turn = atan2(pu * qv - pv * qu, pu * qu + pv * qv);
    double r = hypot(pu, pv), radius = r + s * (hypot(qu, qv) - r);
    out[u] = e->centre[u] + radius * cos(angle + s * turn);
    out[v] = e->centre[v] + radius * sin(angle + s * turn);
}

/* Transfinite interpolation of the twelve edges: on a face it depends on that face's edges alone, so
 * neighbours agree. */
void bw_layout_point(const bw_layout *l, int32_t block, const double local[3], double out[3]) {
    const bw_layout_block *b = &l->block[block];
    double sum[3] = {0, 0, 0};
    for (int a = 0; a < 3; a++)
        for (int k = 0; k < 4; k++) {
            int a1 = (a + 1) % 3, a2 = (a + 2) % 3, c = (k & 1) << a1 | (k >> 1) << a2;
            double w = (k & 1 ? local[a1] : 1 - local[a1]) * (k & 2 ? local[a2] : 1 - local[a2]), p[3];
            const double *from = b->point[c], *to = b->point[c | 1 << a];
            edge_point(&l->edge[b->edge[4 * a + k]], from, to, local[a], p);
            for (int i = 0; i < 3; i++) {
                double straight = from[i] + local[a] * (to[i] - from[i]);
                sum[i] += w * (p[i] - straight * 2 / 3);
            }
        }
    if (l->warp)
        l->warp(l->data, b->tag, sum, out);
    else
        memcpy(out, sum, sizeof sum);
}

double bw_layout_length(const bw_layout *l, int32_t block, int axis) {
    return l->sheet[l->edge[l->block[block].edge[4 * axis]].sheet].length;
}

int bw_layout_cells(const bw_layout *l, int32_t block, int axis) {
    return l->sheet[l->edge[l->block[block].edge[4 * axis]].sheet].cells;
}

/* --- faces and edges --- */

static void face_corners(int face, int corner[4]) {
    int axis = face / 2, n = 0;
    for (int c = 0; c < 8; c++)
        if ((c >> axis & 1) == (face & 1)) corner[n++] = c;
}

static void edge_corners(int edge, int corner[2]) {
    int a = edge / 4, k = edge % 4;
    corner[0] = (k & 1) << (a + 1) % 3 | (k >> 1) << (a + 2) % 3;
    corner[1] = corner[0] | 1 << a;
}

static int by_number(const void *x, const void *y) {
    int32_t a = *(const int32_t *)x, b = *(const int32_t *)y;
    return (a > b) - (a < b);
}

static int by_nodes_face(const void *x, const void *y) {
    const bw_layout_face *a = x, *b = y;
    for (int i = 0; i < 4; i++)
        if (a->node[i] != b->node[i]) return a->node[i] < b->node[i] ? -1 : 1;
    return (a->block[0] > b->block[0]) - (a->block[0] < b->block[0]);
}

static int by_nodes_edge(const void *x, const void *y) {
    const bw_layout_edge *a = x, *b = y;
    for (int i = 0; i < 2; i++)
        if (a->node[i] != b->node[i]) return a->node[i] < b->node[i] ? -1 : 1;
    return 0;
}

int32_t bw_layout_find_face(const bw_layout *l, const int32_t node[4]) {
    bw_layout_face want = {.node = {node[0], node[1], node[2], node[3]}};
    qsort(want.node, 4, sizeof *want.node, by_number);
    for (size_t f = 0; f < l->face_count; f++)
        if (!memcmp(l->face[f].node, want.node, sizeof want.node)) return (int32_t)f;
    return -1;
}

int32_t bw_layout_find_edge(const bw_layout *l, int32_t a, int32_t b) {
    bw_layout_edge want = {.node = {a < b ? a : b, a < b ? b : a}};
    const bw_layout_edge *e = bsearch(&want, l->edge, l->edge_count, sizeof *e, by_nodes_edge);
    return e ? (int32_t)(e - l->edge) : -1;
}

static bw_status make_faces(bw_layout *l) {
    l->face = bw_alloc(l->ctx, 6 * l->block_count, sizeof *l->face);
    if (!l->face) return l->ctx->error.status;
    size_t n = 0;
    for (size_t b = 0; b < l->block_count; b++)
        for (int k = 0; k < 6; k++) {
            int c[4];
            face_corners(k, c);
            bw_layout_face *f = &l->face[n++];
            for (int i = 0; i < 4; i++) f->node[i] = l->block[b].corner[c[i]];
            qsort(f->node, 4, sizeof *f->node, by_number);
            f->block[0] = (int32_t)b;
            f->block[1] = -1;
        }
    qsort(l->face, n, sizeof *l->face, by_nodes_face);
    for (size_t i = 0; i < n; i++) {
        bw_layout_face *last = l->face_count ? &l->face[l->face_count - 1] : NULL;
        if (!last || memcmp(last->node, l->face[i].node, sizeof last->node))
            l->face[l->face_count++] = l->face[i];
        else if (last->block[1] >= 0 || last->block[0] == l->face[i].block[0])
            return bw_fail(l->ctx, BW_E_INTERNAL, "layout: a face has three blocks, or one block twice");
        else
            last->block[1] = l->face[i].block[0];
    }
    for (size_t b = 0; b < l->block_count; b++)
        for (int k = 0; k < 6; k++) {
            int c[4];
            int32_t node[4];
            face_corners(k, c);
            for (int i = 0; i < 4; i++) node[i] = l->block[b].corner[c[i]];
            l->block[b].face[k] = bw_layout_find_face(l, node);
        }
    return BW_OK;
}

static bw_status make_edges(bw_layout *l) {
    l->edge = bw_alloc(l->ctx, 12 * l->block_count, sizeof *l->edge);
    if (!l->edge) return l->ctx->error.status;
    size_t n = 0;
    for (size_t b = 0; b < l->block_count; b++)
        for (int k = 0; k < 12; k++) {
            int c[2];
            edge_corners(k, c);
            int32_t p = l->block[b].corner[c[0]], q = l->block[b].corner[c[1]];
            if (p == q) return bw_fail(l->ctx, BW_E_INTERNAL, "layout: an edge is a loop");
            l->edge[n++] = (bw_layout_edge){.node = {p < q ? p : q, p < q ? q : p}};
        }
    qsort(l->edge, n, sizeof *l->edge, by_nodes_edge);
    for (size_t i = 0; i < n; i++) {
        if (!l->edge_count || by_nodes_edge(&l->edge[l->edge_count - 1], &l->edge[i]))
            l->edge[l->edge_count++] = l->edge[i];
        l->edge[l->edge_count - 1].valence++;
    }
    for (size_t b = 0; b < l->block_count; b++)
        for (int k = 0; k < 12; k++) {
            int c[2];
            edge_corners(k, c);
            l->block[b].edge[k] = bw_layout_find_edge(l, l->block[b].corner[c[0]], l->block[b].corner[c[1]]);
        }
    for (size_t i = 0; i < l->arc_count; i++) {
        int32_t e = bw_layout_find_edge(l, l->arc[i].node[0], l->arc[i].node[1]);
        if (e < 0) return bw_fail(l->ctx, BW_E_INTERNAL, "layout: an arc is no edge");
        l->edge[e].curved = true;
        l->edge[e].axis = l->arc[i].axis;
        memcpy(l->edge[e].centre, l->arc[i].centre, sizeof l->arc[i].centre);
    }
    return BW_OK;
}

static bool face_has_edge(const bw_layout_face *f, const bw_layout_edge *e) {
    int n = 0;
    for (int i = 0; i < 4; i++) n += f->node[i] == e->node[0] || f->node[i] == e->node[1];
    return n == 2;
}

static bw_status mark_boundary(bw_layout *l) {
    for (size_t e = 0; e < l->edge_count; e++) {
        for (size_t f = 0; f < l->face_count; f++)
            if (l->face[f].block[1] < 0 && face_has_edge(&l->face[f], &l->edge[e]))
                l->edge[e].boundary = true;
        int n = l->edge[e].valence;
        if (l->edge[e].boundary ? n % 2 == 0 && n != 2 : n % 4 == 0 && n != 4)
            return bw_fail(l->ctx, BW_E_INTERNAL, "layout: %d blocks around an edge turn nothing", n);
    }
    return BW_OK;
}

bool bw_layout_singular(const bw_layout *l, int32_t edge) {
    return l->edge[edge].valence != (l->edge[edge].boundary ? 2 : 4);
}

/* --- sheets --- */

static int32_t root_of(int32_t *parent, int32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

static double measure(const bw_layout *l, int32_t block, int edge) {
    enum { PIECES = 16 };
    int c[2];
    edge_corners(edge, c);
    double last[3], sum = 0;
    for (int i = 0; i <= PIECES; i++) {
        double local[3], p[3];
        for (int a = 0; a < 3; a++) local[a] = c[0] >> a & 1;
        local[edge / 4] = (double)i / PIECES;
        bw_layout_point(l, block, local, p);
        if (i)
            sum += sqrt((p[0] - last[0]) * (p[0] - last[0]) + (p[1] - last[1]) * (p[1] - last[1]) +
                        (p[2] - last[2]) * (p[2] - last[2]));
        memcpy(last, p, sizeof last);
    }
    return sum;
}

/* A sheet is as long as its edges are on average in space, times a factor of its own between 0.85 and 1.15
 * (multiples of the golden ratio modulo 1: no two sheets are commensurable). */
static void size_sheets(bw_layout *l, const double *sum, const int *edges, int size, double stretch, bool integral) {
    double shortest = INFINITY;
    for (size_t s = 0; s < l->sheet_count; s++) {
        double k = 0.5 + (double)s * 0.61803398874989484820;
        l->sheet[s].length = sum[s] / edges[s] * (0.85 + 0.3 * (k - floor(k)));
        shortest = fmin(shortest, l->sheet[s].length);
    }
    for (size_t s = 0; s < l->sheet_count; s++) {
        int cells = (int)(size * l->sheet[s].length / shortest + 0.5);
        l->sheet[s].cells = cells < 1 ? 1 : cells;
        double cell = l->sheet[s].length * pow(stretch, ((int)(s % 3) - 1) / 2.0) / l->sheet[s].cells;
        l->sheet[s].length = l->sheet[s].cells * (integral ? 1 : bw_snap(cell));
    }
}

static bw_status make_sheets(bw_layout *l, int size, double stretch, bool integral) {
    int32_t *parent = bw_alloc(l->ctx, l->edge_count, sizeof *parent);
    double *sum = bw_alloc(l->ctx, l->edge_count, sizeof *sum);
    int *edges = bw_alloc(l->ctx, l->edge_count, sizeof *edges);
    l->sheet = bw_alloc(l->ctx, l->edge_count, sizeof *l->sheet);
    bw_status status = l->ctx->error.status;
    if (status) goto out;
    for (size_t e = 0; e < l->edge_count; e++) parent[e] = (int32_t)e;
    for (size_t b = 0; b < l->block_count; b++)
        for (int k = 0; k < 12; k++) {
            int32_t x = root_of(parent, l->block[b].edge[k]),
                    y = root_of(parent, l->block[b].edge[k / 4 * 4]);
            parent[x > y ? x : y] = x > y ? y : x;
        }
    for (size_t e = 0; e < l->edge_count; e++) {
        int32_t root = root_of(parent, (int32_t)e);
        l->edge[e].sheet = root == (int32_t)e ? (int32_t)l->sheet_count++ : l->edge[root].sheet;
    }
    for (size_t b = 0; b < l->block_count; b++)
        for (int k = 0; k < 12; k++) {
            int32_t s = l->edge[l->block[b].edge[k]].sheet;
            sum[s] += measure(l, (int32_t)b, k);
            edges[s]++;
        }
    size_sheets(l, sum, edges, size, stretch, integral);
out:
    bw_free(l->ctx, parent);
    bw_free(l->ctx, sum);
    bw_free(l->ctx, edges);
    return status;
}

/* --- charts --- */

static int local_corner(const bw_layout_block *b, int32_t node) {
    for (int i = 0; i < 8; i++)
        if (b->corner[i] == node) return i;
    return -1;
}

static int bit_axis(int difference) {
    return difference == 1 ? 0 : difference == 2 ? 1 : 2;
}

bw_move bw_layout_across(const bw_layout *l, int32_t block, int face) {
    const bw_layout_block *a = &l->block[block];
    const bw_layout_face *f = &l->face[a->face[face]];
    int32_t other = f->block[f->block[0] == block];
    const bw_layout_block *b = &l->block[other];
    int c[4], d[4], axis = face / 2, side = face & 1;
    face_corners(face, c); /* c[0] has no bit of the two other axes, c[1] and c[2] one each */
    for (int i = 0; i < 4; i++) d[i] = local_corner(b, a->corner[c[i]]);
    bw_move m = {.turn = bw_turn_identity()};
    for (int i = 1; i <= 2; i++) {
        int to = bit_axis(d[i] ^ d[0]);
        m.turn.axis[to] = (int8_t)bit_axis(c[i] ^ c[0]);
        m.turn.sign[to] = d[i] > d[0] ? 1 : -1;
    }
    int normal = 3 - bit_axis(d[1] ^ d[0]) - bit_axis(d[2] ^ d[0]), entry = d[0] >> normal & 1;
    m.turn.axis[normal] = (int8_t)axis;
    m.turn.sign[normal] = side != entry ? 1 : -1;
    double u[3], v[3];
    for (int i = 0; i < 3; i++) u[i] = c[0] >> i & 1 ? bw_layout_length(l, block, i) : 0;
    bw_turn_apply(m.turn, u, v);
    for (int i = 0; i < 3; i++) m.shift[i] = (d[0] >> i & 1 ? bw_layout_length(l, other, i) : 0) - v[i];
    return m;
}

static bw_status check_charts(const bw_layout *l) {
    for (size_t b = 0; b < l->block_count; b++)
        for (int k = 0; k < 6; k++) {
            if (l->face[l->block[b].face[k]].block[1] < 0) continue;
            if (turn_determinant(bw_layout_across(l, (int32_t)b, k).turn) != 1)
                return bw_fail(l->ctx, BW_E_INTERNAL, "layout: block %zu is mirrored across its face %d", b,
                               k);
        }
    return BW_OK;
}

/* --- stars --- */

static bool face_has(const bw_layout_face *f, const int32_t *node, int count) {
    for (int i = 0; i < count; i++) {
        bool there = false;
        for (int j = 0; j < 4; j++) there = there || f->node[j] == node[i];
        if (!there) return false;
    }
    return true;
}

static bw_spoke *find_spoke(const bw_layout *l, const bw_star *star, int32_t block) {
    for (size_t i = 0; i < star->count; i++)
        if (l->spoke[star->first + i].block == block) return &l->spoke[star->first + i];
    return NULL;
}

/* Axes along which two ways around the element disagree are not free: the element is on a singular edge. */
static void forbid_difference(bw_star *star, bw_turn x, bw_turn y) {
    x = bw_turn_compose(turn_inverse(y), x);
    for (int i = 0; i < 3; i++)
        if (x.axis[i] != i || x.sign[i] != 1) star->free[i] = false;
}

/* Walks over the blocks around an element (given by its nodes), through the faces that contain it. */
static bw_status make_star(bw_layout *l, bw_star *star, int32_t home, const int32_t *node, int count) {
    *star = (bw_star){l->spoke_count, 1, {true, true, true}};
    if (bw_reserve(l->ctx, &l->spoke, &l->spoke_capacity, l->spoke_count + 1)) return l->ctx->error.status;
    l->spoke[l->spoke_count++] = (bw_spoke){home, bw_turn_identity()};
    for (size_t i = 0; i < star->count; i++) {
        bw_spoke at = l->spoke[star->first + i];
        for (int k = 0; k < 6; k++) {
            const bw_layout_face *f = &l->face[l->block[at.block].face[k]];
            if (!face_has(f, node, count)) continue;
            if (f->block[1] < 0) {
                star->free[at.turn.axis[k / 2]] = false;
                continue;
            }
            int32_t other = f->block[f->block[0] == at.block];
            bw_turn turn = bw_turn_compose(bw_layout_across(l, at.block, k).turn, at.turn);
            const bw_spoke *known = find_spoke(l, star, other);
            if (known) {
                forbid_difference(star, turn, known->turn);
                continue;
            }
            if (bw_reserve(l->ctx, &l->spoke, &l->spoke_capacity, l->spoke_count + 1))
                return l->ctx->error.status;
            l->spoke[l->spoke_count++] = (bw_spoke){other, turn};
            star->count++;
        }
    }
    return BW_OK;
}

static bw_status make_stars(bw_layout *l) {
    size_t n = l->node_count + l->edge_count + l->face_count + l->block_count;
    l->star = bw_alloc(l->ctx, n, sizeof *l->star);
    if (!l->star) return l->ctx->error.status;
    for (size_t i = 0; i < n; i++) l->star[i].count = 0;
    for (size_t b = 0; b < l->block_count; b++) {
        const bw_layout_block *block = &l->block[b];
        for (int i = 0; i < 8 + 12 + 6 + 1; i++) {
            size_t at, nodes;
            const int32_t *node;
            if (i < 8) {
                at = (size_t)block->corner[i], node = &block->corner[i], nodes = 1;
            } else if (i < 20) {
                int32_t e = block->edge[i - 8];
                at = l->node_count + (size_t)e, node = l->edge[e].node, nodes = 2;
            } else if (i < 26) {
                int32_t f = block->face[i - 20];
                at = l->node_count + l->edge_count + (size_t)f, node = l->face[f].node, nodes = 4;
            } else {
                at = l->node_count + l->edge_count + l->face_count + b, node = block->corner, nodes = 8;
            }
            if (l->star[at].count) continue;
            if (make_star(l, &l->star[at], (int32_t)b, node, (int)nodes)) return l->ctx->error.status;
        }
    }
    return BW_OK;
}

bw_status bw_layout_finish(bw_layout *l, int size, double stretch, bool integral) {
    if (l->ctx->error.status) return l->ctx->error.status;
    bw_status status = make_faces(l);
    if (!status) status = make_edges(l);
    if (!status) status = mark_boundary(l);
    if (!status) status = make_sheets(l, size, stretch, integral);
    if (!status) status = check_charts(l);
    if (!status) status = make_stars(l);
    return status;
}
