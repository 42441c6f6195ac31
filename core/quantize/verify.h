/* Independent decision whether a quantization is valid: from the complex and the integers alone, by contraction (Q 5.1).
 *
 * Nothing here searches for paths or knows of constraints. The complex is built again with every block as large as the integers say, blocks, patches and
 * arcs without extent included, and what touches is identified. What comes out is looked at: it has to be a hexahedral mesh with the critical
 * curves and surfaces of the complex on it, one to one.
 *
 * Critical are: boundary regions and feature surfaces; singular and feature curves (links), and rims of feature surfaces; singular nodes, feature vertices, and
 * where links end. VALID means all of
 *  1. opposite sides of every patch are equally long (Q 7), and no block has a negative extent (Q 8);
 *  2. no link, no region, no volume as a whole is gone;
 *  3. every unit square of the contracted complex has a hex on both sides, or a hex on one and one piece of the boundary on the other; pieces of different regions
 *     never share a square;
 *  4. links and critical nodes map to it one to one: two of their points never coincide;
 *  5. an edge has as many hexes around it as its link says, 4 or 2 if it is on none; a vertex has as many corners of hexes as its
 *     critical node, link or region has in the complex, else 8; its surroundings are one ball, or half a ball on the boundary;
 *  6. the Euler characteristic is that of the complex.
 *
 * Why this is enough: verify_check.c. How negative arcs are dealt with: verify_contacts.c.
 */
#ifndef BW_QUANTIZE_VERIFY_H
#define BW_QUANTIZE_VERIFY_H

#include "complex/complex.h"

/* What is broken, tested in this order. */
typedef enum {
    BW_VALID,
    BW_FAULT_RECTANGLE,   /* a patch has opposite sides of different lengths */
    BW_FAULT_EXTENT,      /* a block has a negative extent */
    BW_FAULT_LINK,        /* a link has no length */
    BW_FAULT_REGION,      /* a boundary region or feature surface has no area */
    BW_FAULT_VOLUME,      /* nothing has volume */
    BW_FAULT_COINCIDENCE, /* points of critical entities coincide that do not in the complex */
    BW_FAULT_TOPOLOGY,    /* what is left is no mesh, or not one of the same shape */
    BW_UNDECIDED          /* more than 2^12 patches lie around one place of a wall, or the contracted complex would have more than 2^21 vertices, or its blocks 2^18 planes, and some length is not positive */
} bw_fault;

const char *bw_fault_name(bw_fault fault); /* "valid", "rectangle", ... */

typedef struct {
    bw_fault fault;
    char kind[8]; /* of the element at fault: "patch", "block", "arc", "node"; empty if it is the whole */
    int64_t id, other; /* other: a second one of the kind, or -1 */
    char message[160];
    size_t cells; /* hexes of the contracted complex after merging alike ones; 0 if it was not needed: lengths are positive, and it would be large */
} bw_verdict;

/* Decides whether `length` ([arc], counted from arc_node[a][0] to arc_node[a][1]; any integers) is valid. Errors: BW_E_RANGE if they add up
 * to more than 2^60; BW_E_CHECK where the complex itself is not as bw_complex_check wants it; BW_E_MEMORY. O(n log n) in the size of the complex and of the base complex of
 * the contracted one, which has no more cells than there are hexes. */
bw_status bw_verify(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const int64_t *length, bw_verdict *out);

#endif
