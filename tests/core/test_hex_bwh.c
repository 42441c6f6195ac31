/* The compact form of hex meshes (format/hex_bwh.h): both decoders of clients/decode give back every bit, and tell what is wrong with a damaged file.
 *
 * Corpus of fuzz_bwh: BW_KEEP=1 keeps NAME.bwh of this test; each goes there after a byte 1 (put checksums right) or 0.
 */
#include "core/hex_files.h"

#include <math.h>

#include "bwh.h"
#include "format/hex_bwh.h"

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

static void check_decoded(const bw_hex_mesh *mesh, uint32_t listed, const bwh_mesh *got) {
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
                assert_memory_equal(mesh->position[v], got->position[w], sizeof *mesh->position);
                assert_int_equal(mesh->held[v], got->held[w]);
            }
            assert_int_equal(number[v], w); /* one to one, for there are as many */
        }
    }
    free(number);
    free(order);
}

static char *write_sample(bw_context *ctx, const bw_hex_mesh *mesh, const char *name, size_t *size) {
    uint64_t bytes;
    bw_hex_skin skin;
    const char *path = kit_temp_path("%s.bwh", name);
    kit_expect_ok(ctx, bw_hex_skin_init(ctx, mesh, &skin));
    hex_files_truth(mesh, &skin, kit_temp_path("%s.json", name));
    kit_expect_ok(ctx, bw_hex_write_bwh(ctx, mesh, &skin, path, &bytes));
    bw_hex_skin_clear(ctx, &skin);
    char *data = kit_read_file(path, size);
    assert_int_equal(*size, bytes);
    return data;
}

static void round_trip(bw_context *ctx, const bw_hex_mesh *mesh, uint32_t listed, const char *name) {
    size_t size;
    bwh_mesh got;
    char *data = write_sample(ctx, mesh, name, &size);
    assert_int_equal(bwh_decode(data, size, 0, &got), BWH_OK);
    check_decoded(mesh, listed, &got);
    printf("%s: %zu vertices, %zu hexes, %zu bytes\n", name, mesh->vertex_count, mesh->hex_count, size);
    assert_int_equal(bwh_decode(data, size, 25 * got.vertex_count + 48 * got.hex_count - 1, &(bwh_mesh){0}), BWH_LIMIT);
    bwh_clear(&got);
    free(data);
}

static void every_bit_comes_back(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    for (int i = 0; i < HEX_KIT_COUNT; i++) {
        bw_hex_mesh mesh;
        hex_kit_sample(&ctx, i, &mesh);
        round_trip(&ctx, &mesh, 0, hex_kit_names[i]);
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
    round_trip(&ctx, &mesh, 0, "doubles");
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
    round_trip(&ctx, &mesh, 4, "listed");
    bw_hex_mesh_clear(&ctx, &mesh);
    hex_kit_sample(&ctx, HEX_KIT_GRID, &mesh);
    memcpy(mesh.ijk[1], mesh.ijk[0], sizeof *mesh.ijk);
    round_trip(&ctx, &mesh, 1, "twice");
    for (size_t h = 0; h < mesh.hex_count; h++) mesh.block[h] = BW_NONE;
    round_trip(&ctx, &mesh, 0, "no-blocks");
    bw_hex_mesh_clear(&ctx, &mesh);
}

/* ---- damage -------------------------------------------------------------------------------------------------------- */

static void a_damaged_file_is_told_by_its_code(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_hex_mesh mesh;
    bwh_mesh got;
    size_t size;
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    unsigned char *data = (unsigned char *)write_sample(&ctx, &mesh, "damage", &size);
    for (size_t cut = 0; cut < size; cut++) assert_int_equal(bwh_decode(data, cut, 0, &got), cut < 8 ? BWH_NOT_BWH : BWH_TRUNCATED);
    for (size_t at = 0; at < size; at++) {
        data[at] ^= 0x10;
        bwh_status wanted = at < 8 ? BWH_NOT_BWH : at < 12 ? BWH_VERSION : at >= 40 && at < 48 ? BWH_TRUNCATED : BWH_CHECKSUM, status = bwh_decode(data, size, 0, &got);
        if (at >= 12 && at < 16) assert_true(status == BWH_TRUNCATED || status == BWH_CHECKSUM); /* the number of parts */
        else if (at >= 36 && at < 40) assert_int_equal(status, BWH_DAMAGED);
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

/* A lie with a right checksum: at `at` (32 bits) stands `value`. */
static bwh_status with_lie(const char *data, size_t size, size_t at, uint32_t value) {
    unsigned char *copy = malloc(size);
    bw_bwh_header header;
    memcpy(copy, data, size);
    memcpy(copy + at, &value, 4);
    memcpy(&header, copy, sizeof header);
    header.crc = 0;
    memcpy(copy, &header, sizeof header);
    header.crc = crc_of(copy, 64 + 16 * header.part_count + 24 * BW_BWH_STREAMS);
    memcpy(copy, &header, sizeof header);
    bwh_mesh got;
    bwh_status status = bwh_decode(copy, size, 0, &got);
    bwh_clear(&got);
    free(copy);
    return status;
}

static void a_lie_with_a_right_checksum_is_found(void **state) {
    (void)state;
    bw_context ctx;
    bw_context_init(&ctx);
    bw_hex_mesh mesh;
    size_t size;
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    char *data = write_sample(&ctx, &mesh, "lies", &size);
    size_t parts = 64, directory = 64 + 3 * 16;
    assert_int_equal(with_lie(data, size, 32, 1), BWH_OK);                                         /* subdivide, and it is 1 */
    assert_int_equal(with_lie(data, size, 16, (uint32_t)mesh.vertex_count + 1), BWH_DAMAGED);      /* vertices */
    assert_int_equal(with_lie(data, size, 24, (uint32_t)mesh.hex_count - 1), BWH_DAMAGED);         /* hexes */
    assert_int_equal(with_lie(data, size, 28, 1), BWH_DAMAGED);                                    /* hexes, high half */
    assert_int_equal(with_lie(data, size, parts, (uint32_t)-2), BWH_DAMAGED);                      /* a block */
    assert_int_equal(with_lie(data, size, parts, (uint32_t)-1), BWH_DAMAGED);                      /* a grid without block */
    for (size_t k = 0; k < 3; k++) {
        assert_int_equal(with_lie(data, size, parts + 4 + 4 * k, 0), BWH_DAMAGED);
        assert_int_equal(with_lie(data, size, parts + 4 + 4 * k, 0x7fffffff), BWH_DAMAGED);
        assert_int_equal(with_lie(data, size, parts + 4 + 4 * k, 0xffffffff), BWH_DAMAGED);
    }
    for (size_t s = 0; s < BW_BWH_STREAMS; s++) {
        assert_int_equal(with_lie(data, size, directory + 24 * s, 2), BWH_DAMAGED);                /* method */
        assert_int_equal(with_lie(data, size, directory + 24 * s + 8, 0x01000000), BWH_DAMAGED);   /* size */
        assert_int_equal(with_lie(data, size, directory + 24 * s + 16, 0x01000000), BWH_TRUNCATED); /* stored */
    }
    free(data);
    bw_hex_mesh_clear(&ctx, &mesh);
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
    cmocka_unit_test(what_is_no_grid_is_listed_hex_by_hex),
    cmocka_unit_test(a_damaged_file_is_told_by_its_code),
    cmocka_unit_test(a_lie_with_a_right_checksum_is_found),
    cmocka_unit_test(the_decoder_in_javascript_gives_the_same),
};
KIT_MAIN(tests)
