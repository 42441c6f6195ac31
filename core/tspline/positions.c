/* Where the vertices of a T-mesh are in space: hexes are carried back to the map by the block-wise map (MC 7.1), and the map's tets tell the rest. */
#include "hex/locate.h"
#include "tspline/tmesh.h"

bw_status bw_tmesh_positions(bw_context *ctx, const bw_tmesh *mesh, double (*position)[3]) {
    const bw_atlas *atlas = mesh->atlas;
    bool hexes = atlas->length != atlas->complex->arc_length;
    bw_blockwise map = {0};
    bw_locator locator = {0};
    bw_status status = hexes ? bw_blockwise_init(ctx, atlas, &map) : BW_OK;
    if (status == BW_OK) status = bw_locator_init_blocks(ctx, atlas->cells, atlas->complex, &locator);
    for (size_t v = 0; v < mesh->vertex_count && status == BW_OK; v++) {
        const bw_tpoint *point = &mesh->point[mesh->vertex_place[v]];
        double at[3], back[3];
        bw_hold hold;
        for (int k = 0; k < 3; k++) at[k] = (double)point->at[k] / BW_TMESH_UNIT;
        if (hexes) bw_blockwise_back(&map, point->block, at, back);
        bw_locate_in_block(&locator, point->block, hexes ? back : at, position[v], &hold);
        if (v % 1024 == 0) status = bw_poll(ctx);
    }
    bw_locator_clear(ctx, &locator), bw_blockwise_clear(ctx, &map);
    return status;
}
