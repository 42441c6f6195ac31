/* What holds for every reader behind format/input.h on arbitrary bytes. */
#ifndef BW_TESTS_FUZZ_INPUT_H
#define BW_TESTS_FUZZ_INPUT_H

#include "fuzz.h"

#include <math.h>
#include <string.h>

#include "format/input.h"
#include "hex/trivial.h"
#include "stage/sanitize.h"

enum { FUZZ_BUDGET = 64 << 20 };

static inline void fuzz_expect_mesh(const bw_tet_mesh *m) {
    FUZZ_EXPECT(m->position && (m->tet_count > 0) != (m->hex_count > 0));
    FUZZ_EXPECT(m->tet_count ? m->tet && m->parameter : m->hex && !m->parameter);
    for (size_t i = 0; i < 8 * m->hex_count; i++) FUZZ_EXPECT((size_t)m->hex[i / 8][i % 8] < m->vertex_count);
    for (size_t i = 0; i < 4 * m->feature_quad_count; i++) FUZZ_EXPECT((size_t)m->feature_quad[i / 4][i % 4] < m->vertex_count);
    FUZZ_EXPECT(m->hex_count ? !m->feature_facet_count : !m->feature_quad_count);
    for (size_t i = 0; i < 3 * m->vertex_count; i++) FUZZ_EXPECT(isfinite(m->position[i / 3][i % 3]));
    for (size_t i = 0; i < 12 * m->tet_count; i++)
        FUZZ_EXPECT(isfinite(m->parameter[i / 12][i % 12 / 3][i % 3]));
    for (size_t i = 0; i < 4 * m->tet_count; i++) FUZZ_EXPECT((size_t)m->tet[i / 4][i % 4] < m->vertex_count);
    for (size_t i = 0; i < m->feature_vertex_count; i++)
        FUZZ_EXPECT((size_t)m->feature_vertex[i] < m->vertex_count);
    for (size_t i = 0; i < 2 * m->feature_edge_count; i++)
        FUZZ_EXPECT((size_t)m->feature_edge[i / 2][i % 2] < m->vertex_count);
    for (size_t i = 0; i < 3 * m->feature_facet_count; i++)
        FUZZ_EXPECT((size_t)m->feature_facet[i / 3][i % 3] < m->vertex_count);
    FUZZ_EXPECT(!m->wall_count && !m->facet);
}

/* What is read as hexes is refused as input, or has an exact map. */
static inline void fuzz_expect_map(bw_context *ctx, bw_tet_mesh *mesh) {
    bw_grid_map map = {0};
    bw_hex_mesh source = {0};
    bw_vertex *kept = NULL;
    bw_trivial_report made;
    bw_sanitize_report found;
    bw_status status = bw_trivial_map(ctx, mesh, &map, &source, &kept, &made);
    if (status == BW_OK) {
        status = bw_sanitize(ctx, &(bw_sanitize_options){.tolerance = 0}, mesh, &map, &found);
        FUZZ_EXPECT(status == BW_OK || status == BW_E_INDEX || status == BW_E_NOT_ALIGNED || status == BW_E_MEMORY); /* features */
    }
    FUZZ_EXPECT(status == BW_OK || bw_status_class(status) == BW_CLASS_INPUT || bw_status_class(status) == BW_CLASS_LIMIT);
    bw_grid_map_clear(ctx, &map), bw_hex_mesh_clear(ctx, &source), bw_free(ctx, kept);
}

typedef bw_status fuzz_reader(bw_context *ctx, const uint8_t *data, size_t size, bw_tet_mesh *mesh);

/* `growth`: bytes of memory that a byte of input may take, besides 1 MiB. */
static inline int fuzz_input(fuzz_reader *read, const uint8_t *data, size_t size, size_t growth) {
    bw_context ctx;
    bw_tet_mesh mesh;
    bw_context_init(&ctx);
    ctx.memory.limit = FUZZ_BUDGET;
    bw_status status = read(&ctx, data, size, &mesh);
    FUZZ_EXPECT(status == ctx.error.status);
    FUZZ_EXPECT(status == BW_OK || *ctx.error.message);
    FUZZ_EXPECT(status != BW_E_INTERNAL && status != BW_E_IO && status != BW_E_MEMORY);
    FUZZ_EXPECT(ctx.memory.peak < (1 << 20) + growth * size); /* declared counts alone take nothing */
    for (const char *c = ctx.error.message; *c; c++) FUZZ_EXPECT(*c >= ' ' && *c <= '~');
    if (status == BW_OK)
        fuzz_expect_mesh(&mesh);
    else
        FUZZ_EXPECT(!mesh.position && !mesh.tet && !mesh.hex && !mesh.parameter && !mesh.vertex_count);
    if (mesh.hex_count) fuzz_expect_map(&ctx, &mesh);
    bw_tet_mesh_clear(&ctx, &mesh);
    FUZZ_EXPECT(ctx.memory.used == 0);
    return 0;
}

#endif
