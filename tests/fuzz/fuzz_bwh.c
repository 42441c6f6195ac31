/* The decoder of the compact hex mesh on arbitrary bytes. The first input byte says whether size and checksums are put right first, which gets the
 * rest past them. What is decoded has all its indices in range. */
#include "fuzz.h"

#include <math.h>
#include <stdbool.h>
#include <string.h>
#include <zlib.h>

#include "bwh.h"

enum { LIMIT = 1 << 24 };

static void put32(uint8_t *p, uint64_t value) {
    for (int i = 0; i < 4; i++) p[i] = (uint8_t)(value >> 8 * i);
}

/* Size of the file, and checksums. */
static void seal(uint8_t *p, size_t size) {
    size_t front = size > 36 && p[36] == 2 ? 112 : 64;
    if (size < front) return;
    put32(p + 40, size), put32(p + 44, (uint64_t)size >> 32);
    put32(p + 56, crc32_z(0, p + front, size - front));
    put32(p + 60, 0);
    put32(p + 60, crc32_z(0, p, front));
}

static void check(const bwh_mesh *m) {
    FUZZ_EXPECT(m->vertex_count * 25 + m->hex_count * 48 <= LIMIT && isfinite(m->step));
    for (size_t v = 0; v < m->vertex_count; v++) {
        FUZZ_EXPECT(m->held[v] <= 3);
        for (int k = 0; k < 3; k++) FUZZ_EXPECT(isfinite(m->position[v][k]));
    }
    size_t h = 0;
    for (size_t i = 0; i < m->part_count; i++) {
        FUZZ_EXPECT(m->part[i].first == h && m->part[i].count);
        for (; h < m->part[i].first + m->part[i].count; h++) FUZZ_EXPECT(m->block[h] == m->part[i].block);
    }
    FUZZ_EXPECT(h == m->hex_count);
    for (h = 0; h < m->hex_count; h++)
        for (int c = 0; c < 8; c++) FUZZ_EXPECT(m->hex[h][c] >= 0 && (size_t)m->hex[h][c] < m->vertex_count);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (!size) return 0;
    bool sealed = *data++ & 1;
    size--;
    uint8_t *bytes = malloc(size ? size : 1);
    memcpy(bytes, data, size);
    if (sealed) seal(bytes, size);
    bwh_mesh mesh;
    bwh_status status = bwh_decode(bytes, size, LIMIT, &mesh);
    FUZZ_EXPECT(status < BWH_STATUS_COUNT && *bwh_text(status));
    if (status == BWH_OK) check(&mesh);
    else FUZZ_EXPECT(!mesh.position && !mesh.hex && !mesh.hex_count);
    bwh_clear(&mesh);
    free(bytes);
    return 0;
}
