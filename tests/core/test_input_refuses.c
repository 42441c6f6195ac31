/* Each ill-formed input gets its code, its place and a message. Every case is a documented example with one
 * thing changed. */
#include "kit/kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "core/input_kit.h"
#include "format/input.h"

#define FOLDER BW_SOURCE_DIR "/api/examples/formats/"

static bw_context ctx;

typedef struct {
    const char *from, *to; /* the first `from` of the file becomes `to`; to NULL: the file ends before it */
    bw_status status;
    const char *kind; /* an element that is named, and its number; NULL: none to look for */
    int64_t id;
    const char *words; /* in the message */
} damage;

static bool names(const char *kind, int64_t id) {
    for (size_t i = 0; i < ctx.error.element_count && i < BW_ELEMENTS_KEPT; i++)
        if (!strcmp(ctx.error.elements[i].kind, kind) && ctx.error.elements[i].id == id) return true;
    return false;
}

static char *damaged(const char *text, const damage *d) {
    const char *at = strstr(text, d->from);
    if (!at) fail_msg("nothing to damage: '%s'", d->from);
    size_t before = (size_t)(at - text), after = d->to ? strlen(at + strlen(d->from)) : 0,
           middle = d->to ? strlen(d->to) : 0;
    char *out = malloc(before + middle + after + 1);
    memcpy(out, text, before);
    if (middle) memcpy(out + before, d->to, middle);
    if (after) memcpy(out + before + middle, at + strlen(d->from), after);
    out[before + middle + after] = 0;
    return out;
}

static void refuses(const void *data, size_t size, const char *side, const damage *d) {
    bw_tet_mesh mesh;
    bw_context_init(&ctx);
    bw_status status = bw_input_read_memory(&ctx, data, size, side, side ? strlen(side) : 0, &mesh);
    if (status != d->status)
        fail_msg("'%s' -> '%s': %s, not %s: %s", d->from, d->to ? d->to : "(end)", bw_status_code(status),
                 bw_status_code(d->status), ctx.error.message);
    if (!strstr(ctx.error.message, d->words)) fail_msg("message lacks '%s': %s", d->words, ctx.error.message);
    if (d->kind && !names(d->kind, d->id))
        fail_msg("%s %lld is not named: %s", d->kind, (long long)d->id, ctx.error.message);
    assert_int_equal(ctx.memory.used, 0);
    assert_null(mesh.position);
}

static void refuse_all(const char *file, const damage *list, size_t count) {
    char path[500];
    snprintf(path, sizeof path, FOLDER "%s", file);
    char *text = kit_read_file(path, NULL),
         *side = strcmp(file, "cube.mesh") ? NULL : kit_read_file(FOLDER "cube.parameters", NULL);
    for (size_t i = 0; i < count; i++) {
        char *bad = damaged(text, &list[i]);
        refuses(bad, strlen(bad), side, &list[i]);
        free(bad);
    }
    free(text), free(side);
}
#define REFUSE_ALL(file, list) refuse_all(file, list, sizeof list / sizeof *list)

static void legacy_vtk(void **state) {
    (void)state;
    static const damage list[] = {
        {"Version 3.0", "Version 9.0", BW_E_SYNTAX, "line", 2, "version '9.0'"},
        {"ASCII", "UTF-8", BW_E_SYNTAX, "line", 3, "'UTF-8' stands where ASCII or BINARY is due"},
        {"UNSTRUCTURED_GRID", "POLYDATA", BW_E_SYNTAX, "line", 4, "only UNSTRUCTURED_GRID"},
        {"POINTS 8", "POINTS 800000", BW_E_COUNT, "line", 6, "800000 points cannot be"},
        {"POINTS 8", "POINTS -8", BW_E_COUNT, "line", 6, "negative"},
        {"POINTS 8 double", "POINTS 8 string", BW_E_SYNTAX, "line", 5, "type 'string'"},
        {"1 0 0\n", "1 nan 0\n", BW_E_NUMBER, "vertex", 1, "line 7 (vertex 1): 'nan' is not a finite number"},
        {"1 0 0\n", "1 zero 0\n", BW_E_SYNTAX, "vertex", 1, "'zero' is not a number"},
        {"CELLS 11", "CELLS 11000000", BW_E_COUNT, "line", 15, "cells cannot be"},
        {"4 0 5 1 7", "4 0 5 1 8", BW_E_INDEX, "cell", 1, "line 16 (cell 1): index 8 is outside 0..7"},
        {"4 0 5 1 7", "3 0 5 1 7", BW_E_COUNT, "cell", 8, "more numbers than the 46 announced"},
        {"CELL_TYPES 11", "CELL_TYPES 10", BW_E_COUNT, "line", 27, "10 types for 11 cells"},
        {"10\n10\n10\n10", "10\n13\n10\n10", BW_E_SYNTAX, "cell", 1, "type 13; only hexes (12, 11) or tets (10)"},
        {"10\n10\n10\n10", "10\n12\n10\n10", BW_E_SYNTAX, "cell", 1, "a cell of type 12 has 8 corners, not 4"},
        {"10\n10\n10\n10", "10\n5\n10\n10", BW_E_SYNTAX, "cell", 1, "a cell of type 5 has 3 corners, not 4"},
        {"CELL_DATA 11", "CELL_DATA 12", BW_E_COUNT, NULL, 0, "data of 12 cells, but there are 11"},
        {"CELLS 11", "CELL_DATA 0\nFIELD f 1\nparametrization 12 0 double\nCELLS 11", BW_E_SYNTAX, "line", 15, "data of cells come before the cells"},
        {"POINTS 8", "POINT_DATA 0\nPOINTS 8", BW_E_SYNTAX, "line", 6, "data of points come before the points"},
        {"parametrization 12 11", "parametrization 11 12", BW_E_SYNTAX, NULL, 0,
         "no cell array has 12 components"},
        {"parametrization 12 11", "parametrization 12 10", BW_E_COUNT, NULL, 0, "not one per cell"},
        {"parametrization 12", NULL, BW_E_COUNT, NULL, 0, "1 arrays cannot be in the 1 bytes"},
        {"CELL_DATA", NULL, BW_E_SYNTAX, NULL, 0, "the parametrization is missing"},
        {"CELL_TYPES", NULL, BW_E_TRUNCATED, NULL, 0, "without the types of the cells"},
        {"0.25 0.5 0", "0.25 inf 0", BW_E_NUMBER, "cell", 0, "'inf'"},
        {"FIELD FieldData 1\n", "VECTORS wind double\n", BW_E_SYNTAX, NULL, 0,
         "is not a section that is read here"},
    };
    REFUSE_ALL("cube.vtk", list);
}

static void vtu(void **state) {
    (void)state;
    static const damage list[] = {
        {"<?xml version=\"1.0\"?>", "<!DOCTYPE a [<!ENTITY b \"c\">]>", BW_E_SYNTAX, "line", 1,
         "a document type declaration"},
        {"type=\"UnstructuredGrid\"", "type=\"PolyData\"", BW_E_SYNTAX, "line", 2, "'PolyData'"},
        {"LittleEndian", "MiddleEndian", BW_E_SYNTAX, "line", 2, "byte_order 'MiddleEndian'"},
        {"header_type=\"UInt64\"", "compressor=\"vtkLZ4DataCompressor\"", BW_E_SYNTAX, "line", 2,
         "only vtkZLibDataCompressor"},
        {"</Piece>", "</Piece><Piece/>", BW_E_SYNTAX, NULL, 0, "a second Piece"},
        {"</Points>", "</Pints>", BW_E_SYNTAX, NULL, 0, "mismatched tag"},
        {"</Points>", NULL, BW_E_TRUNCATED, NULL, 0, "not well-formed"},
        {"NumberOfPoints=\"8\"", "NumberOfPoints=\"80000000\"", BW_E_COUNT, NULL, 0,
         "80000000 points cannot be"},
        {"NumberOfPoints=\"8\"", "NumberOfPoints=\"-1\"", BW_E_COUNT, "line", 4,
         "'-1' is no number of things"},
        {"NumberOfPoints=\"8\"", "NumberOfPoints=\"7\"", BW_E_COUNT, "line", 14,
         "more values than belong here"},
        {"NumberOfCells=\"11\"", "NumberOfCells=\"0\"", BW_E_EMPTY, NULL, 0, "no cells"},
        {"Float64\" Name=\"Points\"", "String\" Name=\"Points\"", BW_E_TRUNCATED, NULL, 0,
         "no array of points"},
        {"Name=\"offsets\"", "Name=\"ends\"", BW_E_TRUNCATED, NULL, 0, "no array of offsets"},
        {"1 0 0\n", "1 nan 0\n", BW_E_NUMBER, "vertex", 1, "line 8 (vertex 1): 'nan'"},
        {"0 5 1 7", "0 5 1 77", BW_E_INDEX, "cell", 1, "line 20 (cell 1): index 77 is outside 0..7"},
        {"4 8 12", "4 3 12", BW_E_INDEX, "cell", 1, "before they begin"},
        {"4 8 12", "4 8 1200", BW_E_INDEX, "cell", 3, "before they begin"},
        {"10 10 10", "10 13 10", BW_E_SYNTAX, "cell", 1, "type 13"},
        {"format=\"ascii\"", "format=\"morse\"", BW_E_SYNTAX, "line", 6, "format 'morse'"},
        {"format=\"ascii\"", "format=\"appended\"", BW_E_TRUNCATED, NULL, 0, "not in the appended data"},
        {"format=\"ascii\"", "format=\"binary\"", BW_E_COUNT, NULL, 0, "bytes are announced"},
        {"NumberOfComponents=\"12\"", "NumberOfComponents=\"6\"", BW_E_SYNTAX, NULL, 0,
         "no cell array has 12 components"},
        {"Name=\"feature\" NumberOfComponents=\"1\"", "Name=\"feature\" NumberOfComponents=\"2\"",
         BW_E_SYNTAX, NULL, 0, "has 2 components, not 1"},
    };
    REFUSE_ALL("cube.vtu", list);
}

static void gmsh(void **state) {
    (void)state;
    static const damage list[] = {
        {"4.1 0 8", "4.0 0 8", BW_E_SYNTAX, "line", 2, "version '4.0'"},
        {"4.1 0 8", "4.1 0 4", BW_E_SYNTAX, "line", 2, "sizes of 8 bytes"},
        {"$EndMeshFormat", "$EndNodes", BW_E_SYNTAX, "line", 3, "$EndMeshFormat is due"},
        {"1 8 10 80", "1 8000000 10 80", BW_E_COUNT, NULL, 0, "8000000 nodes cannot be"},
        {"1 8 10 80", "1 9 10 80", BW_E_COUNT, NULL, 0, "8 nodes where 9 are announced"},
        {"10\n20\n30", "10\n10\n30", BW_E_SYNTAX, NULL, 0, "two nodes have the tag 10"},
        {"1 0 0\n", "1 x 0\n", BW_E_SYNTAX, NULL, 0, "'x' is not a"},
        {"5 11 1 106", "5 12 1 106", BW_E_COUNT, NULL, 0, "11 elements where 12 are announced"},
        {"0 1 15 1", "0 1 99 1", BW_E_SYNTAX, NULL, 0, "elements of type 99"},
        {"101 10 20 40 80", "101 10 20 40 81", BW_E_INDEX, "element", 5, "there is no node 81"},
        {"101 10 20 40 80", "102 10 20 40 80", BW_E_SYNTAX, NULL, 0, "two cells have the tag 102"},
        {"101 4  ", "1 4  ", BW_E_INDEX, "row", 0, "no tet with the tag 1"},
        {"101 4  ", "102 4  ", BW_E_SYNTAX, "row", 1, "has parameters already"},
        {"0\n3\n6\n101", "0\n3\n5\n101", BW_E_SYNTAX, NULL, 0, "$EndElementNodeData is due"},
        {"0\n3\n6\n101", "0\n4\n6\n101", BW_E_SYNTAX, NULL, 0, "is not a whole number"},
        {"$ElementNodeData", NULL, BW_E_SYNTAX, NULL, 0, "the parametrization is missing"},
        {"$Elements", NULL, BW_E_TRUNCATED, NULL, 0, "without elements"},
        {"$EndElements", NULL, BW_E_TRUNCATED, NULL, 0, "the input ends here"},
        {"0.25 0.5 0", "0.25 0.5 nan", BW_E_NUMBER, "tet", 0, "'nan'"},
    };
    REFUSE_ALL("cube.msh", list);
}

static void medit(void **state) {
    (void)state;
    static const damage list[] = {
        {"Dimension 3", "Dimension 2", BW_E_SYNTAX, "line", 2, "dimension 2"},
        {"Vertices\n8", "Vertices\n8000000", BW_E_COUNT, "line", 4, "8000000 vertices cannot be"},
        {"Vertices\n8", "Vertices\n7", BW_E_SYNTAX, NULL, 0, "'1' is more than the section holds"},
        {"1 2 4 8 0", "1 2 4 9 0", BW_E_INDEX, "tet", 0, "index 9 is outside 1..8"},
        {"1 2 4 8 0", "0 2 4 8 0", BW_E_INDEX, "tet", 0, "index 0 is outside 1..8"},
        {"Tetrahedra", "Prisms", BW_E_SYNTAX, "prism", 0, "only meshes of tets, or of hexes, are read"},
        {"Tetrahedra", "Pyramids", BW_E_SYNTAX, "pyramid", 0, "only meshes of tets, or of hexes, are read"},
        {"Tetrahedra", "Polyhedra", BW_E_TRUNCATED, NULL, 0, "without Tetrahedra or Hexahedra"},
        {"Ridges", "Hexahedra 1 1 2 4 3 5 6 8 7 0 Ridges", BW_E_SYNTAX, "hex", 0, "the mesh has tets as well"},
        {"Ridges\n1\n2", "Ridges\n1\n3", BW_E_INDEX, NULL, 0, "number 3 in Ridges is outside 1..2"},
        {"Triangles\n2", "Vertices\n2", BW_E_SYNTAX, NULL, 0, "a second section Vertices"},
        {"Tetrahedra\n6", "Tetrahedra\n5", BW_E_SYNTAX, NULL, 0, "more than the section holds"},
        {"4 3 8 0", NULL, BW_E_COUNT, NULL, 0, "6 tets cannot be in the 53 bytes"},
        {"1\n2\nEnd", NULL, BW_E_COUNT, NULL, 0, "2 marks cannot be in the 1 bytes"},
    };
    REFUSE_ALL("cube.mesh", list);
}

/* What only meshes of hexes can have wrong. */
static void hexes(void **state) {
    (void)state;
    static const damage mesh[] = {
        {"2 3 6 5", "2 3 6 55", BW_E_INDEX, "hex", 1, "index 55 is outside 1..12"},
        {"Hexahedra\n2", "Hexahedra\n2000", BW_E_COUNT, NULL, 0, "2000 hexes cannot be"},
        {"Hexahedra\n2", "Hexahedra\n0\nTetrahedra\n0\nPass 2", BW_E_EMPTY, NULL, 0, "no tets and no hexes"},
        {"Corners", "Triangles 1 1 2 3 0 RequiredTriangles 1 1 Corners", BW_E_INDEX, NULL, 0, "no faces of hexes"},
        {"RequiredQuadrilaterals\n1\n1", "RequiredQuadrilaterals\n1\n2", BW_E_INDEX, NULL, 0, "number 2 in RequiredQuadrilaterals is outside 1..1"},
    };
    static const damage vtk[] = {
        {"12\n1\n3\n12", "12\n1\n3\n10", BW_E_SYNTAX, "cell", 3, "a cell of type 10 has 4 corners, not 8"},
        {"8 1 2 5 4 7 8 11 10\n", "8 1 2 5 4 7 8 11 12\n", BW_E_INDEX, "cell", 3, "index 12 is outside 0..11"},
    };
    static const damage msh[] = {
        {"90 120 110", "90 120 111", BW_E_INDEX, "element", 5, "there is no node 111"},
        {"3 1 5 2", "3 1 6 2", BW_E_SYNTAX, NULL, 0, "elements of type 6"},
        {"102 ", "101 ", BW_E_SYNTAX, NULL, 0, "two cells have the tag 101"},
    };
    static const damage ovm[] = {
        {"6 0 2 4 6 8 10", "6 0 2 4 6 10 10", BW_E_SYNTAX, "hex", 0, "belongs to another cell already"},
        {"6 0 2 4 6 8 10", "6 0 2 4 6 8 13", BW_E_SYNTAX, "hex", 0, "not the sides of a hex"},
        {"6 0 2 4 6 8 10", "4 0 2 4 6", BW_E_SYNTAX, "tet", 0, "not the sides of a tet"},
    };
    REFUSE_ALL("hexes.mesh", mesh);
    REFUSE_ALL("hexes.vtk", vtk);
    REFUSE_ALL("hexes.msh", msh);
    REFUSE_ALL("hexes.ovm", ovm);
    char *text = kit_read_file(FOLDER "hexes.mesh", NULL);
    refuses(text, strlen(text), "parameters 2", &(damage){"", "", BW_E_PARAMETERS, NULL, 0, "a mesh of hexes has no parameters"});
    free(text);
}

static void side_files(void **state) {
    (void)state;
    static const damage list[] = {
        {"parameters 6", "parameters 5", BW_E_PARAMETERS, "line", 1,
         "parameters: line 1: parameters of 5 tets, but the mesh has 6"},
        {"parameters", "sol", BW_E_SYNTAX, "line", 1, "the word parameters is due"},
        {"0.25 0.5 0", "0.25 nan 0", BW_E_NUMBER, "tet", 0, "parameters: line 2 (tet 0): 'nan'"},
    };
    char *mesh = kit_read_file(FOLDER "cube.mesh", NULL),
         *side = kit_read_file(FOLDER "cube.parameters", NULL);
    for (size_t i = 0; i < sizeof list / sizeof *list; i++) {
        char *bad = damaged(side, &list[i]);
        refuses(mesh, strlen(mesh), bad, &list[i]);
        free(bad);
    }
    refuses(mesh, strlen(mesh), NULL,
            &(damage){"", "", BW_E_PARAMETERS, NULL, 0, "a side file with \"parameters 6\""});
    refuses(mesh, strlen(mesh), "", &(damage){"", "", BW_E_TRUNCATED, NULL, 0, "parameters: line 1"});
    char longer[4000];
    snprintf(longer, sizeof longer, "%s1", side);
    refuses(mesh, strlen(mesh), longer,
            &(damage){"", "", BW_E_SYNTAX, NULL, 0, "more text after the last tet"});
    char *other = kit_read_file(FOLDER "cube.ovm", NULL);
    refuses(other, strlen(other), side,
            &(damage){"", "", BW_E_PARAMETERS, NULL, 0, "belongs to a Medit mesh only; the input is ovm"});
    free(mesh), free(side), free(other);
}

static void openvolumemesh(void **state) {
    (void)state;
    static const damage list[] = {
        {"OVM ASCII", "OVM BINARY", BW_E_SYNTAX, "line", 1, "OVM ASCII"},
        {"OVM ASCII", "OVMB\n\r\n\xff", BW_E_SYNTAX, "line", 1, "binary form is not read"},
        {"Vertices\n8", "Vertices\n8000000", BW_E_COUNT, NULL, 0, "8000000 vertices cannot be"},
        {"Edges", "Kanten", BW_E_SYNTAX, "line", 12, "'Kanten' stands where Edges is due"},
        {"4 7\n0 6", "4 8\n0 6", BW_E_INDEX, "edge", 7, "index 8 is outside 0..7"},
        {"3 0 2", "5 0 2", BW_E_SYNTAX, "face", 0, "5 corners; only triangles"},
        {"3 0 2", "4 0 2", BW_E_SYNTAX, "face", 0, "no closed walk"},
        {"3 0 2", "3 2 0", BW_E_SYNTAX, "face", 0, "no closed walk"},
        {"4 0 2 4 6", "5 0 2 4 6", BW_E_SYNTAX, "cell", 0, "5 halffaces; only tets and hexes"},
        {"4 8 10 3 12", "6 8 10 3 12 1 1", BW_E_SYNTAX, "hex", 1, "a hex among tets"},
        {"4 0 2 4 6", "4 0 2 4 99", BW_E_INDEX, "tet", 0, "index 99"},
        {"4 0 2 4 6", "4 0 2 4 8", BW_E_SYNTAX, "tet", 0, "not the sides of a tet"},
        {"4 0 2 4 6", "4 0 0 4 6", BW_E_SYNTAX, "tet", 0, "belongs to another cell already"},
        {"HFProp vec3d \"HexHex::Parametrization\"", "HFProp vec3f \"HexHex::Parametrization\"", BW_E_SYNTAX,
         NULL, 0, "no HFProp of type vec3d"},
        {"HFProp vec3d \"HexHex::Parametrization\"", "Prop vec3d \"HexHex::Parametrization\"", BW_E_SYNTAX,
         NULL, 0, "a property is due"},
        {"HFProp vec3d \"HexHex::Parametrization\"", "HFProp vec3d", BW_E_SYNTAX, NULL, 0,
         "a name in quotes"},
        {"VProp int \"feature\"", "VProp vec3d \"feature\"", BW_E_SYNTAX, NULL, 0, "neither int nor bool"},
        {"1.25 1.5 1", "1.25 1.5", BW_E_SYNTAX, "line", 98, "values are missing before this property"},
    };
    REFUSE_ALL("cube.ovm", list);
}

static void what_is_no_format(void **state) {
    (void)state;
    static const damage none = {"", "", BW_E_SYNTAX, "line", 1, "not the beginning of a format that is read"};
    refuses("solid cube", 10, NULL, &none);
    refuses("\x89HDF\r\n\x1a\n", 8, NULL, &none);
    refuses("# a comment", 11, NULL, &none);
    refuses(" \n\t ", 4, NULL, &(damage){"", "", BW_E_EMPTY, NULL, 0, "the input is empty"});
    refuses("", 0, NULL, &(damage){"", "", BW_E_EMPTY, NULL, 0, "the input is empty"});
    kit_bytes many = {0};
    put_text(&many, "<VTKFile type=\"UnstructuredGrid\">");
    for (int i = 0; i < 100001; i++) put_text(&many, "<a/>");
    refuses(many.bytes, many.size, NULL, &(damage){"", "", BW_E_COUNT, "line", 1, "too many elements"});
    many.size = 33;
    for (int i = 0; i < 40; i++) put_text(&many, "<a>");
    refuses(many.bytes, many.size, NULL, &(damage){"", "", BW_E_SYNTAX, "line", 1, "elements nest too deep"});
    many.size = 33;
    put_text(&many, "<a b=\"");
    for (int i = 0; i < 2000; i++) put_text(&many, "%01000d", i);
    refuses(many.bytes, many.size, NULL, &(damage){"", "", BW_E_LINE, "line", 1, "a tag is longer than"});
    free(many.bytes);
    char *word = malloc(70000);
    memset(word, '7', 70000);
    memcpy(word, "OVM ASCII\nVertices\n", 19);
    refuses(word, 70000, NULL, &(damage){"", "", BW_E_LINE, "line", 3, "too long a number"});
    free(word);
}

/* Damage to encoded data: VTU with zlib and base64, and binary files of VTK and Gmsh. */
static void encoded_data(void **state) {
    (void)state;
    bw_tet_mesh mesh;
    bw_context_init(&ctx);
    kit_expect_ok(&ctx, bw_input_read(&ctx, FOLDER "cube.hexex", NULL, &mesh));
    kit_bytes raw = write_vtu(&mesh, (kit_vtu){.placing = KIT_APPENDED_RAW, .deflated = true});
    char *data = memchr(memmem(raw.bytes, raw.size, "<AppendedData", 13), '_', 400) + 1;
    data[4] ^= 1; /* the size of a block */
    refuses(raw.bytes, raw.size, NULL,
            &(damage){"", "", BW_E_COUNT, NULL, 0, "the header of the deflated data"});
    data[4] ^= 1;
    uint32_t blocks;
    memcpy(&blocks, data, 4);
    data[4 * (3 + blocks) + 20] ^= 0x55; /* in the first deflated block */
    refuses(raw.bytes, raw.size, NULL,
            &(damage){"", "", BW_E_SYNTAX, NULL, 0, "a deflated block is damaged"});
    kit_bytes text = write_vtu(&mesh, (kit_vtu){.placing = KIT_INLINE});
    char *at = memmem(text.bytes, text.size, "</Value></InformationKey>\n", 26);
    at[60] = '*';
    refuses(text.bytes, text.size, NULL, &(damage){"", "", BW_E_SYNTAX, NULL, 0, "this is not base64"});
    kit_bytes vtk = write_vtk(&mesh, (kit_vtk){.binary = true});
    refuses(vtk.bytes, vtk.size - 100, NULL,
            &(damage){"", "", BW_E_COUNT, "byte", (int64_t)(vtk.size - 12 * 8 * 10 - 1), "cannot be in the"});
    kit_bytes msh = write_msh(&mesh, (kit_msh){.binary = true});
    refuses(msh.bytes, msh.size - 400, NULL, &(damage){"", "", BW_E_COUNT, NULL, 0, "byte"});
    kit_bytes meshb = write_medit(&mesh, (kit_medit){.binary = 3});
    refuses(meshb.bytes, meshb.size - 100, "parameters 6",
            &(damage){"", "", BW_E_TRUNCATED, NULL, 0, "the next section is at byte"});
    free(raw.bytes), free(text.bytes), free(vtk.bytes), free(msh.bytes), free(meshb.bytes);
    bw_tet_mesh_clear(&ctx, &mesh);
}

static void positions_too_far_out(void **state) {
    (void)state;
    static const char *const far[] = {"\n1e31 1 1\n", "\n1 -1e200 1\n", "\n1 1 1.0000001e30\n"};
    static const char *const files[] = {"cube.hexex", "cube.vtk", "cube.msh", "cube.ovm"};
    for (size_t i = 0; i < sizeof far / sizeof *far; i++)
        for (size_t k = 0; k < sizeof files / sizeof *files; k++)
            refuse_all(files[k], &(damage){"\n1 1 1\n", far[i], BW_E_NUMBER, "vertex", 7, "farther out than 1e+30"}, 1);
    bw_tet_mesh mesh;
    char *text = kit_read_file(FOLDER "cube.hexex", NULL), *at = strstr(text, "1 1 1"), bad[4000];
    for (int limit = 0; limit < 2; limit++) { /* from a file .hexex is streamed */
        snprintf(bad, sizeof bad, "%.*s%s%s", (int)(at - text), text, limit ? "1e30 1 1" : "1 1e31 1", at + 5);
        kit_write_text(kit_temp_path("far.hexex"), bad);
        bw_context_init(&ctx);
        kit_expect_status(&ctx, bw_input_read(&ctx, kit_temp_path("far.hexex"), NULL, &mesh), limit ? BW_OK : BW_E_NUMBER);
        bw_tet_mesh_clear(&ctx, &mesh);
        assert_int_equal(ctx.memory.used, 0);
    }
    free(text);
}

static void a_missing_file_is_an_io_error(void **state) {
    (void)state;
    bw_tet_mesh mesh;
    bw_context_init(&ctx);
    kit_expect_status(&ctx, bw_input_read(&ctx, kit_temp_path("nothing"), NULL, &mesh), BW_E_IO);
    bw_context_init(&ctx);
    kit_expect_status(&ctx, bw_input_read(&ctx, FOLDER "cube.mesh", kit_temp_path("nothing"), &mesh),
                      BW_E_IO);
    bw_context_init(&ctx);
    kit_expect_status(&ctx, bw_input_read(&ctx, kit_temp_dir(), NULL, &mesh), BW_E_IO);
    assert_int_equal(ctx.memory.used, 0);
}

static volatile sig_atomic_t asked = 1;

static void a_cancelled_job_stops_in_every_reader(void **state) {
    (void)state;
    static const char *const files[] = {"cube.vtk",  "cube.vtu", "cube.msh",
                                        "cube.mesh", "cube.ovm", "cube.hexex"};
    for (size_t i = 0; i < sizeof files / sizeof *files; i++) {
        char path[500];
        bw_tet_mesh mesh;
        snprintf(path, sizeof path, FOLDER "%s", files[i]);
        bw_context_init(&ctx);
        ctx.cancel = &asked;
        kit_expect_status(&ctx, bw_input_read(&ctx, path, i == 3 ? FOLDER "cube.parameters" : NULL, &mesh),
                          BW_E_CANCELLED);
        assert_int_equal(ctx.memory.used, 0);
    }
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(legacy_vtk),
    cmocka_unit_test(vtu),
    cmocka_unit_test(gmsh),
    cmocka_unit_test(medit),
    cmocka_unit_test(hexes),
    cmocka_unit_test(side_files),
    cmocka_unit_test(openvolumemesh),
    cmocka_unit_test(what_is_no_format),
    cmocka_unit_test(encoded_data),
    cmocka_unit_test(positions_too_far_out),
    cmocka_unit_test(a_missing_file_is_an_io_error),
    cmocka_unit_test(a_cancelled_job_stops_in_every_reader),
};
KIT_MAIN(tests)
