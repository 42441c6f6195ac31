/* An integer-grid map as .hexex (form: format/hexex.h): parameters in units of hexes, as exact decimals.
 *
 * Values are multiples of a power of two, so decimals end. Features of the mesh follow the tets; there is no wall list.
 */
#ifndef BW_FORMAT_IGM_HEXEX_H
#define BW_FORMAT_IGM_HEXEX_H

#include "igm/igm.h"

enum { BW_DYADIC_TEXT = 72 };

/* value * 2^-exponent as a decimal without loss; 0 <= exponent <= 40. */
void bw_dyadic_text(int64_t value, int32_t exponent, char out[BW_DYADIC_TEXT]);
/* Writes the file at `path`. BW_E_IO, BW_E_MEMORY, BW_E_CANCELLED. */
bw_status bw_igm_hexex_write(bw_context *ctx, const bw_igm *igm, const char *path, uint64_t *bytes);

#endif
