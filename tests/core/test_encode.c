/* Encoding a job: every sample model, both complexes; same bytes again; failures leave nothing half written.
 */
#include "core/encode_kit.h"
#include "core/hex_kit.h"
#include "format/hex_write.h"

#include <sys/stat.h>

#include "core/traced_check.h"

static const struct {
    const char *name;
    int size;
} samples[] = {{"cuboid", 2},       {"l-shape", 2}, {"plus", 2},          {"cylinder", 2},
               {"ball", 2},         {"torus", 2},   {"torus-quarter", 2}, {"torus-half", 2},
               {"hollow-torus", 1}, {"tee", 1},     {"bearing", 1}};
enum { SAMPLES = sizeof samples / sizeof *samples };
static const char *const files[] = {"traced.hexex", "blocks.json", "view.drc"};

static void check_traced(const encoded *e, const char *what) {
    traced_verdict v;
    size_t size;
    char *text = encode_read(e, "traced.hexex", &size);
    if (!traced_check(text, true, &v)) fail_msg("traced.hexex of %s cannot be read", what);
    free(text);
    if (traced_faults(&v)) traced_print(what, &v);
    assert_int_equal(traced_faults(&v), 0);
    assert_int_equal(v.blocks, e->complex.block_count);
    assert_int_equal(v.tets, e->report.quality.traced_tets);
    assert_int_equal(v.vertices, e->report.quality.traced_vertices);
    assert_int_equal(v.walls, e->report.quality.traced_walls);
    assert_true(fabs(v.volume - e->report.quality.volume) < 1e-9 * v.volume);
}

static void check_report(const encoded *e) {
    assert_true(e->report.has_quality);
    assert_int_equal(e->report.result_count, 3);
    for (int i = 0; i < 3; i++) {
        size_t size;
        assert_string_equal(e->report.result[i].name, files[i]);
        free(encode_read(e, files[i], &size));
        assert_int_equal(size, e->report.result[i].bytes);
        assert_false(kit_exists(kit_temp_path("%s/%s.part", strrchr(e->folder, '/') + 1, files[i])));
    }
    const bw_report_range *range[] = {&e->report.quality.block_extent, &e->report.quality.block_aspect,
                                      &e->report.quality.block_volume};
    for (int i = 0; i < 3; i++)
        assert_true(0 < range[i]->min && range[i]->min <= range[i]->median &&
                    range[i]->median <= range[i]->max);
    assert_true(e->report.quality.block_aspect.min >= 1);
}

static void every_sample_gives_cuboid_blocks_that_fill_the_model(void **state) {
    (void)state;
    for (int i = 0; i < SAMPLES; i++)
        for (int kind = 0; kind < 2; kind++) {
            encoded e;
            encode_prepare(&e, samples[i].name, samples[i].size, 0.6, kind ? BW_COMPLEX_BC : BW_COMPLEX_MC);
            encode_run(&e);
            check_traced(&e, samples[i].name);
            check_report(&e);
            encode_clear(&e);
        }
}

static void the_same_job_gives_the_same_bytes(void **state) {
    (void)state;
    for (int i = 2; i < SAMPLES; i += 3) {
        char *first[3];
        size_t size[3];
        for (int run = 0; run < 2; run++) {
            encoded e;
            encode_prepare(&e, samples[i].name, samples[i].size, 0.6, BW_COMPLEX_MC);
            e.ctx.threads = run + 1;
            encode_run(&e);
            for (int f = 0; f < 3; f++) {
                size_t n;
                char *text = encode_read(&e, files[f], &n);
                if (run) {
                    assert_int_equal(n, size[f]);
                    assert_memory_equal(text, first[f], n);
                    free(text), free(first[f]);
                } else {
                    first[f] = text, size[f] = n;
                }
            }
            encode_clear(&e);
        }
    }
}

static void a_folder_that_cannot_be_made_is_an_io_error(void **state) {
    (void)state;
    encoded e;
    encode_prepare(&e, "cuboid", 1, 0.5, BW_COMPLEX_MC);
    e.folder = kit_temp_path("missing/folder");
    kit_expect_status(&e.ctx, bw_encode(&e.ctx, &e.mesh, &e.map, &e.cells, &e.complex, NULL, NULL, &(bw_encode_options){.vtk = true}, &e.report, e.folder),
                      BW_E_IO);
    assert_int_equal(e.report.result_count, 0);
    encode_clear(&e);
}

static void a_result_that_cannot_be_put_in_place_leaves_no_draft(void **state) {
    (void)state;
    encoded e;
    encode_prepare(&e, "cuboid", 1, 0.5, BW_COMPLEX_MC);
    e.folder = kit_temp_path("blocked");
    assert_int_equal(mkdir(e.folder, 0777), 0);
    assert_int_equal(mkdir(kit_temp_path("blocked/blocks.json"), 0777), 0); /* a folder in the file's place */
    kit_expect_status(&e.ctx, bw_encode(&e.ctx, &e.mesh, &e.map, &e.cells, &e.complex, NULL, NULL, &(bw_encode_options){.vtk = true}, &e.report, e.folder),
                      BW_E_IO);
    assert_true(kit_exists(kit_temp_path("blocked/traced.hexex")));
    assert_false(kit_exists(kit_temp_path("blocked/blocks.json.part")));
    encode_clear(&e);
}

static volatile sig_atomic_t stop_now;
static void stop(void *user, const char *line) {
    (void)user, (void)line;
    stop_now = 1; /* the first result has been logged */
}

static void a_cancelled_job_stops_after_the_file_it_is_at(void **state) {
    (void)state;
    encoded e;
    encode_prepare(&e, "cuboid", 1, 0.5, BW_COMPLEX_MC);
    e.folder = kit_temp_path("cancelled");
    stop_now = 0;
    e.ctx.cancel = &stop_now;
    e.ctx.log = stop;
    kit_expect_status(&e.ctx, bw_encode(&e.ctx, &e.mesh, &e.map, &e.cells, &e.complex, NULL, NULL, &(bw_encode_options){.vtk = true}, &e.report, e.folder),
                      BW_E_CANCELLED);
    assert_int_equal(e.report.result_count, 1);
    assert_false(kit_exists(kit_temp_path("cancelled/view.drc")));
    encode_clear(&e);
}

static bw_status encode_again(bw_context *ctx, void *user) {
    encoded *e = user;
    bw_report report = e->report;
    return bw_encode(ctx, &e->mesh, &e->map, &e->cells, &e->complex, NULL, NULL, &(bw_encode_options){.vtk = true}, &report, e->folder);
}

static void every_refused_allocation_is_an_error_without_a_leak(void **state) {
    (void)state;
    encoded e;
    encode_prepare(&e, "l-shape", 1, 0.5, BW_COMPLEX_MC);
    assert_true(kit_fail_each_allocation(encode_again, &e) > 40);
    encode_clear(&e);
}

static void a_hex_mesh_is_written_in_the_formats_asked_for(void **state) {
    (void)state;
    encoded e;
    bw_hex_mesh hex;
    encode_prepare(&e, "cuboid", 1, 0.5, BW_COMPLEX_MC);
    hex_kit_sample(&e.ctx, HEX_KIT_TEE, &hex);
    for (unsigned formats = 0; formats < 1u << BW_HEX_FORMAT_COUNT; formats += 85) {
        bw_report report = e.report;
        e.folder = kit_temp_path("formats-%u", formats);
        kit_expect_ok(&e.ctx, bw_encode(&e.ctx, &e.mesh, &e.map, &e.cells, &e.complex, NULL, &hex, &(bw_encode_options){.hex_formats = formats}, &report, e.folder));
        for (int f = 0; f < BW_HEX_FORMAT_COUNT; f++) {
            size_t found = 0, size;
            char name[24];
            snprintf(name, sizeof name, "hexmesh.%s", bw_hex_formats[f].name);
            const char *path = kit_temp_path("formats-%u/%s", formats, name);
            assert_int_equal(kit_exists(path), formats >> f & 1);
            for (size_t r = 0; r < report.result_count; r++) {
                if (strcmp(report.result[r].name, name)) continue;
                free(kit_read_file(path, &size));
                assert_int_equal(report.result[r].bytes, size);
                found++;
            }
            assert_int_equal(found, formats >> f & 1);
        }
    }
    bw_hex_mesh_clear(&e.ctx, &hex);
    encode_clear(&e);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_sample_gives_cuboid_blocks_that_fill_the_model),
        cmocka_unit_test(the_same_job_gives_the_same_bytes),
        cmocka_unit_test(a_folder_that_cannot_be_made_is_an_io_error),
        cmocka_unit_test(a_result_that_cannot_be_put_in_place_leaves_no_draft),
        cmocka_unit_test(a_cancelled_job_stops_after_the_file_it_is_at),
        cmocka_unit_test(a_hex_mesh_is_written_in_the_formats_asked_for),
        cmocka_unit_test(every_refused_allocation_is_an_error_without_a_leak),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
