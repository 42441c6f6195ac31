/* The container gives back what was put in, and gives out nothing of a file that was changed in any byte. */
#include "kit/kit.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "format/container.h"

static bw_context ctx;
static const int32_t words[5] = {1, -2, 3, INT32_MAX, INT32_MIN};
static const double numbers[3][3] = {{0.1, -0.0, 1e300}, {5e-324, 1, 2}, {3, 4, 5}};
static const bw_section sections[] = {{"words", sizeof *words, 5, words},
                                      {"nothing", 8, 0, NULL},
                                      {"sixteen-bytes-ab", sizeof *numbers, 3, numbers},
                                      {"one byte", 1, 1, "x"}};
enum { SECTIONS = sizeof sections / sizeof *sections };

static int start(void **state) {
    (void)state;
    bw_context_init(&ctx);
    return 0;
}

static int finish(void **state) {
    (void)state;
    return ctx.memory.used ? -1 : 0;
}

static void write_sample(const char *path) { kit_expect_ok(&ctx, bw_container_write(&ctx, path, "trace", 3, sections, SECTIONS, true)); }

/* The sample's bytes, aligned; free() them. */
static char *sample(size_t *size) {
    const char *path = kit_temp_path("sample.state");
    write_sample(path);
    char *bytes = kit_read_file(path, size), *aligned = aligned_alloc(BW_CONTAINER_ALIGN, *size);
    memcpy(aligned, bytes, *size);
    free(bytes);
    return aligned;
}

static bw_status open_bytes(const char *bytes, size_t size) {
    bw_container *c;
    bw_context_init(&ctx);
    bw_status status = bw_container_open_memory(&ctx, bytes, size, "trace", 3, &c);
    if (status != BW_OK) assert_null(c);
    bw_container_close(c);
    assert_int_equal(ctx.memory.used, 0);
    return status;
}

static void the_checksum_is_the_published_one(void **state) {
    (void)state;
    assert_true(bw_checksum("", 0) == 0xef46db3751d8e999u);
    assert_true(bw_checksum("abc", 3) == 0x44bc2cf5ad770999u);
    assert_true(bw_checksum("Call me Ishmael. Some years ago--never mind how long precisely-", 63) == 0x02a2e85470d6fd96u);
}

static void sections_come_back_bit_for_bit_and_aligned(void **state) {
    (void)state;
    const char *path = kit_temp_path("a.state");
    write_sample(path);
    bw_container *c;
    kit_expect_ok(&ctx, bw_container_open(&ctx, path, "trace", 3, &c));
    for (int i = 0; i < SECTIONS; i++) {
        size_t count;
        const void *data = bw_container_section(c, sections[i].tag, sections[i].elem_size, &count);
        assert_non_null(data);
        assert_int_equal(count, sections[i].count);
        assert_int_equal((uintptr_t)data % BW_CONTAINER_ALIGN, 0);
        if (count) assert_memory_equal(data, sections[i].data, count * sections[i].elem_size);
    }
    assert_true(bw_container_has(c, "nothing"));
    assert_false(bw_container_has(c, "word"));
    assert_false(bw_container_has(c, "sixteen-bytes-abc"));
    assert_false(kit_exists(kit_temp_path("a.state.part")));
    bw_container_close(c);
}

static void the_same_sections_give_the_same_bytes(void **state) {
    (void)state;
    size_t n, m;
    char *a = sample(&n), *b = sample(&m);
    assert_int_equal(n, m);
    assert_memory_equal(a, b, n);
    assert_int_equal(n % BW_CONTAINER_ALIGN, 0);
    free(a);
    free(b);
}

static void a_section_that_is_not_there_or_of_another_size_is_a_version_error(void **state) {
    (void)state;
    static const struct {
        const char *tag;
        size_t size;
    } wrong[] = {{"absent", 4}, {"words", 8}, {"", 4}, {"sixteen-bytes-abc", 24}};
    const char *path = kit_temp_path("a.state");
    write_sample(path);
    for (size_t i = 0; i < sizeof wrong / sizeof *wrong; i++) {
        bw_container *c;
        size_t count = 9;
        bw_context_init(&ctx);
        kit_expect_ok(&ctx, bw_container_open(&ctx, path, "trace", 3, &c));
        assert_null(bw_container_section(c, wrong[i].tag, wrong[i].size, &count));
        assert_int_equal(count, 0);
        kit_expect_status(&ctx, ctx.error.status, BW_E_VERSION);
        bw_container_close(c);
    }
    bw_container *c;
    bw_context_init(&ctx);
    kit_expect_ok(&ctx, bw_container_open(&ctx, path, "trace", 3, &c));
    assert_non_null(bw_container_section_of(c, "words", 4, 5));
    assert_null(bw_container_section_of(c, "words", 4, 6));
    assert_int_equal(ctx.error.status, BW_E_IO);
    bw_container_close(c);
}

static void another_stage_or_version_is_a_version_error(void **state) {
    (void)state;
    const char *path = kit_temp_path("a.state");
    write_sample(path);
    bw_container *c;
    kit_expect_status(&ctx, bw_container_open(&ctx, path, "build", 3, &c), BW_E_VERSION);
    bw_context_init(&ctx);
    kit_expect_status(&ctx, bw_container_open(&ctx, path, "trace", 4, &c), BW_E_VERSION);
    bw_context_init(&ctx);
    kit_expect_status(&ctx, bw_container_open(&ctx, path, "trac", 3, &c), BW_E_VERSION);
}

static void every_changed_bit_is_noticed(void **state) {
    (void)state;
    size_t size;
    char *bytes = sample(&size);
    assert_int_equal(open_bytes(bytes, size), BW_OK);
    for (size_t i = 0; i < size * 8; i++) {
        bytes[i / 8] ^= (char)(1 << i % 8);
        bw_status status = open_bytes(bytes, size);
        if (status != BW_E_IO && status != BW_E_VERSION) fail_msg("bit %zu: status %s", i, bw_status_code(status));
        bytes[i / 8] ^= (char)(1 << i % 8);
    }
    free(bytes);
}

static void every_truncated_length_is_noticed(void **state) {
    (void)state;
    size_t size;
    char *bytes = sample(&size);
    const char *path = kit_temp_path("cut.state");
    for (size_t n = 0; n < size; n++) {
        assert_int_equal(open_bytes(bytes, n), BW_E_IO);
        if (n % 37) continue;
        kit_write_file(path, bytes, n);
        bw_container *c;
        bw_context_init(&ctx);
        kit_expect_status(&ctx, bw_container_open(&ctx, path, "trace", 3, &c), BW_E_IO);
    }
    free(bytes);
}

/* A forger who knows the checksum still gets no pointer outside the file. */
static void damage(char *bytes, size_t size, int how) {
    bw_container_header *h = (bw_container_header *)(void *)bytes;
    bw_container_entry *e = (bw_container_entry *)(void *)(bytes + sizeof *h);
    switch (how) {
    case 0: e[0].count = UINT64_MAX / 4; break;
    case 1: e[0].count = UINT64_MAX / 4 + 2; break; /* overflows to 4 bytes */
    case 2: e[3].count = 100000; break;
    case 3: e[3].offset += 64; break;
    case 4: e[1].offset -= 64; break; /* overlaps */
    case 5: e[1].offset++; break;
    case 6: e[0].elem_size = 0; break;
    case 7: memcpy(e[1].tag, e[0].tag, sizeof e[0].tag); break;
    case 8: memset(e[1].tag, 0, sizeof e[1].tag); break;
    case 9: e[1].tag[15] = 'x'; break; /* bytes after the end of the tag */
    case 10: h->section_count = 1025; break;
    case 11: h->section_count = UINT32_MAX; break;
    case 12: h->section_count--; break;
    case 13: h->section_count++; break;
    case 14: h->file_size++; break;
    case 15: h->reserved = 1; break;
    case 16: e[2].reserved[1] = 1; break;
    case 17: e[0].offset = UINT64_MAX - 63; break;
    case 18: e[3].count = 65; break; /* its padding would lie outside */
    }
    h->checksum = bw_container_checksum(bytes, size);
}

static void a_forged_table_gives_out_no_pointer(void **state) {
    (void)state;
    for (int how = 0; how <= 18; how++) {
        size_t size;
        bw_context_init(&ctx);
        char *bytes = sample(&size);
        damage(bytes, size, how);
        bw_status status = open_bytes(bytes, size);
        if (status != BW_E_IO) fail_msg("damage %d: %s", how, bw_status_code(status));
        free(bytes);
    }
}

static void an_old_format_version_is_a_version_error(void **state) {
    (void)state;
    size_t size;
    char *bytes = sample(&size);
    bw_container_header *h = (bw_container_header *)(void *)bytes;
    h->version = BW_CONTAINER_VERSION + 1;
    h->checksum = bw_container_checksum(bytes, size);
    assert_int_equal(open_bytes(bytes, size), BW_E_VERSION);
    free(bytes);
}

static void what_cannot_be_read_back_is_not_written(void **state) {
    (void)state;
    const char *path = kit_temp_path("not.state");
    const bw_section twice[] = {{"a", 1, 0, NULL}, {"a", 1, 0, NULL}}, unnamed = {"", 1, 0, NULL}, lengthy = {"seventeen-bytes-x", 1, 0, NULL},
                     sizeless = {"a", 0, 0, NULL}, overflowing = {"a", 8, SIZE_MAX / 4, words};
    const bw_section *const bad[] = {twice, &unnamed, &lengthy, &sizeless, &overflowing};
    for (int i = 0; i < 5; i++) {
        bw_context_init(&ctx);
        kit_expect_status(&ctx, bw_container_write(&ctx, path, "trace", 1, bad[i], i ? 1 : 2, false), BW_E_INTERNAL);
        assert_false(kit_exists(path));
    }
}

static void a_failed_write_leaves_the_old_file_and_no_other(void **state) {
    (void)state;
    bw_container *c;
    const char *folder = kit_temp_path("folder"), *path = kit_temp_path("folder/a.state");
    kit_expect_status(&ctx, bw_container_write(&ctx, path, "trace", 3, sections, SECTIONS, true), BW_E_IO);
    assert_int_equal(mkdir(folder, 0777), 0);
    bw_context_init(&ctx);
    write_sample(path);
    sig_atomic_t cancel = 1;
    ctx.cancel = &cancel;
    kit_expect_status(&ctx, bw_container_write(&ctx, path, "trace", 4, sections, SECTIONS, false), BW_E_CANCELLED);
    assert_false(kit_exists(kit_temp_path("folder/a.state.part")));
    bw_context_init(&ctx);
    kit_expect_ok(&ctx, bw_container_open(&ctx, path, "trace", 3, &c));
    bw_container_close(c);
}

static bw_status write_and_open(bw_context *context, void *user) {
    bw_container *c = NULL;
    bw_status status = bw_container_write(context, user, "trace", 3, sections, SECTIONS, false);
    if (status == BW_OK) status = bw_container_open(context, user, "trace", 3, &c);
    bw_container_close(c);
    return status;
}

static void every_allocation_may_fail(void **state) {
    (void)state;
    char *path = strdup(kit_temp_path("loop.state"));
    assert_true(kit_fail_each_allocation(write_and_open, path) >= 2);
    free(path);
}

#define TEST(f) cmocka_unit_test_setup_teardown(f, start, finish)
static const struct CMUnitTest tests[] = {
    TEST(the_checksum_is_the_published_one),
    TEST(sections_come_back_bit_for_bit_and_aligned),
    TEST(the_same_sections_give_the_same_bytes),
    TEST(a_section_that_is_not_there_or_of_another_size_is_a_version_error),
    TEST(another_stage_or_version_is_a_version_error),
    TEST(every_changed_bit_is_noticed),
    TEST(every_truncated_length_is_noticed),
    TEST(a_forged_table_gives_out_no_pointer),
    TEST(an_old_format_version_is_a_version_error),
    TEST(what_cannot_be_read_back_is_not_written),
    TEST(a_failed_write_leaves_the_old_file_and_no_other),
    TEST(every_allocation_may_fail),
};
KIT_MAIN(tests)
