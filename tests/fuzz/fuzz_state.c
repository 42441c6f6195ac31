/* State files whose sections were tampered with. The input is a list of edits to the sections of a real file, one that a stage left
 * of the example cube; the outcome is written as a proper container and read. What is accepted must be safe to write, and come
 * back the same. Edits instead of bytes: they stay what they are when a structure changes.
 *
 * The first byte is the stage (sanitize to reduce); an edit is the number of a section, what is done to it, and two bytes. */
#include "fuzz.h"

#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "blockwright.h"
#include "format/container.h"
#include "format/state.h"

enum { STAGES = BW_STAGE_ENCODE, SECTIONS_MOST = 96, GROWTH_MOST = 4096 };

typedef struct {
    char tag[BW_CONTAINER_NAME + 1];
    size_t elem_size, count;
    uint8_t *bytes;
} section;

typedef struct {
    size_t count;
    section list[SECTIONS_MOST];
} sections;

static sections real[STAGES];
static char name[3][64]; /* files in memory */

static void take_sections(const char *path, int stage) {
    static _Alignas(BW_CONTAINER_ALIGN) uint8_t file[1 << 20];
    FILE *stream = fopen(path, "rb");
    size_t size = stream ? fread(file, 1, sizeof file, stream) : 0;
    const bw_container_header *h = (const void *)file;
    const bw_container_entry *e = (const void *)(h + 1);
    FUZZ_EXPECT(size > sizeof *h && size < sizeof file && h->section_count <= SECTIONS_MOST && !fclose(stream));
    real[stage].count = h->section_count;
    for (size_t i = 0; i < h->section_count; i++) {
        section *s = &real[stage].list[i];
        memcpy(s->tag, e[i].tag, BW_CONTAINER_NAME);
        s->elem_size = e[i].elem_size, s->count = e[i].count;
        s->bytes = malloc(s->elem_size * s->count + 1);
        memcpy(s->bytes, file + e[i].offset, s->elem_size * s->count);
    }
}

static void make_real(void) {
    const char *input = BW_SOURCE_DIR "/api/examples/formats/cube.hexex";
    bw_options options;
    bw_options_defaults(&options);
    for (int i = 0; i < 3; i++) snprintf(name[i], sizeof name[i], "/dev/shm/bw-fuzz-%ld-%d", (long)getpid(), i);
    for (int s = 0; s < STAGES; s++) {
        bw_context ctx;
        bw_context_init(&ctx);
        FUZZ_EXPECT(bw_stage_run(&ctx, &options, (bw_stage)s, s ? name[(s - 1) % 2] : input, name[s % 2]) == BW_OK);
        take_sections(name[s % 2], s);
    }
}

static void resize(section *s, size_t count) {
    uint8_t *bytes = calloc(s->elem_size * count + 1, 1);
    memcpy(bytes, s->bytes, s->elem_size * (count < s->count ? count : s->count));
    free(s->bytes);
    s->bytes = bytes, s->count = count;
}

static section *find(sections *all, const char *tag) {
    for (size_t i = 0; i < all->count; i++)
        if (!strcmp(all->list[i].tag, tag)) return &all->list[i];
    return NULL;
}

/* Sets one of the sizes in "counts", or adds to it. */
static void change_size(sections *all, size_t which, bool add, uint64_t value) {
    section *counts = find(all, "counts");
    size_t words = counts ? counts->elem_size * counts->count / 8 : 0;
    uint64_t before;
    if (!words) return;
    uint8_t *at = counts->bytes + which % words * 8;
    memcpy(&before, at, 8);
    if (add) value += before;
    memcpy(at, &value, 8);
}

static void edit(sections *all, size_t which, uint8_t verb, unsigned value) {
    section *s = &all->list[which % all->count];
    size_t bytes = s->elem_size * s->count;
    uint64_t number;
    switch (verb & 7) {
    case 0: /* a byte */
        if (bytes) s->bytes[(value >> 8) * 37 % bytes] = (uint8_t)value;
        break;
    case 1: /* a word becomes small, or all ones */
        number = value & 0x80 ? ~(uint64_t)0 << (value & 63) : value & 0x7f;
        if (bytes >= 8) memcpy(s->bytes + (value >> 8) % (bytes / 8) * 8, &number, 8);
        break;
    case 2:
        resize(s, value % GROWTH_MOST);
        break;
    case 3:
        if (all->count > 1) free(s->bytes), *s = all->list[--all->count];
        break;
    case 4: /* the same bytes in elements of another size */
        s->elem_size = 1 + value % 255, s->count = bytes / s->elem_size;
        break;
    case 5: /* a section and one of the sizes together */
        resize(s, value % GROWTH_MOST);
        change_size(all, verb >> 3, false, s->count);
        break;
    case 6: /* one of the sizes */
        change_size(all, verb >> 3, true, (uint64_t)(int64_t)(int8_t)value);
        break;
    default:
        if (s->count > 1) resize(s, s->count - 1);
    }
}

static bool same_file(const char *a, const char *b) {
    FILE *f = fopen(a, "rb"), *g = fopen(b, "rb");
    int x, y;
    do x = fgetc(f), y = fgetc(g);
    while (x == y && x != EOF);
    fclose(f), fclose(g);
    return x == y;
}

/* What was accepted can be written, read and written again to the same bytes. */
static void expect_stable(bw_context *ctx, bw_state *state, bw_stage stage) {
    static bw_state again;
    FUZZ_EXPECT(bw_state_write(ctx, state, bw_stage_name(stage), bw_stage_version(stage), name[1]) == BW_OK);
    bw_state_init(&again);
    FUZZ_EXPECT(bw_state_read(ctx, &again, bw_stage_name(stage), bw_stage_version(stage), name[1]) == BW_OK);
    FUZZ_EXPECT(bw_state_write(ctx, &again, bw_stage_name(stage), bw_stage_version(stage), name[2]) == BW_OK);
    FUZZ_EXPECT(same_file(name[1], name[2]));
    bw_state_clear(ctx, &again);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static bw_state state;
    static sections now;
    if (!real[0].count) make_real();
    if (!size || size > 400) return 0;
    bw_stage stage = (bw_stage)(*data % STAGES);
    now.count = real[stage].count;
    for (size_t i = 0; i < now.count; i++) {
        now.list[i] = real[stage].list[i];
        now.list[i].bytes = malloc(now.list[i].elem_size * now.list[i].count + 1);
        memcpy(now.list[i].bytes, real[stage].list[i].bytes, now.list[i].elem_size * now.list[i].count);
    }
    for (size_t i = 1; i + 4 <= size; i += 4) edit(&now, data[i], data[i + 1], data[i + 2] * 256u + data[i + 3]);

    bw_section list[SECTIONS_MOST];
    for (size_t i = 0; i < now.count; i++)
        list[i] = (bw_section){now.list[i].tag, now.list[i].elem_size, now.list[i].count, now.list[i].bytes};
    bw_context ctx;
    bw_context_init(&ctx);
    FUZZ_EXPECT(bw_container_write(&ctx, name[0], bw_stage_name(stage), (uint32_t)bw_stage_version(stage), list, now.count,
                                   false) == BW_OK);
    bw_state_init(&state);
    bw_status status = bw_state_read(&ctx, &state, bw_stage_name(stage), bw_stage_version(stage), name[0]);
    FUZZ_EXPECT(status == ctx.error.status && (status == BW_OK || status == BW_E_IO || status == BW_E_VERSION));
    if (status == BW_OK) expect_stable(&ctx, &state, stage);
    bw_state_clear(&ctx, &state);
    FUZZ_EXPECT(ctx.memory.used == 0);
    for (size_t i = 0; i < now.count; i++) free(now.list[i].bytes);
    for (int i = 0; i < 3; i++) unlink(name[i]);
    return 0;
}
