#include "format/input_mesh.h"

#include <string.h>
#include <strings.h>

bw_status bw_input_add_feature(bw_context *ctx, bw_tet_mesh *mesh, bw_input_room *room, int corners,
                               const bw_vertex *corner) {
    bw_vertex **list = corners == 1   ? &mesh->feature_vertex
                       : corners == 2 ? (bw_vertex **)&mesh->feature_edge
                       : corners == 3 ? (bw_vertex **)&mesh->feature_facet
                                      : (bw_vertex **)&mesh->feature_quad;
    size_t *count = corners == 1   ? &mesh->feature_vertex_count
                    : corners == 2 ? &mesh->feature_edge_count
                    : corners == 3 ? &mesh->feature_facet_count
                                   : &mesh->feature_quad_count;
    size_t n = (size_t)corners;
    if ((*count + 1) * n > room->room[corners - 1]) {
        bw_status status = bw_reserve(ctx, list, &room->room[corners - 1], (*count + 1) * n);
        if (status != BW_OK) return status;
    }
    memcpy(*list + *count * n, corner, n * sizeof *corner);
    ++*count;
    return BW_OK;
}

void bw_input_from_ring(bw_vertex hex[8]) {
    for (int i = 2; i < 8; i += 4) {
        bw_vertex v = hex[i];
        hex[i] = hex[i + 1], hex[i + 1] = v;
    }
}

bw_status bw_input_check_cells(bw_scan *place, const bw_tet_mesh *mesh) {
    bool tets = mesh->tet_count > 0, hexes = mesh->hex_count > 0;
    if (!tets && !hexes) return bw_fail(place->ctx, BW_E_EMPTY, "the input has no tets and no hexes");
    if (tets && hexes) {
        place->kind = "hex", place->record = 0;
        return bw_scan_fail(place, BW_E_SYNTAX, "the mesh has tets as well; its cells are all of one kind, or it is not read");
    }
    size_t alien = tets ? mesh->feature_quad_count : mesh->feature_facet_count;
    return alien ? bw_scan_fail(place, BW_E_INDEX, "%zu %s among the features, which are no faces of %s", alien, tets ? "quads" : "triangles", tets ? "tets" : "hexes") : BW_OK;
}

int64_t bw_input_choose(const char *(*name)(const void *user, size_t i), const void *user, size_t count) {
    static const char *const known[] = {"parametrization", "uvw", "param"};
    for (size_t k = 0; k < sizeof known / sizeof *known; k++)
        for (size_t i = 0; i < count; i++)
            if (!strcasecmp(name(user, i), known[k])) return (int64_t)i;
    return count == 0 ? -1 : count == 1 ? 0 : -2;
}
