#include "format/vtu.h"

#include <expat.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "format/hexex_lines.h"
#include "format/input_mesh.h"
#include "format/number.h"
#include "format/vtk_grid.h"
#include "format/vtu_data.h"

enum { DEEPEST = 32, ELEMENTS_MOST = 100000, CHUNK = 1 << 18 };

typedef enum { IN_OTHER, IN_FILE, IN_GRID, IN_PIECE, IN_POINTS, IN_CELLS, IN_CELL_DATA, IN_ARRAY } place;
typedef enum { AS_TEXT, AS_BASE64, AS_APPENDED } encoding;
typedef enum { POINTS, CORNERS, ENDS, TYPES, PARTS } part;

typedef struct {
    bw_vtk_grid grid; /* first: open_array gets a pointer to it */
    bw_context *ctx;
    XML_Parser parser;
    const char *data;
    size_t size;
    place inside[DEEPEST]; /* of the elements that are open */
    int depth;
    int elements; /* begun so far */
    bool big, wide, deflated;
    bool seen_file, seen_piece;
    int64_t points, cells;
    bw_vtk_array part[PARTS]; /* components 0: missing */
    bw_vtk_array open;        /* the DataArray whose text is being passed, in `owner` */
    place owner;
    int array_depth;
    uint64_t text_begin, text_end; /* of its text: [begin, end), in one piece */
    uint64_t offset;
    bool has_text;
    uint64_t appended; /* where appended data begins, after its '_'; 0: there is none */
    bool appended_base64;
} reader;

/* expat has no user pointer for its allocations; a parser lives within one call, on one thread. */
static _Thread_local bw_context *allocating;
static void *xml_alloc(size_t size) {
    return bw_alloc(allocating, size, 1);
}
static void *xml_resize(void *block, size_t size) {
    return bw_resize(allocating, block, size, 1);
}
static void xml_free(void *block) {
    bw_free(allocating, block);
}

/* ---- errors and attributes ----------------------------------------------------------------------------- */

/* A scan that tells the line the parser is at. */
static bw_scan here(const reader *r) {
    bw_scan s = bw_scan_open(r->ctx, r->data, r->size);
    s.line = XML_GetCurrentLineNumber(r->parser);
    return s;
}

static void refuse(reader *r, bw_status status, const char *what, const char *value) {
    char text[60];
    bw_scan s = here(r);
    bw_word_show((bw_word){value, strlen(value)}, text, sizeof text);
    bw_scan_fail(&s, status, what, text); /* `what` is one of ours, with at most one %s */
    XML_StopParser(r->parser, XML_FALSE);
}

static const char *attribute(const char **list, const char *name) {
    for (; *list; list += 2)
        if (!strcmp(list[0], name)) return list[1];
    return NULL;
}

/* The value of an attribute that counts something; `absent` where it is not there. -1 is refused. */
static int64_t count_attribute(reader *r, const char **list, const char *name, int64_t absent) {
    const char *text = attribute(list, name);
    if (!text) return absent;
    int64_t value = -1;
    const char *at = text, *end = text + strlen(text);
    if (bw_integer_read(&at, end, &value) != BW_NUMBER_OK || at != end) value = -1;
    if (value < 0) refuse(r, BW_E_COUNT, "'%s' is no number of things", text);
    return value;
}

static bool find_type(const char *name, bw_vtk_type *type) {
    static const char *const names[BW_VTK_TYPES] = {"Int8",   "UInt8", "Int16",  "UInt16",  "Int32",
                                                    "UInt32", "Int64", "UInt64", "Float32", "Float64"};
    for (int i = 0; i < BW_VTK_TYPES; i++)
        if (!strcmp(names[i], name)) {
            *type = (bw_vtk_type)i;
            return true;
        }
    return false;
}

/* ---- elements ------------------------------------------------------------------------------------------ */

static void start_file(reader *r, const char **list) {
    const char *type = attribute(list, "type"), *order = attribute(list, "byte_order"),
               *header = attribute(list, "header_type"), *compressor = attribute(list, "compressor");
    r->seen_file = true;
    if (!type || strcmp(type, "UnstructuredGrid"))
        refuse(r, BW_E_SYNTAX, "a file of type '%s'; only UnstructuredGrid is read", type ? type : "");
    if (order && strcmp(order, "LittleEndian") && strcmp(order, "BigEndian"))
        refuse(r, BW_E_SYNTAX, "byte_order '%s'", order);
    if (header && strcmp(header, "UInt32") && strcmp(header, "UInt64"))
        refuse(r, BW_E_SYNTAX, "header_type '%s'; UInt32 and UInt64 are read", header);
    if (compressor && *compressor && strcmp(compressor, "vtkZLibDataCompressor"))
        refuse(r, BW_E_SYNTAX, "compressor '%s'; only vtkZLibDataCompressor is read", compressor);
    r->big = order && !strcmp(order, "BigEndian");
    r->wide = header && !strcmp(header, "UInt64");
    r->deflated = compressor && *compressor;
}

static void start_piece(reader *r, const char **list) {
    if (r->seen_piece) refuse(r, BW_E_SYNTAX, "a second Piece; only files of one are read%s", "");
    r->seen_piece = true;
    r->points = count_attribute(r, list, "NumberOfPoints", 0);
    r->cells = count_attribute(r, list, "NumberOfCells", 0);
}

static void start_array(reader *r, const char **list, uint64_t tag_end) {
    const char *name = attribute(list, "Name"), *type = attribute(list, "type"),
               *format = attribute(list, "format");
    bw_vtk_array *a = &r->open;
    memset(a, 0, sizeof *a);
    snprintf(a->name, sizeof a->name, "%s", name ? name : "");
    a->components = count_attribute(r, list, "NumberOfComponents", 1);
    if (!a->components) a->components = 1;
    r->offset = (uint64_t)count_attribute(r, list, "offset", 0);
    if (!type || !find_type(type, &a->format.type)) a->components = -1; /* strings: nothing here needs them */
    if (!format || !strcmp(format, "ascii"))
        a->encoding = AS_TEXT;
    else if (!strcmp(format, "binary"))
        a->encoding = AS_BASE64;
    else if (!strcmp(format, "appended"))
        a->encoding = AS_APPENDED;
    else
        refuse(r, BW_E_SYNTAX, "format '%s' of a DataArray", format);
    a->format.coding = a->encoding == AS_TEXT ? BW_VTK_TEXT : r->big ? BW_VTK_BIG : BW_VTK_LITTLE;
    a->scan.line = XML_GetCurrentLineNumber(r->parser);
    r->owner = r->inside[r->depth - 2];
    r->array_depth = r->depth;
    r->text_begin = r->text_end = tag_end;
    r->has_text = false;
}

static place place_of(const reader *r, const char *name) {
    static const struct {
        place parent, self;
        const char *name;
    } known[] = {{IN_OTHER, IN_FILE, "VTKFile"},       {IN_FILE, IN_GRID, "UnstructuredGrid"},
                 {IN_GRID, IN_PIECE, "Piece"},         {IN_PIECE, IN_POINTS, "Points"},
                 {IN_PIECE, IN_CELLS, "Cells"},        {IN_PIECE, IN_CELL_DATA, "CellData"},
                 {IN_POINTS, IN_ARRAY, "DataArray"},   {IN_CELLS, IN_ARRAY, "DataArray"},
                 {IN_CELL_DATA, IN_ARRAY, "DataArray"}};
    place parent = r->depth ? r->inside[r->depth - 1] : IN_OTHER;
    for (size_t i = 0; i < sizeof known / sizeof *known; i++)
        if (known[i].parent == parent && (parent != IN_OTHER || !r->depth) && !strcmp(known[i].name, name))
            return known[i].self;
    return IN_OTHER;
}

static void start_appended(reader *r, const char **list, uint64_t tag_end) {
    const char *how = attribute(list, "encoding");
    if (how && strcmp(how, "raw") && strcmp(how, "base64"))
        refuse(r, BW_E_SYNTAX, "encoding '%s' of AppendedData", how);
    uint64_t at = tag_end;
    while (at < r->size && bw_is_blank(r->data[at])) at++;
    if (at == r->size || r->data[at] != '_')
        refuse(r, BW_E_SYNTAX, "AppendedData does not begin with '_'%s", "");
    r->appended = at + 1;
    r->appended_base64 = !how || !strcmp(how, "base64");
    XML_StopParser(r->parser, XML_FALSE); /* raw bytes are not XML */
}

static void XMLCALL on_start(void *user, const char *name, const char **list) {
    reader *r = user;
    if (r->ctx->error.status != BW_OK) return;
    uint64_t tag_end =
        (uint64_t)XML_GetCurrentByteIndex(r->parser) + (uint64_t)XML_GetCurrentByteCount(r->parser);
    if (r->depth == DEEPEST) {
        refuse(r, BW_E_SYNTAX, "elements nest too deep, at '%s'", name);
        return;
    }
    if (++r->elements > ELEMENTS_MOST) {
        refuse(r, BW_E_COUNT, "the document has too many elements, at '%s'", name);
        return;
    }
    if (r->depth == 1 && r->seen_file && !strcmp(name, "AppendedData")) {
        start_appended(r, list, tag_end);
        return;
    }
    r->inside[r->depth] = place_of(r, name);
    place now = r->inside[r->depth++];
    if (now == IN_FILE)
        start_file(r, list);
    else if (r->depth == 1)
        refuse(r, BW_E_SYNTAX, "the document is a '%s', not a VTKFile", name);
    if (now == IN_PIECE) start_piece(r, list);
    if (now == IN_ARRAY) start_array(r, list, tag_end);
}

/* Children of a DataArray (InformationKey) stand before or after its text. */
static void XMLCALL on_text(void *user, const char *text, int length) {
    reader *r = user;
    if (!r->array_depth || r->ctx->error.status != BW_OK || r->depth != r->array_depth) return;
    bool blank = true;
    for (int i = 0; i < length && blank; i++) blank = bw_is_blank(text[i]);
    if (blank) return;
    uint64_t begin = (uint64_t)XML_GetCurrentByteIndex(r->parser),
             count = (uint64_t)XML_GetCurrentByteCount(r->parser);
    if (!r->has_text) {
        r->text_begin = begin;
        r->open.scan.line = XML_GetCurrentLineNumber(r->parser);
    }
    r->has_text = true;
    r->text_end = begin + count;
}

static void keep_array(reader *r) {
    bw_vtk_array *a = &r->open;
    static const char *const names[PARTS] = {"", "connectivity", "offsets", "types"};
    if (a->components < 0) return;
    uint64_t line = a->scan.line;
    a->scan = bw_scan_open(r->ctx, r->data + r->text_begin, (size_t)(r->text_end - r->text_begin));
    a->scan.line = line;
    a->scan.base = r->text_begin;
    if (a->encoding == AS_APPENDED) a->scan.base = r->offset; /* the appended data is not found yet */
    if (r->owner == IN_POINTS) {
        if (!r->part[POINTS].components) r->part[POINTS] = *a;
    } else if (r->owner == IN_CELLS) {
        for (int p = CORNERS; p < PARTS; p++)
            if (!strcmp(a->name, names[p]) && !r->part[p].components) r->part[p] = *a;
    } else if (a->components == 12 || !strcmp(a->name, "feature")) {
        if (bw_reserve(r->ctx, &r->grid.array, &r->grid.array_room, r->grid.array_count + 1) == BW_OK)
            r->grid.array[r->grid.array_count++] = *a;
    }
}

static void XMLCALL on_end(void *user, const char *name) {
    (void)name;
    reader *r = user;
    if (r->ctx->error.status != BW_OK) return;
    if (r->depth == r->array_depth) {
        keep_array(r);
        r->array_depth = 0;
    }
    r->depth--;
}

static void XMLCALL on_doctype(void *user, const char *name, const char *system, const char *public_id,
                               int internal) {
    (void)system, (void)public_id, (void)internal;
    refuse(user, BW_E_SYNTAX, "a document type declaration ('%s') is not accepted", name);
}

static bw_status fail_xml(reader *r) {
    if (r->ctx->error.status != BW_OK) return r->ctx->error.status;
    enum XML_Error code = XML_GetErrorCode(r->parser);
    bw_scan s = here(r);
    bool ended = code == XML_ERROR_NO_ELEMENTS || code == XML_ERROR_UNCLOSED_TOKEN ||
                 code == XML_ERROR_PARTIAL_CHAR || code == XML_ERROR_UNCLOSED_CDATA_SECTION;
    return bw_scan_fail(&s, ended ? BW_E_TRUNCATED : BW_E_SYNTAX, "not well-formed XML: %s",
                        XML_ErrorString(code));
}

static bw_status parse(reader *r) {
    bw_status status = BW_OK;
    for (size_t at = 0; status == BW_OK && !r->appended && at <= r->size;) {
        size_t n = r->size - at < CHUNK ? r->size - at : CHUNK;
        bool last = at + n == r->size;
        enum XML_Status parsed = XML_Parse(r->parser, r->data + at, (int)n, last);
        if (parsed != XML_STATUS_OK && !(r->appended && r->ctx->error.status == BW_OK)) return fail_xml(r);
        at += n;
        if ((status = bw_poll(r->ctx)) != BW_OK || last) break;
        bw_progress(r->ctx, (double)at / (double)r->size);
        if (!r->appended && (uint64_t)XML_GetCurrentByteIndex(r->parser) + BW_LINE_MAX < at) {
            bw_scan s = here(r);
            status = bw_scan_fail(&s, BW_E_LINE, "a tag is longer than %d bytes", BW_LINE_MAX);
        }
    }
    return status;
}

/* ---- arrays -------------------------------------------------------------------------------------------- */

static bw_status open_array(bw_vtk_grid *grid, const bw_vtk_array *array, uint64_t count, bw_scan *scan,
                            void **owned) {
    reader *r = (reader *)grid;
    *owned = NULL;
    *scan = array->scan;
    scan->part = true;
    if (array->encoding == AS_TEXT) return BW_OK;
    bw_vtu_coding coding = {.base64 = array->encoding == AS_BASE64 || r->appended_base64,
                            .deflated = r->deflated,
                            .wide = r->wide,
                            .big = r->big};
    bw_scan from = array->scan;
    if (array->encoding == AS_APPENDED) {
        uint64_t offset = array->scan.base;
        if (!r->appended || offset > r->size - r->appended)
            return bw_scan_fail(&from, r->appended ? BW_E_INDEX : BW_E_TRUNCATED,
                                "the values of '%s' are not in the appended data", array->name);
        from = bw_scan_open(r->ctx, r->data + r->appended + offset, (size_t)(r->size - r->appended - offset));
        from.base = r->appended + offset;
    }
    uint64_t size;
    if (__builtin_mul_overflow(count, bw_vtk_size(array->format.type), &size))
        return bw_scan_fail(&from, BW_E_COUNT, "'%s' has too many values", array->name);
    return bw_vtu_decode(&from, coding, size, scan, owned);
}

static bw_status read_part(reader *r, part which, int64_t rows, int64_t components) {
    static const char *const names[PARTS] = {"points", "connectivity", "offsets", "types"};
    bw_vtk_array *a = &r->part[which];
    bw_scan end = bw_scan_open(r->ctx, r->data, r->size), scan;
    end.line = XML_GetCurrentLineNumber(r->parser);
    if (!a->components)
        return bw_scan_fail(&end, BW_E_TRUNCATED, "the input has no array of %s", names[which]);
    if (a->components != components)
        return bw_scan_fail(&a->scan, BW_E_SYNTAX, "%s have %lld components, not %lld", names[which],
                            (long long)a->components, (long long)components);
    void *owned = NULL;
    bw_status status = open_array(&r->grid, a, (uint64_t)(rows * components), &scan, &owned);
    if (status == BW_OK && which == POINTS) status = bw_vtk_read_points(&r->grid, &scan, a->format, rows);
    if (status == BW_OK && which == ENDS) status = bw_vtk_read_ends(&r->grid, &scan, a->format, rows, false);
    if (status == BW_OK && which == CORNERS) status = bw_vtk_read_corners(&r->grid, &scan, a->format, rows);
    if (status == BW_OK && which == TYPES) status = bw_vtk_read_types(&r->grid, &scan, a->format);
    if (status == BW_OK) status = bw_vtk_end(&r->grid, &scan);
    bw_free(r->ctx, owned);
    return status;
}

static bw_status read_grid(reader *r) {
    bw_scan end = here(r);
    if (!r->seen_piece)
        return bw_scan_fail(&end, BW_E_TRUNCATED, "the input has no Piece of an UnstructuredGrid");
    if (!r->cells) return bw_fail(r->ctx, BW_E_EMPTY, "the input has no cells");
    bw_status status = bw_scan_count(&end, "points", r->points, BW_INPUT_VERTICES_MAX, 0);
    if (status == BW_OK) status = bw_scan_count(&end, "cells", r->cells, BW_INPUT_CELLS_MAX, 0);
    if (status == BW_OK) status = read_part(r, POINTS, r->points, 3);
    if (status == BW_OK) status = read_part(r, ENDS, r->cells, 1);
    if (status == BW_OK && r->grid.begin[r->cells] > 16 * (uint64_t)r->cells)
        status = bw_scan_fail(&end, BW_E_SYNTAX, "the cells have %llu corners: no cells that are read",
                              (unsigned long long)r->grid.begin[r->cells]);
    if (status == BW_OK) status = read_part(r, CORNERS, (int64_t)r->grid.begin[r->cells], 1);
    if (status == BW_OK) status = read_part(r, TYPES, r->cells, 1);
    return status == BW_OK ? bw_vtk_finish(&r->grid, &end) : status;
}

bw_status bw_vtu_read_memory(bw_context *ctx, const void *data, size_t size, bw_tet_mesh *mesh) {
    memset(mesh, 0, sizeof *mesh);
    reader r = {.ctx = ctx,
                .data = data,
                .size = size,
                .grid = {.ctx = ctx, .mesh = mesh, .open = open_array, .bounded = true}};
    const XML_Memory_Handling_Suite memory = {xml_alloc, xml_resize, xml_free};
    bw_context *before = allocating;
    allocating = ctx;
    r.parser = XML_ParserCreate_MM("UTF-8", &memory, NULL);
    bw_status status = r.parser ? BW_OK : ctx->error.status;
    if (r.parser) {
        XML_SetUserData(r.parser, &r);
        XML_SetElementHandler(r.parser, on_start, on_end);
        XML_SetCharacterDataHandler(r.parser, on_text);
        XML_SetStartDoctypeDeclHandler(r.parser, on_doctype);
        status = parse(&r);
        if (status == BW_OK) status = read_grid(&r);
        XML_ParserFree(r.parser);
    }
    allocating = before;
    if (status == BW_OK) bw_progress(ctx, 1);
    bw_vtk_clear(&r.grid);
    if (status != BW_OK) bw_tet_mesh_clear(ctx, mesh);
    return status;
}
