/* The legacy VTK reader on arbitrary bytes. */
#include "fuzz_input.h"

#include "format/vtk.h"

static bw_status read_vtk(bw_context *ctx, const uint8_t *data, size_t size, bw_tet_mesh *mesh) {
    return bw_vtk_read_memory(ctx, data, size, mesh);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    return fuzz_input(read_vtk, data, size, 24);
}
