/* The VTU reader on arbitrary bytes. */
#include "fuzz_input.h"

#include "format/vtu.h"

static bw_status read_vtu(bw_context *ctx, const uint8_t *data, size_t size, bw_tet_mesh *mesh) {
    return bw_vtu_read_memory(ctx, data, size, mesh);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    return fuzz_input(read_vtu, data, size, 4096); /* deflated: 1032 : 1 */
}
