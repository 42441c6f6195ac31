#include "mesh/star.h"

#include <stdlib.h>
#include <string.h>

void bw_stars_clear(bw_context *ctx, bw_stars *stars) {
    void *blocks[] = {stars->first, stars->corner, stars->feature, stars->slot, stars->stack, stars->item};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    memset(stars, 0, sizeof *stars);
}

bw_status bw_stars_init(bw_context *ctx, bw_stars *stars, const bw_star_input *input) {
    const bw_tet_mesh *mesh = input->mesh;
    *stars = (bw_stars){.in = input};
    stars->first = bw_alloc(ctx, mesh->vertex_count + 2, sizeof *stars->first);
    stars->corner = bw_alloc(ctx, 4 * mesh->tet_count, sizeof *stars->corner);
    stars->feature = bw_alloc(ctx, mesh->vertex_count, 1);
    stars->slot = bw_alloc(ctx, mesh->tet_count, sizeof *stars->slot);
    if (ctx->error.status) return ctx->error.status;
    for (size_t i = 0; i < 4 * mesh->tet_count; i++) stars->first[mesh->tet[i / 4][i % 4] + 2]++;
    for (size_t v = 0; v < mesh->vertex_count; v++) stars->first[v + 2] += stars->first[v + 1];
    for (size_t i = 0; i < 4 * mesh->tet_count; i++)
        stars->corner[stars->first[mesh->tet[i / 4][i % 4] + 1]++] = (int32_t)i;
    for (size_t i = 0; i < mesh->feature_vertex_count; i++)
        if (mesh->feature_vertex[i] >= 0 && (size_t)mesh->feature_vertex[i] < mesh->vertex_count)
            stars->feature[mesh->feature_vertex[i]] = 1;
    return BW_OK;
}

static bool is_unsure(const bw_stars *stars, bw_tet t) {
    return stars->in->unsure && stars->in->unsure[t];
}

/* What is constant up to the map's defects. */
static int64_t noise(const bw_stars *stars) {
    return 16 * (1 + stars->in->seams->defect);
}

/* Holds the axis of the item's chart. */
static void hold(bw_stars *stars, const bw_star_item *item, int axis) {
    stars->free &= (uint8_t) ~(1 << bw_rotation_axis[item->rotation][axis]);
}

/* An aligned facet holds its constant axis; where its tet is unsure, every axis that may be it. */
static void hold_aligned(bw_stars *stars, const bw_star_item *item, bw_facet f) {
    const bw_tet_mesh *mesh = stars->in->mesh;
    hold(stars, item, stars->in->seams->align[f]);
    for (int k = 0; k < 3 && is_unsure(stars, item->tet); k++) {
        const int64_t(*u)[3] = stars->in->value[item->tet];
        int64_t low = INT64_MAX, high = INT64_MIN;
        for (int i = 0; i < 4; i++) {
            if (mesh->tet_facet[item->tet][i] == f) continue;
            if (u[i][k] < low) low = u[i][k];
            if (u[i][k] > high) high = u[i][k];
        }
        if (high - low <= noise(stars)) hold(stars, item, k);
    }
}

static bool is_clear(const bw_stars *stars, bw_facet f) {
    const bw_tet *t = stars->in->mesh->facet_tet[f];
    if (!is_unsure(stars, t[0]) && !is_unsure(stars, t[1])) return true;
    return bw_seams_facet_clear(stars->in->seams, stars->in->mesh, stars->in->value, f,
                                stars->in->tolerance) == BW_SEAM_CLEAR;
}

/* Goes on across a facet; where the next tet was reached another way, the turn of the loop is held. */
static void cross(bw_stars *stars, const bw_star_item *from, bw_facet f, size_t *top) {
    const bw_tet_mesh *mesh = stars->in->mesh;
    bw_rotation r = stars->in->seams->rotation[f];
    int32_t slot = stars->slot[bw_tet_across(mesh, f, from->tet)];
    bw_star_item *next = &stars->item[slot];
    if (mesh->facet_tet[f][0] != from->tet) r = bw_rotation_inverse(r);
    r = bw_rotation_compose(r, from->rotation);
    if (!is_clear(stars, f)) {
        stars->unclear = true;
    } else if (!next->reached) {
        next->reached = true;
        next->rotation = r;
        stars->stack[(*top)++] = slot;
    } else if (next->rotation != r) {
        int axis = bw_rotation_fixed_axis(bw_rotation_compose(bw_rotation_inverse(next->rotation), r));
        stars->free &= (uint8_t)(axis < 0 ? 0 : 1 << axis);
    }
}

static void walk(bw_stars *stars) {
    size_t top = 0;
    stars->item[0].reached = true;
    stars->stack[top++] = 0;
    while (top) {
        bw_star_item *item = &stars->item[stars->stack[--top]];
        for (int i = 0; i < 4; i++) {
            bw_facet f = stars->in->mesh->tet_facet[item->tet][i];
            if (i == item->corner) continue;
            if (stars->in->seams->align[f] >= 0 && stars->in->mesh->facet_tet[f][0] == item->tet)
                hold_aligned(stars, item, f);
            if (stars->in->mesh->facet_tet[f][1] != BW_NONE) cross(stars, item, f, &top);
        }
    }
}

/* The hinge of an edge at the vertex that has to run along an axis: the two others are held; all, if the
 * values leave open which one it is. */
static void hold_line(bw_stars *stars, bw_hinge h) {
    const bw_tet_mesh *mesh = stars->in->mesh;
    const bw_ring *ring = &stars->in->hinges->ring[h];
    bw_tet t = stars->in->hinges->tet[ring->begin];
    const bw_star_item *item = &stars->item[stars->slot[t]];
    int axis = stars->in->seams->line[h];
    const int64_t *a = stars->in->value[t][bw_tet_corner(mesh, t, mesh->edge[ring->edge][0])];
    const int64_t *b = stars->in->value[t][bw_tet_corner(mesh, t, mesh->edge[ring->edge][1])];
    for (int k = 0; k < 3; k++)
        if (k != axis) hold(stars, item, k);
    if (llabs(a[axis] - b[axis]) <= noise(stars)) hold(stars, item, axis);
}

static void hold_edges(bw_stars *stars) {
    const bw_hinges *hinges = stars->in->hinges;
    for (size_t i = 0; i < stars->count; i++)
        for (int c = 0; c < 4; c++) {
            const bw_star_item *item = &stars->item[i];
            if (c == item->corner) continue;
            bw_edge e = stars->in->mesh->tet_edge[item->tet][bw_tet_edge_of[c][item->corner]];
            if (hinges->first[e + 1] - hinges->first[e] > 1) stars->free = 0;
            for (bw_hinge h = hinges->first[e]; h < hinges->first[e + 1]; h++)
                if (stars->in->seams->line[h] >= 0) hold_line(stars, h);
        }
}

bw_status bw_stars_read(bw_context *ctx, bw_stars *stars, bw_vertex vertex) {
    size_t begin = (size_t)stars->first[vertex];
    stars->count = (size_t)stars->first[vertex + 1] - begin;
    if (bw_reserve(ctx, &stars->item, &stars->room, stars->count) ||
        bw_reserve(ctx, &stars->stack, &stars->stack_room, stars->count))
        return ctx->error.status;
    for (size_t i = 0; i < stars->count; i++) {
        int32_t c = stars->corner[begin + i];
        stars->item[i] = (bw_star_item){.tet = c / 4, .corner = c % 4};
        stars->slot[c / 4] = (int32_t)i;
    }
    stars->unclear = false;
    stars->free = stars->feature[vertex] ? 0 : 7;
    walk(stars);
    for (size_t i = 0; i < stars->count; i++)
        if (!stars->item[i].reached) stars->free = 0;
    if (stars->unclear) stars->free = 0;
    if (stars->free) hold_edges(stars);
    return BW_OK;
}
