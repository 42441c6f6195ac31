/* The multi-block VTK files of a block complex, read by a parser of the tests' own, and by VTK where it is
 * installed. */
#include "core/encode_kit.h"

#include <math.h>

#include "format/vtm.h"

static const struct {
    const char *name;
    int size;
} samples[] = {{"cuboid", 2},        {"plus", 2},         {"cylinder", 1},
               {"torus-quarter", 1}, {"hollow-torus", 1}, {"tee", 1}};
enum { SAMPLES = sizeof samples / sizeof *samples };
static const char *const names[BW_VTM_FILES] = {"blocks.vtu", "walls.vtu", "arcs.vtu", "nodes.vtu",
                                                "complex.vtm"};

/* ---- writing ------------------------------------------------------------------------------------------- */

static double (*positions(encoded *e))[3] {
    double(*at)[3] = bw_alloc(&e->ctx, e->cells.vertex_count, sizeof *at);
    for (size_t v = 0; v < e->cells.vertex_count; v++) bw_cells_position(&e->cells, (bw_cvertex)v, at[v]);
    return at;
}

typedef struct {
    const char *name;
    int size;
    encoded e;
    double (*at)[3];
    const char *folder;
    bw_vtm_written written[BW_VTM_FILES];
} job;

static bw_status write_job(bw_context *ctx, void *user) {
    job *j = user;
    return bw_vtm_write(ctx, &j->e.cells, &j->e.complex, (const double(*)[3])j->at, j->folder, j->written);
}

static void begin(job *j, const char *name, int size, bw_complex_kind kind) {
    j->name = name, j->size = size;
    encode_prepare(&j->e, name, size, 0.6, kind);
    kit_expect_ok(&j->e.ctx, bw_cells_open_all(&j->e.ctx, &j->e.cells));
    j->at = positions(&j->e);
    j->folder = kit_temp_dir();
    kit_expect_ok(&j->e.ctx, write_job(&j->e.ctx, j));
}

static void end(job *j) {
    bw_free(&j->e.ctx, j->at);
    encode_clear(&j->e);
}

/* ---- reading ------------------------------------------------------------------------------------------- */

typedef struct {
    char *bytes;
    size_t size;
    const char *data; /* after the '_' */
} vtu;

static vtu open_vtu(const char *name) {
    vtu v;
    v.bytes = kit_read_file(kit_temp_path("%s", name), &v.size);
    const char *mark = strstr(v.bytes, "<AppendedData encoding=\"raw\">");
    assert_non_null(mark);
    v.data = strchr(mark, '_') + 1;
    return v;
}

static size_t attribute(const vtu *v, const char *name) {
    const char *at = strstr(v->bytes, name);
    assert_non_null(at);
    return (size_t)strtoull(at + strlen(name) + 2, NULL, 10);
}

/* Values of an array, and how many they are; its bytes may be anywhere. */
static void *array(const vtu *v, const char *name, size_t size, size_t *count) {
    char tag[80];
    uint64_t bytes;
    snprintf(tag, sizeof tag, " Name=\"%s\"", name);
    const char *at = strstr(v->bytes, tag);
    if (!at) fail_msg("no array %s", name);
    const char *from = v->data + strtoull(strstr(at, "offset=\"") + 8, NULL, 10);
    assert_true(from + 8 <= v->bytes + v->size);
    memcpy(&bytes, from, 8);
    assert_true(bytes <= (uint64_t)(v->bytes + v->size - from - 8));
    assert_int_equal(bytes % size, 0);
    void *copy = malloc(bytes + 1);
    memcpy(copy, from + 8, bytes);
    *count = bytes / size;
    return copy;
}

static void *array_of(const vtu *v, const char *name, size_t size, size_t count) {
    size_t n;
    void *values = array(v, name, size, &n);
    if (n != count) fail_msg("array %s has %zu values, not %zu", name, n, count);
    return values;
}

static void expect_type(const vtu *v, size_t cells, uint8_t type) {
    uint8_t *types = array_of(v, "types", 1, cells);
    for (size_t i = 0; i < cells; i++) assert_int_equal(types[i], type);
    free(types);
}

/* ---- blocks -------------------------------------------------------------------------------------------- */

static double det(const double *o, const double *a, const double *b, const double *c) {
    double x[3], y[3], z[3];
    for (int k = 0; k < 3; k++) x[k] = a[k] - o[k], y[k] = b[k] - o[k], z[k] = c[k] - o[k];
    return x[0] * (y[1] * z[2] - y[2] * z[1]) - x[1] * (y[0] * z[2] - y[2] * z[0]) +
           x[2] * (y[0] * z[1] - y[1] * z[0]);
}

/* Every directed edge of a polyhedron's faces is matched by its opposite. */
static void expect_closed(const int32_t *face, size_t faces) {
    int32_t edge[512][2];
    size_t n = 0;
    for (size_t f = 0; f < faces; f++) {
        int32_t corners = *face++;
        assert_true(corners >= 3);
        for (int32_t i = 0; i < corners; i++) {
            assert_true(n < 512);
            edge[n][0] = face[i], edge[n][1] = face[(i + 1) % corners];
            n++;
        }
        face += corners;
    }
    for (size_t i = 0; i < n; i++) {
        int same = 0, opposite = 0;
        for (size_t k = 0; k < n; k++) {
            same += edge[k][0] == edge[i][0] && edge[k][1] == edge[i][1];
            opposite += edge[k][0] == edge[i][1] && edge[k][1] == edge[i][0];
        }
        assert_int_equal(same, 1);
        assert_int_equal(opposite, 1);
    }
}

static double volume_of(const double (*point)[3], const int32_t *face, size_t faces) {
    const double *o = point[face[1]];
    double sum = 0;
    for (size_t f = 0; f < faces; f++) {
        int32_t corners = *face++;
        for (int32_t i = 1; i + 1 < corners; i++)
            sum += det(o, point[face[0]], point[face[i]], point[face[i + 1]]);
        face += corners;
    }
    return sum / 6;
}

/* The points of a polyhedron are those of its faces, each once. */
static void expect_points(const int32_t *corner, size_t corners, const int32_t *face, size_t faces) {
    for (size_t i = 0; i < corners; i++)
        for (size_t k = 0; k < i; k++) assert_true(corner[i] != corner[k]);
    uint8_t seen[512] = {0};
    for (size_t f = 0; f < faces; f++) {
        int32_t n = *face++;
        for (; n; n--, face++) {
            size_t i = 0;
            while (i < corners && corner[i] != *face) i++;
            assert_true(i < corners);
            seen[i] = 1;
        }
    }
    for (size_t i = 0; i < corners; i++) assert_int_equal(seen[i], 1);
}

/* Volumes of the model's tets, in the order of the input. */
static double *tet_volumes(const job *j, double *total) {
    bw_model model;
    bw_model_options options;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_model_options_defaults(&options);
    options.size = j->size, options.noise = 0.6, options.seed = kit_seed(); /* as encode_prepare has it */
    kit_expect_ok(&ctx, bw_model_make(&ctx, j->name, &options, &model));
    double *volume = calloc(model.tet_count, sizeof *volume);
    *total = 0;
    for (size_t t = 0; t < model.tet_count; t++) {
        const int32_t *x = model.tet[t];
        volume[t] = fabs(det(model.position[x[0]], model.position[x[1]], model.position[x[2]],
                             model.position[x[3]])) /
                    6;
        *total += volume[t];
    }
    bw_model_clear(&ctx, &model);
    return volume;
}

static void check_blocks(const job *j) {
    vtu v = open_vtu("blocks.vtu");
    size_t cells = attribute(&v, "NumberOfCells"), points = attribute(&v, "NumberOfPoints"), corners, numbers;
    assert_int_equal(cells, j->e.cells.cell_count);
    double(*point)[3] = array_of(&v, "Points", 8, 3 * points);
    int32_t *corner = array(&v, "connectivity", 4, &corners), *faces = array(&v, "faces", 4, &numbers);
    int64_t *offset = array_of(&v, "offsets", 8, cells), *face_offset = array_of(&v, "faceoffsets", 8, cells);
    int32_t *block = array_of(&v, "block", 4, cells), *tet = array_of(&v, "tet", 4, cells);
    expect_type(&v, cells, 42);
    assert_int_equal(offset[cells - 1], corners);
    assert_int_equal(face_offset[cells - 1], numbers);
    double total, *left = tet_volumes(j, &total);
    for (size_t c = 0; c < cells; c++) {
        size_t from = c ? (size_t)offset[c - 1] : 0, face_from = c ? (size_t)face_offset[c - 1] : 0;
        const int32_t *face = faces + face_from;
        assert_int_equal(block[c], j->e.complex.cell_block[c]);
        expect_closed(face + 1, (size_t)face[0]);
        expect_points(corner + from, (size_t)offset[c] - from, face + 1, (size_t)face[0]);
        double volume = volume_of((const double(*)[3])point, face + 1, (size_t)face[0]);
        assert_true(volume > 0); /* outwards */
        assert_true(tet[c] >= 0 && (size_t)tet[c] < j->e.mesh.tet_count);
        left[tet[c]] -= volume;
    }
    for (size_t t = 0; t < j->e.mesh.tet_count; t++)
        assert_true(fabs(left[t]) < 1e-12 * total); /* its cells fill it */
    free(point), free(corner), free(faces), free(offset), free(face_offset), free(block), free(tet);
    free(left), free(v.bytes);
}

/* ---- walls, arcs, nodes -------------------------------------------------------------------------------- */

static void check_walls(const job *j) {
    const bw_complex *x = &j->e.complex;
    vtu v = open_vtu("walls.vtu");
    size_t cells = attribute(&v, "NumberOfCells"), corners;
    assert_int_equal(cells, x->patch_polygon_begin[x->patch_count]);
    int32_t *patch = array_of(&v, "patch", 4, cells), *blocks = array_of(&v, "blocks", 4, 2 * cells),
            *corner = array(&v, "connectivity", 4, &corners);
    int64_t *offset = array_of(&v, "offsets", 8, cells);
    double *distance = array_of(&v, "distance", 8, cells),
           (*point)[3] = array_of(&v, "Points", 8, 3 * attribute(&v, "NumberOfPoints"));
    uint8_t *boundary = array_of(&v, "boundary", 1, cells), *flags = array_of(&v, "flags", 1, cells);
    expect_type(&v, cells, 7);
    for (size_t i = 0; i < cells; i++) {
        bw_polygon p = x->patch_polygon[i];
        assert_true(i >= x->patch_polygon_begin[patch[i]] && i < x->patch_polygon_begin[patch[i] + 1]);
        assert_int_equal(blocks[2 * i], x->patch_block[patch[i]][0]);
        assert_int_equal(blocks[2 * i + 1], x->patch_block[patch[i]][1]);
        assert_int_equal(boundary[i], blocks[2 * i + 1] < 0);
        assert_int_equal(flags[i], x->patch_flags[patch[i]]);
        assert_true(distance[i] == ldexp((double)bw_cells_distance(&j->e.cells, p), -j->e.map.exponent));
        bw_half h = j->e.cells.polygon[p].half;
        size_t from = i ? (size_t)offset[i - 1] : 0;
        assert_true((size_t)offset[i] >= from + 3);
        for (size_t k = from; k < (size_t)offset[i]; k++, h = j->e.cells.half[h].next)
            assert_memory_equal(point[corner[k]], j->at[j->e.cells.half[h].origin], sizeof *point);
        assert_int_equal(h, j->e.cells.polygon[p].half); /* all the way around */
    }
    free(patch), free(blocks), free(corner), free(offset), free(distance), free(point), free(boundary),
        free(flags), free(v.bytes);
}

static void check_arcs(const job *j) {
    const bw_complex *x = &j->e.complex;
    vtu v = open_vtu("arcs.vtu");
    size_t arcs = attribute(&v, "NumberOfCells"), corners;
    assert_int_equal(arcs, x->arc_count);
    int32_t *arc = array_of(&v, "arc", 4, arcs), *quarters = array_of(&v, "quarters", 4, arcs),
            *corner = array(&v, "connectivity", 4, &corners);
    int64_t *offset = array_of(&v, "offsets", 8, arcs);
    double *length = array_of(&v, "length", 8, arcs),
           (*point)[3] = array_of(&v, "Points", 8, 3 * attribute(&v, "NumberOfPoints"));
    uint8_t *singular = array_of(&v, "singular", 1, arcs), *t = array_of(&v, "t", 1, arcs),
            *boundary = array_of(&v, "boundary", 1, arcs);
    expect_type(&v, arcs, 4);
    for (size_t a = 0; a < arcs; a++) {
        size_t from = a ? (size_t)offset[a - 1] : 0, to = (size_t)offset[a];
        assert_int_equal(arc[a], a);
        assert_int_equal(to - from, x->arc_edge_begin[a + 1] - x->arc_edge_begin[a] + 1);
        assert_memory_equal(point[corner[from]], j->at[x->node_vertex[x->arc_node[a][0]]], sizeof *point);
        assert_memory_equal(point[corner[to - 1]], j->at[x->node_vertex[x->arc_node[a][1]]], sizeof *point);
        for (size_t k = from; k + 1 < to; k++) assert_int_not_equal(corner[k], corner[k + 1]);
        assert_true(length[a] == ldexp((double)x->arc_length[a], -j->e.map.exponent));
        assert_int_equal(quarters[a], x->arc_quarters[a]);
        assert_int_equal(singular[a], !!(x->arc_flags[a] & BW_ARC_SINGULAR));
        assert_int_equal(boundary[a], !!(x->arc_flags[a] & BW_ARC_BOUNDARY));
        assert_int_equal(t[a], !!(x->arc_flags[a] & BW_ARC_T));
    }
    free(arc), free(quarters), free(corner), free(offset), free(length), free(point), free(singular), free(t),
        free(boundary), free(v.bytes);
}

static void check_nodes(const job *j) {
    const bw_complex *x = &j->e.complex;
    vtu v = open_vtu("nodes.vtu");
    size_t nodes = attribute(&v, "NumberOfCells");
    assert_int_equal(nodes, x->node_count);
    int32_t *node = array_of(&v, "node", 4, nodes), *corner = array_of(&v, "connectivity", 4, nodes);
    int64_t *offset = array_of(&v, "offsets", 8, nodes);
    uint8_t *flags = array_of(&v, "flags", 1, nodes), *singular = array_of(&v, "singular", 1, nodes);
    double(*point)[3] = array_of(&v, "Points", 8, 3 * attribute(&v, "NumberOfPoints"));
    expect_type(&v, nodes, 1);
    for (size_t n = 0; n < nodes; n++) {
        assert_int_equal(node[n], n);
        assert_int_equal(offset[n], n + 1);
        assert_int_equal(flags[n], x->node_flags[n]);
        assert_int_equal(singular[n], x->node_flags[n] & BW_NODE_SINGULAR);
        assert_memory_equal(point[corner[n]], j->at[x->node_vertex[n]], sizeof *point);
    }
    free(node), free(corner), free(offset), free(flags), free(singular), free(point), free(v.bytes);
}

static void for_each_sample(void (*check)(const job *j)) {
    for (int i = 0; i < SAMPLES; i++)
        for (int kind = 0; kind < 2; kind++) {
            job j;
            begin(&j, samples[i].name, samples[i].size, kind ? BW_COMPLEX_BC : BW_COMPLEX_MC);
            check(&j);
            end(&j);
        }
}

static void blocks_are_closed_polyhedra_that_fill_the_model(void **state) {
    (void)state;
    for_each_sample(check_blocks);
}

static void walls_are_the_polygons_of_the_patches(void **state) {
    (void)state;
    for_each_sample(check_walls);
}

static void arcs_run_from_node_to_node(void **state) {
    (void)state;
    for_each_sample(check_arcs);
}

static void nodes_are_where_the_complex_has_them(void **state) {
    (void)state;
    for_each_sample(check_nodes);
}

static void the_same_complex_gives_the_same_bytes(void **state) {
    (void)state;
    char *first[BW_VTM_FILES];
    size_t size[BW_VTM_FILES];
    for (int run = 0; run < 2; run++) {
        job j;
        begin(&j, "torus-quarter", 1, BW_COMPLEX_MC);
        for (int f = 0; f < BW_VTM_FILES; f++) {
            size_t n;
            char *bytes = kit_read_file(kit_temp_path("%s", names[f]), &n);
            assert_string_equal(j.written[f].name, names[f]);
            assert_int_equal(j.written[f].bytes, n);
            assert_false(kit_exists(kit_temp_path("%s.part", names[f])));
            if (!run) first[f] = bytes, size[f] = n;
            if (run)
                assert_int_equal(n, size[f]), assert_memory_equal(bytes, first[f], n), free(bytes),
                    free(first[f]);
        }
        end(&j);
    }
}

static void every_refused_allocation_is_an_error_without_a_leak(void **state) {
    (void)state;
    job j;
    begin(&j, "plus", 1, BW_COMPLEX_MC);
    assert_true(kit_fail_each_allocation(write_job, &j) > 15);
    for (int f = 0; f < BW_VTM_FILES; f++) assert_false(kit_exists(kit_temp_path("%s.part", names[f])));
    end(&j);
}

static void a_folder_that_is_not_there_is_an_io_error(void **state) {
    (void)state;
    job j;
    begin(&j, "cuboid", 1, BW_COMPLEX_MC);
    j.folder = kit_temp_path("missing");
    kit_expect_status(&j.e.ctx, write_job(&j.e.ctx, &j), BW_E_IO);
    end(&j);
}

/* ---- VTK ----------------------------------------------------------------------------------------------- */

static const char reads_with_vtk[] =
    "import sys\n"
    "try:\n"
    "    import vtk\n"
    "except ImportError:\n"
    "    sys.exit(77)\n"
    "r = vtk.vtkXMLMultiBlockDataReader(); r.SetFileName(sys.argv[1]); r.Update()\n"
    "m = r.GetOutput()\n"
    "for i in range(4):\n"
    "    g = m.GetBlock(i); kinds = vtk.vtkCellTypes(); g.GetCellTypes(kinds)\n"
    "    arrays = [g.GetCellData().GetArrayName(k) for k in range(g.GetCellData().GetNumberOfArrays())]\n"
    "    name = m.GetMetaData(i).Get(vtk.vtkCompositeDataSet.NAME())\n"
    "    print(name, g.GetNumberOfCells(), kinds.GetNumberOfTypes(), kinds.GetCellType(0), *arrays)\n"
    "g = m.GetBlock(0)\n"
    "f = vtk.vtkDataSetSurfaceFilter(); f.SetInputData(g); t = vtk.vtkTriangleFilter(); "
    "t.SetInputConnection(f.GetOutputPort())\n"
    "p = vtk.vtkMassProperties(); p.SetInputConnection(t.GetOutputPort()); p.Update()\n"
    "print('volume %.6g' % p.GetVolume())\n";

static void vtk_reads_what_was_written(void **state) {
    (void)state;
    job j;
    begin(&j, "cylinder", 1, BW_COMPLEX_MC);
    const char *script = kit_temp_path("read.py");
    kit_write_text(script, reads_with_vtk);
    kit_result r =
        kit_run((const char *const[]){"/usr/bin/python3", script, kit_temp_path("complex.vtm"), NULL});
    if (r.exit == 77 || r.exit == 127) {
        kit_result_clear(&r);
        end(&j);
        kit_skip("python3-vtk9 is not installed");
    }
    double volume = 0;
    for (size_t t = 0; t < j.e.mesh.tet_count; t++) {
        const bw_vertex *x = j.e.mesh.tet[t];
        volume += fabs(det(j.e.mesh.position[x[0]], j.e.mesh.position[x[1]], j.e.mesh.position[x[2]],
                           j.e.mesh.position[x[3]])) /
                  6;
    }
    char wanted[600];
    const bw_complex *x = &j.e.complex;
    snprintf(wanted, sizeof wanted,
             "blocks %zu 1 42 block tet\nwalls %zu 1 7 patch blocks distance boundary flags\n"
             "arcs %zu 1 4 arc length quarters singular boundary t flags\nnodes %zu 1 1 node singular "
             "boundary flags\nvolume %.6g\n",
             j.e.cells.cell_count, x->patch_polygon_begin[x->patch_count], x->arc_count, x->node_count,
             volume);
    if (r.exit || *r.err) fail_msg("python3: exit %d: %s", r.exit, r.err);
    assert_string_equal(r.out, wanted);
    kit_result_clear(&r);
    end(&j);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(blocks_are_closed_polyhedra_that_fill_the_model),
    cmocka_unit_test(walls_are_the_polygons_of_the_patches),
    cmocka_unit_test(arcs_run_from_node_to_node),
    cmocka_unit_test(nodes_are_where_the_complex_has_them),
    cmocka_unit_test(the_same_complex_gives_the_same_bytes),
    cmocka_unit_test(every_refused_allocation_is_an_error_without_a_leak),
    cmocka_unit_test(a_folder_that_is_not_there_is_an_io_error),
    cmocka_unit_test(vtk_reads_what_was_written),
};
KIT_MAIN(tests)
