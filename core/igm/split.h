/* Splitting edges of a frame: more freedom where a map could not be made.
 *
 * A new vertex is in the middle of its edge, in space, in the input's map and in the map being made; on an aligned facet or a line it is held like them. So the surface and the
 * features stay the same sets of points, and what is linear on the old tets is linear on the new ones.
 */
#ifndef BW_IGM_SPLIT_H
#define BW_IGM_SPLIT_H

#include "igm/frame.h"

/* Splits edges around the tets that are marked ([tet]): those between two held vertices that lie in no aligned facet and no line; where there are none, all edges of the marked
 * tets. Requires a resolved frame and leaves one. *count: how many. Errors: BW_E_MEMORY, BW_E_RANGE if indices run out. */
bw_status bw_frame_split(bw_context *ctx, bw_frame *frame, const uint8_t *marked, size_t *count);

#endif
