#include "hex/vertices.h"

#include <math.h>
#include <string.h>

#include "base/parallel.h"

enum { LEAST_TETS = 256 }; /* for a thread */

/* ---- which points are a tet's own ---- */

/* Bit m: the points of the tet that lie on exactly the facets of mask m are its own. */
static uint16_t own_masks(const bw_hex_vertices *p, bw_tet t) {
    const bw_tet_mesh *mesh = &p->lattice.igm->mesh;
    unsigned own = 1;
    for (int i = 0; i < 4; i++) {
        if (mesh->facet_tet[mesh->tet_facet[t][i]][0] == t) own |= 1u << (1 << i);
        if (p->carriers.vertex_tet[mesh->tet[t][i]] == t) own |= 1u << (15 ^ 1 << i);
    }
    for (int k = 0; k < 6; k++)
        if (p->carriers.edge_tet[mesh->tet_edge[t][k]] == t) own |= 1u << (15 ^ 1 << bw_tet_edge_corners[k][0] ^ 1 << bw_tet_edge_corners[k][1]);
    return (uint16_t)own;
}

static uint64_t own_in_row(const bw_lattice_row *row, uint16_t own) {
    uint64_t count = 0;
    if (row->high - row->low > 1 && own >> row->flat & 1) count += (uint64_t)(row->high - row->low - 1);
    count += own >> bw_lattice_mask(row, row->low) & 1;
    if (row->high > row->low) count += own >> bw_lattice_mask(row, row->high) & 1;
    return count;
}

/* ---- counting ---- */

typedef struct {
    uint32_t columns, rows, points, vertices, hexes;
} tally;

typedef struct {
    bw_hex_vertices *points;
    bw_hex_mesh *mesh;
    bw_hex_origin *origin;
    tally *count; /* [tet + 1]; after summing up: before the tet */
} filling;

static bw_status out_of_range(bw_context *ctx, const bw_hex_vertices *p, bw_tet t) {
    return bw_fail(ctx, BW_E_RANGE, "tet %d has too many hexes, or too far from the origin", p->lattice.igm->mesh.tet_id[t]);
}

static bool far(const int64_t range[2]) { return range[0] < -(1 << 30) || range[1] > 1 << 30; }

static bw_status count_tet(bw_context *ctx, const bw_hex_vertices *p, bw_tet t, tally *out) {
    bw_lattice_tet tet;
    bw_lattice_row row;
    int64_t x[2], y[2];
    uint64_t columns = 0, rows = 0, points = 0, vertices = 0, hexes = 0;
    if (bw_lattice_tet_init(ctx, &p->lattice, t, &tet)) return ctx->error.status;
    uint16_t own = own_masks(p, t);
    for (int parity = 0; parity < 2; parity++) {
        bw_lattice_columns(&tet, parity, x);
        if (far(x)) return out_of_range(ctx, p, t);
        for (int64_t i = x[0]; i <= x[1]; i++) {
            bw_lattice_rows(&tet, parity, i, y);
            if (y[0] <= y[1] && far(y)) return out_of_range(ctx, p, t);
            columns += !parity;
            for (int64_t j = y[0]; j <= y[1]; j++) {
                bw_lattice_row_init(&tet, parity, i, j, &row);
                rows += !parity;
                if (row.low > row.high) continue;
                if (row.low < -(1 << 30) || row.high > 1 << 30) return out_of_range(ctx, p, t);
                if (!parity) points += (uint64_t)(row.high - row.low + 1);
                *(parity ? &hexes : &vertices) += own_in_row(&row, own);
            }
        }
    }
    if (!points) columns = rows = 0;
    if ((columns | rows | points | vertices | hexes) >> 31) return out_of_range(ctx, p, t);
    *out = (tally){(uint32_t)columns, (uint32_t)rows, (uint32_t)points, (uint32_t)vertices, (uint32_t)hexes};
    return BW_OK;
}

static bw_status count_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    filling *f = user;
    (void)range;
    for (size_t t = begin; t < end; t++) {
        if (t % 1024 == 0 && bw_poll(ctx)) return ctx->error.status;
        if (count_tet(ctx, f->points, (bw_tet)t, &f->count[t])) return ctx->error.status;
    }
    return BW_OK;
}

/* Turns counts into offsets; the totals end up in count[n]. */
static bw_status sum_up(bw_context *ctx, tally *count, size_t n) {
    uint64_t sum[5] = {0};
    for (size_t t = 0; t <= n; t++) {
        uint32_t *c = &count[t].columns;
        for (int k = 0; k < 5; k++) {
            uint32_t here = c[k];
            c[k] = (uint32_t)sum[k];
            if (t < n) sum[k] += here;
            if (sum[k] > INT32_MAX) return bw_fail(ctx, BW_E_LIMIT, "the hex mesh has more vertices than can be numbered");
        }
    }
    return BW_OK;
}
_Static_assert(sizeof(tally) == 5 * sizeof(uint32_t), "a tally is five counts");

/* ---- filling ---- */

/* Writes vertex v: point k of a row, on the facets of `mask`. */
static void fill_vertex(const filling *f, bw_tet t, const bw_lattice_tet *tet, const bw_lattice_row *row, int64_t k, uint8_t mask, bw_hvertex v) {
    const bw_hex_vertices *p = f->points;
    const bw_tet_mesh *mesh = &p->lattice.igm->mesh;
    double weight[4], sum = 0, *at = f->mesh->position[v];
    int corner[4], n = 0, on = 0;
    for (int i = 0; i < 4; i++) {
        if (mask >> i & 1) {
            on = i;
            continue;
        }
        weight[n] = (double)(row->start[i] + tet->normal[i][2] * (2 * (k - row->low)));
        if (tet->fraction[i]) weight[n] += 0.5; /* of numbers far above one */
        sum += weight[n];
        corner[n++] = i;
    }
    for (int j = 0; j < 3; j++) at[j] = 0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < 3; j++) at[j] += (n == 1 ? 1 : weight[i] / sum) * mesh->position[mesh->tet[t][corner[i]]][j];
    bw_hold hold = {t, BW_HELD_NOT};
    if (n == 3) hold = bw_carriers_hold(&p->carriers, BW_IN_FACET, mesh->tet_facet[t][on], t);
    if (n == 2) hold = bw_carriers_hold(&p->carriers, BW_IN_EDGE, mesh->tet_edge[t][bw_tet_edge_of[corner[0]][corner[1]]], t);
    if (n == 1) hold = bw_carriers_hold(&p->carriers, BW_IN_VERTEX, mesh->tet[t][corner[0]], t);
    f->mesh->held[v] = hold.held;
    f->mesh->carrier[v] = hold.carrier;
}

static void fill_vertices(const filling *f, bw_tet t, const bw_lattice_tet *tet, uint16_t own) {
    bw_hex_vertices *p = f->points;
    bw_lattice_row row;
    int64_t x[2], y[2];
    tally at = f->count[t];
    bw_lattice_columns(tet, 0, x);
    p->column_first[t] = (int32_t)x[0];
    for (int64_t i = x[0]; i <= x[1]; i++) {
        bw_lattice_rows(tet, 0, i, y);
        p->column[at.columns++] = (bw_hex_span){(int32_t)y[0], at.rows};
        for (int64_t j = y[0]; j <= y[1]; j++) {
            bw_lattice_row_init(tet, 0, i, j, &row);
            p->row[at.rows++] = (bw_hex_span){(int32_t)row.low, at.points};
            for (int64_t k = row.low; k <= row.high; k++) {
                uint8_t mask = bw_lattice_mask(&row, k);
                bool mine = own >> mask & 1;
                if (mine) fill_vertex(f, t, tet, &row, k, mask, (bw_hvertex)at.vertices);
                p->id[at.points++] = mine ? (bw_hvertex)at.vertices++ : -2 - mask;
            }
        }
    }
}

static void fill_centres(const filling *f, bw_tet t, const bw_lattice_tet *tet, uint16_t own) {
    bw_lattice_row row;
    int64_t x[2], y[2];
    size_t h = f->count[t].hexes;
    bw_lattice_columns(tet, 1, x);
    for (int64_t i = x[0]; i <= x[1]; i++) {
        bw_lattice_rows(tet, 1, i, y);
        for (int64_t j = y[0]; j <= y[1]; j++) {
            bw_lattice_row_init(tet, 1, i, j, &row);
            for (int64_t k = row.low; k <= row.high; k++) {
                if (!(own >> bw_lattice_mask(&row, k) & 1)) continue;
                f->origin->tet[h] = t;
                f->origin->low[h][0] = i, f->origin->low[h][1] = j, f->origin->low[h][2] = k;
                h++;
            }
        }
    }
}

static bw_status fill_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    filling *f = user;
    bw_lattice_tet tet;
    (void)range;
    for (size_t t = begin; t < end; t++) {
        const tally *c = &f->count[t];
        if (t % 1024 == 0 && bw_poll(ctx)) return ctx->error.status;
        if (c[1].points == c->points && c[1].hexes == c->hexes) continue;
        if (bw_lattice_tet_init(ctx, &f->points->lattice, (bw_tet)t, &tet)) return ctx->error.status;
        uint16_t own = own_masks(f->points, (bw_tet)t);
        if (c[1].points > c->points) fill_vertices(f, (bw_tet)t, &tet, own);
        if (c[1].hexes > c->hexes) fill_centres(f, (bw_tet)t, &tet, own);
    }
    return BW_OK;
}

/* ---- points of other tets ---- */

/* Brings vertex k of tet t on edge or at a corner of it to the chart of another tet that has them too. A corner is an edge of length nothing. */
static void carry_along_edge(const bw_hex_vertices *p, bw_tet t, const int corner[2], bw_tet to, const int64_t k[3], int64_t out[3]) {
    const bw_igm *igm = p->lattice.igm;
    const int64_t *a[2], *b[2];
    for (int i = 0; i < 2; i++) {
        a[i] = igm->map.value[t][corner[i]];
        b[i] = igm->map.value[to][bw_tet_corner(&igm->mesh, to, igm->mesh.tet[t][corner[i]])];
    }
    int axis = 0;
    while (axis < 2 && a[1][axis] == a[0][axis]) axis++;
    bw_wide length = (bw_wide)(a[1][axis] - a[0][axis]) * p->lattice.factor;
    bw_wide along = (bw_wide)(2 * k[axis]) * p->lattice.unit - (bw_wide)a[0][axis] * p->lattice.factor;
    for (int j = 0; j < 3; j++) {
        /* Edges keep their components, but for order and sign, so the quotient is whole. */
        bw_wide x = (bw_wide)b[0][j] * p->lattice.factor;
        bw_wide d = (bw_wide)(b[1][j] - b[0][j]) * p->lattice.factor;
        if (length) x += d == length ? along : d == -length ? -along : d * along / length;
        out[j] = (int64_t)(x >> (p->lattice.shift + 1));
    }
}

static bw_status resolve(bw_context *ctx, bw_hex_vertices *p, bw_tet t, uint8_t mask, const int64_t k[3], bw_hvertex *id) {
    const bw_tet_mesh *mesh = &p->lattice.igm->mesh;
    int64_t there[3];
    int corner[4], n = 0;
    bw_tet own;
    for (int i = 0; i < 4; i++)
        if (!(mask >> i & 1)) corner[n++] = i;
    if (n == 3) {
        bw_transition across;
        bw_facet facet = mesh->tet_facet[t][__builtin_ctz(mask)];
        own = mesh->facet_tet[facet][0];
        if (bw_lattice_across(ctx, &p->lattice, facet, t, &across)) return ctx->error.status;
        int64_t at[3] = {2 * k[0], 2 * k[1], 2 * k[2]};
        bw_transition_apply(&across, at, there);
        for (int j = 0; j < 3; j++) there[j] >>= 1;
    } else {
        if (n == 1) corner[1] = corner[0];
        own = n == 1 ? p->carriers.vertex_tet[mesh->tet[t][corner[0]]] : p->carriers.edge_tet[mesh->tet_edge[t][bw_tet_edge_of[corner[0]][corner[1]]]];
        carry_along_edge(p, t, corner, own, k, there);
    }
    *id = bw_hex_vertices_find(p, own, there);
    return *id >= 0 ? BW_OK : bw_fail(ctx, BW_E_CHECK, "tets %d and %d do not have the same vertices where they meet", mesh->tet_id[t], mesh->tet_id[own]);
}

static bw_status resolve_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    bw_hex_vertices *p = ((filling *)user)->points;
    (void)range;
    for (size_t t = begin; t < end; t++) {
        if (t % 1024 == 0 && bw_poll(ctx)) return ctx->error.status;
        for (uint32_t c = p->column_begin[t]; c < p->column_begin[t + 1]; c++)
            for (uint32_t r = p->column[c].begin; r < p->column[c + 1].begin; r++)
                for (uint32_t i = p->row[r].begin; i < p->row[r + 1].begin; i++) {
                    if (p->id[i] >= 0) continue;
                    const int64_t k[3] = {p->column_first[t] + (int64_t)(c - p->column_begin[t]), p->column[c].first + (int64_t)(r - p->column[c].begin),
                                          p->row[r].first + (int64_t)(i - p->row[r].begin)};
                    if (resolve(ctx, p, (bw_tet)t, (uint8_t)(-2 - p->id[i]), k, &p->id[i])) return ctx->error.status;
                }
    }
    return BW_OK;
}

/* ---- the whole ---- */

/* Volume of the map in hexes, nearly. */
static double volume(const bw_lattice *lattice) {
    const bw_igm *igm = lattice->igm;
    double sum = 0, step = (double)lattice->factor / (double)lattice->unit / 2;
    for (size_t t = 0; t < igm->mesh.tet_count; t++) {
        double d[3][3];
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++) d[i][k] = step * (double)(igm->map.value[t][i + 1][k] - igm->map.value[t][0][k]);
        sum += d[0][0] * (d[1][1] * d[2][2] - d[1][2] * d[2][1]) - d[0][1] * (d[1][0] * d[2][2] - d[1][2] * d[2][0]) +
               d[0][2] * (d[1][0] * d[2][1] - d[1][1] * d[2][0]);
    }
    return sum / 6;
}

static bw_status make_room(bw_context *ctx, const tally *count, size_t tets, bw_hex_vertices *p, bw_hex_mesh *mesh, bw_hex_origin *origin) {
    const tally *all = &count[tets];
    p->column_begin = bw_alloc(ctx, tets + 1, sizeof *p->column_begin);
    p->column_first = bw_alloc(ctx, tets, sizeof *p->column_first);
    p->column = bw_alloc(ctx, (size_t)all->columns + 1, sizeof *p->column);
    p->row = bw_alloc(ctx, (size_t)all->rows + 1, sizeof *p->row);
    p->id = bw_alloc(ctx, all->points, sizeof *p->id);
    mesh->vertex_count = all->vertices, mesh->hex_count = all->hexes;
    mesh->position = bw_alloc(ctx, all->vertices, sizeof *mesh->position);
    mesh->held = bw_alloc(ctx, all->vertices, 1);
    mesh->carrier = bw_alloc(ctx, all->vertices, sizeof *mesh->carrier);
    mesh->hex = bw_alloc(ctx, all->hexes, sizeof *mesh->hex);
    mesh->block = bw_alloc(ctx, all->hexes, sizeof *mesh->block);
    mesh->ijk = bw_alloc(ctx, all->hexes, sizeof *mesh->ijk);
    origin->tet = bw_alloc(ctx, all->hexes, sizeof *origin->tet);
    origin->low = bw_alloc(ctx, all->hexes, sizeof *origin->low);
    if (ctx->error.status != BW_OK) return ctx->error.status;
    for (size_t t = 0; t <= tets; t++) p->column_begin[t] = count[t].columns;
    p->column[all->columns].begin = all->rows;
    p->row[all->rows].begin = all->points;
    for (size_t h = 0; h < mesh->hex_count; h++) mesh->block[h] = BW_NONE;
    return BW_OK;
}

bw_status bw_hex_vertices_init(bw_context *ctx, const bw_igm *igm, int32_t subdivide, uint64_t max_hexes, bw_hex_vertices *p, bw_hex_mesh *mesh, bw_hex_origin *origin) {
    size_t tets = igm->mesh.tet_count;
    filling f = {p, mesh, origin, NULL};
    memset(p, 0, sizeof *p);
    int ranges = bw_parallel_ranges(ctx, tets, LEAST_TETS);
    bw_status status = bw_lattice_init(ctx, igm, subdivide, &p->lattice);
    if (status != BW_OK) return status;
    double hexes = volume(&p->lattice);
    if (hexes > (double)max_hexes + 0.5)
        return bw_fail(ctx, BW_E_LIMIT, "the hex mesh would have %.0f hexes, more than %llu", hexes, (unsigned long long)max_hexes);
    status = bw_carriers_init(ctx, &igm->mesh, &igm->map, &p->carriers);
    if (status == BW_OK && !(f.count = bw_alloc(ctx, tets + 1, sizeof *f.count))) status = ctx->error.status;
    if (status == BW_OK) status = bw_parallel(ctx, tets, ranges, count_range, &f);
    if (status == BW_OK) status = sum_up(ctx, f.count, tets);
    if (status == BW_OK && fabs(f.count[tets].hexes - hexes) > 0.5)
        status = bw_fail(ctx, BW_E_CHECK, "the map has room for %.1f hexes, but %u were found", hexes, f.count[tets].hexes);
    if (status == BW_OK) status = make_room(ctx, f.count, tets, p, mesh, origin);
    if (status == BW_OK) status = bw_parallel(ctx, tets, ranges, fill_range, &f);
    if (status == BW_OK) status = bw_parallel(ctx, tets, ranges, resolve_range, &f);
    mesh->subdivide = subdivide;
    bw_free(ctx, f.count);
    return status;
}

void bw_hex_vertices_clear(bw_context *ctx, bw_hex_vertices *p) {
    bw_carriers_clear(ctx, &p->carriers);
    bw_free(ctx, p->column_begin);
    bw_free(ctx, p->column_first);
    bw_free(ctx, p->column);
    bw_free(ctx, p->row);
    bw_free(ctx, p->id);
    memset(p, 0, sizeof *p);
}
