/* CGNS by its own library. ADF rather than HDF5 files: HDF5 stamps every array with the time; ADF does so in two places of its header, where the time is put
 * back to a fixed one, so that the same mesh gives the same bytes. What the library takes is not counted in the job's budget: it keeps the tree, not the arrays. */
#include <cgnslib.h>
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "format/hex_links.h"
#include "format/hex_write.h"

typedef struct {
    bw_context *ctx;
    const bw_hex_mesh *mesh;
    const bw_hex_skin *skin;
    const char *path;
    bw_hex_groups blocks;
    bw_hvertex *grid;   /* of the block at hand */
    double *coordinate; /* of the zone at hand */
    int32_t *named;     /* [group] links and conditions written so far: their names */
    int file, base;
} writer;

static bw_status library(writer *w, int result) {
    if (result == CG_OK) return BW_OK;
    return bw_fail(w->ctx, BW_E_IO, "cannot write %s: %s", w->path, cg_get_error());
}

/* ---- structured zones: zone of group g is g + 1 -------------------------------------------------------------------- */

static bw_status write_coordinates(writer *w, int zone, const bw_hvertex *vertex, size_t count) {
    static const char *const name[] = {"CoordinateX", "CoordinateY", "CoordinateZ"};
    static const float length[5] = {0, 1, 0, 0, 0}; /* mass, length, time, temperature, angle */
    bw_status status = BW_OK;
    for (int k = 0, c; k < 3 && status == BW_OK; k++) {
        for (size_t i = 0; i < count; i++) w->coordinate[i] = w->mesh->position[vertex ? (size_t)vertex[i] : i][k];
        status = library(w, cg_coord_write(w->file, w->base, zone, CGNS_ENUMV(RealDouble), name[k], w->coordinate, &c));
        if (status == BW_OK) status = library(w, cg_goto(w->file, w->base, "Zone_t", zone, "GridCoordinates_t", 1, "DataArray_t", c, "end"));
        if (status == BW_OK) status = library(w, cg_exponents_write(CGNS_ENUMV(RealSingle), length));
    }
    return status;
}

static bw_status write_zone(writer *w, size_t g) {
    uint32_t n[3];
    char name[33];
    int zone;
    cgsize_t size[9] = {0};
    bw_hex_grid_measure(w->mesh, &w->blocks, g, n);
    bw_hex_grid_fill(w->mesh, &w->blocks, g, n, w->grid);
    for (int k = 0; k < 3; k++) size[k] = (cgsize_t)n[k] + 1, size[3 + k] = (cgsize_t)n[k];
    snprintf(name, sizeof name, "Block_%d", w->blocks.key[g]);
    bw_status status = library(w, cg_zone_write(w->file, w->base, name, size, CGNS_ENUMV(Structured), &zone));
    return status == BW_OK ? write_coordinates(w, zone, w->grid, bw_hex_grid_points(n)) : status;
}

static void range_of(const int32_t from[3], const int32_t to[3], cgsize_t range[6]) {
    for (int k = 0; k < 3; k++) range[k] = from[k] + 1, range[3 + k] = to[k] + 1;
}

static bw_status write_connection(writer *w, const bw_hex_link *l) {
    char name[33], donor[33];
    cgsize_t range[6], donor_range[6];
    int i;
    snprintf(name, sizeof name, "Interface_%d", ++w->named[l->group]);
    snprintf(donor, sizeof donor, "Block_%d", w->blocks.key[l->other]);
    range_of(l->from, l->to, range), range_of(l->other_from, l->other_to, donor_range);
    return library(w, cg_1to1_write(w->file, w->base, (int)l->group + 1, name, donor, range, donor_range, l->turn, &i));
}

/* A condition, and the family of its surface. */
static bw_status write_condition(writer *w, int zone, int32_t surface, int32_t part, CGNS_ENUMT(GridLocation_t) where, const cgsize_t *range) {
    char name[33], family[33];
    int i;
    snprintf(family, sizeof family, "Surface_%d", surface);
    snprintf(name, sizeof name, part ? "Surface_%d_part_%d" : "Surface_%d", surface, part);
    bw_status status = library(w, cg_boco_write(w->file, w->base, zone, name, CGNS_ENUMV(BCWall), CGNS_ENUMV(PointRange), 2, range, &i));
    if (status == BW_OK && where != CGNS_ENUMV(Vertex)) status = library(w, cg_boco_gridlocation_write(w->file, w->base, zone, i, where));
    if (status == BW_OK) status = library(w, cg_goto(w->file, w->base, "Zone_t", zone, "ZoneBC_t", 1, "BC_t", i, "end"));
    return status == BW_OK ? library(w, cg_famname_write(family)) : status;
}

static bw_status write_link(writer *w, const bw_hex_link *l) {
    if (l->surface >= 0) {
        cgsize_t range[6];
        range_of(l->from, l->to, range);
        return write_condition(w, (int)l->group + 1, l->surface, ++w->named[l->group], CGNS_ENUMV(Vertex), range);
    }
    bw_hex_link back = bw_hex_link_turned(l);
    bw_status status = write_connection(w, l);
    return status == BW_OK ? write_connection(w, &back) : status;
}

static bw_status write_blocks(writer *w) {
    bw_hex_links links = {0};
    w->named = bw_alloc(w->ctx, w->blocks.count, sizeof *w->named);
    bw_status status = w->named ? bw_hex_links_init(w->ctx, w->mesh, w->skin, &w->blocks, &links) : w->ctx->error.status;
    for (size_t g = 0; g < w->blocks.count && status == BW_OK; g++) {
        status = write_zone(w, g);
        if (status == BW_OK) status = bw_poll(w->ctx);
    }
    for (size_t i = 0; i < links.count && status == BW_OK; i++) status = write_link(w, &links.link[i]);
    bw_hex_links_clear(w->ctx, &links);
    return status;
}

/* ---- one unstructured zone ----------------------------------------------------------------------------------------- */

static bw_status write_section(writer *w, const char *name, CGNS_ENUMT(ElementType_t) type, size_t first, size_t count, const cgsize_t *corner) {
    int section;
    return library(w, cg_section_write(w->file, w->base, 1, name, type, (cgsize_t)first, (cgsize_t)(first + count - 1), 0, corner, &section));
}

static bw_status write_hexes(writer *w) {
    size_t count = w->mesh->hex_count;
    cgsize_t *corner = bw_alloc(w->ctx, 8 * count, sizeof *corner);
    if (!corner) return w->ctx->error.status;
    for (size_t i = 0; i < 8 * count; i++) corner[i] = (cgsize_t)w->mesh->hex[i / 8][bw_hex_ring[i % 8]] + 1;
    bw_status status = write_section(w, "Hexes", CGNS_ENUMV(HEXA_8), 1, count, corner);
    bw_free(w->ctx, corner);
    return status;
}

static bw_status write_surfaces(writer *w) {
    bw_hex_groups surfaces = {0};
    cgsize_t *corner = bw_alloc(w->ctx, 4 * w->skin->quad_count, sizeof *corner);
    bw_status status = corner ? bw_hex_groups_of_surfaces(w->ctx, w->skin, &surfaces) : w->ctx->error.status;
    for (size_t g = 0; g < surfaces.count && status == BW_OK; g++) {
        char name[33];
        size_t from = surfaces.begin[g], count = surfaces.begin[g + 1] - from, first = w->mesh->hex_count + from + 1;
        for (size_t i = 0; i < 4 * count; i++)
            corner[i] = (cgsize_t)bw_hex_quad_vertex(w->mesh, &w->skin->quad[surfaces.item[from + i / 4]], (int)(i % 4)) + 1;
        snprintf(name, sizeof name, "Quads_%d", surfaces.key[g]);
        status = write_section(w, name, CGNS_ENUMV(QUAD_4), first, count, corner);
        cgsize_t range[2] = {(cgsize_t)first, (cgsize_t)(first + count - 1)};
        if (status == BW_OK) status = write_condition(w, 1, surfaces.key[g], 0, CGNS_ENUMV(FaceCenter), range);
    }
    bw_hex_groups_clear(w->ctx, &surfaces);
    bw_free(w->ctx, corner);
    return status;
}

static bw_status write_unstructured(writer *w) {
    int zone;
    const bw_hex_mesh *m = w->mesh;
    if (m->hex_count > INT32_MAX / 8 || m->vertex_count > INT32_MAX) return bw_fail(w->ctx, BW_E_LIMIT, "too many hexes for one zone of a CGNS file");
    cgsize_t size[3] = {(cgsize_t)m->vertex_count, (cgsize_t)m->hex_count, 0};
    bw_status status = library(w, cg_zone_write(w->file, w->base, "Hexes", size, CGNS_ENUMV(Unstructured), &zone));
    if (status == BW_OK) status = write_coordinates(w, zone, NULL, m->vertex_count);
    if (status == BW_OK) status = write_hexes(w);
    return status == BW_OK ? write_surfaces(w) : status;
}

/* ---- the file ------------------------------------------------------------------------------------------------------ */

/* Room for the largest zone; *structured: every block is a grid. */
static bw_status prepare(writer *w, bool *structured) {
    bw_status status = bw_hex_groups_of_blocks(w->ctx, w->mesh, &w->blocks);
    size_t most = 0;
    uint32_t n[3];
    *structured = status == BW_OK;
    for (size_t g = 0; g < w->blocks.count && *structured; g++) {
        *structured = bw_hex_grid_measure(w->mesh, &w->blocks, g, n);
        if (*structured && bw_hex_grid_points(n) > most) most = bw_hex_grid_points(n);
    }
    if (status != BW_OK) return status;
    if (*structured && most > INT32_MAX) return bw_fail(w->ctx, BW_E_LIMIT, "too many hexes for one zone of a CGNS file");
    w->grid = bw_alloc(w->ctx, *structured ? most : 0, sizeof *w->grid);
    w->coordinate = bw_alloc(w->ctx, most > w->mesh->vertex_count ? most : w->mesh->vertex_count, sizeof *w->coordinate);
    if (!w->grid || !w->coordinate) return w->ctx->error.status;
    for (size_t g = 0; g < w->blocks.count && *structured; g++) {
        bw_hex_grid_measure(w->mesh, &w->blocks, g, n);
        *structured = bw_hex_grid_fill(w->mesh, &w->blocks, g, n, w->grid);
    }
    return BW_OK;
}

static bw_status write_families(writer *w) {
    bw_status status = BW_OK;
    for (size_t s = 0; s < w->skin->surface_count && status == BW_OK; s++) {
        char name[33];
        int family, condition;
        snprintf(name, sizeof name, "Surface_%zu", s);
        status = library(w, cg_family_write(w->file, w->base, name, &family));
        if (status == BW_OK) status = library(w, cg_fambc_write(w->file, w->base, family, "FamBC", CGNS_ENUMV(BCWall), &condition));
    }
    return status;
}

/* Puts the two times in the header back; *bytes: size of the file. */
static bw_status finish(writer *w, uint64_t *bytes) {
    enum { CREATED = 32, CHANGED = 64, TAG = 4 };
    static const char time[] = "Thu Jan  1 00:00:00 1970    ";
    char head[CHANGED + TAG];
    struct stat info;
    int file = open(w->path, O_RDWR | O_CLOEXEC);
    bool good = file >= 0 && pread(file, head, sizeof head, 0) == (ssize_t)sizeof head && !memcmp(head + CREATED, "AdF0", TAG) &&
                !memcmp(head + CHANGED, "AdF1", TAG) && pwrite(file, time, sizeof time - 1, CREATED + TAG) == (ssize_t)sizeof time - 1 &&
                pwrite(file, time, sizeof time - 1, CHANGED + TAG) == (ssize_t)sizeof time - 1 && fstat(file, &info) == 0;
    if (good && bytes) *bytes = (uint64_t)info.st_size;
    if (file >= 0 && close(file)) good = false;
    return good ? BW_OK : bw_fail(w->ctx, BW_E_IO, "cannot write %s: %s", w->path, strerror(errno));
}

bw_status bw_hex_write_cgns(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes) {
    writer w = {.ctx = ctx, .mesh = mesh, .skin = skin, .path = path};
    bool structured, opened = false;
    bw_status status = prepare(&w, &structured);
    if (status == BW_OK) status = library(&w, cg_set_file_type(CG_FILE_ADF));
    if (status == BW_OK) status = library(&w, cg_open(path, CG_MODE_WRITE, &w.file));
    opened = status == BW_OK;
    if (status == BW_OK) status = library(&w, cg_base_write(w.file, "Mesh", 3, 3, &w.base));
    if (status == BW_OK) status = library(&w, cg_goto(w.file, w.base, "end"));
    if (status == BW_OK) status = library(&w, cg_dataclass_write(CGNS_ENUMV(NormalizedByUnknownDimensional))); /* the input's unit, whatever it is */
    if (status == BW_OK) status = write_families(&w);
    if (status == BW_OK) status = structured ? write_blocks(&w) : write_unstructured(&w);
    if (opened) {
        bw_status closed = library(&w, cg_close(w.file));
        if (status == BW_OK) status = closed;
    }
    if (status == BW_OK) status = finish(&w, bytes);
    bw_hex_groups_clear(ctx, &w.blocks);
    bw_free(ctx, w.grid), bw_free(ctx, w.coordinate), bw_free(ctx, w.named);
    return status;
}
