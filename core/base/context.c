#include "base/context.h"

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "base/large.h"

typedef union {
    size_t bytes;
    max_align_t align;
} header;

void bw_context_init(bw_context *ctx) {
    memset(ctx, 0, sizeof *ctx);
    ctx->threads = 1;
    ctx->stage = "";
}

bw_status bw_fail(bw_context *ctx, bw_status status, const char *format, ...) {
    if (ctx->error.status != BW_OK) return ctx->error.status;
    va_list args;
    va_start(args, format);
    vsnprintf(ctx->error.message, sizeof ctx->error.message, format, args);
    va_end(args);
    ctx->error.status = status;
    return status;
}

void bw_fail_element(bw_context *ctx, const char *kind, int64_t id, const double *position) {
    size_t at = ctx->error.element_count++;
    if (at >= BW_ELEMENTS_KEPT) return;
    bw_element *e = &ctx->error.elements[at];
    memset(e, 0, sizeof *e);
    snprintf(e->kind, sizeof e->kind, "%s", kind);
    e->id = id;
    e->has_position = position != NULL;
    if (position) memcpy(e->position, position, sizeof e->position);
}

void bw_fail_region(bw_context *ctx, const bw_region *region) {
    size_t at = ctx->error.region_count++;
    if (at < BW_REGIONS_KEPT) ctx->error.regions[at] = *region;
}

void bw_log(bw_context *ctx, const char *format, ...) {
    if (!ctx->log) return;
    char line[1024];
    va_list args;
    va_start(args, format);
    vsnprintf(line, sizeof line, format, args);
    va_end(args);
    ctx->log(ctx->user, line);
}

void bw_progress(bw_context *ctx, double fraction) {
    if (ctx->progress) ctx->progress(ctx->user, ctx->stage, fraction < 0 ? 0 : fraction > 1 ? 1 : fraction);
}

void bw_note(bw_context *ctx, const char *format, ...) {
    if (!ctx->note) return;
    char text[BW_NOTE_MOST + 1];
    va_list args;
    va_start(args, format);
    vsnprintf(text, sizeof text, format, args);
    va_end(args);
    ctx->note(ctx->user, text);
}

bw_status bw_poll(bw_context *ctx) {
    if (ctx->error.status != BW_OK) return ctx->error.status;
    if (ctx->cancel && *ctx->cancel) return bw_fail(ctx, BW_E_CANCELLED, "cancelled during %s", ctx->stage);
    return BW_OK;
}

double bw_seconds_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void *refuse(bw_context *ctx, size_t bytes) {
    bw_fail(ctx, BW_E_MEMORY, "%s needs %zu more bytes; %zu are in use and the limit is %zu",
            *ctx->stage ? ctx->stage : "the job", bytes, ctx->memory.used, ctx->memory.limit);
    return NULL;
}

/* Blocks of this many bytes are large. A memory checker shall see all of them. */
#ifdef __SANITIZE_ADDRESS__
static const size_t large = SIZE_MAX;
#else
static const size_t large = 2 * BW_HUGE_PAGE;
#endif

static void release(header *h) {
    if (h->bytes + sizeof *h >= large) bw_large_free(h, h->bytes + sizeof *h);
    else free(h);
}

/* Resizes a block, header included (before == 0: a new one); new bytes are zero. */
static header *resize(header *old, size_t before, size_t whole) {
    if (before >= large && whole >= large) return bw_large_resize(old, before, whole);
    if (before < large && whole < large) {
        header *now = old ? realloc(old, whole) : calloc(1, whole);
        if (now && old && whole > before) memset((char *)now + before, 0, whole - before);
        return now;
    }
    header *now = whole >= large ? bw_large_new(whole) : malloc(whole);
    if (!now || !old) return now;
    memcpy(now, old, before < whole ? before : whole);
    release(old);
    return now;
}

void *bw_resize(bw_context *ctx, void *block, size_t count, size_t size) {
    bw_memory *m = &ctx->memory;
    size_t bytes, whole;
    if (__builtin_mul_overflow(count, size, &bytes) || __builtin_add_overflow(bytes, sizeof(header), &whole))
        return refuse(ctx, SIZE_MAX);
    header *old = block ? (header *)block - 1 : NULL;
    size_t before = old ? old->bytes : 0;
    if (m->fail_at && ++m->calls >= m->fail_at) return refuse(ctx, bytes);
    if (bytes > before && m->limit && (m->used > m->limit || bytes - before > m->limit - m->used))
        return refuse(ctx, bytes - before);
    header *now = resize(old, old ? before + sizeof(header) : 0, whole);
    if (!now) return refuse(ctx, bytes);
    now->bytes = bytes;
    m->used += bytes - before;
    if (m->used > m->peak) m->peak = m->used;
    return now + 1;
}

void *bw_alloc(bw_context *ctx, size_t count, size_t size) { return bw_resize(ctx, NULL, count, size); }

void bw_free(bw_context *ctx, void *block) {
    if (!block) return;
    header *h = (header *)block - 1;
    ctx->memory.used -= h->bytes;
    release(h);
}

bw_status bw_charge(bw_context *ctx, size_t *charged, size_t bytes) {
    bw_memory *m = &ctx->memory;
    bool more = bytes > *charged;
    m->used += bytes - *charged;
    *charged = bytes;
    if (m->used > m->peak) m->peak = m->used;
    if (!more || !m->limit || m->used <= m->limit) return BW_OK;
    refuse(ctx, bytes);
    return ctx->error.status;
}

bw_status bw_trim_(bw_context *ctx, void **items, size_t *capacity, size_t count, size_t size) {
    if (count == *capacity) return BW_OK;
    void *block = bw_resize(ctx, *items, count, size);
    if (!block) return ctx->error.status;
    *items = block;
    *capacity = count;
    return BW_OK;
}

bw_status bw_reserve_(bw_context *ctx, void **items, size_t *capacity, size_t need, size_t size) {
    if (need <= *capacity) return BW_OK;
    size_t more = *capacity < 16 ? 16 : *capacity + *capacity / (*capacity < 65536 ? 2 : 8); /* large blocks move by remapping */
    if (more < need) more = need;
    if (more >= large / size && more <= SIZE_MAX / 2 / size) { /* whole huge pages: part of one would be small pages for good */
        size_t pages = (more * size + sizeof(header)) / BW_HUGE_PAGE + 1;
        more = (pages * BW_HUGE_PAGE - sizeof(header)) / size;
    }
    void *block = bw_resize(ctx, *items, more, size);
    if (!block) return ctx->error.status;
    *items = block;
    *capacity = more;
    return BW_OK;
}
