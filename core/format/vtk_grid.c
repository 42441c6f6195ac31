#include "format/vtk_grid.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "format/input_mesh.h"

enum { BLOCK = 256 }; /* values converted at a time; of text one, so that errors tell their line */
enum { OFTEN = 65536 }; /* values passed between questions whether to go on */

static size_t block_of(bw_vtk_format format, size_t left) {
    return format.coding == BW_VTK_TEXT ? 1 : left < BLOCK ? left : BLOCK;
}

/* ---- values -------------------------------------------------------------------------------------------- */

size_t bw_vtk_size(bw_vtk_type type) {
    static const uint8_t size[BW_VTK_TYPES] = {1, 1, 2, 2, 4, 4, 8, 8, 4, 8};
    return size[type];
}

static uint64_t take_bits(const char *bytes, size_t size, bw_vtk_coding coding) {
    uint64_t bits = 0;
    for (size_t i = 0; i < size; i++) {
        size_t shift = coding == BW_VTK_BIG ? size - 1 - i : i;
        bits |= (uint64_t)(uint8_t)bytes[i] << 8 * shift;
    }
    return bits;
}

static int64_t whole_of(uint64_t bits, bw_vtk_type type) {
    switch (type) {
    case BW_VTK_INT8:
        return (int8_t)bits;
    case BW_VTK_INT16:
        return (int16_t)bits;
    case BW_VTK_INT32:
        return (int32_t)bits;
    case BW_VTK_UINT64:
        return bits > INT64_MAX ? INT64_MAX : (int64_t)bits;
    default:
        return (int64_t)bits;
    }
}

static double real_of(uint64_t bits, bw_vtk_type type) {
    if (type == BW_VTK_FLOAT64) {
        double value;
        memcpy(&value, &bits, sizeof value);
        return value;
    }
    if (type == BW_VTK_FLOAT32) {
        float value;
        uint32_t low = (uint32_t)bits;
        memcpy(&value, &low, sizeof value);
        return (double)value;
    }
    return type == BW_VTK_UINT64 ? (double)bits : (double)whole_of(bits, type);
}

bw_status bw_vtk_check_count(bw_scan *s, bw_vtk_format format, const char *plural, int64_t count) {
    return bw_scan_count(s, plural, count, INT64_MAX,
                         format.coding == BW_VTK_TEXT ? 2 : bw_vtk_size(format.type));
}

static bw_status text_reals(bw_scan *s, uint64_t count, const char *kind, uint64_t per_record, double *out) {
    bw_status status = BW_OK;
    for (uint64_t i = 0; i < count && status == BW_OK; i++) {
        if (i % per_record == 0) status = bw_scan_record(s, kind, (int64_t)(i / per_record));
        if (status == BW_OK) status = bw_scan_number(s, &out[i]);
    }
    return status;
}

bw_status bw_vtk_reals(bw_scan *s, bw_vtk_format format, uint64_t count, const char *kind,
                       uint64_t per_record, double *out) {
    bw_status status = BW_OK;
    size_t size = bw_vtk_size(format.type);
    if (format.coding == BW_VTK_TEXT) {
        status = text_reals(s, count, kind, per_record, out);
    } else {
        const char *bytes = NULL;
        status = bw_scan_bytes(s, size * (size_t)count, &bytes); /* count was checked: no overflow */
        for (uint64_t i = 0; i < count && status == BW_OK; i++) {
            out[i] = real_of(take_bits(bytes + i * size, size, format.coding), format.type);
            if (i % per_record == 0) status = bw_scan_record(s, kind, (int64_t)(i / per_record));
            if (status == BW_OK && !isfinite(out[i])) {
                s->at = bytes + i * size;
                status =
                    bw_scan_fail(s, BW_E_NUMBER, "%s is not a finite number", isnan(out[i]) ? "nan" : "inf");
            }
        }
    }
    if (status == BW_OK) s->kind = NULL;
    return status;
}

bw_status bw_vtk_wholes(bw_scan *s, bw_vtk_format format, size_t count, int64_t *out) {
    if (format.type >= BW_VTK_FLOAT32)
        return bw_scan_fail(s, BW_E_SYNTAX, "whole numbers are needed, these are floating");
    bw_status status = BW_OK;
    if (format.coding == BW_VTK_TEXT) {
        for (size_t i = 0; i < count && status == BW_OK; i++) status = bw_scan_whole(s, &out[i]);
        return status;
    }
    const char *bytes = NULL;
    size_t size = bw_vtk_size(format.type);
    if ((status = bw_scan_bytes(s, size * count, &bytes)) != BW_OK) return status;
    for (size_t i = 0; i < count; i++)
        out[i] = whole_of(take_bits(bytes + i * size, size, format.coding), format.type);
    return BW_OK;
}

bw_status bw_vtk_end(const bw_vtk_grid *g, bw_scan *s) {
    if (!g->bounded || !bw_scan_blanks(s)) return BW_OK;
    return bw_scan_fail(s, BW_E_COUNT, "there are more values than belong here");
}

bw_status bw_vtk_pass(bw_scan *s, bw_vtk_format format, uint64_t count) {
    const char *bytes;
    if (format.coding != BW_VTK_TEXT)
        return bw_scan_bytes(s, bw_vtk_size(format.type) * (size_t)count, &bytes);
    bw_word word;
    bw_status status = BW_OK;
    for (uint64_t i = 0; i < count && status == BW_OK; i++) {
        status = bw_scan_word(s, &word);
        if (i % OFTEN == 0 && status == BW_OK) status = bw_poll(s->ctx);
    }
    return status;
}

/* ---- sections ------------------------------------------------------------------------------------------ */

bw_status bw_vtk_read_points(bw_vtk_grid *g, bw_scan *s, bw_vtk_format format, int64_t count) {
    if (g->mesh->position) return bw_scan_fail(s, BW_E_SYNTAX, "there are points already");
    uint64_t bytes = 3 * (format.coding == BW_VTK_TEXT ? 2 : bw_vtk_size(format.type));
    bw_status status = bw_scan_count(s, "points", count, BW_INPUT_VERTICES_MAX, bytes);
    if (status != BW_OK) return status;
    if (!(g->mesh->position = bw_alloc(g->ctx, (size_t)count, sizeof *g->mesh->position)))
        return g->ctx->error.status;
    status = bw_vtk_reals(s, format, 3 * (uint64_t)count, "vertex", 3, (double *)g->mesh->position);
    g->mesh->vertex_count = (size_t)count;
    return status;
}

bw_status bw_vtk_read_corners(bw_vtk_grid *g, bw_scan *s, bw_vtk_format format, int64_t count) {
    bw_status status = bw_vtk_check_count(s, format, "corners", count);
    if (status != BW_OK) return status;
    if (!(g->corner = bw_alloc(g->ctx, (size_t)count, sizeof *g->corner))) return g->ctx->error.status;
    g->corner_count = (size_t)count;
    size_t cell = 0; /* the ends come before the corners */
    for (size_t i = 0, n; i < (size_t)count && status == BW_OK; i += n) {
        int64_t value[BLOCK];
        n = block_of(format, (size_t)count - i);
        while (cell < g->cell_count && g->begin[cell + 1] <= i) cell++;
        status = bw_scan_record(s, "cell", (int64_t)cell);
        if (status == BW_OK) status = bw_vtk_wholes(s, format, n, value);
        for (size_t k = 0; k < n && status == BW_OK; k++) {
            while (cell < g->cell_count && g->begin[cell + 1] <= i + k) cell++;
            s->record = (int64_t)cell;
            status = bw_scan_check_index(s, value[k], 0, g->mesh->vertex_count);
            g->corner[i + k] = (bw_vertex)value[k];
        }
    }
    if (status == BW_OK) s->kind = NULL;
    return status;
}

bw_status bw_vtk_read_ends(bw_vtk_grid *g, bw_scan *s, bw_vtk_format format, int64_t cells, bool with_zero) {
    bw_status status = bw_scan_count(s, "cells", cells, BW_INPUT_CELLS_MAX,
                                     format.coding == BW_VTK_TEXT ? 2 : bw_vtk_size(format.type));
    if (status != BW_OK) return status;
    if (!(g->begin = bw_alloc(g->ctx, (size_t)cells + 1, sizeof *g->begin))) return g->ctx->error.status;
    g->cell_count = (size_t)cells;
    size_t first = with_zero ? 0 : 1;
    for (size_t i = first, n; i <= (size_t)cells && status == BW_OK; i += n) {
        int64_t value[BLOCK];
        n = block_of(format, (size_t)cells + 1 - i);
        if ((status = bw_vtk_wholes(s, format, n, value)) != BW_OK) break;
        for (size_t k = 0; k < n && status == BW_OK; k++) {
            int64_t before = i + k ? (int64_t)g->begin[i + k - 1] : 0;
            g->begin[i + k] = (uint64_t)value[k];
            if (i + k == 0) {
                if (value[k] != 0)
                    status =
                        bw_scan_fail(s, BW_E_INDEX, "the first offset is %lld, not 0", (long long)value[k]);
                continue;
            }
            status = bw_scan_record(s, "cell", (int64_t)(i + k) - 1);
            if (status == BW_OK && value[k] < before)
                status = bw_scan_fail(s, BW_E_INDEX, "its corners end at %lld, before they begin",
                                      (long long)value[k]);
        }
    }
    if (status == BW_OK) s->kind = NULL;
    return status;
}

bw_status bw_vtk_read_types(bw_vtk_grid *g, bw_scan *s, bw_vtk_format format) {
    bw_status status = bw_vtk_check_count(s, format, "cell types", (int64_t)g->cell_count);
    if (status != BW_OK) return status;
    if (!(g->type = bw_alloc(g->ctx, g->cell_count, 1))) return g->ctx->error.status;
    for (size_t i = 0, n; i < g->cell_count && status == BW_OK; i += n) {
        int64_t value[BLOCK];
        n = block_of(format, g->cell_count - i);
        status = bw_vtk_wholes(s, format, n, value);
        for (size_t k = 0; k < n && status == BW_OK; k++)
            g->type[i + k] = (uint8_t)(value[k] < 0 || value[k] > 255 ? 255 : value[k]);
        if (status == BW_OK) status = bw_scan_record(s, NULL, (int64_t)i);
    }
    return status;
}

/* ---- the mesh ------------------------------------------------------------------------------------------ */

enum { VERTEX = 1, LINE = 3, TRIANGLE = 5, QUAD = 9, TET = 10, VOXEL = 11, HEX = 12 };

/* 0: a type that is not read. */
static int corners_of(uint8_t type) {
    static const uint8_t corners[] = {[VERTEX] = 1, [LINE] = 2, [TRIANGLE] = 3, [QUAD] = 4, [TET] = 4, [VOXEL] = 8, [HEX] = 8};
    return type < sizeof corners ? corners[type] : 0;
}

static bool is_hex(uint8_t type) { return type == VOXEL || type == HEX; }

static bw_status check_cells(bw_vtk_grid *g, bw_scan *place) {
    bw_status status = BW_OK;
    size_t tets = 0, hexes = 0;
    if (g->begin[g->cell_count] != g->corner_count)
        return bw_scan_fail(place, BW_E_COUNT, "the cells have %llu corners, and %zu are listed",
                            (unsigned long long)g->begin[g->cell_count], g->corner_count);
    for (size_t c = 0; c < g->cell_count && status == BW_OK; c++) {
        uint64_t corners = g->begin[c + 1] - g->begin[c];
        place->kind = "cell", place->record = (int64_t)c;
        if (!corners_of(g->type[c]))
            status = bw_scan_fail(
                place, BW_E_SYNTAX,
                "type %d; only hexes (12, 11) or tets (10), quads (9), triangles (5), lines (3) and vertices (1) are read", g->type[c]);
        else if (corners != (uint64_t)corners_of(g->type[c]))
            status = bw_scan_fail(place, BW_E_SYNTAX, "a cell of type %d has %d corners, not %llu",
                                  g->type[c], corners_of(g->type[c]), (unsigned long long)corners);
        tets += g->type[c] == TET, hexes += is_hex(g->type[c]);
        if (status == BW_OK && tets && hexes)
            status = bw_scan_fail(place, BW_E_SYNTAX, "a %s among %s; the cells of a mesh are all of one kind, or it is not read",
                                  is_hex(g->type[c]) ? "hex" : "tet", is_hex(g->type[c]) ? "tets" : "hexes");
    }
    place->kind = NULL;
    if (status == BW_OK && !tets && !hexes) status = bw_fail(g->ctx, BW_E_EMPTY, "the input has no tets and no hexes");
    if (status == BW_OK && (tets > (size_t)BW_INPUT_TETS_MAX || hexes > (size_t)BW_INPUT_HEXES_MAX))
        status = bw_scan_fail(place, BW_E_COUNT, "%zu %s are more than the %lld supported", tets + hexes, tets ? "tets" : "hexes",
                              (long long)(tets ? BW_INPUT_TETS_MAX : BW_INPUT_HEXES_MAX));
    if (status == BW_OK && tets && !(g->mesh->tet = bw_alloc(g->ctx, tets, sizeof *g->mesh->tet))) status = g->ctx->error.status;
    if (status == BW_OK && hexes && !(g->mesh->hex = bw_alloc(g->ctx, hexes, sizeof *g->mesh->hex))) status = g->ctx->error.status;
    return status;
}

/* The values of an array of numbers, one row per cell. */
static bw_status read_array(bw_vtk_grid *g, const bw_vtk_array *array, double **out) {
    bw_scan scan;
    void *owned = NULL;
    uint64_t count = g->cell_count * (uint64_t)array->components;
    bw_status status = g->open(g, array, count, &scan, &owned);
    if (status == BW_OK) status = bw_vtk_check_count(&scan, array->format, "values", (int64_t)count);
    if (status == BW_OK && !(*out = bw_alloc(g->ctx, count, sizeof **out))) status = g->ctx->error.status;
    if (status == BW_OK)
        status = bw_vtk_reals(&scan, array->format, count, "cell", (uint64_t)array->components, *out);
    if (status == BW_OK) status = bw_vtk_end(g, &scan);
    bw_free(g->ctx, owned);
    return status;
}

/* A voxel lists its corners by bits. */
static void take_hex(bw_tet_mesh *m, const bw_vertex *corner, bool voxel) {
    bw_vertex *hex = m->hex[m->hex_count++];
    memcpy(hex, corner, sizeof *m->hex);
    if (!voxel) bw_input_from_ring(hex);
}

static bw_status take_cells(bw_vtk_grid *g, const double *feature) {
    bw_tet_mesh *m = g->mesh;
    bw_input_room room = {{0}};
    bw_status status = BW_OK;
    for (size_t c = 0; c < g->cell_count && status == BW_OK; c++) {
        const bw_vertex *corner = g->corner + g->begin[c];
        if (is_hex(g->type[c]))
            take_hex(m, corner, g->type[c] == VOXEL);
        else if (g->type[c] == TET)
            memcpy(m->tet[m->tet_count++], corner, sizeof *m->tet);
        else if (!feature || feature[c] != 0)
            status = bw_input_add_feature(g->ctx, m, &room, corners_of(g->type[c]), corner);
    }
    return status;
}

typedef struct {
    const bw_vtk_grid *grid;
    const bw_vtk_array **array;
} candidates;

static const char *candidate_name(const void *user, size_t i) {
    return ((const candidates *)user)->array[i]->name;
}

static bw_status choose_parameters(bw_vtk_grid *g, bw_scan *place, const bw_vtk_array **chosen) {
    candidates c = {g, bw_alloc(g->ctx, g->array_count, sizeof *c.array)};
    if (!c.array) return g->ctx->error.status;
    size_t count = 0;
    for (size_t i = 0; i < g->array_count; i++)
        if (g->array[i].components == 12) c.array[count++] = &g->array[i];
    int64_t best = bw_input_choose(candidate_name, &c, count);
    bw_status status = BW_OK;
    if (best == -1)
        status = bw_scan_fail(place, BW_E_SYNTAX,
                              "no cell array has 12 components: the parametrization is missing");
    else if (best == -2)
        status = bw_scan_fail(
            place, BW_E_SYNTAX,
            "%zu cell arrays have 12 components, and none is named parametrization, uvw or param", count);
    else
        *chosen = c.array[best];
    bw_free(g->ctx, c.array);
    return status;
}

static bw_status read_parameters(bw_vtk_grid *g, bw_scan *place) {
    const bw_vtk_array *array = NULL;
    double *row = NULL;
    bw_status status = choose_parameters(g, place, &array);
    if (status == BW_OK) status = read_array(g, array, &row);
    if (status != BW_OK) {
        bw_free(g->ctx, row);
        return status;
    }
    size_t tets = 0;
    for (size_t c = 0; c < g->cell_count; c++)
        if (g->type[c] == TET) memmove(row + 12 * tets++, row + 12 * c, 12 * sizeof *row);
    if (tets == g->cell_count) {
        g->mesh->parameter = (void *)row;
    } else if (!(g->mesh->parameter = bw_resize(g->ctx, row, tets, sizeof *g->mesh->parameter))) {
        bw_free(g->ctx, row);
        status = g->ctx->error.status;
    }
    return status;
}

static bw_status read_features(bw_vtk_grid *g, bw_scan *place, double **feature) {
    for (size_t i = 0; i < g->array_count; i++) {
        if (strcmp(g->array[i].name, "feature")) continue;
        if (g->array[i].components != 1)
            return bw_scan_fail(place, BW_E_SYNTAX, "the cell array 'feature' has %lld components, not 1",
                                (long long)g->array[i].components);
        return read_array(g, &g->array[i], feature);
    }
    return BW_OK;
}

bw_status bw_vtk_finish(bw_vtk_grid *g, bw_scan *place) {
    if (!g->mesh->position || !g->begin || !g->corner || !g->type)
        return bw_scan_fail(place, BW_E_TRUNCATED, "the input ends without %s",
                            !g->mesh->position        ? "points"
                            : !g->begin || !g->corner ? "cells"
                                                      : "the types of the cells");
    double *feature = NULL;
    bw_status status = check_cells(g, place);
    if (status == BW_OK) status = read_features(g, place, &feature);
    if (status == BW_OK) status = take_cells(g, feature);
    bw_free(g->ctx, feature);
    bw_free(g->ctx, g->corner), bw_free(g->ctx, g->begin);
    g->corner = NULL, g->begin = NULL;
    if (status == BW_OK) status = bw_input_check_cells(place, g->mesh);
    return status == BW_OK && g->mesh->tet_count ? read_parameters(g, place) : status;
}

void bw_vtk_clear(bw_vtk_grid *g) {
    bw_free(g->ctx, g->corner), bw_free(g->ctx, g->begin), bw_free(g->ctx, g->type),
        bw_free(g->ctx, g->array);
}
