/* The Gmsh reader on arbitrary bytes. */
#include "fuzz_input.h"

#include "format/msh.h"

static bw_status read_msh(bw_context *ctx, const uint8_t *data, size_t size, bw_tet_mesh *mesh) {
    return bw_msh_read_memory(ctx, data, size, mesh);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    return fuzz_input(read_msh, data, size, 40);
}
