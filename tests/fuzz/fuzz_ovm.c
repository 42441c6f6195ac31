/* The OpenVolumeMesh reader on arbitrary bytes. */
#include "fuzz_input.h"

#include "format/ovm.h"

static bw_status read_ovm(bw_context *ctx, const uint8_t *data, size_t size, bw_tet_mesh *mesh) {
    return bw_ovm_read_memory(ctx, data, size, mesh);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    return fuzz_input(read_ovm, data, size, 24);
}
