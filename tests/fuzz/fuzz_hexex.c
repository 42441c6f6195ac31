/* The .hexex reader on arbitrary bytes: it ends with a status, keeps its books, and what it accepts is in range and the same
 * again after being written and read once more. */
#include "fuzz.h"

#include <math.h>
#include <string.h>
#include <unistd.h>

#include "format/hexex.h"
#include "format/hexex_write.h"

enum { BUDGET = 64 << 20 };

static void expect_in_range(const bw_tet_mesh *m) {
    FUZZ_EXPECT(m->tet_count > 0);
    for (size_t i = 0; i < 3 * m->vertex_count; i++) FUZZ_EXPECT(isfinite(m->position[i / 3][i % 3]));
    for (size_t i = 0; i < 12 * m->tet_count; i++) FUZZ_EXPECT(isfinite(m->parameter[i / 12][i % 12 / 3][i % 3]));
    for (size_t i = 0; i < 4 * m->tet_count; i++)
        FUZZ_EXPECT(m->tet[i / 4][i % 4] >= 0 && (size_t)m->tet[i / 4][i % 4] < m->vertex_count);
    for (size_t i = 0; i < 3 * m->wall_count; i++)
        FUZZ_EXPECT(m->wall[i / 3][i % 3] >= 0 && (size_t)m->wall[i / 3][i % 3] < m->vertex_count);
    for (size_t i = 0; i < m->wall_count; i++) FUZZ_EXPECT(isfinite(m->wall_distance[i]));
    for (size_t i = 0; i < m->feature_vertex_count; i++)
        FUZZ_EXPECT(m->feature_vertex[i] >= 0 && (size_t)m->feature_vertex[i] < m->vertex_count);
    for (size_t i = 0; i < 2 * m->feature_edge_count; i++) FUZZ_EXPECT((size_t)m->feature_edge[i / 2][i % 2] < m->vertex_count);
    for (size_t i = 0; i < 3 * m->feature_facet_count; i++) FUZZ_EXPECT((size_t)m->feature_facet[i / 3][i % 3] < m->vertex_count);
}

static void expect_same_after_writing(bw_context *ctx, const bw_tet_mesh *m) {
    static char path[40];
    if (!*path) snprintf(path, sizeof path, "/tmp/bw-fuzz-%ld.hexex", (long)getpid());
    bw_tet_mesh back;
    FUZZ_EXPECT(bw_hexex_write_mesh(ctx, path, m) == BW_OK);
    FUZZ_EXPECT(bw_hexex_read(ctx, path, &back) == BW_OK);
    unlink(path);
    FUZZ_EXPECT(back.vertex_count == m->vertex_count && back.tet_count == m->tet_count && back.wall_count == m->wall_count);
    FUZZ_EXPECT(!memcmp(back.position, m->position, m->vertex_count * sizeof *m->position));
    FUZZ_EXPECT(!memcmp(back.tet, m->tet, m->tet_count * sizeof *m->tet));
    FUZZ_EXPECT(!memcmp(back.parameter, m->parameter, m->tet_count * sizeof *m->parameter));
    bw_tet_mesh_clear(ctx, &back);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_context_init(&ctx);
    ctx.memory.limit = BUDGET;
    bw_status status = bw_hexex_read_memory(&ctx, data, size, &mesh);
    FUZZ_EXPECT(status == ctx.error.status);
    FUZZ_EXPECT(status == BW_OK || *ctx.error.message);
    FUZZ_EXPECT(status != BW_E_INTERNAL && status != BW_E_IO && status != BW_E_MEMORY);
    FUZZ_EXPECT(ctx.memory.peak < (1 << 20) + 8 * size); /* declared counts alone take nothing */
    for (const char *c = ctx.error.message; *c; c++) FUZZ_EXPECT(*c >= ' ' && *c <= '~');
    if (status == BW_OK) {
        expect_in_range(&mesh);
        expect_same_after_writing(&ctx, &mesh);
        bw_tet_mesh_clear(&ctx, &mesh);
    }
    FUZZ_EXPECT(ctx.memory.used == 0);
    return 0;
}
