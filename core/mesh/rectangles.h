/* Parts walls into rectangles where they turn around singular vertices.
 *
 * Around a singular edge that lies in a side of a block, two walls pass it flat. Where such edges end or turn, the arcs around their
 * common vertex can be more than half a turn apart within that side: a wall that is L-shaped, or has a hole (at the foot of a smaller box that
 * stands on a larger one, say). The blocks are cuboids all the same (MC 4.1 asks no more), but patches have to be rectangles.
 *
 * There the arc is continued straight, through the wall alone, up to the next arc: a motorcycle in two dimensions. The edges of this
 * line are marked BW_KEPT; the cells beside it are cut, and nothing burns.
 */
#ifndef BW_MESH_RECTANGLES_H
#define BW_MESH_RECTANGLES_H

#include "mesh/fire.h"

/* Draws such lines from the ends of singular edges until arcs next to each other around them are at most half a turn apart in every wall. Requires
 * that nothing is alight. Cells are cut within the fire's max_cells. */
bw_status bw_rectangles(bw_fire *fire);

#endif
