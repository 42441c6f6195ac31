/* Writers of every input format, for tests of the readers: one mesh, with features, in each of them.
 *
 * They are written from the formats' descriptions, apart from the readers. Numbers in text have 17 digits.
 */
#ifndef BW_TESTS_CORE_INPUT_KIT_H
#define BW_TESTS_CORE_INPUT_KIT_H

#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <zlib.h>

#include "mesh/tetmesh.h"

/* ---- bytes --------------------------------------------------------------------------------------------- */

typedef struct {
    char *bytes;
    size_t size, room;
} kit_bytes;

static inline void put(kit_bytes *out, const void *bytes, size_t size) {
    if (out->size + size > out->room)
        out->bytes = realloc(out->bytes, out->room = 2 * (out->size + size) + 64);
    if (size) memcpy(out->bytes + out->size, bytes, size);
    out->size += size;
}

__attribute__((format(printf, 2, 3))) static inline void put_text(kit_bytes *out, const char *format, ...) {
    char text[2000];
    va_list args;
    va_start(args, format);
    int n = vsnprintf(text, sizeof text, format, args);
    va_end(args);
    put(out, text, (size_t)n);
}

static inline void put_whole(kit_bytes *out, int64_t value, int size, bool big) {
    char bytes[8];
    for (int i = 0; i < size; i++) bytes[big ? size - 1 - i : i] = (char)((uint64_t)value >> 8 * i);
    put(out, bytes, (size_t)size);
}

static inline void put_real(kit_bytes *out, double value, int size, bool big) {
    uint64_t bits = 0;
    float single = (float)value;
    if (size == 8)
        memcpy(&bits, &value, 8);
    else
        memcpy(&bits, &single, 4);
    put_whole(out, (int64_t)bits, size, big);
}

static inline void put_base64(kit_bytes *out, const kit_bytes *in) {
    static const char digit[] = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    for (size_t i = 0; i < in->size; i += 3) {
        size_t n = in->size - i < 3 ? in->size - i : 3;
        uint32_t bits = 0;
        for (size_t k = 0; k < 3; k++) bits = bits << 8 | (k < n ? (uint8_t)in->bytes[i + k] : 0);
        char text[4];
        for (size_t k = 0; k < 4; k++) text[k] = k <= n ? digit[bits >> (18 - 6 * k) & 63] : '=';
        put(out, text, 4);
    }
}

/* ---- cells: what VTK and Gmsh call the mixture of tets and lower-dimensional ones ---------------------- */

typedef struct {
    int corners;
    bw_vertex corner[4];
    int64_t tet; /* -1: not one */
    bool feature;
} kit_cell;

typedef struct {
    kit_cell *cell;
    size_t count, corner_count;
} kit_cells;

static inline void add_cell(kit_cells *c, int corners, const bw_vertex *corner, int64_t tet, bool feature) {
    kit_cell *x = &c->cell[c->count++];
    *x = (kit_cell){.corners = corners, .tet = tet, .feature = feature};
    memcpy(x->corner, corner, (size_t)corners * sizeof *corner);
    c->corner_count += (size_t)corners;
}

/* Features among the tets; with `others`, also a vertex, a line and a triangle that are none. */
static inline kit_cells mixed_cells(const bw_tet_mesh *m, bool others) {
    kit_cells c = {.cell = calloc(m->tet_count + m->feature_vertex_count + m->feature_edge_count +
                                      m->feature_facet_count + 3,
                                  sizeof *c.cell)};
    for (size_t i = 0; i < m->feature_vertex_count; i++) add_cell(&c, 1, &m->feature_vertex[i], -1, true);
    if (others)
        for (int n = 1; n < 4; n++) add_cell(&c, n, m->tet[0], -1, false);
    for (size_t i = 0; i < m->tet_count; i++) {
        add_cell(&c, 4, m->tet[i], (int64_t)i, false);
        if (i < m->feature_edge_count) add_cell(&c, 2, m->feature_edge[i], -1, true);
    }
    for (size_t i = m->tet_count; i < m->feature_edge_count; i++)
        add_cell(&c, 2, m->feature_edge[i], -1, true);
    for (size_t i = 0; i < m->feature_facet_count; i++) add_cell(&c, 3, m->feature_facet[i], -1, true);
    return c;
}

static const int kit_vtk_type[5] = {0, 1, 3, 5, 10}, kit_gmsh_type[5] = {0, 15, 1, 2, 4};

/* ---- legacy VTK ---------------------------------------------------------------------------------------- */

typedef struct {
    bool binary, version_5, field, feature_array;
} kit_vtk;

static inline void vtk_whole(kit_bytes *out, kit_vtk how, int64_t value, int size) {
    if (how.binary)
        put_whole(out, value, size, true);
    else
        put_text(out, "%lld\n", (long long)value);
}

static inline void vtk_real(kit_bytes *out, kit_vtk how, double value) {
    if (how.binary)
        put_real(out, value, 8, true);
    else
        put_text(out, "%.17g ", value);
}

static inline void write_vtk_cells(kit_bytes *out, const kit_cells *c, kit_vtk how) {
    if (how.version_5) {
        put_text(out, "CELLS %zu %zu\nOFFSETS vtktypeint64\n", c->count + 1, c->corner_count);
        int64_t end = 0;
        vtk_whole(out, how, 0, 8);
        for (size_t i = 0; i < c->count; i++) vtk_whole(out, how, end += c->cell[i].corners, 8);
        put_text(out, "\nCONNECTIVITY vtktypeint64\n");
        for (size_t i = 0; i < c->count; i++)
            for (int k = 0; k < c->cell[i].corners; k++) vtk_whole(out, how, c->cell[i].corner[k], 8);
    } else {
        put_text(out, "CELLS %zu %zu\n", c->count, c->count + c->corner_count);
        for (size_t i = 0; i < c->count; i++) {
            vtk_whole(out, how, c->cell[i].corners, 4);
            for (int k = 0; k < c->cell[i].corners; k++) vtk_whole(out, how, c->cell[i].corner[k], 4);
        }
    }
    put_text(out, "\nCELL_TYPES %zu\n", c->count);
    for (size_t i = 0; i < c->count; i++) vtk_whole(out, how, kit_vtk_type[c->cell[i].corners], 4);
}

static inline kit_bytes write_vtk(const bw_tet_mesh *m, kit_vtk how) {
    kit_bytes out = {0};
    kit_cells c = mixed_cells(m, how.feature_array);
    put_text(&out, "# vtk DataFile Version %s\na mesh\n%s\nDATASET UNSTRUCTURED_GRID\n",
             how.version_5 ? "5.1" : "3.0", how.binary ? "BINARY" : "ASCII");
    put_text(&out, "FIELD FieldData 1\nTimeValue 1 1 double\n");
    vtk_real(&out, how, 0.25);
    put_text(&out, "\nPOINTS %zu double\n", m->vertex_count);
    for (size_t i = 0; i < 3 * m->vertex_count; i++) vtk_real(&out, how, m->position[i / 3][i % 3]);
    put_text(&out, "\n");
    write_vtk_cells(&out, &c, how);
    put_text(&out, "\nPOINT_DATA %zu\nVECTORS shift double\n", m->vertex_count);
    for (size_t i = 0; i < 3 * m->vertex_count; i++) vtk_real(&out, how, 1);
    put_text(&out, "\nCELL_DATA %zu\n", c.count);
    if (how.feature_array) {
        put_text(&out, "SCALARS feature int 1\nLOOKUP_TABLE default\n");
        for (size_t i = 0; i < c.count; i++) vtk_whole(&out, how, c.cell[i].feature ? 7 : 0, 4);
        put_text(&out, "\nSCALARS weight double\nLOOKUP_TABLE default\n");
        for (size_t i = 0; i < c.count; i++) vtk_real(&out, how, 0.5);
        put_text(&out, "\n");
    }
    if (how.field) put_text(&out, "FIELD FieldData 2\nother 2 %zu int\n", c.count);
    for (size_t i = 0; i < 2 * c.count && how.field; i++) vtk_whole(&out, how, (int64_t)i, 4);
    if (how.field)
        put_text(&out, "\nMETADATA\nINFORMATION 0\n\nmy%%20map 12 %zu double\n", c.count);
    else
        put_text(&out, "SCALARS parametrization double 12\nLOOKUP_TABLE default\n");
    for (size_t i = 0; i < c.count; i++)
        for (int k = 0; k < 12; k++)
            vtk_real(&out, how, c.cell[i].tet < 0 ? 0 : m->parameter[c.cell[i].tet][k / 3][k % 3]);
    put_text(&out, "\n");
    free(c.cell);
    return out;
}

/* ---- VTU ----------------------------------------------------------------------------------------------- */

typedef enum { KIT_ASCII, KIT_INLINE, KIT_APPENDED_RAW, KIT_APPENDED_BASE64 } kit_placing;

typedef struct {
    kit_placing placing;
    bool wide, big, deflated, no_features;
    size_t block; /* of deflated data, bytes */
} kit_vtu;

static inline void put_encoded(kit_bytes *out, const kit_bytes *raw, kit_vtu how, bool base64) {
    kit_bytes header = {0}, body = {0};
    int word = how.wide ? 8 : 4;
    if (!how.deflated) {
        put_whole(&header, (int64_t)raw->size, word, how.big);
        put(&header, raw->bytes, raw->size);
    } else {
        size_t whole = raw->size / how.block, rest = raw->size % how.block;
        put_whole(&header, (int64_t)(whole + (rest > 0)), word, how.big);
        put_whole(&header, (int64_t)how.block, word, how.big);
        put_whole(&header, (int64_t)rest, word, how.big);
        for (size_t at = 0; at < raw->size; at += how.block) {
            size_t n = raw->size - at < how.block ? raw->size - at : how.block;
            uLongf packed = compressBound(n);
            Bytef *to = malloc(packed);
            compress(to, &packed, (const Bytef *)raw->bytes + at, n);
            put_whole(&header, (int64_t)packed, word, how.big);
            put(&body, to, packed);
            free(to);
        }
    }
    if (base64)
        put_base64(out, &header), put_base64(out, &body);
    else
        put(out, header.bytes, header.size), put(out, body.bytes, body.size);
    free(header.bytes), free(body.bytes);
}

/* One DataArray of `raw` values of `size` bytes; `text` has the same values for the ascii form. */
static inline void put_array(kit_bytes *out, kit_bytes *appended, kit_vtu how, const char *type,
                             const char *name, int components, const kit_bytes *raw, const kit_bytes *text) {
    static const char *const format[] = {"ascii", "binary", "appended", "appended"};
    put_text(out, "<DataArray type=\"%s\" Name=\"%s\" NumberOfComponents=\"%d\" format=\"%s\"", type, name,
             components, format[how.placing]);
    if (how.placing >= KIT_APPENDED_RAW) {
        put_text(out, " offset=\"%zu\"/>\n", appended->size);
        put_encoded(appended, raw, how, how.placing == KIT_APPENDED_BASE64);
        return;
    }
    put_text(out, ">\n<InformationKey name=\"L2_NORM_RANGE\" location=\"vtkDataArray\" length=\"2\"><Value "
                  "index=\"0\">0</Value></InformationKey>\n");
    if (how.placing == KIT_ASCII)
        put(out, text->bytes, text->size);
    else
        put_encoded(out, raw, how, true);
    put_text(out, "\n</DataArray>\n");
}

typedef struct {
    kit_bytes raw, text;
} kit_values;

static inline void value_real(kit_values *v, kit_vtu how, double value) {
    put_real(&v->raw, value, 8, how.big);
    put_text(&v->text, "%.17g\n", value);
}

static inline void value_whole(kit_values *v, kit_vtu how, int64_t value, int size) {
    put_whole(&v->raw, value, size, how.big);
    put_text(&v->text, "%lld ", (long long)value);
}

static inline void end_values(kit_values *v, kit_bytes *out, kit_bytes *appended, kit_vtu how,
                              const char *type, const char *name, int components) {
    put_array(out, appended, how, type, name, components, &v->raw, &v->text);
    free(v->raw.bytes), free(v->text.bytes);
    memset(v, 0, sizeof *v);
}

static inline void write_vtu_data(kit_bytes *out, kit_bytes *appended, const bw_tet_mesh *m,
                                  const kit_cells *c, kit_vtu how) {
    kit_values v = {0};
    put_text(out, "<CellData Scalars=\"feature\">\n");
    for (size_t i = 0; i < c->count; i++)
        for (int k = 0; k < 12; k++)
            value_real(&v, how, c->cell[i].tet < 0 ? 0 : m->parameter[c->cell[i].tet][k / 3][k % 3]);
    end_values(&v, out, appended, how, "Float64", "UVW", 12);
    for (size_t i = 0; i < 12 * c->count; i++) value_real(&v, how, (double)i);
    end_values(&v, out, appended, how, "Float64", "other", 12);
    for (size_t i = 0; i < c->count && !how.no_features; i++) value_whole(&v, how, c->cell[i].feature, 1);
    if (!how.no_features) end_values(&v, out, appended, how, "UInt8", "feature", 1);
    put_text(out, "</CellData>\n<Cells>\n");
    for (size_t i = 0; i < c->count; i++)
        for (int k = 0; k < c->cell[i].corners; k++) value_whole(&v, how, c->cell[i].corner[k], 4);
    end_values(&v, out, appended, how, "Int32", "connectivity", 1);
    int64_t end = 0;
    for (size_t i = 0; i < c->count; i++) value_whole(&v, how, end += c->cell[i].corners, 8);
    end_values(&v, out, appended, how, "Int64", "offsets", 1);
    for (size_t i = 0; i < c->count; i++) value_whole(&v, how, kit_vtk_type[c->cell[i].corners], 1);
    end_values(&v, out, appended, how, "UInt8", "types", 1);
    put_text(out, "</Cells>\n<Points>\n");
    for (size_t i = 0; i < 3 * m->vertex_count; i++) value_real(&v, how, m->position[i / 3][i % 3]);
    end_values(&v, out, appended, how, "Float64", "Points", 3);
    put_text(out, "</Points>\n");
}

static inline kit_bytes write_vtu(const bw_tet_mesh *m, kit_vtu how) {
    kit_bytes out = {0}, appended = {0};
    kit_cells c = mixed_cells(m, !how.no_features);
    if (!how.block) how.block = 1000;
    put_text(&out,
             "<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"%s\" "
             "header_type=\"%s\"%s>\n",
             how.big ? "BigEndian" : "LittleEndian", how.wide ? "UInt64" : "UInt32",
             how.deflated ? " compressor=\"vtkZLibDataCompressor\"" : "");
    put_text(&out,
             "<UnstructuredGrid><!-- two < three -->\n<Piece NumberOfPoints=\"%zu\" "
             "NumberOfCells=\"%zu\">\n<PointData/>\n",
             m->vertex_count, c.count);
    write_vtu_data(&out, &appended, m, &c, how);
    put_text(&out, "</Piece>\n</UnstructuredGrid>\n");
    if (how.placing >= KIT_APPENDED_RAW) {
        put_text(&out, "<AppendedData encoding=\"%s\">\n _",
                 how.placing == KIT_APPENDED_RAW ? "raw" : "base64");
        put(&out, appended.bytes, appended.size);
        put_text(&out, "\n</AppendedData>\n");
    }
    put_text(&out, "</VTKFile>\n");
    free(appended.bytes), free(c.cell);
    return out;
}

/* ---- Gmsh ---------------------------------------------------------------------------------------------- */

typedef struct {
    bool version_2, binary, big, sparse, no_names;
} kit_msh;

static inline void msh_whole(kit_bytes *out, kit_msh how, int64_t value, int size) {
    if (how.binary)
        put_whole(out, value, size, how.big);
    else
        put_text(out, "%lld ", (long long)value);
}

static inline void msh_real(kit_bytes *out, kit_msh how, double value) {
    if (how.binary)
        put_real(out, value, 8, how.big);
    else
        put_text(out, "%.17g ", value);
}

/* Any numbers that differ, in no order. */
static inline int64_t msh_tag(kit_msh how, size_t i) {
    return how.sparse ? (int64_t)(i * 7919 % 100003) * 3 + 5 : (int64_t)i + 1;
}

/* Entities: 1 of each dimension has the features, 2 what is none; volume 1 the tets. Groups 11: "feature
 * ...", 12: "other". */
static inline void write_msh_groups(kit_bytes *out, kit_msh how) {
    if (!how.no_names) {
        put_text(out, "$PhysicalNames\n6\n");
        for (int d = 0; d < 3; d++) put_text(out, "%d 11 \"feature %d\"\n%d 12 \"no feature\"\n", d, d, d);
        put_text(out, "$EndPhysicalNames\n");
    }
    if (how.version_2) return;
    put_text(out, "$Entities\n");
    for (int d = 0; d < 4; d++) msh_whole(out, how, d < 3 ? 2 : 1, 8);
    for (int d = 0; d < 4; d++)
        for (int tag = 1; tag <= (d < 3 ? 2 : 1); tag++) {
            msh_whole(out, how, tag, 4);
            for (int k = 0; k < (d ? 6 : 3); k++) msh_real(out, how, 0.5);
            msh_whole(out, how, d < 3, 8);
            if (d < 3) msh_whole(out, how, 10 + tag, 4);
            if (d) msh_whole(out, how, 1, 8), msh_whole(out, how, -1, 4);
        }
    put_text(out, "\n$EndEntities\n");
}

static inline void write_msh_nodes(kit_bytes *out, const bw_tet_mesh *m, kit_msh how) {
    size_t n = m->vertex_count, half = n / 2;
    put_text(out, "$Nodes\n");
    if (how.version_2) {
        put_text(out, "%zu\n", n);
        for (size_t i = 0; i < n; i++) {
            msh_whole(out, how, msh_tag(how, i), 4);
            for (int k = 0; k < 3; k++) msh_real(out, how, m->position[i][k]);
            if (!how.binary) put_text(out, "\n");
        }
    } else {
        msh_whole(out, how, 2, 8), msh_whole(out, how, (int64_t)n, 8), msh_whole(out, how, 1, 8),
            msh_whole(out, how, (int64_t)n, 8);
        for (int block = 0; block < 2; block++) {
            size_t from = block ? half : 0, to = block ? n : half;
            msh_whole(out, how, 2 + block, 4), msh_whole(out, how, 1, 4), msh_whole(out, how, !block, 4),
                msh_whole(out, how, (int64_t)(to - from), 8);
            for (size_t i = from; i < to; i++) msh_whole(out, how, msh_tag(how, i), 8);
            for (size_t i = from; i < to; i++) {
                for (int k = 0; k < 3; k++) msh_real(out, how, m->position[i][k]);
                for (int k = 0; k < 2 && !block; k++) msh_real(out, how, 0.125); /* place on the surface */
            }
        }
    }
    put_text(out, "\n$EndNodes\n");
}

static inline void write_msh_element(kit_bytes *out, const kit_cell *x, size_t number, kit_msh how) {
    int word = how.version_2 ? 4 : 8;
    if (how.version_2 && how.binary)
        msh_whole(out, how, kit_gmsh_type[x->corners], 4), msh_whole(out, how, 1, 4),
            msh_whole(out, how, 2, 4);
    msh_whole(out, how, msh_tag(how, number), word);
    if (how.version_2) {
        if (!how.binary) put_text(out, "%d 2 ", kit_gmsh_type[x->corners]);
        msh_whole(out, how, x->tet >= 0 ? 0 : x->feature ? 11 : 12, 4), msh_whole(out, how, 1, 4);
    }
    for (int k = 0; k < x->corners; k++) msh_whole(out, how, msh_tag(how, (size_t)x->corner[k]), word);
    if (!how.binary) put_text(out, "\n");
}

static inline void write_msh_elements(kit_bytes *out, const kit_cells *c, kit_msh how) {
    put_text(out, "$Elements\n");
    if (how.version_2)
        put_text(out, "%zu\n", c->count);
    else
        msh_whole(out, how, (int64_t)c->count, 8), msh_whole(out, how, (int64_t)c->count, 8),
            msh_whole(out, how, 1, 8), msh_whole(out, how, 1, 8);
    for (size_t i = 0; i < c->count; i++) {
        const kit_cell *x = &c->cell[i];
        if (!how.version_2)
            msh_whole(out, how, x->corners - 1, 4), msh_whole(out, how, x->tet >= 0 || x->feature ? 1 : 2, 4),
                msh_whole(out, how, kit_gmsh_type[x->corners], 4), msh_whole(out, how, 1, 8);
        write_msh_element(out, x, i, how);
    }
    put_text(out, "\n$EndElements\n");
}

static inline kit_bytes write_msh(const bw_tet_mesh *m, kit_msh how) {
    kit_bytes out = {0};
    kit_cells c = mixed_cells(m, !how.no_names);
    put_text(&out, "$MeshFormat\n%s %d 8\n", how.version_2 ? "2.2" : "4.1", how.binary);
    if (how.binary) put_whole(&out, 1, 4, how.big), put_text(&out, "\n");
    put_text(&out, "$EndMeshFormat\n$Comments\na $ comment\n$EndComments\n");
    write_msh_groups(&out, how);
    write_msh_nodes(&out, m, how);
    write_msh_elements(&out, &c, how);
    put_text(&out, "$ElementNodeData\n1\n\"parametrization\"\n1\n0.0\n3\n0\n3\n%zu\n", m->tet_count);
    for (size_t i = c.count; i-- > 0;) { /* rows need not be in order */
        if (c.cell[i].tet < 0) continue;
        msh_whole(&out, how, msh_tag(how, i), 4), msh_whole(&out, how, 4, 4);
        for (int k = 0; k < 12; k++) msh_real(&out, how, m->parameter[c.cell[i].tet][k / 3][k % 3]);
        if (!how.binary) put_text(&out, "\n");
    }
    put_text(&out, "\n$EndElementNodeData\n");
    free(c.cell);
    return out;
}

/* ---- Medit --------------------------------------------------------------------------------------------- */

typedef struct {
    int binary; /* version of .meshb: 2, 3, 4; 0: text */
    bool big;
} kit_medit;

static inline void medit_whole(kit_bytes *out, kit_medit how, int64_t value) {
    if (how.binary)
        put_whole(out, value, how.binary == 4 ? 8 : 4, how.big);
    else
        put_text(out, "%lld ", (long long)value);
}

/* A section's title and count; in .meshb the place of the next one, `size` bytes behind the count. */
static inline void medit_section(kit_bytes *out, kit_medit how, const char *name, int code, size_t count,
                                 size_t size) {
    int place = how.binary >= 3 ? 8 : 4, word = how.binary == 4 ? 8 : 4;
    if (!how.binary) {
        put_text(out, "\n%s\n%zu\n", name, count);
        return;
    }
    put_whole(out, code, 4, how.big);
    put_whole(out, (int64_t)(out->size + (size_t)place + (size_t)word + size), place, how.big);
    put_whole(out, (int64_t)count, word, how.big);
}

static inline void medit_marks(kit_bytes *out, kit_medit how, const char *name, int code, size_t from,
                               size_t to, const bw_vertex *item) {
    size_t word = how.binary == 4 ? 8 : 4;
    medit_section(out, how, name, code, to - from, word * (to - from));
    for (size_t i = from; i < to; i++) medit_whole(out, how, (item ? item[i] : (int64_t)i) + 1);
}

static inline void medit_elements(kit_bytes *out, kit_medit how, const char *name, int code, int corners,
                                  size_t count, const bw_vertex *list) {
    size_t word = how.binary == 4 ? 8 : 4;
    medit_section(out, how, name, code, count, word * (size_t)(corners + 1) * count);
    for (size_t i = 0; i < count; i++) {
        for (int k = 0; k < corners; k++) medit_whole(out, how, list[i * (size_t)corners + (size_t)k] + 1);
        medit_whole(out, how, 0);
        if (!how.binary) put_text(out, "\n");
    }
}

static inline kit_bytes write_medit(const bw_tet_mesh *m, kit_medit how) {
    kit_bytes out = {0};
    size_t word = how.binary == 4 ? 8 : 4, fv = m->feature_vertex_count, fe = m->feature_edge_count;
    if (how.binary) {
        put_whole(&out, 1, 4, how.big), put_whole(&out, how.binary, 4, how.big),
            put_whole(&out, 3, 4, how.big);
        int place = how.binary >= 3 ? 8 : 4;
        put_whole(&out, (int64_t)out.size + place + 4, place, how.big), put_whole(&out, 3, 4, how.big);
    } else {
        put_text(&out, "MeshVersionFormatted 2\n# a comment\nDimension\n3\n");
    }
    medit_section(&out, how, "Vertices", 4, m->vertex_count, m->vertex_count * (24 + word));
    for (size_t i = 0; i < m->vertex_count; i++) {
        for (int k = 0; k < 3; k++)
            if (how.binary)
                put_real(&out, m->position[i][k], 8, how.big);
            else
                put_text(&out, "%.17g ", m->position[i][k]);
        medit_whole(&out, how, 0);
    }
    medit_marks(&out, how, "Corners", 13, 0, fv / 2, m->feature_vertex);
    medit_marks(&out, how, "RequiredVertices", 15, 0, fv,
                m->feature_vertex);                        /* the first half a second time */
    medit_marks(&out, how, "Ridges", 14, 0, fe / 2, NULL); /* edges come later */
    medit_elements(&out, how, "Edges", 5, 2, fe, (const bw_vertex *)m->feature_edge);
    medit_marks(&out, how, "RequiredEdges", 16, fe / 2, fe, NULL);
    medit_marks(&out, how, "NormalAtVertices", 20, 0, 2, NULL); /* passed over */
    medit_elements(&out, how, "Triangles", 6, 3, m->feature_facet_count, (const bw_vertex *)m->feature_facet);
    medit_marks(&out, how, "RequiredTriangles", 17, 0, m->feature_facet_count, NULL);
    medit_elements(&out, how, "Tetrahedra", 8, 4, m->tet_count, (const bw_vertex *)m->tet);
    if (how.binary)
        put_whole(&out, 54, 4, how.big), put_whole(&out, 0, how.binary >= 3 ? 8 : 4, how.big);
    else
        put_text(&out, "\nEnd\n");
    return out;
}

static inline kit_bytes write_parameters(const bw_tet_mesh *m) {
    kit_bytes out = {0};
    put_text(&out, "# of a Medit mesh\nparameters %zu\n", m->tet_count);
    for (size_t i = 0; i < 12 * m->tet_count; i++)
        put_text(&out, "%.17g%s", m->parameter[i / 12][i % 12 / 3][i % 3], i % 12 == 11 ? "\n" : " ");
    return out;
}

/* ---- OpenVolumeMesh ------------------------------------------------------------------------------------ */

/* Turns each tet so that its corner 0 is the smallest of the first three: the order that its first halfface
 * gives it. */
static inline void turn_tets_for_ovm(bw_tet_mesh *m) {
    for (size_t t = 0; t < m->tet_count; t++)
        while (m->tet[t][0] > m->tet[t][1] || m->tet[t][0] > m->tet[t][2]) {
            bw_vertex v = m->tet[t][0];
            double p[3];
            memcpy(p, m->parameter[t][0], sizeof p);
            memmove(m->tet[t], m->tet[t] + 1, 2 * sizeof v);
            memmove(m->parameter[t], m->parameter[t] + 1, 2 * sizeof p);
            m->tet[t][2] = v;
            memcpy(m->parameter[t][2], p, sizeof p);
        }
}

/* Index of `list` in `table`, where it is added if it is not there. Quadratic: for small meshes. */
static inline size_t ovm_find(int32_t (*table)[3], size_t *count, int size, const int32_t *list) {
    for (size_t i = 0; i < *count; i++)
        if (!memcmp(table[i], list, (size_t)size * sizeof *list)) return i;
    memcpy(table[*count], list, (size_t)size * sizeof *list);
    return (*count)++;
}

static inline void ovm_sorted(const bw_vertex *from, int size, int32_t to[3]) {
    for (int i = 0; i < size; i++) {
        int j = i;
        for (; j > 0 && to[j - 1] > from[i]; j--) to[j] = to[j - 1];
        to[j] = from[i];
    }
}

static inline int ovm_has(const bw_vertex *lists, size_t count, int size, const int32_t *sorted) {
    for (size_t i = 0; i < count; i++) {
        int32_t key[3];
        ovm_sorted(lists + i * (size_t)size, size, key);
        if (!memcmp(key, sorted, (size_t)size * sizeof *key)) return 1;
    }
    return 0;
}

static inline kit_bytes write_ovm(const bw_tet_mesh *m, const char *name) {
    static const int side[4][3] = {{0, 1, 2}, {0, 3, 1}, {0, 2, 3}, {1, 3, 2}}, opposite[4] = {3, 2, 1, 0};
    kit_bytes out = {0}, faces = {0}, cells = {0};
    int32_t(*edge)[3] = calloc(6 * m->tet_count, sizeof *edge),
    (*face)[3] = calloc(4 * m->tet_count, sizeof *face);
    double(*value)[3] = calloc(8 * m->tet_count, sizeof *value);
    size_t edges = 0, face_count = 0;
    for (size_t t = 0; t < m->tet_count; t++) {
        put_text(&cells, "4");
        for (int s = 0; s < 4; s++) {
            bw_vertex v[3] = {m->tet[t][side[s][0]], m->tet[t][side[s][1]], m->tet[t][side[s][2]]};
            int32_t key[3];
            ovm_sorted(v, 3, key);
            bool over = (v[0] < v[1]) ^ (v[1] < v[2]) ^ (v[2] < v[0]); /* an odd order of the ascending one */
            size_t before = face_count, f = ovm_find(face, &face_count, 3, key);
            if (f == before) {
                put_text(&faces, "3");
                for (int k = 0; k < 3; k++) {
                    int32_t a = key[k], b = key[(k + 1) % 3], ends[2] = {a < b ? a : b, a < b ? b : a};
                    put_text(&faces, " %zu", 2 * ovm_find(edge, &edges, 2, ends) + (a > b));
                }
                put_text(&faces, "\n");
            }
            put_text(&cells, " %zu", 2 * f + over);
            memcpy(value[2 * f + over], m->parameter[t][opposite[s]], sizeof *value);
        }
        put_text(&cells, "\n");
    }
    put_text(&out, "OVM ASCII\n# a mesh\nVertices\n%zu\n", m->vertex_count);
    for (size_t i = 0; i < m->vertex_count; i++)
        put_text(&out, "%.17g %.17g %.17g\n", m->position[i][0], m->position[i][1], m->position[i][2]);
    put_text(&out, "Edges\n%zu\n", edges);
    for (size_t i = 0; i < edges; i++) put_text(&out, "%d %d\n", edge[i][0], edge[i][1]);
    put_text(&out, "Faces\n%zu\n", face_count);
    put(&out, faces.bytes, faces.size);
    put_text(&out, "Polyhedra\n%zu\n", m->tet_count);
    put(&out, cells.bytes, cells.size);
    put_text(&out, "VProp int \"feature\"\n");
    for (size_t i = 0; i < m->vertex_count; i++)
        put_text(&out, "%d\n",
                 ovm_has(m->feature_vertex, m->feature_vertex_count, 1, &(int32_t){(int32_t)i}));
    put_text(&out, "CProp string \"a name\"\nfirst\nsecond thing\nEProp bool \"feature\"\n");
    for (size_t i = 0; i < edges; i++)
        put_text(&out, "%d\n",
                 ovm_has((const bw_vertex *)m->feature_edge, m->feature_edge_count, 2, edge[i]));
    put_text(&out, "HFProp vec3d \"%s\"\n", name);
    for (size_t i = 0; i < 2 * face_count; i++)
        put_text(&out, "%.17g %.17g %.17g\n", value[i][0], value[i][1], value[i][2]);
    put_text(&out, "HFProp vec3d \"normal\"\n");
    for (size_t i = 0; i < 2 * face_count; i++) put_text(&out, "0 0 1\n");
    put_text(&out, "FProp int \"feature\"\n");
    for (size_t i = 0; i < face_count; i++)
        put_text(&out, "%d\n",
                 ovm_has((const bw_vertex *)m->feature_facet, m->feature_facet_count, 3, face[i]));
    free(edge), free(face), free(value), free(faces.bytes), free(cells.bytes);
    return out;
}

#endif
