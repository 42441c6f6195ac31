/* Encoded data of VTU files: base64, and blocks deflated by zlib, each behind a header of counts. */
#ifndef BW_FORMAT_VTU_DATA_H
#define BW_FORMAT_VTU_DATA_H

#include "format/input_scan.h"

typedef struct {
    bool base64, deflated, wide, big; /* wide: counts of 64 bits; big: big-endian */
} bw_vtu_coding;

/* Decodes the `size` bytes that begin at the cursor of *s. *out stands over them: in the input itself (raw
 * and not deflated), else in
 * *owned, which the caller frees. BW_E_COUNT if the header announces another size; BW_E_SYNTAX where base64
 * or the deflated data is broken; BW_E_TRUNCATED. */
bw_status bw_vtu_decode(bw_scan *s, bw_vtu_coding coding, uint64_t size, bw_scan *out, void **owned);

#endif
