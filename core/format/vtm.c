#include "format/vtm.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "format/vtm_file.h"
#include "mesh/walk.h"

enum { VTK_VERTEX = 1, VTK_POLY_LINE = 4, VTK_POLYGON = 7, VTK_POLYHEDRON = 42, POLL_EVERY = 1 << 14, ARRAYS_MOST = 12 };

typedef struct {
    bw_context *ctx;
    const bw_cells *cells;
    const bw_complex *complex;
    const double (*position)[3];
    bw_vtm_file file;
    bw_vtm_array_info array[ARRAYS_MOST]; /* of the file */
    int32_t *point;     /* [vertex]: its number in the file being written; BW_NONE */
    bw_cvertex *vertex; /* [point] */
    size_t point_count;
    /* of the cell at hand */
    bw_polygon *face;
    bool *turned; /* [face] its half-edges run so that it points inwards */
    size_t face_count, face_room, turned_room;
    int32_t *slot; /* [polygon]: its number in `face`, if face[slot] is it */
} writer;

/* ---- points -------------------------------------------------------------------------------------------- */

static void forget_points(writer *w) {
    for (size_t i = 0; i < w->point_count; i++) w->point[w->vertex[i]] = BW_NONE;
    w->point_count = 0;
}

static void need_point(writer *w, bw_cvertex v) {
    if (w->point[v] != BW_NONE) return;
    w->point[v] = (int32_t)w->point_count;
    w->vertex[w->point_count++] = v;
}

static void put_points(writer *w) {
    bw_vtm_array(&w->file);
    for (size_t i = 0; i < w->point_count; i++)
        for (int k = 0; k < 3; k++) bw_vtm_float64(&w->file, w->position[w->vertex[i]][k]);
}

static void put_types(writer *w, size_t count, uint8_t type) {
    bw_vtm_array(&w->file);
    for (size_t i = 0; i < count; i++) bw_vtm_uint8(&w->file, type);
}

/* An array of the cells' data, `components` values each. */
static bw_vtm_array_info per_cell(const char *name, bw_vtm_type type, int components, size_t cells) {
    return (bw_vtm_array_info){BW_VTM_CELL_DATA, name, type, components, (uint64_t)components * cells};
}

/* Begins a file of `cells` cells over the points needed: the arrays that every file has, `corners` points in all of its cells, then
 * `more`. Values are written in the same order. */
static bw_status begin_file(writer *w, const char *path, size_t cells, uint64_t corners, const bw_vtm_array_info *more,
                            size_t count) {
    const bw_vtm_array_info common[] = {{BW_VTM_POINTS, "Points", BW_VTM_FLOAT64, 3, 3 * w->point_count},
                                        {BW_VTM_CELLS, "connectivity", BW_VTM_INT32, 1, corners},
                                        {BW_VTM_CELLS, "offsets", BW_VTM_INT64, 1, cells},
                                        {BW_VTM_CELLS, "types", BW_VTM_UINT8, 1, cells}};
    size_t before = sizeof common / sizeof *common;
    memcpy(w->array, common, sizeof common);
    memcpy(w->array + before, more, count * sizeof *more);
    return bw_vtm_begin(w->ctx, &w->file, path, w->point_count, cells, w->array, before + count);
}

static double in_map(const writer *w, int64_t units) {
    return ldexp((double)units, -w->cells->map->exponent);
}

static void put_flag(writer *w, const uint8_t *flags, size_t count, uint8_t flag) {
    bw_vtm_array(&w->file);
    for (size_t i = 0; i < count; i++) bw_vtm_uint8(&w->file, (flags[i] & flag) != 0);
}

static void put_flags(writer *w, const uint8_t *flags, size_t count) {
    bw_vtm_array(&w->file);
    for (size_t i = 0; i < count; i++) bw_vtm_uint8(&w->file, flags[i]);
}

static void put_numbers(writer *w, size_t count) {
    bw_vtm_array(&w->file);
    for (size_t i = 0; i < count; i++) bw_vtm_int32(&w->file, (int32_t)i);
}

/* ---- polygons ------------------------------------------------------------------------------------------ */

static size_t polygon_size(const bw_cells *cells, bw_polygon p) {
    size_t n = 0;
    bw_half first = cells->polygon[p].half, h = first;
    do n++, h = cells->half[h].next;
    while (h != first);
    return n;
}

static void put_polygon(writer *w, bw_polygon p, bool turned) {
    bw_half first = w->cells->polygon[p].half, h = first;
    do {
        bw_vtm_int32(&w->file, w->point[w->cells->half[h].origin]);
        h = turned ? bw_cells_half_previous(w->cells, h) : w->cells->half[h].next;
    } while (h != first);
}

static void need_polygon(writer *w, bw_polygon p) {
    bw_half first = w->cells->polygon[p].half, h = first;
    do need_point(w, w->cells->half[h].origin), h = w->cells->half[h].next;
    while (h != first);
}

/* ---- blocks -------------------------------------------------------------------------------------------- */

static bw_status take_faces(writer *w, bw_cell cell) {
    w->face_count = 0;
    for (bw_polygon p = bw_cells_first_in_cell(w->cells, cell); p != BW_NONE;
         p = bw_cells_next_in_cell(w->cells, p, cell)) {
        bw_status status = bw_reserve(w->ctx, &w->face, &w->face_room, w->face_count + 1);
        if (status == BW_OK) status = bw_reserve(w->ctx, &w->turned, &w->turned_room, w->face_count + 1);
        if (status != BW_OK) return status;
        w->slot[p] = (int32_t)w->face_count;
        w->face[w->face_count++] = p;
    }
    return BW_OK;
}

static bool runs_along(const bw_cells *cells, bw_polygon p, bw_cedge edge, bw_cvertex from) {
    bw_half h = cells->polygon[p].half;
    while (cells->half[h].edge != edge) h = cells->half[h].next;
    return cells->half[h].origin == from;
}

static double volume_at(const double o[3], const double a[3], const double b[3], const double c[3]) {
    double e[3][3];
    for (int k = 0; k < 3; k++) e[0][k] = a[k] - o[k], e[1][k] = b[k] - o[k], e[2][k] = c[k] - o[k];
    return e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) -
           e[0][1] * (e[1][0] * e[2][2] - e[1][2] * e[2][0]) +
           e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]);
}

/* Six times the volume that the faces enclose if they point outwards; negative if inwards. */
static double enclosed(const writer *w) {
    const bw_cells *cells = w->cells;
    const double *o = w->position[cells->half[cells->polygon[w->face[0]].half].origin];
    double sum = 0;
    for (size_t f = 0; f < w->face_count; f++) {
        bw_half first = cells->polygon[w->face[f]].half;
        const double *a = w->position[cells->half[first].origin];
        for (bw_half h = cells->half[first].next; cells->half[h].next != first; h = cells->half[h].next) {
            double v = volume_at(o, a, w->position[cells->half[h].origin],
                                 w->position[cells->half[cells->half[h].next].origin]);
            sum += w->turned[f] ? -v : v;
        }
    }
    return sum;
}

/* Turns the faces of a cell so that all point outwards: neighbours run along their edge in opposite
 * directions; which of the two ways it is, the volume tells. The faces are listed anew, in the order in which
 * they are reached from the first. */
static bw_status orient_faces(writer *w, bw_cell cell) {
    const bw_cells *cells = w->cells;
    bw_status status = take_faces(w, cell);
    if (status != BW_OK) return status;
    w->turned[0] = false;
    for (size_t done = 0, reached = 1; done < reached; done++) {
        bw_half first = cells->polygon[w->face[done]].half, h = first;
        do {
            bw_polygon next = bw_walk_other(cells, cells->half[h].edge, cell, w->face[done]);
            size_t at = (size_t)w->slot[next];
            if (at >= reached) { /* takes the next place */
                bool same = runs_along(cells, next, cells->half[h].edge, cells->half[h].origin);
                w->slot[w->face[reached]] = (int32_t)at;
                w->face[at] = w->face[reached];
                w->face[reached] = next;
                w->slot[next] = (int32_t)reached;
                w->turned[reached++] = w->turned[done] ^ same;
            }
            h = cells->half[h].next;
        } while (h != first);
    }
    bool inwards = enclosed(w) < 0;
    for (size_t f = 0; f < w->face_count; f++) w->turned[f] ^= inwards;
    return BW_OK;
}

/* The points of a cell, without repeats, in the order in which its faces have them; writes them if `write`.
 * `mark`: [vertex] the last cell that had it, plus 1. */
static uint64_t cell_points(writer *w, bw_cell cell, int32_t *mark, bool write) {
    uint64_t n = 0;
    for (bw_polygon p = bw_cells_first_in_cell(w->cells, cell); p != BW_NONE;
         p = bw_cells_next_in_cell(w->cells, p, cell)) {
        bw_half first = w->cells->polygon[p].half, h = first;
        do {
            bw_cvertex v = w->cells->half[h].origin;
            if (mark[v] != cell + 1) {
                mark[v] = cell + 1;
                n++;
                if (write) bw_vtm_int32(&w->file, w->point[v]);
            }
            h = w->cells->half[h].next;
        } while (h != first);
    }
    return n;
}

static uint64_t face_numbers(const writer *w, bw_cell cell) {
    uint64_t n = 1;
    for (bw_polygon p = bw_cells_first_in_cell(w->cells, cell); p != BW_NONE;
         p = bw_cells_next_in_cell(w->cells, p, cell))
        n += 1 + polygon_size(w->cells, p);
    return n;
}

static bw_status put_faces(writer *w) {
    bw_status status = BW_OK;
    bw_vtm_array(&w->file);
    for (size_t c = 0; c < w->cells->cell_count && status == BW_OK; c++) {
        status = orient_faces(w, (bw_cell)c);
        if (status == BW_OK && c % POLL_EVERY == 0) status = bw_poll(w->ctx);
        if (status != BW_OK) break;
        bw_vtm_int32(&w->file, (int32_t)w->face_count);
        for (size_t f = 0; f < w->face_count; f++) {
            bw_vtm_int32(&w->file, (int32_t)polygon_size(w->cells, w->face[f]));
            put_polygon(w, w->face[f], w->turned[f]);
        }
    }
    return status;
}

static bw_status put_cells(writer *w, int32_t *mark) {
    const bw_cells *cells = w->cells;
    size_t count = cells->cell_count;
    put_points(w);
    bw_vtm_array(&w->file);
    memset(mark, 0, cells->vertex_count * sizeof *mark);
    for (size_t c = 0; c < count; c++) cell_points(w, (bw_cell)c, mark, true);
    bw_vtm_array(&w->file);
    memset(mark, 0, cells->vertex_count * sizeof *mark);
    uint64_t end = 0;
    for (size_t c = 0; c < count; c++)
        bw_vtm_int64(&w->file, (int64_t)(end += cell_points(w, (bw_cell)c, mark, false)));
    put_types(w, count, VTK_POLYHEDRON);
    bw_status status = put_faces(w);
    if (status != BW_OK) return status;
    bw_vtm_array(&w->file);
    end = 0;
    for (size_t c = 0; c < count; c++) bw_vtm_int64(&w->file, (int64_t)(end += face_numbers(w, (bw_cell)c)));
    bw_vtm_array(&w->file);
    for (size_t c = 0; c < count; c++) bw_vtm_int32(&w->file, w->complex->cell_block[c]);
    bw_vtm_array(&w->file);
    for (size_t c = 0; c < count; c++) bw_vtm_int32(&w->file, cells->mesh->tet_id[bw_cells_tet(cells, (bw_cell)c)]);
    return BW_OK;
}

static bw_status write_blocks(writer *w, const char *path, uint64_t *bytes) {
    const bw_cells *cells = w->cells;
    size_t count = cells->cell_count;
    uint64_t corners = 0, numbers = 0;
    int32_t *mark = bw_alloc(w->ctx, cells->vertex_count, sizeof *mark);
    if (!mark) return w->ctx->error.status;
    for (size_t c = 0; c < count; c++) {
        for (bw_polygon p = bw_cells_first_in_cell(cells, (bw_cell)c); p != BW_NONE;
             p = bw_cells_next_in_cell(cells, p, (bw_cell)c))
            need_polygon(w, p);
        corners += cell_points(w, (bw_cell)c, mark, false);
        numbers += face_numbers(w, (bw_cell)c);
    }
    const bw_vtm_array_info more[] = {{BW_VTM_CELLS, "faces", BW_VTM_INT32, 1, numbers},
                                      {BW_VTM_CELLS, "faceoffsets", BW_VTM_INT64, 1, count},
                                      per_cell("block", BW_VTM_INT32, 1, count),
                                      per_cell("tet", BW_VTM_INT32, 1, count)};
    bw_status status = begin_file(w, path, count, corners, more, sizeof more / sizeof *more);
    if (status == BW_OK) status = put_cells(w, mark);
    bw_status closed = bw_vtm_end(&w->file, bytes);
    bw_free(w->ctx, mark);
    return status == BW_OK ? closed : status;
}

/* ---- walls --------------------------------------------------------------------------------------------- */

static void put_patch_data(writer *w, size_t polygons) {
    const bw_complex *x = w->complex;
    bw_vtm_array(&w->file);
    for (size_t p = 0; p < x->patch_count; p++)
        for (size_t i = x->patch_polygon_begin[p]; i < x->patch_polygon_begin[p + 1]; i++)
            bw_vtm_int32(&w->file, (int32_t)p);
    bw_vtm_array(&w->file);
    for (size_t p = 0; p < x->patch_count; p++)
        for (size_t i = x->patch_polygon_begin[p]; i < x->patch_polygon_begin[p + 1]; i++)
            for (int side = 0; side < 2; side++) bw_vtm_int32(&w->file, x->patch_block[p][side]);
    bw_vtm_array(&w->file);
    for (size_t i = 0; i < polygons; i++)
        bw_vtm_float64(&w->file, in_map(w, bw_cells_distance(w->cells, x->patch_polygon[i])));
    for (int all = 0; all < 2; all++) {
        bw_vtm_array(&w->file);
        for (size_t p = 0; p < x->patch_count; p++)
            for (size_t i = x->patch_polygon_begin[p]; i < x->patch_polygon_begin[p + 1]; i++)
                bw_vtm_uint8(&w->file,
                             all ? x->patch_flags[p] : (x->patch_flags[p] & BW_PATCH_BOUNDARY) != 0);
    }
}

static bw_status write_walls(writer *w, const char *path, uint64_t *bytes) {
    const bw_complex *x = w->complex;
    size_t count = x->patch_polygon_begin[x->patch_count];
    uint64_t corners = 0;
    for (size_t i = 0; i < count; i++) {
        need_polygon(w, x->patch_polygon[i]);
        corners += polygon_size(w->cells, x->patch_polygon[i]);
    }
    const bw_vtm_array_info more[] = {per_cell("patch", BW_VTM_INT32, 1, count),
                                      per_cell("blocks", BW_VTM_INT32, 2, count),
                                      per_cell("distance", BW_VTM_FLOAT64, 1, count),
                                      per_cell("boundary", BW_VTM_UINT8, 1, count),
                                      per_cell("flags", BW_VTM_UINT8, 1, count)};
    begin_file(w, path, count, corners, more, sizeof more / sizeof *more);
    put_points(w);
    bw_vtm_array(&w->file);
    for (size_t i = 0; i < count; i++) put_polygon(w, x->patch_polygon[i], false);
    bw_vtm_array(&w->file);
    uint64_t end = 0;
    for (size_t i = 0; i < count; i++)
        bw_vtm_int64(&w->file, (int64_t)(end += polygon_size(w->cells, x->patch_polygon[i])));
    put_types(w, count, VTK_POLYGON);
    put_patch_data(w, count);
    return bw_vtm_end(&w->file, bytes);
}

/* ---- arcs and nodes ------------------------------------------------------------------------------------ */

/* The vertex of an arc's edge that is not `from`. */
static bw_cvertex step(const bw_cells *cells, bw_cedge edge, bw_cvertex from) {
    return cells->edge[edge].vertex[cells->edge[edge].vertex[0] == from];
}

static void put_arc_data(writer *w) {
    const bw_complex *x = w->complex;
    size_t count = x->arc_count;
    put_numbers(w, count);
    bw_vtm_array(&w->file);
    for (size_t a = 0; a < count; a++) bw_vtm_float64(&w->file, in_map(w, x->arc_length[a]));
    bw_vtm_array(&w->file);
    for (size_t a = 0; a < count; a++) bw_vtm_int32(&w->file, x->arc_quarters[a]);
    put_flag(w, x->arc_flags, count, BW_ARC_SINGULAR);
    put_flag(w, x->arc_flags, count, BW_ARC_BOUNDARY);
    put_flag(w, x->arc_flags, count, BW_ARC_T);
    put_flags(w, x->arc_flags, count);
}

static void put_lines(writer *w) {
    const bw_complex *x = w->complex;
    bw_vtm_array(&w->file);
    for (size_t a = 0; a < x->arc_count; a++) {
        bw_cvertex v = x->node_vertex[x->arc_node[a][0]];
        bw_vtm_int32(&w->file, w->point[v]);
        for (size_t i = x->arc_edge_begin[a]; i < x->arc_edge_begin[a + 1]; i++)
            bw_vtm_int32(&w->file, w->point[v = step(w->cells, x->arc_edge[i], v)]);
    }
    bw_vtm_array(&w->file);
    for (size_t a = 0; a < x->arc_count; a++)
        bw_vtm_int64(&w->file, (int64_t)(x->arc_edge_begin[a + 1] + a + 1));
    put_types(w, x->arc_count, VTK_POLY_LINE);
}

static bw_status write_arcs(writer *w, const char *path, uint64_t *bytes) {
    const bw_complex *x = w->complex;
    size_t count = x->arc_count, edges = x->arc_edge_begin[count];
    for (size_t i = 0; i < edges; i++)
        for (int k = 0; k < 2; k++) need_point(w, w->cells->edge[x->arc_edge[i]].vertex[k]);
    const bw_vtm_array_info more[] = {per_cell("arc", BW_VTM_INT32, 1, count),
                                      per_cell("length", BW_VTM_FLOAT64, 1, count),
                                      per_cell("quarters", BW_VTM_INT32, 1, count),
                                      per_cell("singular", BW_VTM_UINT8, 1, count),
                                      per_cell("boundary", BW_VTM_UINT8, 1, count),
                                      per_cell("t", BW_VTM_UINT8, 1, count),
                                      per_cell("flags", BW_VTM_UINT8, 1, count)};
    begin_file(w, path, count, edges + count, more, sizeof more / sizeof *more);
    put_points(w);
    put_lines(w);
    put_arc_data(w);
    return bw_vtm_end(&w->file, bytes);
}

static bw_status write_nodes(writer *w, const char *path, uint64_t *bytes) {
    const bw_complex *x = w->complex;
    size_t count = x->node_count;
    for (size_t n = 0; n < count; n++) need_point(w, x->node_vertex[n]);
    const bw_vtm_array_info more[] = {per_cell("node", BW_VTM_INT32, 1, count),
                                      per_cell("singular", BW_VTM_UINT8, 1, count),
                                      per_cell("boundary", BW_VTM_UINT8, 1, count),
                                      per_cell("flags", BW_VTM_UINT8, 1, count)};
    begin_file(w, path, count, count, more, sizeof more / sizeof *more);
    put_points(w);
    bw_vtm_array(&w->file);
    for (size_t n = 0; n < count; n++) bw_vtm_int32(&w->file, w->point[x->node_vertex[n]]);
    bw_vtm_array(&w->file);
    for (size_t n = 0; n < count; n++) bw_vtm_int64(&w->file, (int64_t)n + 1);
    put_types(w, count, VTK_VERTEX);
    put_numbers(w, count);
    put_flag(w, x->node_flags, count, BW_NODE_SINGULAR);
    put_flag(w, x->node_flags, count, BW_NODE_BOUNDARY);
    put_flags(w, x->node_flags, count);
    return bw_vtm_end(&w->file, bytes);
}

/* ---- all ----------------------------------------------------------------------------------------------- */

static bw_status write_index(writer *w, const char *path, uint64_t *bytes) {
    bw_output out;
    bw_output_open(w->ctx, &out, path);
    bw_put_text(&out, "<?xml version=\"1.0\"?>\n"
                      "<VTKFile type=\"vtkMultiBlockDataSet\" version=\"1.0\" byte_order=\"LittleEndian\" "
                      "header_type=\"UInt64\">\n"
                      "  <vtkMultiBlockDataSet>\n"
                      "    <DataSet index=\"0\" name=\"blocks\" file=\"blocks.vtu\"/>\n"
                      "    <DataSet index=\"1\" name=\"walls\" file=\"walls.vtu\"/>\n"
                      "    <DataSet index=\"2\" name=\"arcs\" file=\"arcs.vtu\"/>\n"
                      "    <DataSet index=\"3\" name=\"nodes\" file=\"nodes.vtu\"/>\n"
                      "  </vtkMultiBlockDataSet>\n</VTKFile>\n");
    return bw_output_close(&out, bytes);
}

static bw_status write_file(writer *w, const char *folder, const char *name,
                            bw_status (*write)(writer *, const char *, uint64_t *), uint64_t *bytes) {
    size_t room = strlen(folder) + strlen(name) + sizeof "/.part";
    char *path = bw_alloc(w->ctx, 2 * room, 1), *draft = path + room;
    if (!path) return w->ctx->error.status;
    snprintf(path, room, "%s/%s", folder, name);
    snprintf(draft, room, "%s/%s.part", folder, name);
    bw_status status = write(w, draft, bytes);
    if (status == BW_OK && rename(draft, path))
        status = bw_fail(w->ctx, BW_E_IO, "cannot rename %s: %s", draft, strerror(errno));
    if (status == BW_OK)
        status = bw_poll(w->ctx);
    else
        unlink(draft);
    forget_points(w);
    bw_free(w->ctx, path);
    return status;
}

bw_status bw_vtm_write(bw_context *ctx, const bw_cells *cells, const bw_complex *complex,
                       const double (*position)[3], const char *out_dir,
                       bw_vtm_written written[BW_VTM_FILES]) {
    static const struct {
        const char *name;
        bw_status (*write)(writer *, const char *, uint64_t *);
    } files[BW_VTM_FILES] = {{"blocks.vtu", write_blocks},
                             {"walls.vtu", write_walls},
                             {"arcs.vtu", write_arcs},
                             {"nodes.vtu", write_nodes},
                             {"complex.vtm", write_index}};
    writer w = {.ctx = ctx, .cells = cells, .complex = complex, .position = position};
    w.point = bw_alloc(ctx, cells->vertex_count, sizeof *w.point);
    w.vertex = bw_alloc(ctx, cells->vertex_count, sizeof *w.vertex);
    w.slot = bw_alloc(ctx, cells->polygon_count, sizeof *w.slot);
    bw_status status = w.point && w.vertex && w.slot ? BW_OK : ctx->error.status;
    for (size_t v = 0; v < cells->vertex_count && status == BW_OK; v++) w.point[v] = BW_NONE;
    for (int i = 0; i < BW_VTM_FILES && status == BW_OK; i++) {
        written[i].name = files[i].name;
        status = write_file(&w, out_dir, files[i].name, files[i].write, &written[i].bytes);
    }
    bw_free(ctx, w.point), bw_free(ctx, w.vertex), bw_free(ctx, w.slot), bw_free(ctx, w.face),
        bw_free(ctx, w.turned);
    return status;
}
