/* The container on arbitrary bytes. The first input byte says whether the header's size and checksum are put right first, which
 * gets the rest past them and at the table of sections. Every section given out is read to its last byte. */
#include "fuzz.h"

#include <string.h>

#include "format/container.h"

volatile unsigned sink; /* keeps the reading of sections */

static unsigned read_sections(const bw_container *c, const uint8_t *data) {
    const bw_container_header *h = (const void *)data;
    unsigned sum = 0;
    for (uint32_t i = 0; i < h->section_count; i++) {
        const bw_container_entry *e = (const bw_container_entry *)(const void *)(data + sizeof *h) + i;
        char tag[BW_CONTAINER_NAME + 1] = {0};
        memcpy(tag, e->tag, BW_CONTAINER_NAME);
        size_t count;
        const unsigned char *p = bw_container_section(c, tag, e->elem_size, &count);
        FUZZ_EXPECT(p && bw_container_has(c, tag) && (uintptr_t)p % BW_CONTAINER_ALIGN == 0);
        for (size_t k = 0; k < count * e->elem_size; k++) sum += p[k];
    }
    return sum;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (!size) return 0;
    bool seal = *data++ & 1;
    size--;
    uint8_t *bytes = aligned_alloc(BW_CONTAINER_ALIGN, (size + BW_CONTAINER_ALIGN) & ~(size_t)(BW_CONTAINER_ALIGN - 1));
    memcpy(bytes, data, size);
    bw_container_header *h = (void *)bytes;
    if (seal && size >= sizeof *h) {
        h->file_size = size;
        h->checksum = bw_container_checksum(bytes, size);
    }
    bw_context ctx;
    bw_container *c;
    bw_context_init(&ctx);
    bw_status status = bw_container_open_memory(&ctx, bytes, size, "trace", 3, &c);
    FUZZ_EXPECT(status == ctx.error.status && (c != NULL) == (status == BW_OK));
    FUZZ_EXPECT(status == BW_OK || status == BW_E_IO || status == BW_E_VERSION);
    if (status == BW_OK) sink = read_sections(c, bytes);
    bw_container_close(c);
    FUZZ_EXPECT(ctx.memory.used == 0);
    free(bytes);
    return 0;
}
