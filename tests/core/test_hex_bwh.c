/* The compact form of hex meshes (format/hex_bwh.h): both decoders of clients/decode give back every bit, or the nearest point of the lattice, and tell what is
 * wrong with a damaged file.
 *
 * Corpus of fuzz_bwh: BW_KEEP=1 keeps NAME.bwh of this test; each goes there after a byte 1 (put checksums right) or 0.
 */
#include "core/hex_files.h"

#include <math.h>
#include <unistd.h>

#include "bwh.h"
#include "format/hex_bwh.h"
#include "hex/predict.h"

/* ---- what was written, decoded in C -------------------------------------------------------------------------------- */

typedef struct {
    int32_t block, ijk[3];
    size_t hex;
} place;

static int by_place(const void *a, const void *b) {
    const place *x = a, *y = b;
    if (x->block != y->block) return (uint32_t)x->block < (uint32_t)y->block ? -1 : 1; /* no block: last */
    for (int k = 2; k >= 0; k--)
        if (x->ijk[k] != y->ijk[k]) return x->ijk[k] < y->ijk[k] ? -1 : 1;
    return (x->hex > y->hex) - (x->hex < y->hex);
}

/* The hexes of a mesh in the order of the compact form; listed: blocks that are told hex by hex. */
static place *sorted(const bw_hex_mesh *mesh, uint32_t listed) {
    place *p = calloc(mesh->hex_count, sizeof *p);
    for (size_t h = 0; h < mesh->hex_count; h++) {
        p[h].block = mesh->block[h], p[h].hex = h;
        if (mesh->block[h] >= 0 && !(listed >> mesh->block[h] & 1)) memcpy(p[h].ijk, mesh->ijk[h], sizeof p[h].ijk);
    }
    qsort(p, mesh->hex_count, sizeof *p, by_place);
    return p;
}

/* The same bits; with bits, within half a step, and the mesh gets the positions that were decoded. */
static void check_position(double position[3], const double got[3], int bits, const double step[3]) {
    if (!bits) assert_memory_equal(position, got, 3 * sizeof *position);
    for (int k = 0; k < 3 && bits; k++) {
        assert_true(fabs(position[k] - got[k]) <= 0.5 * step[k] * (1 + 1e-9));
        position[k] = got[k];
    }
}

static void check_decoded(const bw_hex_mesh *mesh, uint32_t listed, const bwh_mesh *got, int bits, const double step[3]) {
    place *order = sorted(mesh, listed);
    int32_t *number = malloc(mesh->vertex_count * sizeof *number);
    memset(number, 0xff, mesh->vertex_count * sizeof *number);
    assert_int_equal(got->vertex_count, mesh->vertex_count);
    assert_int_equal(got->hex_count, mesh->hex_count);
    assert_int_equal(got->subdivide, mesh->subdivide);
    for (size_t i = 0; i < mesh->hex_count; i++) {
        size_t h = order[i].hex;
        bool by_itself = mesh->block[h] < 0 || (listed >> mesh->block[h] & 1);
        assert_int_equal(got->block[i], mesh->block[h]);
        for (int k = 0; k < 3; k++) assert_int_equal(got->ijk[i][k], by_itself ? -1 : mesh->ijk[h][k]);
        for (int c = 0; c < 8; c++) {
            bw_hvertex v = mesh->hex[h][c], w = got->hex[i][c];
            if (number[v] < 0) {
                number[v] = w;
                check_position(mesh->position[v], got->position[w], bits, step);
                assert_int_equal(mesh->held[v], got->held[w]);
            }
            assert_int_equal(number[v], w); /* one to one, for there are as many */
        }
    }
    free(number);
    free(order);
}

static void write_truth(bw_context *ctx, const bw_hex_mesh *mesh, const char *name) {
    bw_hex_skin skin;
    kit_expect_ok(ctx, bw_hex_skin_init(ctx, mesh, &skin));
    hex_files_truth(mesh, &skin, kit_temp_path("%s.json", name));
    bw_hex_skin_clear(ctx, &skin);
}

static char *write_sample(bw_context *ctx, const bw_hex_mesh *mesh, int bits, const char *name, size_t *size, bw_bwh_sizes *sizes) {
    const char *path = kit_temp_path("%s.bwh", name);
    kit_expect_ok(ctx, bw_bwh_write(ctx, mesh, bits, path, sizes));
    char *data = kit_read_file(path, size);
    assert_int_equal(*size, sizes->header + sizes->shape + sizes->places);
    return data;
}

/* Positions of the mesh become those that were decoded. Returns the kind of the file. */
static bw_bwh_kind round_trip(bw_context *ctx, bw_hex_mesh *mesh, uint32_t listed, int bits, const char *name) {
    size_t size;
    bwh_mesh got;
    bw_bwh_sizes sizes;
    bw_bwh_header header;
    char *data = write_sample(ctx, mesh, bits, name, &size, &sizes);
    assert_int_equal(bwh_decode(data, size, 0, &got), BWH_OK);
    assert_true(bits ? got.step > 0 : got.step == 0);
    check_decoded(mesh, listed, &got, bits, sizes.step);
    write_truth(ctx, mesh, name);
    memcpy(&header, data, sizeof header);
    printf("%s: %zu vertices, %zu hexes, kind %d of %d, %zu bytes (shape %zu, places %zu)\n", name, mesh->vertex_count, mesh->hex_count, header.kind, header.parameter,
           size, (size_t)sizes.shape, (size_t)sizes.places);
    assert_int_equal(bwh_decode(data, size, 25 * got.vertex_count + 48 * got.hex_count - 1, &(bwh_mesh){0}), BWH_LIMIT);
    bwh_clear(&got);
    free(data);
    return (bw_bwh_kind)header.kind;
}

static void every_bit_comes_back(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    for (int i = 0; i < HEX_KIT_COUNT; i++) {
        bw_hex_mesh mesh;
        hex_kit_sample(&ctx, i, &mesh);
        assert_int_equal(round_trip(&ctx, &mesh, 0, 0, hex_kit_names[i]), BW_BWH_DOUBLES);
        bw_hex_mesh_clear(&ctx, &mesh);
    }
    assert_int_equal(ctx.memory.used, 0);
}

static void any_doubles_come_back(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_hex_mesh mesh;
    kit_random random = kit_random_start(7);
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    for (size_t v = 0; v < mesh.vertex_count; v++)
        for (int k = 0; k < 3; k++) mesh.position[v][k] = v % 7 == 0 ? -0.0 : v % 5 == 0 ? 1.7e308 : kit_random_bits(&random);
    assert_int_equal(round_trip(&ctx, &mesh, 0, 0, "doubles"), BW_BWH_DOUBLES);
    bw_hex_mesh_clear(&ctx, &mesh);
}

/* Meshes of few digits, of floats, of whole numbers. -0 is no decimal. */
static void few_digits_are_coded_as_few(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_hex_mesh mesh;
    size_t size[4];
    for (int i = 0; i < 4; i++) {
        bw_bwh_sizes sizes;
        hex_kit_sample(&ctx, HEX_KIT_GRID, &mesh);
        for (size_t v = 0; v < mesh.vertex_count; v++)
            for (int k = 0; k < 3; k++) {
                double *x = &mesh.position[v][k];
                if (i == 1) *x = (double)(float)*x;
                if (i == 2) *x = round(1000 * *x) / 1000;
                if (i == 3) *x = round(10 * *x);
                *x += 0; /* -0 becomes 0 */
            }
        const char *name = ((const char *const[]){"all-bits", "floats", "digits", "whole"})[i];
        bw_bwh_kind kind = round_trip(&ctx, &mesh, 0, 0, name);
        assert_int_equal(kind, i < 2 ? BW_BWH_DOUBLES : BW_BWH_DECIMAL);
        free(write_sample(&ctx, &mesh, 0, "again", &size[i], &sizes));
        if (i) assert_true(size[i] < size[i - 1]);
        if (i == 3) {
            mesh.position[mesh.vertex_count / 2][0] = -0.0;
            assert_int_equal(round_trip(&ctx, &mesh, 0, 0, "minus-zero"), BW_BWH_DOUBLES);
        }
        bw_hex_mesh_clear(&ctx, &mesh);
    }
    unlink(kit_temp_path("again.bwh"));
    assert_int_equal(ctx.memory.used, 0);
}

static void a_lattice_is_missed_by_half_a_step_at_most(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    static const int chosen[] = {BW_BWH_LEAST_BITS, 7, 12, 16, BW_BWH_MOST_BITS};
    size_t last = 0;
    for (size_t i = 0; i < sizeof chosen / sizeof *chosen; i++) {
        bw_hex_mesh mesh;
        bw_bwh_sizes sizes;
        size_t size;
        double low[3], high[3];
        hex_kit_sample(&ctx, (int)i % HEX_KIT_COUNT, &mesh);
        bw_predict_box((const double(*)[3])mesh.position, mesh.vertex_count, low, high);
        char name[24];
        snprintf(name, sizeof name, "lattice-%d", chosen[i]);
        assert_int_equal(round_trip(&ctx, &mesh, 0, chosen[i], name), BW_BWH_LATTICE);
        bw_hex_mesh_clear(&ctx, &mesh);
        hex_kit_sample(&ctx, HEX_KIT_GRID, &mesh);
        free(write_sample(&ctx, &mesh, chosen[i], "again", &size, &sizes));
        assert_true(size > last);
        last = size;
        bw_hex_mesh_clear(&ctx, &mesh);
        hex_kit_sample(&ctx, (int)i % HEX_KIT_COUNT, &mesh);
        free(write_sample(&ctx, &mesh, chosen[i], "again", &size, &sizes));
        for (int k = 0; k < 3; k++) /* the lattice is that of the box */
            assert_true(fabs(sizes.step[k] * (double)((1 << chosen[i]) - 1) / (high[k] - low[k]) - 1) < 1e-8);
        bw_hex_mesh_clear(&ctx, &mesh);
    }
    unlink(kit_temp_path("again.bwh"));
    assert_int_equal(ctx.memory.used, 0);
}

/* All vertices in one plane, in one point, and the box of the largest numbers. */
static void flat_meshes_have_a_lattice_too(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_hex_mesh mesh;
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    for (size_t v = 0; v < mesh.vertex_count; v++) mesh.position[v][1] = 0.7;
    round_trip(&ctx, &mesh, 0, 12, "plane");
    for (size_t v = 0; v < mesh.vertex_count; v++) mesh.position[v][0] = mesh.position[v][2] = -1e-310 * (double)(v & 1);
    bw_bwh_sizes sizes;
    size_t size;
    bwh_mesh got;
    char *data = write_sample(&ctx, &mesh, 12, "again", &size, &sizes);
    assert_int_equal(bwh_decode(data, size, 0, &got), BWH_OK);
    bwh_clear(&got);
    free(data);
    unlink(kit_temp_path("again.bwh"));
    for (size_t v = 0; v < mesh.vertex_count; v++) mesh.position[v][0] = v & 1 ? 1.7e308 : -1.7e308;
    kit_expect_status(&ctx, bw_bwh_write(&ctx, &mesh, 12, kit_temp_path("none.bwh"), &sizes), BW_E_LIMIT);
    bw_hex_mesh_clear(&ctx, &mesh);
}

/* Blocks that are not known, do not fill their box, or have a hex twice at one place. */
static void what_is_no_grid_is_listed_hex_by_hex(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_hex_mesh mesh;
    hex_kit_sample(&ctx, HEX_KIT_GRID, &mesh);
    for (size_t h = 0; h < mesh.hex_count; h++)
        if (mesh.block[h] == 1) mesh.block[h] = BW_NONE;
    for (size_t h = 0; h < mesh.hex_count; h++)
        if (mesh.block[h] == 2) {
            mesh.ijk[h][0] += 1000;
            break;
        }
    round_trip(&ctx, &mesh, 4, 0, "listed");
    bw_hex_mesh_clear(&ctx, &mesh);
    hex_kit_sample(&ctx, HEX_KIT_GRID, &mesh);
    memcpy(mesh.ijk[1], mesh.ijk[0], sizeof *mesh.ijk);
    round_trip(&ctx, &mesh, 1, 0, "twice");
    for (size_t h = 0; h < mesh.hex_count; h++) mesh.block[h] = BW_NONE;
    round_trip(&ctx, &mesh, 0, 0, "no-blocks");
    bw_hex_mesh_clear(&ctx, &mesh);
}

/* ---- damage -------------------------------------------------------------------------------------------------------- */

static void a_damaged_file_is_told_by_its_code(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_hex_mesh mesh;
    bwh_mesh got;
    bw_bwh_sizes sizes;
    size_t size;
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    unsigned char *data = (unsigned char *)write_sample(&ctx, &mesh, 12, "damage", &size, &sizes);
    write_truth(&ctx, &mesh, "damage");
    unlink(kit_temp_path("damage.bwh"));
    for (size_t cut = 0; cut < size; cut++) assert_int_equal(bwh_decode(data, cut, 0, &got), cut < 8 ? BWH_NOT_BWH : BWH_TRUNCATED);
    for (size_t at = 0; at < size; at++) {
        data[at] ^= 0x10;
        bwh_status wanted = at < 8 ? BWH_NOT_BWH : at < 12 ? BWH_VERSION : at >= 40 && at < 48 ? BWH_TRUNCATED : BWH_CHECKSUM, status = bwh_decode(data, size, 0, &got);
        if (at >= 48 && at < 56) assert_true(status == BWH_TRUNCATED || status == BWH_CHECKSUM); /* sizes of streams */
        else assert_int_equal(status, wanted);
        assert_null(got.position);
        data[at] ^= 0x10;
    }
    assert_int_equal(bwh_decode(data, size, 0, &got), BWH_OK);
    bwh_clear(&got);
    free(data);
    bw_hex_mesh_clear(&ctx, &mesh);
}

static uint32_t crc_of(const unsigned char *p, size_t size) {
    uint32_t crc = ~0u;
    for (size_t i = 0; i < size; i++) {
        crc ^= p[i];
        for (int k = 0; k < 8; k++) crc = crc & 1 ? crc >> 1 ^ 0xedb88320u : crc >> 1;
    }
    return ~crc;
}

/* Puts size and checksums right, as fuzz_bwh.c does. */
static void seal(unsigned char *p, uint64_t size) {
    size_t front = size > 36 && p[36] == BW_BWH_LATTICE ? 112 : 64;
    if (size < front) return;
    memcpy(p + 40, &size, sizeof size);
    memset(p + 60, 0, 4);
    uint32_t crc = crc_of(p + front, (size_t)size - front);
    memcpy(p + 56, &crc, sizeof crc);
    crc = crc_of(p, front);
    memcpy(p + 60, &crc, sizeof crc);
}

/* A lie with right checksums: at `at` (32 bits) stands `value`. */
static bwh_status with_lie(const char *data, size_t size, size_t at, uint32_t value) {
    unsigned char *copy = malloc(size);
    memcpy(copy, data, size);
    memcpy(copy + at, &value, 4);
    seal(copy, size);
    bwh_mesh got;
    bwh_status status = bwh_decode(copy, size, 0, &got);
    bwh_clear(&got);
    free(copy);
    return status;
}

static void a_lie_with_right_checksums_is_found(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_hex_mesh mesh;
    bw_bwh_sizes sizes;
    size_t size;
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    char *data = write_sample(&ctx, &mesh, 12, "lies", &size, &sizes);
    unlink(kit_temp_path("lies.bwh"));
    uint32_t vertices = (uint32_t)mesh.vertex_count, hexes = (uint32_t)mesh.hex_count, shape = (uint32_t)sizes.shape, places = (uint32_t)sizes.places;
    const uint32_t infinity = 0x7ff00000, minus_one = 0xbff00000;
    assert_int_equal(with_lie(data, size, 32, 1), BWH_OK); /* subdivide, and it is 1 */
    const struct {
        size_t at;
        uint32_t value;
        bwh_status status;
    } lies[] = {
        {12, 2, BWH_DAMAGED},            {12, 4, BWH_DAMAGED},                 {12, 0xffffffff, BWH_DAMAGED},                   /* parts */
        {16, vertices - 1, BWH_DAMAGED}, {16, vertices + 1, BWH_DAMAGED},      {16, 0x7fffffff, BWH_DAMAGED}, {20, 1, BWH_DAMAGED}, /* vertices */
        {24, hexes - 1, BWH_DAMAGED},    {24, hexes + 1, BWH_DAMAGED},         {28, 1, BWH_DAMAGED},                            /* hexes */
        {36, 3, BWH_DAMAGED},            {36, 12 << 8, BWH_DAMAGED},           {36, 2 | 3 << 8, BWH_DAMAGED},                   /* kind, bits */
        {36, 2 | 25 << 8, BWH_DAMAGED},  {36, 2 | 12 << 8 | 1 << 16, BWH_DAMAGED}, {36, 2 | 4 << 8, BWH_DAMAGED},               /* kind, bits, zeros */
        {48, shape - 1, BWH_DAMAGED},    {48, shape + places + 1, BWH_TRUNCATED}, {48, 0, BWH_DAMAGED},                         /* sizes of streams */
        {52, places + 1, BWH_TRUNCATED}, {52, 0, BWH_DAMAGED},                 {52, 0xffffffff, BWH_TRUNCATED},
        {68, infinity, BWH_DAMAGED},     {92, infinity, BWH_DAMAGED},          {92, minus_one, BWH_DAMAGED},                    /* low, step */
    };
    for (size_t i = 0; i < sizeof lies / sizeof *lies; i++) {
        bwh_status status = with_lie(data, size, lies[i].at, lies[i].value);
        if (status != lies[i].status) fail_msg("lie %zu: %s", i, bwh_text(status));
    }
    free(data);
    bw_hex_mesh_clear(&ctx, &mesh);
}

/* ---- sizes --------------------------------------------------------------------------------------------------------- */

/* The whole file at 12 bits against what X 4.1 estimates for the coordinates alone. */
static void the_file_is_smaller_than_the_estimate(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    static const hex_kit_box box[] = {{{0, 0, 0}, {12, 10, 8}}, {{12, 0, 0}, {20, 10, 8}}, {{0, 0, 8}, {10, 10, 14}}, {{10, 2, 8}, {20, 8, 14}}};
    bw_hex_mesh mesh;
    hex_kit_boxes(&ctx, box, 4, 5, &mesh);
    for (size_t v = 0; v < mesh.vertex_count; v++) {
        double *p = mesh.position[v], bend = 0.1 * p[0];
        double x = (20 + p[2]) * sin(bend), z = (20 + p[2]) * cos(bend);
        p[0] = x, p[2] = z + 0.1 * p[1] * p[1];
    }
    bool known;
    bw_predict_report report;
    bw_bwh_sizes sizes;
    size_t size;
    kit_expect_ok(&ctx, bw_predict_mesh(&ctx, &mesh, 12, &known, &report));
    assert_true(known);
    free(write_sample(&ctx, &mesh, 12, "bent", &size, &sizes));
    unlink(kit_temp_path("bent.bwh"));
    double whole = 8 * (double)size / (double)mesh.vertex_count, places = 8 * (double)sizes.places / (double)mesh.vertex_count;
    printf("%zu vertices: E_g %.2f pooled, %.2f by blocks; %.2f bits per vertex written, %.2f of them coordinates\n", mesh.vertex_count, report.e_g_pooled,
           report.e_g_blocks, whole, places);
    assert_true(places < whole && whole <= 1.05 * report.e_g_pooled && whole <= 1.05 * report.e_g_blocks);
    bw_hex_mesh_clear(&ctx, &mesh);
}

/* ---- both decoders on what fuzz_bwh.c found ------------------------------------------------------------------------- */

/* A line for each file: its name, the code, and checksums of positions and hexes. check_bwh.mjs expects the same of the other decoder. */
static void the_corpus_is_judged(void **state) {
    (void)state;
    static const char *const code[] = {"ok", "not-bwh", "version", "truncated", "checksum", "damaged", "limit", "memory"};
    const char *folder = BW_SOURCE_DIR "/tests/fuzz/corpus/bwh";
    size_t count, times[8] = {0};
    char **names = kit_names(folder, "", &count);
    FILE *out = fopen(kit_temp_path("judged.txt"), "w");
    for (size_t i = 0; i < count; i++) {
        size_t size;
        bwh_mesh mesh;
        char path[512];
        snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        char *bytes = kit_read_file(path, &size);
        unsigned char *data = malloc(size);
        memcpy(data, bytes + 1, size - 1);
        if (bytes[0] & 1) seal(data, size - 1);
        bwh_status status = bwh_decode(data, size - 1, 1 << 24, &mesh);
        times[status]++;
        fprintf(out, "%s %s %08x %08x\n", names[i], code[status], crc_of((const unsigned char *)mesh.position, mesh.vertex_count * sizeof *mesh.position),
                crc_of((const unsigned char *)mesh.hex, mesh.hex_count * sizeof *mesh.hex));
        bwh_clear(&mesh);
        free(bytes), free(data);
    }
    assert_int_equal(fclose(out), 0);
    printf("%zu files: %zu good, %zu damaged\n", count, times[BWH_OK], times[BWH_DAMAGED]);
    assert_true(times[BWH_OK] > 10 && times[BWH_DAMAGED] > 10);
    kit_names_free(names, count);
}

/* ---- JavaScript ---------------------------------------------------------------------------------------------------- */

static void the_decoder_in_javascript_gives_the_same(void **state) {
    (void)state;
    kit_result version = kit_run((const char *const[]){"node", "--version", NULL});
    bool there = version.exit == 0;
    kit_result_clear(&version);
    if (!there) kit_skip("node is not installed");
    const char *script = BW_SOURCE_DIR "/tests/core/check_bwh.mjs";
    kit_result r = kit_run((const char *const[]){"node", script, kit_temp_dir(), NULL});
    printf("%s", r.out);
    if (r.exit) fail_msg("node: exit %d: %s", r.exit, r.err);
    kit_result_clear(&r);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(every_bit_comes_back),
    cmocka_unit_test(any_doubles_come_back),
    cmocka_unit_test(few_digits_are_coded_as_few),
    cmocka_unit_test(a_lattice_is_missed_by_half_a_step_at_most),
    cmocka_unit_test(flat_meshes_have_a_lattice_too),
    cmocka_unit_test(what_is_no_grid_is_listed_hex_by_hex),
    cmocka_unit_test(a_damaged_file_is_told_by_its_code),
    cmocka_unit_test(a_lie_with_right_checksums_is_found),
    cmocka_unit_test(the_file_is_smaller_than_the_estimate),
    cmocka_unit_test(the_corpus_is_judged),
    cmocka_unit_test(the_decoder_in_javascript_gives_the_same),
};
KIT_MAIN(tests)
