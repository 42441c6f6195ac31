/* Sparse serial construction (MC 4.2, last remark; after EGKT08, 7): walls one after another, and none that the blocks can do without.
 *
 * The singular arcs are visited one after another, along each its edges. At an edge whatever walls came there from elsewhere are taken as
 * they are. Where the angle between two of them that follow each other around the edge is more than half a turn, the iso-surface that
 * continues the first straight is lit and burns out before the next is looked for. So
 *
 *   around every singular edge walls are 90 or 180 degrees apart when it has been visited, and burning more walls later
 *   only makes angles smaller: an iso-surface is left out exactly where both of its neighbours around the edge burn, the
 *   condition of the 2D case. A block sees such an edge inside a side, and its own edges and corners have 90 degrees.
 *
 * A regular feature edge gets the walls that make it part of an arc: three that meet in a T.
 */
#ifndef BW_MESH_FIRE_SERIAL_H
#define BW_MESH_FIRE_SERIAL_H

#include "mesh/fire.h"

/* Lights and burns out, arc by arc, what the singular and feature edges need. Requires that the tets around these edges are
 * opened, and nothing is alight. */
bw_status bw_fire_serial(bw_fire *fire);

#endif
