/* Verifier, 2: the critical entities of the complex (Q 5.1, definitions 5 and 6), features among them, and how it looks around each.
 *
 * Surfaces are boundary patches and patches with feature facets. An arc is critical if it is singular or a feature, or if not just two surfaces pass it flat:
 * that is where a feature surface ends, bends or meets another. A node is critical if it is a feature, or if the critical arcs at it are not two of one kind that
 * continue each other straight; critical arcs between critical nodes are links, surfaces between links are regions.
 *
 * Two arcs at a node continue each other if no block has them perpendicular. (Perpendicular ones of a regular node bound an octant, which lies in
 * a block, whose surface then has both. Around a singular arc of k quarters that goes straight on there are 2 k octants; the only way to fill a sphere by 2 k octants
 * with two vertices of degree k, all others of degree 4, is the double pyramid with those as its tips.)
 */
#include "base/forest.h"
#include "quantize/verify_parts.h"

/* ---- around nodes and arcs ---- */

static int ends_of(const bw_verifier *v, size_t block, const bw_place *place) {
    int ends = 0;
    for (int k = 0; k < 3; k++) ends += place->at[k].p == 0 || place->at[k].p == v->x->block_extent[block][k];
    return ends;
}

static void count_corners(bw_verifier *v) {
    const bw_complex *x = v->x;
    for (size_t b = 0; b < x->block_count; b++)
        for (size_t i = v->place_begin[b]; i < v->place_begin[b + 1]; i++)
            v->node_octants[v->place[i].node] += 8 >> ends_of(v, b, &v->place[i]);
    for (size_t p = 0; p < x->patch_count; p++) {
        if (!(x->patch_flags[p] & BW_PATCH_BOUNDARY)) continue;
        for (size_t s = 0; s < 4; s++)
            for (size_t i = x->patch_chain_begin[4 * p + s]; i < x->patch_chain_begin[4 * p + s + 1]; i++)
                v->node_quadrants[bw_arc_use_start(x, x->patch_chain[i])] += i == x->patch_chain_begin[4 * p + s] ? 1 : 2;
    }
}

/* BW_PATCH_FEATURE is also set where reduction must keep a patch for a node: the facets tell. */
static uint8_t surface_of(const bw_verifier *v, size_t patch) {
    const bw_complex *x = v->x;
    if (x->patch_flags[patch] & BW_PATCH_BOUNDARY) return BW_SURFACE_BOUNDARY;
    if (x->patch_flags[patch] & BW_PATCH_FEATURE)
        for (size_t i = x->patch_polygon_begin[patch]; i < x->patch_polygon_begin[patch + 1]; i++)
            if (v->cells->polygon[x->patch_polygon[i]].flags & BW_FEATURE) return BW_SURFACE_FEATURE;
    return BW_SURFACE_NONE;
}

static void find_surfaces(bw_verifier *v) {
    const bw_complex *x = v->x;
    for (size_t p = 0; p < x->patch_count; p++) {
        v->surface[p] = surface_of(v, p);
        if (v->surface[p] == BW_SURFACE_NONE) continue;
        for (size_t i = x->patch_chain_begin[4 * p]; i < x->patch_chain_begin[4 * p + 4]; i++) {
            bw_arc a = x->patch_chain[i] >> 1;
            if (v->arc_surfaces[a] < 2) v->arc_surface[a][v->arc_surfaces[a]] = (bw_patch)p;
            v->arc_surfaces[a]++;
        }
    }
}

/* Marks critical arcs with BW_NONE - 1 in arc_link, the others with BW_NONE. */
enum { CRITICAL = BW_NONE - 1 };

static void find_critical_arcs(bw_verifier *v) {
    const bw_complex *x = v->x;
    for (size_t a = 0; a < x->arc_count; a++) {
        bool flat = v->arc_surfaces[a] == 0 || v->arc_surfaces[a] == 2;
        v->arc_link[a] = !flat || x->arc_flags[a] & (BW_ARC_SINGULAR | BW_ARC_FEATURE) ? CRITICAL : BW_NONE;
    }
    for (size_t i = 0; i < v->rib_begin[x->block_count]; i++) { /* two surfaces with one corner of a block between them are not flat */
        const bw_rib *r = &v->rib[i];
        if (r->side[0] != r->side[1] && v->surface[r->patch[0]] && v->surface[r->patch[1]]) v->arc_link[r->arc] = CRITICAL;
    }
}

/* ---- links ---- */

/* The ends of critical arcs at each node, as 2 * arc + end. */
typedef struct {
    size_t *begin;
    int32_t *end;
} fans;

static bw_status list_fans(bw_verifier *v, fans *f) {
    const bw_complex *x = v->x;
    f->begin = bw_alloc(v->ctx, x->node_count + 2, sizeof *f->begin);
    f->end = bw_alloc(v->ctx, 2 * x->arc_count, sizeof *f->end);
    if (v->ctx->error.status != BW_OK) return v->ctx->error.status;
    for (size_t i = 0; i < 2 * x->arc_count; i++)
        if (v->arc_link[i / 2] == CRITICAL) f->begin[x->arc_node[i / 2][i & 1] + 2]++;
    for (size_t n = 2; n < x->node_count + 2; n++) f->begin[n] += f->begin[n - 1];
    for (size_t i = 0; i < 2 * x->arc_count; i++)
        if (v->arc_link[i / 2] == CRITICAL) f->end[f->begin[x->arc_node[i / 2][i & 1] + 1]++] = (int32_t)i;
    return BW_OK;
}

static bool same_kind(const bw_verifier *v, int32_t a, int32_t b) {
    const bw_complex *x = v->x;
    return x->arc_quarters[a] == x->arc_quarters[b] && v->arc_surfaces[a] == v->arc_surfaces[b] &&
           !((x->arc_flags[a] ^ x->arc_flags[b]) & (BW_ARC_BOUNDARY | BW_ARC_SINGULAR));
}

/* node_critical, in which nodes with perpendicular critical arcs are marked already. */
static void find_critical_nodes(bw_verifier *v, const fans *f) {
    const bw_complex *x = v->x;
    for (size_t n = 0; n < x->node_count; n++) {
        size_t count = f->begin[n + 1] - f->begin[n];
        const int32_t *end = &f->end[f->begin[n]];
        bool ends = count != 0 && count != 2;
        if (count == 2)
            ends = v->node_critical[n] || !same_kind(v, end[0] / 2, end[1] / 2) ||
                   v->node_octants[n] != 2 * x->arc_quarters[end[0] / 2];
        v->node_critical[n] = ends || x->node_flags[n] & BW_NODE_FEATURE;
    }
}

static bw_status mark_bends(bw_verifier *v) {
    size_t places = v->place_begin[v->x->block_count];
    uint8_t *axes = bw_alloc(v->ctx, places, 1);
    if (!axes) return v->ctx->error.status;
    for (size_t i = 0; i < v->rib_begin[v->x->block_count]; i++)
        for (int e = 0; e < 2 && v->arc_link[v->rib[i].arc] == CRITICAL; e++) axes[v->rib[i].place[e]] |= (uint8_t)(1 << v->rib[i].axis);
    for (size_t i = 0; i < places; i++)
        if (axes[i] & (axes[i] - 1)) v->node_critical[v->place[i].node] = 1;
    bw_free(v->ctx, axes);
    return BW_OK;
}

/* Follows a link from one end of an arc on to its last, or around. */
static void follow(bw_verifier *v, const fans *f, int32_t start) {
    const bw_complex *x = v->x;
    int32_t number = (int32_t)v->link_count++, out = start;
    bw_verify_link *l = &v->link[number];
    *l = (bw_verify_link){.arc = start / 2, .quarters = x->arc_quarters[start / 2], .surfaces = v->arc_surfaces[start / 2],
                          .boundary = x->arc_flags[start / 2] & BW_ARC_BOUNDARY};
    for (;;) {
        int32_t a = out / 2, in = out ^ 1;
        bw_node n = x->arc_node[a][in & 1];
        v->arc_link[a] = number;
        v->arc_sense[a] = out & 1 ? -1 : 1;
        v->arc_at[a] = out & 1 ? l->length + v->length[a] : l->length;
        l->length += v->length[a];
        l->end[1] = n;
        if (v->node_critical[n]) break;
        const int32_t *end = &f->end[f->begin[n]];
        out = end[end[0] == in];
        if (out == start) break;
    }
    l->end[0] = x->arc_node[start / 2][start & 1];
    if (!v->node_critical[l->end[0]]) l->end[0] = l->end[1] = BW_NONE;
    if (l->length <= 0) bw_verify_fault(v, BW_FAULT_LINK, "arc", l->arc, -1, "the link that the arc is part of has no length");
}

static bw_status find_links(bw_verifier *v) {
    const bw_complex *x = v->x;
    fans f = {NULL, NULL};
    bw_status status = mark_bends(v);
    if (status == BW_OK) status = list_fans(v, &f);
    if (status == BW_OK) {
        find_critical_nodes(v, &f);
        for (int closed = 0; closed < 2; closed++)
            for (size_t i = 0; i < 2 * x->arc_count; i++)
                if (v->arc_link[i / 2] == CRITICAL && (closed || v->node_critical[x->arc_node[i / 2][i & 1]])) follow(v, &f, (int32_t)i);
    }
    bw_free(v->ctx, f.begin);
    bw_free(v->ctx, f.end);
    return status;
}

/* ---- regions ---- */

/* The area of every region; on the region's lowest patch. */
static bw_status check_regions(bw_verifier *v) {
    const bw_complex *x = v->x;
    bw_patch *parent = bw_alloc(v->ctx, x->patch_count, sizeof *parent);
    __int128 *area = bw_alloc(v->ctx, x->patch_count, sizeof *area);
    for (size_t p = 0; p < x->patch_count && parent; p++) parent[p] = (bw_patch)p;
    for (size_t a = 0; a < x->arc_count && parent; a++) {
        if (v->arc_link[a] != BW_NONE || v->arc_surfaces[a] != 2) continue;
        bw_forest_join(parent, v->arc_surface[a][0], v->arc_surface[a][1]);
    }
    for (size_t p = 0; p < x->patch_count && parent && area; p++) {
        int64_t side[2] = {0, 0};
        for (size_t s = 0; s < 2; s++)
            for (size_t i = x->patch_chain_begin[4 * p + s]; i < x->patch_chain_begin[4 * p + s + 1]; i++)
                side[s] += v->length[x->patch_chain[i] >> 1];
        if (v->surface[p]) area[bw_forest_root(parent, (bw_patch)p)] += (__int128)side[0] * side[1];
    }
    for (size_t p = 0; p < x->patch_count && parent && area; p++)
        if (v->surface[p] && parent[p] == (bw_patch)p && area[p] <= 0)
            bw_verify_fault(v, BW_FAULT_REGION, "patch", (int64_t)p, -1, "the region that the patch is part of has no area");
    bw_free(v->ctx, parent);
    bw_free(v->ctx, area);
    return v->ctx->error.status;
}

static void check_volume(bw_verifier *v) {
    for (size_t b = 0; b < v->x->block_count; b++)
        if (v->extent[b][0] > 0 && v->extent[b][1] > 0 && v->extent[b][2] > 0) return;
    bw_verify_fault(v, BW_FAULT_VOLUME, "", -1, -1, "no block has any volume");
}

bw_status bw_verify_strata(bw_verifier *v) {
    const bw_complex *x = v->x;
    v->surface = bw_alloc(v->ctx, x->patch_count, sizeof *v->surface);
    v->arc_surface = bw_alloc(v->ctx, x->arc_count, sizeof *v->arc_surface);
    v->arc_surfaces = bw_alloc(v->ctx, x->arc_count, sizeof *v->arc_surfaces);
    v->arc_link = bw_alloc(v->ctx, x->arc_count, sizeof *v->arc_link);
    v->arc_at = bw_alloc(v->ctx, x->arc_count, sizeof *v->arc_at);
    v->arc_sense = bw_alloc(v->ctx, x->arc_count, sizeof *v->arc_sense);
    v->link = bw_alloc(v->ctx, x->arc_count, sizeof *v->link);
    v->node_critical = bw_alloc(v->ctx, x->node_count, sizeof *v->node_critical);
    v->node_octants = bw_alloc(v->ctx, x->node_count, sizeof *v->node_octants);
    v->node_quadrants = bw_alloc(v->ctx, x->node_count, sizeof *v->node_quadrants);
    if (v->ctx->error.status != BW_OK) return v->ctx->error.status;
    count_corners(v);
    find_surfaces(v);
    find_critical_arcs(v);
    bw_status status = find_links(v);
    if (status == BW_OK) status = check_regions(v);
    if (status == BW_OK) check_volume(v);
    return status;
}
