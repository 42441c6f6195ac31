#include "format/igm_hexex.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>

#include "format/hexex_write.h"

void bw_dyadic_text(int64_t value, int32_t exponent, char out[BW_DYADIC_TEXT]) {
    uint64_t size = value < 0 ? -(uint64_t)value : (uint64_t)value, mask = ((uint64_t)1 << exponent) - 1, rest = size & mask;
    int n = snprintf(out, BW_DYADIC_TEXT, "%s%" PRIu64, value < 0 ? "-" : "", size >> exponent);
    if (!rest) return;
    out[n++] = '.';
    while (rest && n < BW_DYADIC_TEXT - 1) { /* one digit after the other; each leaves a bit less */
        unsigned __int128 ten = (unsigned __int128)rest * 10;
        out[n++] = (char)('0' + (int)(ten >> exponent));
        rest = (uint64_t)ten & mask;
    }
    out[n] = 0;
}

static void write_tet(bw_hexex_writer *w, const bw_igm *igm, size_t t) {
    char text[12][BW_DYADIC_TEXT];
    const char *number[12];
    for (int i = 0; i < 12; i++) {
        bw_dyadic_text(igm->map.value[t][i / 3][i % 3], igm->map.exponent, text[i]);
        number[i] = text[i];
    }
    bw_hexex_write_tet_text(w, igm->mesh.tet[t], number);
}

bw_status bw_igm_hexex_write(bw_context *ctx, const bw_igm *igm, const char *path, uint64_t *bytes) {
    const bw_tet_mesh *m = &igm->mesh;
    bw_hexex_writer w;
    bw_hexex_write_begin(ctx, &w, path, m->vertex_count);
    for (size_t v = 0; v < m->vertex_count; v++) bw_hexex_write_vertex(&w, m->position[v]);
    bw_hexex_write_tets(&w, m->tet_count);
    for (size_t t = 0; t < m->tet_count; t++) {
        if (t % 4096 == 0 && bw_poll(ctx)) break;
        write_tet(&w, igm, t);
    }
    if (m->feature_vertex_count + m->feature_edge_count + m->feature_facet_count) {
        bw_hexex_write_features(&w, m->feature_vertex_count, m->feature_edge_count, m->feature_facet_count);
        for (size_t i = 0; i < m->feature_vertex_count; i++) bw_hexex_write_feature_vertex(&w, m->feature_vertex[i]);
        for (size_t i = 0; i < m->feature_edge_count; i++) bw_hexex_write_feature_edge(&w, m->feature_edge[i]);
        for (size_t i = 0; i < m->feature_facet_count; i++) bw_hexex_write_feature_facet(&w, m->feature_facet[i]);
    }
    return bw_hexex_write_end(&w, bytes);
}
