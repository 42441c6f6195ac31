/* Sample hex meshes as files of every format, beside a JSON file that says what is in them: for readers in other languages. */
#ifndef BW_TESTS_CORE_HEX_FILES_H
#define BW_TESTS_CORE_HEX_FILES_H

#include "core/hex_kit.h"

#include <stdio.h>

#include "format/hex_write.h"

static inline void hex_files_list(FILE *out, const char *name, size_t count, int width, const int32_t *value, size_t stride, const char *after) {
    fprintf(out, "\"%s\": [", name);
    for (size_t i = 0; i < count; i++) {
        fprintf(out, "%s%s", i ? ", " : "", width > 1 ? "[" : "");
        for (int k = 0; k < width; k++) fprintf(out, "%s%d", k ? ", " : "", value[i * stride + (size_t)k]);
        if (width > 1) fputc(']', out);
    }
    fprintf(out, "]%s\n", after);
}

/* {points, held, hexes (corners around the low face, then the high one), block, ijk, quads, surface, edges: [low, high, hexes, boundary]} */
static inline void hex_files_truth(const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path) {
    FILE *out = fopen(path, "w");
    assert_non_null(out);
    int32_t *list = calloc(8 * mesh->hex_count + mesh->vertex_count + 8 * skin->quad_count + 8 * skin->edge_count, sizeof *list);
    fprintf(out, "{\"points\": [");
    for (size_t v = 0; v < mesh->vertex_count; v++)
        fprintf(out, "%s[%.17g, %.17g, %.17g]", v ? ",\n" : "", mesh->position[v][0], mesh->position[v][1], mesh->position[v][2]);
    fprintf(out, "],\n");
    for (size_t v = 0; v < mesh->vertex_count; v++) list[v] = mesh->held[v];
    hex_files_list(out, "held", mesh->vertex_count, 1, list, 1, ",");
    static const int ring[8] = {0, 1, 3, 2, 4, 5, 7, 6};
    for (size_t i = 0; i < 8 * mesh->hex_count; i++) list[i] = mesh->hex[i / 8][ring[i % 8]];
    hex_files_list(out, "hexes", mesh->hex_count, 8, list, 8, ",");
    hex_files_list(out, "block", mesh->hex_count, 1, mesh->block, 1, ",");
    hex_files_list(out, "ijk", mesh->hex_count, 3, mesh->ijk[0], 3, ",");
    for (size_t i = 0; i < 4 * skin->quad_count; i++) list[i] = bw_hex_quad_vertex(mesh, &skin->quad[i / 4], (int)(i % 4));
    hex_files_list(out, "quads", skin->quad_count, 4, list, 4, ",");
    for (size_t i = 0; i < skin->quad_count; i++) list[i] = skin->quad[i].surface;
    hex_files_list(out, "surface", skin->quad_count, 1, list, 1, ",");
    for (size_t i = 0; i < skin->edge_count; i++) {
        const bw_hex_edge *e = &skin->edge[i];
        list[4 * i] = e->vertex[0], list[4 * i + 1] = e->vertex[1], list[4 * i + 2] = e->valence, list[4 * i + 3] = e->boundary;
    }
    hex_files_list(out, "edges", skin->edge_count, 4, list, 4, "}");
    free(list);
    assert_int_equal(fclose(out), 0);
}

#endif
