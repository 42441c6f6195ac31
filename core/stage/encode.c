#include "stage/encode.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "format/blocks_json.h"
#include "format/constraints_json.h"
#include "format/igm_hexex.h"
#include "format/hex_labels.h"
#include "format/hex_write.h"
#include "format/sizes_svg.h"
#include "format/tmesh_json.h"
#include "format/traced.h"
#include "format/view.h"
#include "format/vtm.h"
#include "igm/overlay.h"

typedef struct {
    bw_context *ctx;
    const bw_cells *cells;
    const bw_complex *complex;
    const int64_t *length;
    const bw_igm *igm;
    const bw_hex_mesh *hex, *source;
    const bw_vertex *source_vertex;
    bw_hex_skin skin;
    bw_hex_format hex_format; /* of the file that is being written */
    int bwh_bits;
    bw_bwh_sizes bwh_sizes;
    bw_report *report;
    const char *folder;
    bw_tessellation tessellation;
    double (*position)[3]; /* [point] */
    double *cell_volume, *block_volume;
    const bw_tmesh *tmesh;
    double (*tmesh_position)[3]; /* [vertex of it] */
} encoder;

/* ---- files
 * ------------------------------------------------------------------------------------------------------- */

static bw_status write_traced(encoder *e, const char *path, uint64_t *bytes) {
    bw_traced_counts counts;
    bw_status status = bw_traced_write(e->ctx, &e->tessellation, (const double(*)[3])e->position, path,
                                       &counts, e->cell_volume);
    e->report->quality.traced_vertices = counts.vertices;
    e->report->quality.traced_tets = counts.tets;
    e->report->quality.traced_walls = counts.walls;
    *bytes = counts.bytes;
    for (size_t c = 0; c < e->cells->cell_count; c++)
        e->block_volume[e->complex->cell_block[c]] += e->cell_volume[c];
    return status;
}

static bw_status write_blocks(encoder *e, const char *path, uint64_t *bytes) {
    return bw_blocks_write(e->ctx, e->cells, e->complex, e->report->complex.kind, e->length, e->block_volume,
                           (const double(*)[3])e->position, path, bytes);
}

static bw_status write_sizes(encoder *e, const char *path, uint64_t *bytes) {
    return bw_sizes_write(e->ctx, e->report, path, bytes);
}

static bw_status write_constraints(encoder *e, const char *path, uint64_t *bytes) {
    bw_validity *validity;
    bw_differential d = {0};
    bw_status status = bw_validity_new(e->ctx, e->cells, e->complex, &validity);
    if (status == BW_OK) status = bw_differential_init(e->ctx, e->cells, validity, e->length, &d);
    if (status == BW_OK) status = bw_constraints_write(e->ctx, e->cells, e->complex, &d, path, bytes);
    bw_differential_clear(e->ctx, &d);
    bw_validity_free(e->ctx, validity);
    return status;
}

static bw_status write_igm(encoder *e, const char *path, uint64_t *bytes) { return bw_igm_hexex_write(e->ctx, e->igm, path, bytes); }

static bw_status write_view(encoder *e, const char *path, uint64_t *bytes) {
    return bw_view_write(e->ctx, &e->tessellation, e->complex, (const double(*)[3])e->position, path, bytes);
}

static bw_status write_hexes(encoder *e, const char *path, uint64_t *bytes) {
    return bw_hex_formats[e->hex_format].write(e->ctx, e->hex, &e->skin, path, bytes);
}

/* The compact form has a choice that the others have not, and tells what of it is what. */
static bw_status write_compact(encoder *e, const char *path, uint64_t *bytes) {
    bw_status status = bw_bwh_write(e->ctx, e->hex, e->bwh_bits, path, &e->bwh_sizes);
    *bytes = e->bwh_sizes.header + e->bwh_sizes.shape + e->bwh_sizes.places;
    return status;
}

static bw_status write_labels(encoder *e, const char *path, uint64_t *bytes) { return bw_hex_labels_write(e->ctx, e->source, path, bytes); }

static bw_status write_walls(encoder *e, const char *path, uint64_t *bytes) {
    return bw_hex_walls_write(e->ctx, e->cells, e->complex, e->source, e->source_vertex, path, bytes);
}

static bw_status write_tmesh_json(encoder *e, const char *path, uint64_t *bytes) {
    return bw_tmesh_write(e->ctx, e->tmesh, (const double(*)[3])e->tmesh_position, e->report->complex.kind, path, bytes);
}

static bw_status write_tmesh_vtu(encoder *e, const char *path, uint64_t *bytes) {
    return bw_tmesh_write_vtu(e->ctx, e->tmesh, (const double(*)[3])e->tmesh_position, path, bytes);
}

/* Writes under another name first, so that a file of that name is always whole. */
static bw_status write_result(encoder *e, const char *name,
                              bw_status (*write)(encoder *, const char *, uint64_t *)) {
    size_t room = strlen(e->folder) + strlen(name) + sizeof "/.part";
    char *path = bw_alloc(e->ctx, 2 * room, 1), *draft = path + room;
    if (!path) return e->ctx->error.status;
    snprintf(path, room, "%s/%s", e->folder, name);
    snprintf(draft, room, "%s/%s.part", e->folder, name);
    uint64_t bytes = 0;
    bw_status status = write(e, draft, &bytes);
    if (status == BW_OK && rename(draft, path))
        status = bw_fail(e->ctx, BW_E_IO, "cannot rename %s: %s", draft, strerror(errno));
    if (status == BW_OK) {
        bw_report_add_result(e->report, name, bytes);
        bw_log(e->ctx, "%s: %llu bytes", name, (unsigned long long)bytes);
        status = bw_poll(e->ctx);
    } else {
        unlink(draft);
    }
    bw_free(e->ctx, path);
    return status;
}

static bw_status write_vtm(encoder *e) {
    bw_vtm_written written[BW_VTM_FILES];
    bw_status status = bw_vtm_write(e->ctx, e->cells, e->complex, (const double(*)[3])e->position, e->folder, written);
    for (int i = 0; i < BW_VTM_FILES && status == BW_OK; i++) bw_report_add_result(e->report, written[i].name, written[i].bytes);
    return status;
}

static bw_status write_hex_formats(encoder *e, unsigned formats) {
    if (!formats) return BW_OK;
    bw_status status = bw_hex_skin_init(e->ctx, e->hex, &e->skin);
    for (int f = 0; f < BW_HEX_FORMAT_COUNT && status == BW_OK; f++) {
        char name[24];
        if (!(formats >> f & 1)) continue;
        e->hex_format = (bw_hex_format)f;
        snprintf(name, sizeof name, "hexmesh.%s", bw_hex_formats[f].name);
        status = write_result(e, name, f == BW_HEX_FORMAT_BWH ? write_compact : write_hexes);
    }
    bw_hex_skin_clear(e->ctx, &e->skin);
    return status;
}

/* What coding the hex mesh by its blocks costs: estimated, and measured where it was written. */
static bw_status measure_compression(encoder *e, unsigned formats) {
    bw_predict_report predicted;
    bool known;
    bw_status status = bw_predict_mesh(e->ctx, e->hex, BW_PREDICT_BITS, &known, &predicted);
    if (status != BW_OK || !known) return status;
    bw_report_fill_compression(e->report, &predicted, BW_PREDICT_BITS);
    if (formats >> BW_HEX_FORMAT_BWH & 1) bw_report_fill_written(e->report, &e->bwh_sizes, e->bwh_bits, e->hex->vertex_count);
    return BW_OK;
}

/* ---- quality
 * ----------------------------------------------------------------------------------------------------- */

static int ascending(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Sorts the values. */
static bw_report_range range_of(double *value, size_t count) {
    if (!count) return (bw_report_range){0, 0, 0};
    qsort(value, count, sizeof *value, ascending);
    double median = (value[(count - 1) / 2] + value[count / 2]) / 2;
    return (bw_report_range){value[0], median, value[count - 1]};
}

static bw_status measure_blocks(encoder *e) {
    size_t blocks = e->complex->block_count;
    double *value = bw_alloc(e->ctx, 3 * blocks, sizeof *value);
    if (!value) return e->ctx->error.status;
    for (size_t i = 0; i < 3 * blocks; i++)
        value[i] = ldexp((double)e->complex->block_extent[i / 3][i % 3], -e->cells->map->exponent);
    e->report->quality.block_extent = range_of(value, 3 * blocks);
    e->report->quality.volume = 0;
    for (size_t i = 0; i < blocks; i++) {
        const int64_t *x = e->complex->block_extent[i];
        double low = fmin(fmin((double)x[0], (double)x[1]), (double)x[2]);
        value[i] = fmax(fmax((double)x[0], (double)x[1]), (double)x[2]) / (low > 0 ? low : 1);
    }
    e->report->quality.block_aspect = range_of(value, blocks);
    for (size_t i = 0; i < blocks; i++) e->report->quality.volume += value[i] = e->block_volume[i];
    e->report->quality.block_volume = range_of(value, blocks);
    e->report->has_quality = true;
    bw_free(e->ctx, value);
    return BW_OK;
}

/* ---- the block-wise map
 * ----------------------------------------------------------------------------------------------------- */

/* A hex mesh straight from blocks has a map as well: refined, so it is made only for its file. Where that would be too large, or the grid is too coarse for
 * it, there is no file; the hex mesh does not depend on it. */
static bw_status find_block_map(encoder *e, bw_cells *cells, bw_igm *own) {
    enum { MOST_TETS = 300000 };
    bw_context apart = *e->ctx; /* its own error */
    bw_atlas atlas = {0};
    bw_blockwise map = {0};
    bw_overlay_report report;
    bw_status status = bw_atlas_init(&apart, cells, e->complex, e->length, &atlas);
    if (status == BW_OK) status = bw_blockwise_init(&apart, &atlas, &map);
    if (status == BW_OK) status = bw_overlay(&apart, &map, cells, MOST_TETS, own, &report);
    if (status == BW_OK) status = bw_igm_check(&apart, own);
    bw_blockwise_clear(&apart, &map), bw_atlas_clear(&apart, &atlas);
    if (status != BW_OK) bw_igm_clear(&apart, own);
    e->ctx->memory = apart.memory;
    if (status == BW_OK) e->igm = own;
    if (status == BW_E_LIMIT || status == BW_E_RANGE || status == BW_E_MEMORY) {
        char *why = e->report->quality.integer_grid_omitted;
        snprintf(why, sizeof e->report->quality.integer_grid_omitted, "%.230s", apart.error.message);
        bw_log(e->ctx, "no integer_grid.hexex: %s", apart.error.message);
        return BW_OK;
    }
    e->ctx->error = apart.error;
    return status;
}

static bool is_positive(const encoder *e) {
    for (size_t a = 0; a < e->complex->arc_count; a++)
        if (e->length[a] < 1) return false;
    return true;
}

/* ---- the T-mesh
 * ----------------------------------------------------------------------------------------------------- */

static void report_tmesh(bw_report *report, const bw_tmesh *mesh, bool hexes, double seconds) {
    const bw_complex *x = mesh->atlas->complex;
    uint64_t arcs = 0;
    for (size_t a = 0; a < x->arc_count; a++) arcs += bw_tmesh_is_extraordinary(x, (bw_arc)a);
    report->has_tspline = true;
    snprintf(report->tspline.knots, sizeof report->tspline.knots, "%s", hexes ? "hexes" : "map");
    report->tspline.blocks = x->block_count, report->tspline.cells = mesh->cell_count;
    report->tspline.added_cells = mesh->cell_count - x->block_count, report->tspline.refined_blocks = mesh->refined_blocks;
    report->tspline.vertices = mesh->vertex_count, report->tspline.t_joints = mesh->joint_count;
    report->tspline.extraordinary_arcs = arcs;
    report->tspline.seconds = seconds;
}

/* With knots in hexes where all integer lengths are positive, else in units of the map. */
static bw_status write_tmesh(encoder *e) {
    bool hexes = e->length && is_positive(e);
    double since = bw_seconds_now();
    bw_atlas atlas = {0};
    bw_tmesh mesh = {0};
    bw_status status = bw_atlas_init(e->ctx, e->cells, e->complex, hexes ? e->length : e->complex->arc_length, &atlas);
    if (status == BW_OK) status = bw_tmesh_init(e->ctx, &atlas, &mesh);
    if (status == BW_OK) status = bw_tmesh_check(e->ctx, &mesh);
    if (status == BW_OK && !(e->tmesh_position = bw_alloc(e->ctx, mesh.vertex_count, sizeof *e->tmesh_position))) status = e->ctx->error.status;
    if (status == BW_OK) status = bw_tmesh_positions(e->ctx, &mesh, e->tmesh_position);
    e->tmesh = &mesh;
    if (status == BW_OK) report_tmesh(e->report, &mesh, hexes, bw_seconds_now() - since);
    if (status == BW_OK) status = write_result(e, "tmesh.json", write_tmesh_json);
    if (status == BW_OK) status = write_result(e, "tmesh.vtu", write_tmesh_vtu);
    bw_free(e->ctx, e->tmesh_position);
    bw_tmesh_clear(e->ctx, &mesh), bw_atlas_clear(e->ctx, &atlas);
    return status;
}

/* ---- the stage
 * --------------------------------------------------------------------------------------------------- */

static bw_status prepare(encoder *e, bw_cells *cells) {
    if (mkdir(e->folder, 0777) && errno != EEXIST)
        return bw_fail(e->ctx, BW_E_IO, "cannot make the folder %s: %s", e->folder, strerror(errno));
    e->cell_volume = bw_alloc(e->ctx, e->cells->cell_count, sizeof *e->cell_volume);
    e->block_volume = bw_alloc(e->ctx, e->complex->block_count, sizeof *e->block_volume);
    if (!e->cell_volume || !e->block_volume) return e->ctx->error.status;
    bw_status status = bw_tessellate(e->ctx, &e->tessellation, cells);
    return status == BW_OK ? bw_points_positions(e->ctx, &e->tessellation.points, &e->position) : status;
}

bw_status bw_encode(bw_context *ctx, const bw_tet_mesh *mesh, const bw_grid_map *map, bw_cells *cells,
                    const bw_complex *complex, const int64_t *length, const bw_hex_mesh *hex, const bw_encode_options *options, bw_report *report,
                    const char *out_dir) {
    if (cells->mesh != mesh || cells->map != map)
        return bw_fail(ctx, BW_E_INTERNAL, "the cell complex belongs to another mesh");
    encoder e = {.ctx = ctx, .cells = cells, .complex = complex, .length = length, .igm = options->igm, .hex = hex ? hex : options->source, .source = options->source, .source_vertex = options->source_vertex,
                 .report = report, .folder = out_dir, .bwh_bits = options->bwh_bits};
    bw_igm own = {0};
    report->quality.integer_grid_omitted[0] = 0;
    bw_status status = prepare(&e, cells);
    if (status == BW_OK && hex && length && !e.igm && is_positive(&e)) status = find_block_map(&e, cells, &own);
    if (status == BW_OK) status = write_result(&e, "traced.hexex", write_traced);
    if (status == BW_OK) status = write_result(&e, "blocks.json", write_blocks);
    if (status == BW_OK && length) status = write_result(&e, "constraints.json", write_constraints);
    if (status == BW_OK && e.igm) status = write_result(&e, "integer_grid.hexex", write_igm);
    if (status == BW_OK && length && report->sweep_count) status = write_result(&e, "sizes.svg", write_sizes);
    if (status == BW_OK) status = write_result(&e, "view.drc", write_view);
    if (status == BW_OK && options->vtk) status = write_vtm(&e);
    if (status == BW_OK && options->tmesh) status = write_tmesh(&e);
    if (status == BW_OK && e.source) status = write_result(&e, "labels.txt", write_labels);
    if (status == BW_OK && e.source) status = write_result(&e, "walls.txt", write_walls);
    if (status == BW_OK && e.hex) status = write_hex_formats(&e, options->hex_formats);
    if (status == BW_OK && e.hex) status = measure_compression(&e, options->hex_formats);
    if (status == BW_OK) status = measure_blocks(&e);
    if (status == BW_OK) bw_progress(ctx, 1);
    bw_igm_clear(ctx, &own);
    bw_tessellation_clear(ctx, &e.tessellation);
    bw_free(ctx, e.position), bw_free(ctx, e.cell_volume), bw_free(ctx, e.block_volume);
    return status;
}
