#include "refine.h"

#include <string.h>

/* Points of a tet: 0..3 its corners, 4 + e the middle of edge e. Each row is positive in a positive tet. */
static const uint8_t part[8][4] = {{0, 4, 5, 6}, {4, 1, 7, 8}, {5, 7, 2, 9}, {6, 8, 9, 3},
                                   {5, 8, 6, 4}, {5, 8, 9, 6}, {5, 8, 7, 9}, {5, 8, 4, 7}};

static void point(const bw_tet_mesh *in, size_t tet, int i, bw_vertex *vertex, double parameter[3]) {
    if (i < 4) {
        *vertex = in->tet[tet][i];
        memcpy(parameter, in->parameter[tet][i], 3 * sizeof *parameter);
        return;
    }
    const uint8_t *end = bw_tet_edge_corners[i - 4];
    *vertex = (bw_vertex)in->vertex_count + in->tet_edge[tet][i - 4];
    for (int k = 0; k < 3; k++)
        parameter[k] = 0.5 * in->parameter[tet][end[0]][k] + 0.5 * in->parameter[tet][end[1]][k];
}

bw_status bench_refine(bw_context *ctx, bw_tet_mesh *in, bw_tet_mesh *out) {
    *out = (bw_tet_mesh){0};
    bw_status status = bw_tet_mesh_connect(ctx, in);
    if (status != BW_OK) return status;
    out->vertex_count = in->vertex_count + in->edge_count;
    out->tet_count = 8 * in->tet_count;
    out->position = bw_alloc(ctx, out->vertex_count, sizeof *out->position);
    out->tet = bw_alloc(ctx, out->tet_count, sizeof *out->tet);
    out->parameter = bw_alloc(ctx, out->tet_count, sizeof *out->parameter);
    if (ctx->error.status != BW_OK) return ctx->error.status;
    memcpy(out->position, in->position, in->vertex_count * sizeof *in->position);
    for (size_t e = 0; e < in->edge_count; e++)
        for (int k = 0; k < 3; k++)
            out->position[in->vertex_count + e][k] =
                0.5 * (in->position[in->edge[e][0]][k] + in->position[in->edge[e][1]][k]);
    for (size_t t = 0; t < out->tet_count; t++)
        for (int i = 0; i < 4; i++) point(in, t / 8, part[t % 8][i], &out->tet[t][i], out->parameter[t][i]);
    return BW_OK;
}
