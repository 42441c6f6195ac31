#include "format/view.h"

#include <math.h>

#include "format/blocks_json.h"
#include "format/output.h"
#include "format/view_draco.h"

enum { WALLS, SKINS, CURVES, PARTS };

typedef struct {
    bw_context *ctx;
    bw_tessellation *t;
    const bw_complex *complex;
    const bw_cells *cells;
    const double (*position)[3];
    bw_view_lattice lattice;
    bw_draco_geometry g; /* the part being made */
    size_t position_room, id_room, point_room, face_room;
    int32_t *entry_of; /* [vertex] its position entry; meaningful where entry_vertex says so */
    bw_cvertex *entry_vertex;
    int32_t *point_of; /* [position entry] its newest point */
    size_t vertex_room, of_room;
    bw_cvertex (*triangle)[3];
    bw_chart chart;
    int outside; /* side_outside */
} maker;

/* ---- the lattice
 * ------------------------------------------------------------------------------------------------- */

bw_view_lattice bw_view_lattice_of(const bw_tet_mesh *mesh) {
    double low[3] = {0}, high[3] = {0}, extent = 0;
    for (size_t t = 0; t < mesh->tet_count; t++)
        for (int i = 0; i < 4; i++) {
            const double *x = mesh->position[mesh->tet[t][i]];
            for (int k = 0; k < 3; k++) {
                if ((t == 0 && i == 0) || x[k] < low[k]) low[k] = x[k];
                if ((t == 0 && i == 0) || x[k] > high[k]) high[k] = x[k];
            }
        }
    for (int k = 0; k < 3; k++) extent = fmax(extent, high[k] - low[k]);
    bw_view_lattice lattice = {{low[0], low[1], low[2]}, extent / ((1 << BW_VIEW_BITS) - 1)};
    if (!(lattice.step > 0) || !isfinite(lattice.step))
        lattice.step = 1; /* a single point, or beyond doubles */
    return lattice;
}

void bw_view_quantize(const bw_view_lattice *lattice, const double position[3], int32_t out[3]) {
    const double top = (1 << BW_VIEW_BITS) - 1;
    for (int k = 0; k < 3; k++) {
        double q = rint((position[k] - lattice->origin[k]) / lattice->step);
        out[k] = (int32_t)(q > 0 ? fmin(q, top) : 0); /* rounding may put a cut vertex a hair outside */
    }
}

/* ---- parts
 * ------------------------------------------------------------------------------------------------------- */

static void start_part(maker *m, int ids) {
    m->g.position_count = m->g.id_count = m->g.point_count = m->g.face_count = 0;
    m->g.ids = ids;
}

static bw_status add_id(maker *m, const int32_t id[BW_DRACO_IDS]) {
    bw_status status = bw_reserve(m->ctx, &m->g.id, &m->id_room, m->g.id_count + 1);
    if (status == BW_OK) memcpy(m->g.id[m->g.id_count++], id, sizeof *m->g.id);
    return status;
}

static bw_status add_position(maker *m, bw_cvertex v, int32_t *entry) {
    size_t e = (size_t)m->entry_of[v];
    *entry = (int32_t)e;
    if (e < m->g.position_count && m->entry_vertex[e] == v) return BW_OK;
    e = m->g.position_count;
    bw_status status = bw_reserve(m->ctx, &m->g.position, &m->position_room, e + 1);
    if (status == BW_OK) status = bw_reserve(m->ctx, &m->entry_vertex, &m->vertex_room, e + 1);
    if (status == BW_OK) status = bw_reserve(m->ctx, &m->point_of, &m->of_room, e + 1);
    if (status != BW_OK) return status;
    bw_view_quantize(&m->lattice, m->position[v], m->g.position[e]);
    m->entry_vertex[e] = v;
    m->point_of[e] = BW_NONE;
    m->g.position_count++;
    *entry = m->entry_of[v] = (int32_t)e;
    return BW_OK;
}

/* The point of a vertex with the newest id. */
static bw_status add_point(maker *m, bw_cvertex v, int32_t *point) {
    int32_t entry, id = (int32_t)m->g.id_count - 1;
    bw_status status = add_position(m, v, &entry);
    if (status == BW_OK) status = bw_reserve(m->ctx, &m->g.point, &m->point_room, m->g.point_count + 1);
    if (status != BW_OK) return status;
    *point = m->point_of[entry];
    if (*point != BW_NONE && m->g.point[*point][1] == id && m->g.face_count) return BW_OK;
    *point = m->point_of[entry] = (int32_t)m->g.point_count++;
    m->g.point[*point][0] = entry;
    m->g.point[*point][1] = id;
    return BW_OK;
}

static bw_status add_triangle(maker *m, const bw_cvertex v[3], bool reversed) {
    bw_status status = bw_reserve(m->ctx, &m->g.face, &m->face_room, m->g.face_count + 1);
    int32_t face[3];
    m->g.face_count++;
    for (int k = 0; k < 3 && status == BW_OK; k++) status = add_point(m, v[reversed ? 2 - k : k], &face[k]);
    if (status == BW_OK) memcpy(m->g.face[m->g.face_count - 1], face, sizeof face);
    return status;
}

static bw_status add_polygon(maker *m, bw_polygon p, bool reversed) {
    bw_status status = BW_OK;
    bw_tessellation_triangles(m->t, p, m->triangle);
    for (int32_t i = 0; i < m->t->size[p] - 2 && status == BW_OK; i++)
        status = add_triangle(m, m->triangle[i], reversed);
    return status;
}

static bw_status make_walls(maker *m) {
    const bw_complex *c = m->complex;
    bw_status status = BW_OK;
    start_part(m, 4);
    for (size_t patch = 0; patch < c->patch_count && status == BW_OK; patch++) {
        const int32_t id[BW_DRACO_IDS] = {(int32_t)patch, c->patch_block[patch][0], c->patch_block[patch][1],
                                          c->patch_flags[patch]};
        status = add_id(m, id);
        for (size_t i = c->patch_polygon_begin[patch];
             i < c->patch_polygon_begin[patch + 1] && status == BW_OK; i++)
            status = add_polygon(m, c->patch_polygon[i], false);
    }
    return status;
}

/* 1 if tets that are positive in the parametrization are so in space, else -1. A polygon whose cell is on
 * that side of it turns counterclockwise for who looks from outside the cell. */
static int side_outside(const bw_tet_mesh *mesh) {
    double volume = 0;
    for (size_t t = 0; t < mesh->tet_count; t++) {
        double e[3][3];
        for (int i = 0; i < 3; i++)
            for (int k = 0; k < 3; k++)
                e[i][k] = mesh->position[mesh->tet[t][i + 1]][k] - mesh->position[mesh->tet[t][0]][k];
        volume += e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
                  e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
                  e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
    }
    return volume < 0 ? -1 : 1;
}

/* The polygons of a patch as seen from outside the block on one of its sides. */
static bw_status add_skin(maker *m, bw_patch patch, int which) {
    const bw_complex *c = m->complex;
    const int32_t id[BW_DRACO_IDS] = {c->patch_block[patch][which], patch, c->patch_side[patch][which]};
    bw_status status = add_id(m, id);
    for (size_t i = c->patch_polygon_begin[patch]; i < c->patch_polygon_begin[patch + 1] && status == BW_OK;
         i++) {
        bw_polygon p = c->patch_polygon[i];
        int side, slot = m->cells->polygon[p].cell[0] != bw_patch_cell(m->cells, c, patch, p, which);
        status = bw_tessellation_side(m->ctx, m->t, &m->chart, p, slot, &side);
        if (status == BW_OK) status = add_polygon(m, p, side != m->outside);
    }
    return status;
}

static bw_status make_skins(maker *m) {
    bw_status status = BW_OK;
    start_part(m, 3);
    for (size_t patch = 0; patch < m->complex->patch_count; patch++)
        for (int which = 0; which < 2 && status == BW_OK; which++)
            if (m->complex->patch_block[patch][which] != BW_NONE)
                status = add_skin(m, (bw_patch)patch, which);
    return status;
}

static bw_status make_curves(maker *m) {
    const bw_complex *c = m->complex;
    bw_status status = BW_OK;
    int32_t point;
    start_part(m, 3);
    for (size_t arc = 0; arc < c->arc_count && status == BW_OK; arc++) {
        const int32_t id[BW_DRACO_IDS] = {(int32_t)arc, c->arc_flags[arc], c->arc_quarters[arc]};
        bw_cvertex at = c->node_vertex[c->arc_node[arc][0]];
        status = add_id(m, id);
        if (status == BW_OK) status = add_point(m, at, &point);
        for (size_t i = c->arc_edge_begin[arc]; i < c->arc_edge_begin[arc + 1] && status == BW_OK; i++) {
            const bw_cvertex *end = m->cells->edge[c->arc_edge[i]].vertex;
            at = end[end[0] == at];
            status = add_point(m, at, &point);
        }
    }
    return status;
}

/* ---- the file
 * ---------------------------------------------------------------------------------------------------- */

static void put_little(bw_output *out, uint64_t value, int bytes) {
    uint8_t b[8];
    for (int i = 0; i < bytes; i++) b[i] = (uint8_t)(value >> 8 * i);
    bw_put_bytes(out, b, (size_t)bytes);
}

static void put_double(bw_output *out, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_little(out, bits, 8);
}

static bw_status write_file(maker *m, uint8_t *const blob[PARTS], const size_t length[PARTS],
                            const char *path, uint64_t *bytes) {
    static const char name[PARTS][16] = {"walls", "skins", "curves"};
    bw_output out;
    bw_output_open(m->ctx, &out, path);
    bw_put_bytes(&out, "BWVIEW\r\n", 8);
    put_little(&out, BW_VIEW_VERSION, 4);
    put_little(&out, PARTS, 4);
    for (int k = 0; k < 3; k++) put_double(&out, m->lattice.origin[k]);
    put_double(&out, m->lattice.step);
    uint64_t offset = BW_VIEW_HEADER + PARTS * BW_VIEW_ENTRY;
    for (int i = 0; i < PARTS; i++) {
        bw_put_bytes(&out, name[i], sizeof name[i]);
        put_little(&out, offset, 8);
        put_little(&out, length[i], 8);
        offset += length[i];
    }
    for (int i = 0; i < PARTS; i++) bw_put_bytes(&out, blob[i], length[i]);
    return bw_output_close(&out, bytes);
}

bw_status bw_view_write(bw_context *ctx, bw_tessellation *t, const bw_complex *complex,
                        const double (*position)[3], const char *path, uint64_t *bytes) {
    static bw_status (*const make[PARTS])(maker *) = {make_walls, make_skins, make_curves};
    maker m = {.ctx = ctx, .t = t, .complex = complex, .cells = t->cells, .position = position};
    uint8_t *blob[PARTS] = {NULL};
    size_t length[PARTS] = {0};
    m.lattice = bw_view_lattice_of(t->cells->mesh);
    m.outside = side_outside(t->cells->mesh);
    m.entry_of = bw_alloc(ctx, t->cells->vertex_count, sizeof *m.entry_of);
    m.triangle = bw_alloc(ctx, (size_t)t->largest, sizeof *m.triangle);
    bw_status status = m.entry_of && m.triangle ? BW_OK : ctx->error.status;
    for (int i = 0; i < PARTS && status == BW_OK; i++) {
        status = make[i](&m);
        if (status == BW_OK) status = bw_draco_encode(ctx, &m.g, &blob[i], &length[i]);
        if (status == BW_OK) status = bw_poll(ctx);
    }
    if (status == BW_OK) status = write_file(&m, blob, length, path, bytes);
    for (int i = 0; i < PARTS; i++) bw_free(ctx, blob[i]);
    bw_draco_geometry_clear(ctx, &m.g);
    bw_chart_clear(ctx, &m.chart);
    bw_free(ctx, m.entry_of), bw_free(ctx, m.entry_vertex), bw_free(ctx, m.point_of),
        bw_free(ctx, m.triangle);
    return status;
}
