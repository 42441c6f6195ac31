#include "format/vtk.h"

#include <stdio.h>
#include <string.h>

#include "format/input_mesh.h"
#include "format/vtk_grid.h"

enum { COMPONENTS_MAX = 1 << 16 };

typedef enum { OF_NOTHING, OF_CELLS, OF_POINTS } owner;

typedef struct {
    bw_scan scan;
    bw_vtk_grid grid;
    bool binary;
    int major;
    owner owner;  /* whose attributes are being read */
    int64_t rows; /* of them */
} reader;

/* ---- small things -------------------------------------------------------------------------------------- */

static bw_status expect_word(reader *r, const char *wanted) {
    bw_word word;
    char text[40];
    bw_status status = bw_scan_word(&r->scan, &word);
    if (status != BW_OK || bw_word_is(word, wanted)) return status;
    return bw_scan_fail(&r->scan, BW_E_SYNTAX, "'%s' stands where %s is due",
                        bw_word_show(word, text, sizeof text), wanted);
}

static bw_status read_format(reader *r, bw_vtk_format *format) {
    static const struct {
        const char *name;
        bw_vtk_type type;
    } types[] = {{"char", BW_VTK_INT8},
                 {"unsigned_char", BW_VTK_UINT8},
                 {"signed_char", BW_VTK_INT8},
                 {"short", BW_VTK_INT16},
                 {"unsigned_short", BW_VTK_UINT16},
                 {"int", BW_VTK_INT32},
                 {"unsigned_int", BW_VTK_UINT32},
                 {"long", BW_VTK_INT64},
                 {"unsigned_long", BW_VTK_UINT64},
                 {"vtktypeint64", BW_VTK_INT64},
                 {"vtktypeuint64", BW_VTK_UINT64},
                 {"vtkidtype", BW_VTK_INT32},
                 {"float", BW_VTK_FLOAT32},
                 {"double", BW_VTK_FLOAT64}};
    bw_word word;
    bw_status status = bw_scan_word(&r->scan, &word);
    if (status != BW_OK) return status;
    format->coding = r->binary ? BW_VTK_BIG : BW_VTK_TEXT;
    for (size_t i = 0; i < sizeof types / sizeof *types; i++)
        if (bw_word_is(word, types[i].name)) {
            format->type = types[i].type;
            return BW_OK;
        }
    char text[40];
    return bw_scan_fail(&r->scan, BW_E_SYNTAX, "values of type '%s' are not read",
                        bw_word_show(word, text, sizeof text));
}

/* Binary values begin after the line break of the line that announces them. */
static bw_status end_of_line(reader *r) {
    bw_word rest = bw_scan_line(&r->scan);
    char text[40];
    if (!rest.length) return BW_OK;
    return bw_scan_fail(&r->scan, BW_E_SYNTAX, "'%s' is more than belongs on the line",
                        bw_word_show(rest, text, sizeof text));
}

/* A name of an array, in which VTK writes blanks and others as %20. */
static void take_name(bw_word word, char *name, size_t room) {
    size_t n = 0;
    for (size_t i = 0; i < word.length && n + 1 < room; i++) {
        unsigned code = 0;
        char hex[3] = {0};
        if (word.text[i] == '%' && word.length - i > 2 &&
            (memcpy(hex, word.text + i + 1, 2), sscanf(hex, "%2x", &code) == 1))
            i += 2;
        name[n++] = code ? (char)code : word.text[i];
    }
    name[n] = 0;
}

/* ---- attributes ---------------------------------------------------------------------------------------- */

static bw_status open_array(bw_vtk_grid *grid, const bw_vtk_array *array, uint64_t count, bw_scan *scan,
                            void **owned) {
    (void)grid, (void)count;
    *owned = NULL;
    *scan = array->scan;
    scan->part = true;
    return BW_OK;
}

/* After the word METADATA: to the next blank line. */
static bw_status pass_metadata(reader *r) {
    bw_status status = end_of_line(r);
    while (status == BW_OK && bw_scan_left(&r->scan) && bw_scan_line(&r->scan).length) {
    }
    return status;
}

/* At the values of an array: notes it down if it is one of the cells', and passes it. */
static bw_status take_array(reader *r, const char *name, bw_vtk_format format, int64_t components,
                            int64_t rows, bool of_cells) {
    bw_scan *s = &r->scan;
    bw_vtk_grid *g = &r->grid;
    bw_status status = bw_scan_count(s, "components", components, COMPONENTS_MAX, 0);
    if (status == BW_OK) status = bw_scan_count(s, "rows", rows, INT64_MAX / COMPONENTS_MAX / 8, 0);
    if (status == BW_OK) status = bw_vtk_check_count(s, format, "values", components * rows);
    if (status != BW_OK) return status;
    if (of_cells && (components == 12 || !strcmp(name, "feature"))) {
        if (rows != r->rows)
            return bw_scan_fail(s, BW_E_COUNT, "the array has %lld rows, not one per cell", (long long)rows);
        if ((status = bw_reserve(g->ctx, &g->array, &g->array_room, g->array_count + 1)) != BW_OK)
            return status;
        bw_vtk_array *a = &g->array[g->array_count++];
        *a = (bw_vtk_array){.format = format, .components = components, .scan = *s};
        snprintf(a->name, sizeof a->name, "%s", name);
    }
    return bw_vtk_pass(s, format, (uint64_t)components * (uint64_t)rows);
}

static bw_status read_name(reader *r, char name[80]) {
    bw_word word;
    bw_status status = bw_scan_word(&r->scan, &word);
    if (status == BW_OK) take_name(word, name, 80);
    return status;
}

/* SCALARS name type [components], then LOOKUP_TABLE name */
static bw_status read_scalars(reader *r) {
    char name[80];
    bw_vtk_format format = {0};
    int64_t components = 1;
    bw_status status = read_name(r, name);
    if (status == BW_OK) status = read_format(r, &format);
    if (status != BW_OK) return status;
    bw_word rest = bw_scan_line(&r->scan);
    bw_scan line = bw_scan_open(r->scan.ctx, rest.text, rest.length);
    line.line = r->scan.line - 1;
    if (rest.length) status = bw_scan_whole(&line, &components);
    if (status != BW_OK) return status;
    bw_scan next = r->scan; /* what follows may be values */
    if (bw_scan_blanks(&next) && bw_word_starts((bw_word){next.at, bw_scan_left(&next)}, "LOOKUP_TABLE")) {
        bw_scan_line(&next);
        r->scan = next;
    }
    return take_array(r, name, format, components, r->rows, r->owner == OF_CELLS);
}

/* name components rows type, then the values; `count` times */
static bw_status read_field(reader *r, bool of_cells) {
    char name[80];
    int64_t count = 0;
    bw_status status = read_name(r, name);
    if (status == BW_OK) status = bw_scan_whole(&r->scan, &count);
    if (status == BW_OK) status = bw_scan_count(&r->scan, "arrays", count, INT32_MAX, 8);
    for (int64_t i = 0; i < count && status == BW_OK; i++) {
        bw_vtk_format format = {0};
        int64_t components = 0, rows = 0;
        status = bw_poll(r->scan.ctx);
        if (status == BW_OK) status = read_name(r, name);
        if (status == BW_OK && !strcmp(name, "METADATA")) { /* of the array before */
            status = pass_metadata(r);
            i--;
            continue;
        }
        if (status == BW_OK) status = bw_scan_whole(&r->scan, &components);
        if (status == BW_OK) status = bw_scan_whole(&r->scan, &rows);
        if (status == BW_OK) status = read_format(r, &format);
        if (status == BW_OK) status = end_of_line(r);
        if (status == BW_OK) status = take_array(r, name, format, components, rows, of_cells);
    }
    return status;
}

/* VECTORS name type and the like, with a known number of components */
static bw_status read_tuples(reader *r, int64_t components) {
    char name[80];
    bw_vtk_format format = {0};
    bw_status status = read_name(r, name);
    if (status == BW_OK && !components) status = bw_scan_whole(&r->scan, &components);
    if (status == BW_OK) status = read_format(r, &format);
    if (status == BW_OK) status = end_of_line(r);
    return status == BW_OK ? take_array(r, name, format, components, r->rows, r->owner == OF_CELLS) : status;
}

/* LOOKUP_TABLE name size, or COLOR_SCALARS name components: bytes in binary files, fractions in others */
static bw_status read_colours(reader *r, bool table) {
    char name[80];
    int64_t count = 0;
    bw_vtk_format format = {BW_VTK_UINT8, r->binary ? BW_VTK_BIG : BW_VTK_TEXT};
    bw_status status = read_name(r, name);
    if (status == BW_OK) status = bw_scan_whole(&r->scan, &count);
    if (status == BW_OK) status = end_of_line(r);
    if (status != BW_OK) return status;
    return take_array(r, name, format, table ? 4 : count, table ? count : r->rows, false);
}

/* ---- geometry ------------------------------------------------------------------------------------------ */

static bw_status read_points(reader *r) {
    int64_t count = 0;
    bw_vtk_format format = {0};
    bw_status status = bw_scan_whole(&r->scan, &count);
    if (status == BW_OK) status = read_format(r, &format);
    if (status == BW_OK) status = end_of_line(r);
    return status == BW_OK ? bw_vtk_read_points(&r->grid, &r->scan, format, count) : status;
}

/* Before version 5: each cell as the number of its corners and the corners, `size` numbers in all. */
static bw_status read_counted_cells(reader *r, int64_t cells, int64_t size) {
    bw_scan *s = &r->scan;
    bw_vtk_grid *g = &r->grid;
    bw_vtk_format format = {BW_VTK_INT32, r->binary ? BW_VTK_BIG : BW_VTK_TEXT};
    bw_status status = bw_scan_count(s, "cells", cells, BW_INPUT_CELLS_MAX, r->binary ? 4 : 2);
    if (status == BW_OK) status = bw_vtk_check_count(s, format, "numbers of cells", size);
    if (status == BW_OK && size < cells)
        status = bw_scan_fail(s, BW_E_COUNT, "%lld numbers are too few for %lld cells", (long long)size,
                              (long long)cells);
    if (status != BW_OK) return status;
    g->begin = bw_alloc(g->ctx, (size_t)cells + 1, sizeof *g->begin);
    g->corner = bw_alloc(g->ctx, (size_t)(size - cells), sizeof *g->corner);
    if (!g->begin || !g->corner) return g->ctx->error.status;
    g->cell_count = (size_t)cells, g->corner_count = (size_t)(size - cells);
    for (size_t c = 0; c < (size_t)cells && status == BW_OK; c++) {
        int64_t n = 0, value[16];
        size_t at = (size_t)g->begin[c];
        status = bw_scan_record(s, "cell", (int64_t)c);
        if (status == BW_OK) status = bw_vtk_wholes(s, format, 1, &n);
        if (status == BW_OK && (n < 0 || n > 16))
            status = bw_scan_fail(s, BW_E_SYNTAX, "%lld corners: no cell that is read", (long long)n);
        if (status == BW_OK && (size_t)n > g->corner_count - at)
            status = bw_scan_fail(s, BW_E_COUNT, "the cells have more numbers than the %lld announced",
                                  (long long)size);
        if (status == BW_OK) status = bw_vtk_wholes(s, format, (size_t)n, value);
        for (int64_t i = 0; i < n && status == BW_OK; i++) {
            status = bw_scan_check_index(s, value[i], 0, g->mesh->vertex_count);
            g->corner[at + (size_t)i] = (bw_vertex)value[i];
        }
        g->begin[c + 1] = at + (uint64_t)n;
    }
    if (status == BW_OK) s->kind = NULL;
    return status;
}

/* From version 5 on: OFFSETS type, one more than cells; CONNECTIVITY type, `size` corners. */
static bw_status read_listed_cells(reader *r, int64_t offsets, int64_t size) {
    bw_vtk_format format = {0};
    bw_status status = expect_word(r, "OFFSETS");
    if (status == BW_OK) status = read_format(r, &format);
    if (status == BW_OK) status = end_of_line(r);
    if (status == BW_OK && offsets < 1) status = bw_fail(r->scan.ctx, BW_E_EMPTY, "the input has no cells");
    if (status == BW_OK) status = bw_vtk_read_ends(&r->grid, &r->scan, format, offsets - 1, true);
    if (status == BW_OK) status = expect_word(r, "CONNECTIVITY");
    if (status == BW_OK) status = read_format(r, &format);
    if (status == BW_OK) status = end_of_line(r);
    return status == BW_OK ? bw_vtk_read_corners(&r->grid, &r->scan, format, size) : status;
}

static bw_status read_cells(reader *r) {
    int64_t count = 0, size = 0;
    if (!r->grid.mesh->position) return bw_scan_fail(&r->scan, BW_E_SYNTAX, "cells come before the points");
    if (r->grid.begin) return bw_scan_fail(&r->scan, BW_E_SYNTAX, "there are cells already");
    bw_status status = bw_scan_whole(&r->scan, &count);
    if (status == BW_OK) status = bw_scan_whole(&r->scan, &size);
    if (status == BW_OK) status = end_of_line(r);
    if (status != BW_OK) return status;
    return r->major >= 5 ? read_listed_cells(r, count, size) : read_counted_cells(r, count, size);
}

static bw_status read_types(reader *r) {
    int64_t count = 0;
    bw_vtk_format format = {BW_VTK_INT32, r->binary ? BW_VTK_BIG : BW_VTK_TEXT};
    bw_status status = bw_scan_whole(&r->scan, &count);
    if (status == BW_OK) status = end_of_line(r);
    if (status != BW_OK) return status;
    if (!r->grid.begin) return bw_scan_fail(&r->scan, BW_E_SYNTAX, "types of cells come before the cells");
    if (r->grid.type) return bw_scan_fail(&r->scan, BW_E_SYNTAX, "there are types of cells already");
    if (count < 0 || (size_t)count != r->grid.cell_count)
        return bw_scan_fail(&r->scan, BW_E_COUNT, "%lld types for %zu cells", (long long)count,
                            r->grid.cell_count);
    return bw_vtk_read_types(&r->grid, &r->scan, format);
}

/* ---- the file ------------------------------------------------------------------------------------------ */

static bw_status begin_attributes(reader *r, owner of) {
    bw_status status = bw_scan_whole(&r->scan, &r->rows);
    if (status == BW_OK) status = end_of_line(r);
    if (status != BW_OK) return status;
    r->owner = of;
    if (of == OF_CELLS ? !r->grid.begin : !r->grid.mesh->position)
        return bw_scan_fail(&r->scan, BW_E_SYNTAX, "data of %s come before the %s", of == OF_CELLS ? "cells" : "points", of == OF_CELLS ? "cells" : "points");
    size_t wanted = of == OF_CELLS ? r->grid.cell_count : r->grid.mesh->vertex_count;
    if (r->rows < 0 || (size_t)r->rows != wanted)
        return bw_scan_fail(&r->scan, BW_E_COUNT, "data of %lld %s, but there are %zu", (long long)r->rows,
                            of == OF_CELLS ? "cells" : "points", wanted);
    return BW_OK;
}

static bw_status read_section(reader *r, bw_word word) {
    static const struct {
        const char *name;
        int64_t components; /* 0: written in the file */
    } tuples[] = {{"VECTORS", 3},    {"NORMALS", 3},      {"TENSORS", 9},    {"TENSORS6", 6},
                  {"GLOBAL_IDS", 1}, {"PEDIGREE_IDS", 1}, {"EDGE_FLAGS", 1}, {"TEXTURE_COORDINATES", 0}};
    if (bw_word_is(word, "POINTS")) return read_points(r);
    if (bw_word_is(word, "CELLS")) return read_cells(r);
    if (bw_word_is(word, "CELL_TYPES")) return read_types(r);
    if (bw_word_is(word, "CELL_DATA")) return begin_attributes(r, OF_CELLS);
    if (bw_word_is(word, "POINT_DATA")) return begin_attributes(r, OF_POINTS);
    if (bw_word_is(word, "FIELD")) return read_field(r, r->owner == OF_CELLS);
    if (bw_word_is(word, "METADATA")) return pass_metadata(r);
    bool attribute = r->owner != OF_NOTHING;
    if (attribute && bw_word_is(word, "SCALARS")) return read_scalars(r);
    if (attribute && bw_word_is(word, "LOOKUP_TABLE")) return read_colours(r, true);
    if (attribute && bw_word_is(word, "COLOR_SCALARS")) return read_colours(r, false);
    for (size_t i = 0; attribute && i < sizeof tuples / sizeof *tuples; i++)
        if (bw_word_is(word, tuples[i].name)) return read_tuples(r, tuples[i].components);
    char text[40];
    return bw_scan_fail(&r->scan, BW_E_SYNTAX, "'%s' is not a section that is read here",
                        bw_word_show(word, text, sizeof text));
}

static bw_status read_header(reader *r) {
    bw_scan *s = &r->scan;
    bw_word word = bw_scan_line(s);
    static const char magic[] = "# vtk DataFile Version ";
    char text[40];
    if (!bw_word_starts(word, magic))
        return bw_scan_fail(s, BW_E_SYNTAX, "the file does not begin as VTK files do");
    char digit = word.length > sizeof magic - 1 ? word.text[sizeof magic - 1] : 0;
    if (digit < '1' || digit > '5')
        return bw_scan_fail(
            s, BW_E_SYNTAX, "version '%s' is not read; 1.0 to 5.1 are",
            bw_word_show((bw_word){word.text + sizeof magic - 1, word.length - sizeof magic + 1}, text,
                         sizeof text));
    r->major = digit - '0';
    bw_scan_line(s); /* the title */
    bw_status status = bw_scan_word(s, &word);
    if (status != BW_OK) return status;
    r->binary = s->binary = bw_word_is(word, "BINARY");
    if (!r->binary && !bw_word_is(word, "ASCII"))
        return bw_scan_fail(s, BW_E_SYNTAX, "'%s' stands where ASCII or BINARY is due",
                            bw_word_show(word, text, sizeof text));
    status = expect_word(r, "DATASET");
    if (status == BW_OK) status = bw_scan_word(s, &word);
    if (status == BW_OK && !bw_word_is(word, "UNSTRUCTURED_GRID"))
        status = bw_scan_fail(s, BW_E_SYNTAX, "a data set '%s'; only UNSTRUCTURED_GRID is read",
                              bw_word_show(word, text, sizeof text));
    return status;
}

bw_status bw_vtk_read_memory(bw_context *ctx, const void *data, size_t size, bw_tet_mesh *mesh) {
    memset(mesh, 0, sizeof *mesh);
    reader r = {.scan = bw_scan_open(ctx, data, size),
                .grid = {.ctx = ctx, .mesh = mesh, .open = open_array}};
    bw_status status = read_header(&r);
    while (status == BW_OK && bw_scan_blanks(&r.scan)) {
        bw_word word;
        status = bw_poll(ctx);
        if (status == BW_OK) status = bw_scan_word(&r.scan, &word);
        if (status == BW_OK) status = read_section(&r, word);
    }
    if (status == BW_OK) status = bw_vtk_finish(&r.grid, &r.scan);
    if (status == BW_OK) bw_progress(ctx, 1);
    bw_vtk_clear(&r.grid);
    if (status != BW_OK) bw_tet_mesh_clear(ctx, mesh);
    return status;
}
