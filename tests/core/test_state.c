/* A state file comes back as it was written; one whose sizes or offsets contradict each other is refused, though its checksum is right. */
#include "kit/kit.h"

#include <stdlib.h>
#include <string.h>

#include "blockwright.h"
#include "format/container.h"
#include "format/state.h"

static bw_context ctx;
static const char *file[BW_STAGE_ENCODE]; /* what each stage left of a sample model */

static int start(void **state) {
    (void)state;
    bw_options options;
    bw_options_defaults(&options);
    bw_context_init(&ctx);
    for (int s = 0; s < BW_STAGE_ENCODE; s++) {
        file[s] = kit_temp_path("%s", bw_stage_name((bw_stage)s));
        kit_expect_ok(&ctx, bw_stage_run(&ctx, &options, (bw_stage)s,
                                         s ? file[s - 1] : BW_SOURCE_DIR "/api/examples/formats/cube.hexex", file[s]));
    }
    return 0;
}

static bw_status read_state(bw_state *s, bw_stage stage, const char *path) {
    bw_state_init(s);
    return bw_state_read(&ctx, s, bw_stage_name(stage), bw_stage_version(stage), path);
}

static void a_state_is_written_as_it_was_read(void **state) {
    (void)state;
    for (int s = 0; s < BW_STAGE_ENCODE; s++) {
        static bw_state it;
        size_t size, again_size;
        const char *again = kit_temp_path("again");
        bw_context_init(&ctx);
        kit_expect_ok(&ctx, read_state(&it, (bw_stage)s, file[s]));
        kit_expect_ok(&ctx, bw_state_write(&ctx, &it, bw_stage_name((bw_stage)s), bw_stage_version((bw_stage)s), again));
        bw_state_clear(&ctx, &it);
        assert_int_equal(ctx.memory.used, 0);
        char *one = kit_read_file(file[s], &size), *other = kit_read_file(again, &again_size);
        assert_int_equal(size, again_size);
        assert_memory_equal(one, other, size);
        free(one), free(other);
    }
}

/* Adds `by` to word `at` of a section (from its end if negative), puts the checksum right, and expects BW_E_IO with these words. */
static void expect_damage(bw_stage stage, const char *tag, long at, uint64_t by, const char *words) {
    static bw_state it;
    size_t size;
    char *bytes = kit_read_file(file[stage], &size);
    bw_container_header *h = (void *)bytes;
    bw_container_entry *e = (void *)(bytes + sizeof *h);
    while (strncmp(e->tag, tag, BW_CONTAINER_NAME)) e++;
    uint64_t *word = (void *)(bytes + e->offset), before;
    word += at < 0 ? (long)(e->elem_size * e->count / sizeof *word) + at : at;
    before = *word;
    *word += by;
    h->checksum = bw_container_checksum(bytes, size);
    kit_write_file(kit_temp_path("damaged"), bytes, size);
    bw_context_init(&ctx);
    bw_status status = read_state(&it, stage, kit_temp_path("damaged"));
    if (status != BW_E_IO || !strstr(ctx.error.message, words))
        fail_msg("%s %s[%ld] %llu + %llu: %s", bw_stage_name(stage), tag, at, (unsigned long long)before,
                 (unsigned long long)by, ctx.error.message);
    bw_state_clear(&ctx, &it);
    assert_int_equal(ctx.memory.used, 0);
    free(bytes);
}

static void sizes_that_contradict_each_other_are_refused(void **state) {
    (void)state;
    enum { VERTEX = 0, CELLS = 12, NODES = 14 }; /* words of "counts" */
    expect_damage(BW_STAGE_SANITIZE, "counts", VERTEX, 1, "section 'position' of the state file has 8 elements, not 9");
    expect_damage(BW_STAGE_SANITIZE, "counts", CELLS, 6, "its sizes contradict each other");
    expect_damage(BW_STAGE_TRACE, "counts", NODES, 1, "its sizes contradict each other");
    expect_damage(BW_STAGE_BUILD, "counts", CELLS, 1, "of the state file has 6 elements, not 7");
    expect_damage(BW_STAGE_BUILD, "counts", CELLS, ~(uint64_t)0, "its sizes contradict each other"); /* fewer than tets */
    expect_damage(BW_STAGE_SANITIZE, "counts", -1, 1 << 16, "its sizes contradict each other"); /* says that it has blocks */
}

static void offsets_that_do_not_fit_are_refused(void **state) {
    (void)state;
    static const char *const tags[] = {"arc.edge.begin", "patch.poly.begin", "patch.side.begin", "block.side.begin",
                                       "block.edge.begin"};
    for (size_t i = 0; i < sizeof tags / sizeof *tags; i++) {
        expect_damage(BW_STAGE_BUILD, tags[i], 0, 1, tags[i]);
        expect_damage(BW_STAGE_BUILD, tags[i], 1, (uint64_t)1 << 40, tags[i]);
        expect_damage(BW_STAGE_REDUCE, tags[i], -1, ~(uint64_t)0, tags[i]);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_state_is_written_as_it_was_read),
        cmocka_unit_test(sizes_that_contradict_each_other_are_refused),
        cmocka_unit_test(offsets_that_do_not_fit_are_refused),
    };
    return kit_exit(cmocka_run_group_tests(tests, start, NULL), sizeof tests / sizeof *tests);
}
