/* bwh2vtk IN.bwh OUT.vtk: a hexmesh.bwh as legacy VTK. An example of bwh.h.
 *
 *     cc -O2 bwh2vtk.c bwh.c -lm -o bwh2vtk
 */
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>

#include "bwh.h"

/* The whole file; NULL if it cannot be read. */
static char *read_file(const char *path, size_t *size) {
    FILE *in = fopen(path, "rb");
    char *data = NULL;
    size_t room = 0;
    for (*size = 0; in && (*size == room);) {
        char *more = realloc(data, room = 2 * room + 65536);
        if (!more) break;
        data = more;
        *size += fread(data + *size, 1, room - *size, in);
    }
    bool good = in && !ferror(in) && feof(in);
    if (in) fclose(in);
    if (good) return data;
    free(data);
    return NULL;
}

static bool write_vtk(const bwh_mesh *m, const char *path) {
    FILE *out = fopen(path, "w");
    if (!out) return false;
    fprintf(out, "# vtk DataFile Version 3.0\nhexahedral mesh\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS %zu double\n", m->vertex_count);
    for (size_t v = 0; v < m->vertex_count; v++) fprintf(out, "%.17g %.17g %.17g\n", m->position[v][0], m->position[v][1], m->position[v][2]);
    fprintf(out, "CELLS %zu %zu\n", m->hex_count, 9 * m->hex_count);
    for (size_t h = 0; h < m->hex_count; h++) {
        fputc('8', out);
        for (int i = 0; i < 8; i++) fprintf(out, " %d", m->hex[h][bwh_ring[i]]);
        fputc('\n', out);
    }
    fprintf(out, "CELL_TYPES %zu\n", m->hex_count);
    for (size_t h = 0; h < m->hex_count; h++) fputs("12\n", out);
    fprintf(out, "CELL_DATA %zu\nSCALARS block int 1\nLOOKUP_TABLE default\n", m->hex_count);
    for (size_t h = 0; h < m->hex_count; h++) fprintf(out, "%d\n", m->block[h]);
    bool good = !ferror(out);
    return fclose(out) == 0 && good;
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fprintf(stderr, "Usage: bwh2vtk IN.bwh OUT.vtk\n");
        return 2;
    }
    size_t size;
    char *data = read_file(argv[1], &size);
    if (!data) {
        perror(argv[1]);
        return 3;
    }
    bwh_mesh mesh;
    bwh_status status = bwh_decode(data, size, 0, &mesh);
    free(data);
    if (status != BWH_OK) {
        fprintf(stderr, "bwh2vtk: %s: %s\n", argv[1], bwh_text(status));
        return 3;
    }
    bool good = write_vtk(&mesh, argv[2]);
    bwh_clear(&mesh);
    if (!good) perror(argv[2]);
    return good ? 0 : 5;
}
