/* The validator of hex meshes: it passes meshes made of blocks, and names each damage. */
#include "core/hex_kit.h"

static void expect(const char *what, bw_hex_mesh *mesh, const char *words) {
    bw_context ctx;
    bw_context_init(&ctx);
    bw_status status = bw_hex_mesh_check(&ctx, mesh);
    if (!words) kit_expect_ok(&ctx, status);
    else if (status != BW_E_CHECK || !strstr(ctx.error.message, words))
        fail_msg("%s: \"%s\" expected, but it is %s: %s", what, words, bw_status_code(status), ctx.error.message);
    assert_int_equal(ctx.memory.used, 0);
}

static void meshes_made_of_blocks_are_valid(void **state) {
    (void)state;
    for (int i = 0; i < HEX_KIT_COUNT; i++) {
        bw_context ctx;
        bw_hex_mesh mesh;
        bw_context_init(&ctx);
        hex_kit_sample(&ctx, i, &mesh);
        expect(hex_kit_names[i], &mesh, NULL);
        for (size_t h = 0; h < mesh.hex_count; h++) mesh.block[h] = BW_NONE;
        expect(hex_kit_names[i], &mesh, NULL);
        bw_hex_mesh_clear(&ctx, &mesh);
        assert_int_equal(ctx.memory.used, 0);
    }
}

/* ---- damages: each starts from the grid of four blocks ---- */

static size_t inner_vertex(const bw_hex_mesh *m) {
    size_t v = 0;
    while (m->held[v] != BW_HELD_NOT) v++;
    return v;
}
static void index_out_of_range(bw_hex_mesh *m) { m->hex[3][5] = (bw_hvertex)m->vertex_count; }
static void index_negative(bw_hex_mesh *m) { m->hex[3][5] = -1; }
static void corner_repeated(bw_hex_mesh *m) { m->hex[3][5] = m->hex[3][2]; }
static void vertex_unused(bw_hex_mesh *m) {
    bw_hvertex v = m->hex[0][0];
    for (size_t i = 0; i < 8 * m->hex_count; i++)
        if (m->hex[i / 8][i % 8] == v) m->hex[i / 8][i % 8] = (bw_hvertex)m->vertex_count;
    m->vertex_count++; /* room for eight vertices a hex */
}
static void hex_listed_three_times(bw_hex_mesh *m) {
    memcpy(m->hex[1], m->hex[0], sizeof m->hex[0]);
    memcpy(m->hex[2], m->hex[0], sizeof m->hex[0]);
}
static void hex_inside_out(bw_hex_mesh *m) {
    for (int c = 0; c < 8; c += 2) {
        bw_hvertex swap = m->hex[0][c];
        m->hex[0][c] = m->hex[0][c + 1], m->hex[0][c + 1] = swap;
    }
}
static void hex_twisted(bw_hex_mesh *m) {
    bw_hvertex swap = m->hex[0][0];
    m->hex[0][0] = m->hex[0][1], m->hex[0][1] = swap;
}
static void vertices_welded(bw_hex_mesh *m) { /* two that no hex shares: far apart */
    bw_hvertex a = m->hex[0][0], b = m->hex[m->hex_count - 1][7], last = (bw_hvertex)m->vertex_count - 1;
    for (size_t i = 0; i < 8 * m->hex_count; i++) {
        bw_hvertex *v = &m->hex[i / 8][i % 8];
        if (*v == b) *v = a;
        if (*v == last) *v = b;
    }
    m->vertex_count--;
}
static void hole_of_one_hex(bw_hex_mesh *m) { /* the surface of the hole is a second boundary, not held */
    size_t h = 0;
    for (bool inside = false; !inside; h++) {
        inside = true;
        for (int c = 0; c < 8; c++) inside = inside && m->held[m->hex[h][c]] == BW_HELD_NOT;
    }
    memcpy(m->hex[h - 1], m->hex[m->hex_count - 1], sizeof m->hex[0]);
    m->block[h - 1] = m->block[m->hex_count - 1];
    m->hex_count--;
}
static void boundary_not_held(bw_hex_mesh *m) {
    size_t v = 0;
    while (m->held[v] != BW_HELD_SURFACE) v++;
    m->held[v] = BW_HELD_NOT;
}
static void held_by_nothing_known(bw_hex_mesh *m) { m->held[inner_vertex(m)] = BW_HELD_NOT + 1; }
static void one_without_block(bw_hex_mesh *m) { m->block[2] = BW_NONE; }
static void place_taken_twice(bw_hex_mesh *m) { memcpy(m->ijk[1], m->ijk[0], sizeof m->ijk[0]); }
static void place_negative(bw_hex_mesh *m) { m->ijk[0][1] = -1; }
static void block_with_a_gap(bw_hex_mesh *m) { m->ijk[0][1] = 40; }
static void places_swapped(bw_hex_mesh *m) {
    int32_t a[3];
    memcpy(a, m->ijk[0], sizeof a), memcpy(m->ijk[0], m->ijk[1], sizeof a), memcpy(m->ijk[1], a, sizeof a);
}
static void axes_turned(bw_hex_mesh *m) {
    bw_hvertex v[8];
    memcpy(v, m->hex[0], sizeof v);
    for (int c = 0; c < 8; c++) m->hex[0][(c << 1 | c >> 2) & 7] = v[c];
}

static const struct {
    const char *what;
    void (*damage)(bw_hex_mesh *mesh);
    const char *words;
} damages[] = {
    {"index out of range", index_out_of_range, "no vertex"},
    {"negative index", index_negative, "no vertex"},
    {"repeated corner", corner_repeated, "repeats a vertex"},
    {"vertex not used", vertex_unused, "is in no hex"},
    {"a hex listed three times", hex_listed_three_times, ""},
    {"a hex inside out", hex_inside_out, "same side"},
    {"a twisted hex", hex_twisted, "same side"},
    {"vertices welded", vertices_welded, "link is no disk"},
    {"a hole", hole_of_one_hex, "not held"},
    {"boundary not held", boundary_not_held, "not held"},
    {"held by what is not known", held_by_nothing_known, "held by nothing"},
    {"one hex without a block", one_without_block, "in no block"},
    {"a place taken twice", place_taken_twice, ""},
    {"a place outside", place_negative, "outside its block"},
    {"a gap in a block", block_with_a_gap, "hexes has"},
    {"places swapped", places_swapped, "does not meet"},
    {"axes turned", axes_turned, "does not meet"},
};

static void every_damage_is_named(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof damages / sizeof *damages; i++) {
        static const hex_kit_box grid[] = {{{0, 0, 0}, {4, 3, 4}}, {{4, 0, 0}, {9, 3, 4}}, {{0, 3, 0}, {4, 7, 4}}, {{4, 3, 0}, {9, 7, 4}}};
        bw_context ctx;
        bw_hex_mesh mesh;
        bw_context_init(&ctx);
        hex_kit_boxes(&ctx, grid, 4, 7, &mesh);
        expect(damages[i].what, &mesh, NULL);
        damages[i].damage(&mesh);
        expect(damages[i].what, &mesh, damages[i].words);
        bw_hex_mesh_clear(&ctx, &mesh);
    }
}

/* Ids as a file may have them: memory goes by hexes, not by the highest id. */
static void ids_of_blocks_may_be_far_apart(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    for (size_t h = 0; h < mesh.hex_count; h++) mesh.block[h] = INT32_MAX - 1 - 1000 * mesh.block[h];
    ctx.memory.limit = ctx.memory.used + 1000000;
    kit_expect_ok(&ctx, bw_hex_mesh_check(&ctx, &mesh));
    mesh.ijk[0][1] = 40;
    assert_int_equal(bw_hex_mesh_check(&ctx, &mesh), BW_E_CHECK);
    assert_non_null(strstr(ctx.error.message, "block 21474"));
    bw_hex_mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory.used, 0);
}

static void a_check_that_is_cancelled_ends_and_says_so(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    volatile sig_atomic_t cancel = 1;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    ctx.cancel = &cancel;
    assert_int_equal(bw_hex_mesh_check(&ctx, &mesh), BW_E_CANCELLED);
    bw_hex_mesh_clear(&ctx, &mesh);
    assert_int_equal(ctx.memory.used, 0);
}

static bw_status check_again(bw_context *ctx, void *user) { return bw_hex_mesh_check(ctx, user); }

static void each_allocation_may_fail(void **state) {
    (void)state;
    bw_context ctx;
    bw_hex_mesh mesh;
    bw_context_init(&ctx);
    hex_kit_sample(&ctx, HEX_KIT_TEE, &mesh);
    assert_true(kit_fail_each_allocation(check_again, &mesh) > 5);
    bw_hex_mesh_clear(&ctx, &mesh);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(meshes_made_of_blocks_are_valid),
        cmocka_unit_test(every_damage_is_named),
        cmocka_unit_test(ids_of_blocks_may_be_far_apart),
        cmocka_unit_test(a_check_that_is_cancelled_ends_and_says_so),
        cmocka_unit_test(each_allocation_may_fail),
    };
    return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof tests / sizeof *tests);
}
