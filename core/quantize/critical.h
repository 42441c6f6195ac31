/* Critical entities: what the collapse of blocks without extent must leave where it is (Q 5.1), on our block complex.
 *
 * Critical patches are those of the boundary and those with feature facets. Critical arcs are singular or feature arcs, and those at which
 * critical patches do not simply continue flat in pairs: the rim of a sheet of features, the curve in which it meets another sheet or the
 * boundary. Critical nodes are feature vertices and those at which critical arcs end, meet or change their kind or direction.
 *
 *   link    (Q Definition 5) a maximal sequence of critical arcs through nodes that are not critical. It is straight: two singular curves that meet in an
 *           otherwise regular node run on in each other's direction, others are parted where they do not. It ends in critical nodes or is a cycle.
 *   region  (Q Definition 6) a maximal set of critical patches joined across arcs that are not critical. It is flat and ends at links, or is closed.
 *
 * T-joints need no care: links and regions are unions of whole arcs and whole patches, whatever ends at them from the side. The confinement zone of a
 * critical point (Q 5.3.2) is the lowest of node, link, region that holds it.
 */
#ifndef BW_QUANTIZE_CRITICAL_H
#define BW_QUANTIZE_CRITICAL_H

#include "quantize/surface.h"

/* An entity by number: nodes of the complex first, then links, then regions. */
typedef int32_t bw_critical_entity;

typedef struct {
    size_t nodes; /* of the complex */
    size_t node_count, link_count, region_count;
    uint8_t *node;         /* [node]: whether it is critical */
    int32_t *arc_link;     /* [arc]: its link, or BW_NONE */
    int32_t *patch_region; /* [patch]: its region, or BW_NONE */
    size_t *link_begin;    /* [link + 1] */
    bw_arc_use *link_arc;  /* in order and direction along the link */
    size_t *touch_begin;   /* [entity + 1] */
    bw_critical_entity *touch; /* ascending: itself, a link's ends, the links and critical nodes in a region's closure */
    int32_t *arc_edge;     /* [arc]: a place of it, an edge of the surface */
} bw_critical;

bw_status bw_critical_init(bw_context *ctx, const bw_cells *cells, const bw_surface *surface, bw_critical *critical);
void bw_critical_clear(bw_context *ctx, bw_critical *critical);

static inline bw_critical_entity bw_critical_link_entity(const bw_critical *c, int32_t link) { return (int32_t)c->nodes + link; }
static inline bw_critical_entity bw_critical_region_entity(const bw_critical *c, int32_t region) {
    return (int32_t)(c->nodes + c->link_count) + region;
}
/* Whether two entities have a node or a link in common, or are one. */
bool bw_critical_touch(const bw_critical *critical, bw_critical_entity a, bw_critical_entity b);

/* Whether a link returns to its start without a critical node. */
bool bw_critical_link_is_cycle(const bw_complex *complex, const bw_critical *critical, size_t link);

/* The rim through which a critical patch continues flat across an arc: seen from the same side as `rim`. BW_NONE where nothing does. *crossed (may
 * be NULL): the slot on the way, which leads from the block of `rim` to that of the result; BW_NONE if both are one block. */
int32_t bw_critical_continue(const bw_surface *surface, const int32_t *patch_region, int32_t rim, int32_t *crossed);

#endif
