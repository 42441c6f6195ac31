/* Quality of a hex mesh: shapes, valences, sizes, and how far its boundary is from the surface of the tet mesh it was made from.
 *
 * The scaled Jacobian of a corner is the determinant of the unit vectors along its three edges; that of a hexahedron is the least over its 8 corners (Knupp; the
 * Verdict library): 1 for a box, positive if the trilinear map is positive at every corner.
 *
 * Distances are between the hex mesh's boundary, each quad as four triangles around the mean of its corners, and the triangles of the input's
 * boundary: from samples of one (vertices, and points inside triangles) to exactly the closest point of the other. They are
 * lower bounds of the Hausdorff distance, which samples approach from below.
 */
#ifndef BW_HEX_QUALITY_H
#define BW_HEX_QUALITY_H

#include "hex/hexmesh.h"
#include "hex/surface.h"

enum { BW_HEX_BINS = 20, BW_HEX_WORST = 16, BW_HEX_VALENCES = 12 };

typedef struct {
    bw_hex hex;
    double scaled_jacobian;
    double centre[3];
} bw_hex_worst;

typedef struct {
    double min, mean, max;
} bw_hex_range;

typedef struct {
    bw_hex_range scaled_jacobian;
    uint64_t hexes, nonpositive;        /* hexes whose scaled Jacobian is not positive */
    uint64_t histogram[BW_HEX_BINS];    /* over -1..1, each bin with its lower end; 1 in the last */
    size_t worst_count;
    bw_hex_worst worst[BW_HEX_WORST];   /* ascending */
    uint64_t inner[BW_HEX_VALENCES], boundary[BW_HEX_VALENCES]; /* [hexes around it] number of edges; the last for that many or more */
    double volume;                      /* of the hexes, by their trilinear maps */
    bw_hex_range edge_length;
} bw_hex_quality;

typedef struct {
    double diagonal;             /* of the input's box */
    double to_input, from_input; /* from the hex mesh's boundary to the input's, and back */
    double curves;               /* from the input's curves to edges of the hex mesh along them, and back */
    double input_volume;
} bw_hex_distance;

/* corner[c]: its position; the edges of corner c lead to c^1, c^2, c^4. */
double bw_hex_corner_jacobian(const double corner[8][3], int c);
/* Least over the 8 corners. */
double bw_hex_scaled_jacobian(const double corner[8][3]);
void bw_hex_corners(const bw_hex_mesh *mesh, bw_hex hex, double corner[8][3]);
/* O(n). Errors: BW_E_MEMORY, BW_E_CANCELLED. The same bits at any thread count. */
bw_status bw_hex_measure(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_quality *quality);
/* O(n log n). Errors: BW_E_MEMORY, BW_E_CANCELLED. */
bw_status bw_hex_measure_distance(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_surface *surface, bw_hex_distance *distance);

#endif
