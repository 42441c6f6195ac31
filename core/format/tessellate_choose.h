/* The combinatorial part of tessellate.h. */
#ifndef BW_FORMAT_TESSELLATE_CHOOSE_H
#define BW_FORMAT_TESSELLATE_CHOOSE_H

#include "format/tessellate.h"

/* Given size[] and straight[], fills fan[] and apex[]; cells that no vertex can be the apex of keep BW_NONE.
 * O(n). */
bw_status bw_tessellation_choose(bw_context *ctx, bw_tessellation *tessellation);

#endif
