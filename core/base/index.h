/* Index types. All count from 0; BW_NONE marks absence. Sizes in memory are size_t. */
#ifndef BW_BASE_INDEX_H
#define BW_BASE_INDEX_H

#include <stdint.h>

typedef int32_t bw_vertex; /* of the input tet mesh */
typedef int32_t bw_tet;
typedef int32_t bw_facet; /* triangle of the tet mesh */
typedef int32_t bw_edge;  /* edge of the tet mesh */

typedef int32_t bw_cvertex; /* of the cell complex */
typedef int32_t bw_cedge;
typedef int32_t bw_polygon;
typedef int32_t bw_cell;

typedef int32_t bw_node; /* of the block complex */
typedef int32_t bw_arc;
typedef int32_t bw_patch;
typedef int32_t bw_block;

enum { BW_NONE = -1 };

#endif
