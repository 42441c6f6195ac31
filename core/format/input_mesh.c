#include "format/input_mesh.h"

#include <string.h>
#include <strings.h>

bw_status bw_input_add_feature(bw_context *ctx, bw_tet_mesh *mesh, bw_input_room *room, int corners,
                               const bw_vertex *corner) {
    bw_vertex **list = corners == 1   ? &mesh->feature_vertex
                       : corners == 2 ? (bw_vertex **)&mesh->feature_edge
                                      : (bw_vertex **)&mesh->feature_facet;
    size_t *count = corners == 1   ? &mesh->feature_vertex_count
                    : corners == 2 ? &mesh->feature_edge_count
                                   : &mesh->feature_facet_count;
    size_t n = (size_t)corners;
    if ((*count + 1) * n > room->room[corners - 1]) {
        bw_status status = bw_reserve(ctx, list, &room->room[corners - 1], (*count + 1) * n);
        if (status != BW_OK) return status;
    }
    memcpy(*list + *count * n, corner, n * sizeof *corner);
    ++*count;
    return BW_OK;
}

int64_t bw_input_choose(const char *(*name)(const void *user, size_t i), const void *user, size_t count) {
    static const char *const known[] = {"parametrization", "uvw", "param"};
    for (size_t k = 0; k < sizeof known / sizeof *known; k++)
        for (size_t i = 0; i < count; i++)
            if (!strcasecmp(name(user, i), known[k])) return (int64_t)i;
    return count == 0 ? -1 : count == 1 ? 0 : -2;
}
