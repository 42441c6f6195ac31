/* What the sources of the verifier share: verify.c calls them in the order below.
 *
 * Two lengths are carried everywhere: under the quantization (q), and in the map (p, grid units, always positive). Together, compared first by q and then
 * by p, they measure in q + epsilon p: lengths so near to the quantization's that nothing but its zeros changes, while no
 * block, and no arc that is not negative, is without extent any more.
 */
#ifndef BW_QUANTIZE_VERIFY_PARTS_H
#define BW_QUANTIZE_VERIFY_PARTS_H

#include "quantize/verify.h"

typedef struct {
    int64_t q, p;
} bw_pair;

static inline int bw_pair_compare(bw_pair a, bw_pair b) {
    if (a.q != b.q) return a.q < b.q ? -1 : 1;
    return (a.p > b.p) - (a.p < b.p);
}

/* A node on the surface of a block, in its chart. A node may have several places in one block. */
typedef struct {
    bw_pair at[3];
    bw_node node;
} bw_place;

/* An arc on the surface of a block, with the two patches that it has there. */
typedef struct {
    int32_t place[2]; /* its ends: low and high in the map */
    bw_arc arc;
    bw_patch patch[2];
    uint8_t side[2];  /* of the block in which they lie; equal if the arc is inside a side (T-arc) */
    uint8_t axis;
    bool reversed;    /* arc_node[0] is at place[1] */
} bw_rib;

/* A rectangle in the chart of a block: low and high as in the map, so high.q may be less than low.q. Both are equal along its normal. */
typedef struct {
    bw_pair low[3], high[3];
} bw_box;

/* A critical curve, straight from end to end: arcs of one kind. */
typedef struct {
    int64_t length;     /* q */
    bw_arc arc;         /* one of it */
    bw_node end[2];     /* BW_NONE: closed */
    int32_t quarters, surfaces; /* angle around it; critical patches around it */
    bool boundary;
} bw_verify_link;

/* Where two blocks touch, or a block and the outside. */
typedef struct {
    bw_block block[2];   /* [1]: BW_NONE outside */
    uint8_t side[2];
    bw_transition chart; /* of block[0] to that of block[1], in q */
    int64_t low[3], high[3]; /* q, in the chart of block[0] */
    bw_patch patch;      /* where they touch in the complex, or the first patch on the way from one to the other */
    bool critical;       /* part of a region: that of `patch` */
} bw_contact;

typedef struct {
    bw_context *ctx;
    const bw_cells *cells;
    const bw_complex *x;
    const int64_t *length;
    bw_verdict *verdict;

    /* verify_place.c */
    bw_transition *across;    /* [patch], inner ones: chart of patch_block[0] to that of patch_block[1], in p */
    bw_box (*box)[2];         /* [patch][slot] */
    int64_t (*extent)[3];     /* [block] q */
    size_t *place_begin;      /* [block + 1] */
    bw_place *place;
    size_t place_room;
    size_t *rib_begin;        /* [block + 1] */
    bw_rib *rib;
    size_t rib_room;

    /* verify_strata.c */
    uint8_t *surface;         /* [patch] SURFACE_* */
    bw_patch (*arc_surface)[2]; /* [arc] its first two critical patches */
    int32_t *arc_surfaces;    /* [arc] how many it has */
    int32_t *arc_link;        /* [arc]; BW_NONE if it is not critical */
    int64_t *arc_at;          /* [arc] coordinate of arc_node[0] along the link */
    int8_t *arc_sense;        /* [arc] 1: runs along the link; -1 */
    bw_verify_link *link;
    size_t link_count;
    uint8_t *node_critical;
    int32_t *node_octants;    /* [node] corners of cubes around it */
    int32_t *node_quadrants;  /* [node] corners of squares around it on the boundary */

    /* verify_contacts.c */
    uint8_t *slid;            /* [6 * block + side]: something on the wall of this side has passed something else */
    bw_contact *contact;
    size_t contact_count, contact_room;

    bool positive; /* no arc has to be contracted: the complex itself, with longer and shorter arcs, is the proof */
    bool too_fine; /* the contracted complex would have too many elements */
} bw_verifier;

enum { BW_SURFACE_NONE, BW_SURFACE_BOUNDARY, BW_SURFACE_FEATURE };

/* The first three steps, for whoever needs what they find: *v is to be closed, also after a failure or with a fault in *out. Errors as bw_verify. */
bw_status bw_verify_open(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, const int64_t *length, bw_verdict *out, bw_verifier *v);
void bw_verify_close(bw_verifier *v);

/* Records the first fault. other: -1 for none. */
void bw_verify_fault(bw_verifier *v, bw_fault fault, const char *kind, int64_t id, int64_t other, const char *message);
static inline bool bw_verify_going(const bw_verifier *v, bw_status status) {
    return status == BW_OK && v->verdict->fault == BW_VALID;
}

/* Places the nodes, ribs and patches of every block; finds RECTANGLE and EXTENT. */
bw_status bw_verify_place(bw_verifier *v);
/* Critical entities; finds LINK, REGION and VOLUME. */
bw_status bw_verify_strata(bw_verifier *v);
/* What touches; finds TOPOLOGY where walls cannot be laid out. */
bw_status bw_verify_contacts(bw_verifier *v);
/* The contracted complex; finds COINCIDENCE and TOPOLOGY, or sets too_fine. */
bw_status bw_verify_contraction(bw_verifier *v);

#endif
