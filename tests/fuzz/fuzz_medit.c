/* The Medit reader on arbitrary bytes: the mesh, then, after the byte 0xff that neither has in text, its side
 * file. Without that byte the mesh stands for both, or if its size is even there is no side file, as for hexes;
 * in binary meshes the last such byte parts them. */
#include "fuzz_input.h"

#include "format/medit.h"

static bw_status read_medit(bw_context *ctx, const uint8_t *data, size_t size, bw_tet_mesh *mesh) {
    const uint8_t *part = size ? memrchr(data, 0xff, size) : NULL;
    if (!part) return bw_medit_read_memory(ctx, data, size, size % 2 ? data : NULL, size, mesh);
    size_t first = (size_t)(part - data);
    return bw_medit_read_memory(ctx, data, first, part + 1, size - first - 1, mesh);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    return fuzz_input(read_medit, data, size, 24);
}
