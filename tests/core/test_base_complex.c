/* The base complex of a hex mesh, found on its quads, is the one that tracing finds by the trivial map: the same blocks, hex by hex. */
#include "core/extract_kit.h"
#include "core/hex_input_kit.h"
#include "hex/base_complex.h"

static size_t blocks_of_base_complex(bw_context *ctx, const bw_igm *igm) {
    bw_cells cells;
    bw_complex complex = {0};
    kit_expect_ok(ctx, bw_cells_init(ctx, &cells, &igm->mesh, &igm->map));
    kit_expect_ok(ctx, bw_trace(ctx, &cells, BW_COMPLEX_BC, 1000000));
    kit_expect_ok(ctx, bw_build_complex(ctx, &cells, &(bw_build_options){.max_cells = 1000000}, &complex));
    size_t blocks = complex.block_count;
    bw_complex_clear(ctx, &complex), bw_cells_clear(ctx, &cells);
    return blocks;
}

/* Traces the base complex of a hex mesh, and compares hex by hex. */
static void expect_same_blocks(const bw_hex_mesh *hex, const char *name) {
    hex_input in;
    bw_hex_base_complex found;
    hex_input_read(&in, hex, NULL, NULL);
    hex_input_map(&in);
    hex_input_build(&in, BW_COMPLEX_BC, BW_REDUCE_NONE, false);
    size_t blocks = in.complex.block_count;
    bw_block *block = calloc(in.source.hex_count, sizeof *block), *seen = calloc(blocks, sizeof *seen);
    kit_expect_ok(&in.ctx, bw_hex_find_base_complex(&in.ctx, &in.source, &found, block));
    print_message("%s: %zu hexes, %llu blocks, %llu irregular edges\n", name, in.source.hex_count, (unsigned long long)found.blocks,
                  (unsigned long long)found.irregular_edges);
    assert_int_equal(found.blocks, blocks);
    for (size_t b = 0; b < blocks; b++) seen[b] = BW_NONE;
    for (size_t h = 0; h < in.source.hex_count; h++) {
        if (seen[in.source.block[h]] == BW_NONE) seen[in.source.block[h]] = block[h];
        assert_int_equal(seen[in.source.block[h]], block[h]);
    }
    free(block), free(seen);
    hex_input_clear(&in);
}

static void meshes_of_blocks_have_the_blocks_that_tracing_finds(void **state) {
    (void)state;
    for (int which = 0; which < HEX_KIT_COUNT; which++) {
        bw_context ctx;
        bw_hex_mesh hex;
        bw_context_init(&ctx);
        hex_kit_sample(&ctx, which, &hex);
        expect_same_blocks(&hex, hex_kit_names[which]);
        bw_hex_mesh_clear(&ctx, &hex);
    }
}

/* In the order of hex_kit_names. A grid of blocks is one block, whatever it was made of, and so is a box on two; a point with five quads around it makes five blocks, a
 * square in a square too, swept upwards or around. */
static void blocks_are_as_many_as_drawn(void **state) {
    (void)state;
    static const uint64_t known[HEX_KIT_COUNT] = {1, 5, 5, 5, 1, 1};
    for (int which = 0; which < HEX_KIT_COUNT; which++) {
        bw_context ctx;
        bw_hex_mesh hex;
        bw_hex_base_complex found;
        bw_context_init(&ctx);
        hex_kit_sample(&ctx, which, &hex);
        kit_expect_ok(&ctx, bw_hex_find_base_complex(&ctx, &hex, &found, NULL));
        assert_int_equal(found.blocks, known[which]);
        bw_hex_mesh_clear(&ctx, &hex);
    }
}

/* The hex mesh of an integer-grid map has the base complex of the map, subdivided or not. */
static void hex_meshes_of_maps_have_the_blocks_of_the_map(void **state) {
    (void)state;
    static const char *const names[] = {"l-shape", "plus", "cylinder", "ball", "torus-quarter", "hollow-torus", "tee", "plate"};
    for (size_t i = 0; i < sizeof names / sizeof *names; i++)
        for (int subdivide = 1; subdivide < 3; subdivide++) {
            extractable x;
            bw_hex_base_complex found;
            extractable_open(&x, names[i], 2, 0.5, 0, i);
            size_t blocks = blocks_of_base_complex(&x.ctx, &x.igm);
            extractable_extract(&x, subdivide);
            kit_expect_ok(&x.ctx, bw_hex_find_base_complex(&x.ctx, &x.mesh, &found, NULL));
            print_message("%s: %llu blocks\n", x.name, (unsigned long long)found.blocks);
            assert_int_equal(found.blocks, blocks);
            extractable_close(&x);
        }
}

static void the_shared_hex_meshes_have_their_published_blocks(void **state) {
    (void)state;
    static const struct {
        const char *file;
        uint64_t blocks;
    } published[] = {{"data/hex/block_out.mesh", 100}, {"data/hex/cap_out.mesh", 327}, {"data/hex/hanger_stresstest_out.mesh", 50}, {"data/hex/impeller_stresstest_out.mesh", 878}};
    for (size_t i = 0; i < sizeof published / sizeof *published; i++) {
        bw_context ctx;
        bw_tet_mesh mesh = {0};
        bw_hex_mesh hex = {0};
        bw_context_init(&ctx);
        kit_expect_ok(&ctx, bw_input_read(&ctx, kit_shared(published[i].file), NULL, &mesh));
        hex.vertex_count = mesh.vertex_count, hex.hex_count = mesh.hex_count, hex.position = mesh.position, hex.hex = mesh.hex;
        mesh.position = NULL, mesh.hex = NULL;
        bw_tet_mesh_clear(&ctx, &mesh);
        bw_hex_base_complex found;
        kit_expect_ok(&ctx, bw_hex_find_base_complex(&ctx, &hex, &found, NULL));
        assert_int_equal(found.blocks, published[i].blocks);
        expect_same_blocks(&hex, published[i].file);
        bw_hex_mesh_clear(&ctx, &hex);
    }
}

/* A wall left out joins blocks: the count is not right by accident. */
static void without_one_irregular_edge_there_are_other_blocks(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh hex;
    bw_hex_base_complex found;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_FIVE, &hex);
    bw_hvertex most = 0;
    for (size_t h = 1; h < hex.hex_count; h++) /* a hex on the outside away: its neighbours' edges become irregular */
        if (hex.hex[h][0] > hex.hex[most][0]) most = (bw_hvertex)h;
    memcpy(hex.hex[most], hex.hex[--hex.hex_count], sizeof *hex.hex);
    kit_expect_ok(&ctx, bw_hex_find_base_complex(&ctx, &hex, &found, NULL));
    assert_true(found.blocks > 5);
    bw_hex_mesh_clear(&ctx, &hex);
}

static bw_status find(bw_context *ctx, void *user) {
    bw_hex_base_complex found;
    return bw_hex_find_base_complex(ctx, user, &found, NULL);
}

static void it_can_be_cancelled(void **state) {
    (void)state;
    volatile sig_atomic_t cancel = 1;
    bw_context ctx;
    bw_hex_mesh hex;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_O_GRID, &hex);
    size_t used = ctx.memory.used;
    ctx.cancel = &cancel;
    kit_expect_status(&ctx, find(&ctx, &hex), BW_E_CANCELLED);
    assert_int_equal(ctx.memory.used, used);
    bw_hex_mesh_clear(&ctx, &hex);
}

static void every_failing_allocation_is_reported(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh hex;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_O_GRID, &hex);
    assert_true(kit_fail_each_allocation(find, &hex) > 5);
    bw_hex_mesh_clear(&ctx, &hex);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(meshes_of_blocks_have_the_blocks_that_tracing_finds),
    cmocka_unit_test(blocks_are_as_many_as_drawn),
    cmocka_unit_test(hex_meshes_of_maps_have_the_blocks_of_the_map),
    cmocka_unit_test(the_shared_hex_meshes_have_their_published_blocks),
    cmocka_unit_test(without_one_irregular_edge_there_are_other_blocks),
    cmocka_unit_test(it_can_be_cancelled),
    cmocka_unit_test(every_failing_allocation_is_reported),
};

KIT_MAIN(tests)
