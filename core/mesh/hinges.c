#include "mesh/hinges.h"

#include <string.h>

void bw_hinge_corners(const bw_tet_mesh *mesh, bw_tet tet, int local_edge, int out[4]) {
    static const uint8_t other[6][2] = {{2, 3}, {3, 1}, {1, 2}, {0, 3}, {2, 0}, {0, 1}};
    int a = bw_tet_edge_corners[local_edge][0], b = bw_tet_edge_corners[local_edge][1];
    bool flip = mesh->tet[tet][a] > mesh->tet[tet][b];
    out[0] = flip ? b : a, out[1] = flip ? a : b;
    out[2] = other[local_edge][flip], out[3] = other[local_edge][!flip];
}

void bw_hinges_clear(bw_context *ctx, bw_hinges *hinges) {
    bw_free(ctx, hinges->first);
    bw_free(ctx, hinges->ring);
    bw_free(ctx, hinges->tet);
    bw_free(ctx, hinges->exit);
    bw_free(ctx, hinges->of_facet);
    memset(hinges, 0, sizeof *hinges);
}

/* Parity of the permutation that sorts the corners of a facet of a tet, seen from outside the tet. */
static int facet_parity(const bw_tet_mesh *mesh, bw_tet t, int local) {
    const bw_vertex *v = mesh->tet[t];
    int parity = local & 1;
    for (int i = 0; i < 4; i++)
        for (int j = i + 1; j < 4; j++)
            if (i != local && j != local) parity ^= v[i] > v[j];
    return parity;
}

static bw_status check_orientation(bw_context *ctx, const bw_tet_mesh *mesh) {
    size_t bad = 0;
    uint8_t *parity = bw_alloc(ctx, mesh->facet_count, 1);
    if (!parity) return ctx->error.status;
    for (size_t t = 0; t < mesh->tet_count; t++)
        for (int i = 0; i < 4; i++) {
            bw_facet f = mesh->tet_facet[t][i];
            if (mesh->facet_tet[f][1] == BW_NONE) continue;
            if (mesh->facet_tet[f][0] == (bw_tet)t)
                parity[f] = (uint8_t)facet_parity(mesh, (bw_tet)t, i);
            else if (parity[f] == facet_parity(mesh, (bw_tet)t, i)) {
                double centre[3];
                bw_facet_centre(mesh, f, centre);
                bw_fail_element(ctx, "facet", f, centre);
                bad++;
            }
        }
    bw_free(ctx, parity);
    return bad ? bw_fail(ctx, BW_E_INVERTED,
                         "at %zu facets both tets lie on the same side in the parametrization", bad)
               : BW_OK;
}

/* The tets of every edge, as a list of 8 * tet + local edge: edge e has item[first[e]] .. item[first[e + 1] -
 * 1]. */
typedef struct {
    int32_t *first;
    int32_t *item;
    uint8_t *done; /* [tet] one bit per local edge: its ring was walked */
} edge_stars;

static void stars_clear(bw_context *ctx, edge_stars *stars) {
    bw_free(ctx, stars->first);
    bw_free(ctx, stars->item);
    bw_free(ctx, stars->done);
}

static bw_status stars_init(bw_context *ctx, edge_stars *stars, const bw_tet_mesh *mesh) {
    stars->first = bw_alloc(ctx, mesh->edge_count + 2, sizeof *stars->first);
    stars->item = bw_alloc(ctx, 6 * mesh->tet_count, sizeof *stars->item);
    stars->done = bw_alloc(ctx, mesh->tet_count, 1);
    if (ctx->error.status) return ctx->error.status;
    for (size_t t = 0; t < mesh->tet_count; t++)
        for (int i = 0; i < 6; i++) stars->first[mesh->tet_edge[t][i] + 2]++;
    for (size_t e = 2; e < mesh->edge_count + 2; e++) stars->first[e] += stars->first[e - 1];
    for (size_t t = 0; t < mesh->tet_count; t++)
        for (int i = 0; i < 6; i++)
            stars->item[stars->first[mesh->tet_edge[t][i] + 1]++] = (int32_t)(8 * t) + i;
    return BW_OK;
}

static void note_facet(bw_hinges *hinges, const bw_tet_mesh *mesh, bw_facet f, bw_hinge h) {
    const bw_vertex *edge = mesh->edge[hinges->ring[h].edge];
    for (int i = 0; i < 3; i++)
        if (mesh->facet[f][i] != edge[0] && mesh->facet[f][i] != edge[1]) hinges->of_facet[f][i] = h;
}

/* The facet through which a counterclockwise walk around a local edge enters the tet. */
static bw_facet entry_facet(const bw_tet_mesh *mesh, int32_t item) {
    int c[4];
    bw_hinge_corners(mesh, item / 8, item % 8, c);
    return mesh->tet_facet[item / 8][c[3]];
}

/* Walks one fan from the given tet counterclockwise until the boundary or the tet itself. */
static void walk(bw_hinges *hinges, const bw_tet_mesh *mesh, edge_stars *stars, int32_t item, bw_hinge h) {
    bw_tet t = item / 8;
    int local = item % 8;
    bw_ring *ring = &hinges->ring[h];
    int32_t at = ring->begin;
    note_facet(hinges, mesh, ring->entry, h);
    while (t != BW_NONE && !(stars->done[t] & 1 << local)) {
        int c[4];
        stars->done[t] |= (uint8_t)(1 << local);
        bw_hinge_corners(mesh, t, local, c);
        bw_vertex a = mesh->tet[t][c[0]], b = mesh->tet[t][c[1]];
        hinges->tet[at] = t;
        hinges->exit[at] = mesh->tet_facet[t][c[2]];
        note_facet(hinges, mesh, hinges->exit[at], h);
        t = bw_tet_across(mesh, hinges->exit[at++], t);
        if (t != BW_NONE) local = bw_tet_edge_of[bw_tet_corner(mesh, t, a)][bw_tet_corner(mesh, t, b)];
    }
    ring->end = at;
}

/* The hinges of one edge: the open fans, each from its start, then what is left. */
static bw_status walk_edge(bw_context *ctx, bw_hinges *hinges, const bw_tet_mesh *mesh, edge_stars *stars,
                           bw_edge e, size_t *room) {
    int32_t at = stars->first[e];
    for (int open = 1; open >= 0; open--)
        for (int32_t i = stars->first[e]; i < stars->first[e + 1]; i++) {
            int32_t item = stars->item[i];
            if (stars->done[item / 8] & 1 << item % 8) continue;
            bw_facet entry = entry_facet(mesh, item);
            if (open && mesh->facet_tet[entry][1] != BW_NONE) continue;
            if (bw_reserve(ctx, &hinges->ring, room, hinges->count + 1)) return ctx->error.status;
            bw_hinge h = (bw_hinge)hinges->count++;
            hinges->ring[h] = (bw_ring){.edge = e, .entry = entry, .begin = at, .open = open};
            walk(hinges, mesh, stars, item, h);
            at = hinges->ring[h].end;
        }
    return BW_OK;
}

bw_status bw_hinges_init(bw_context *ctx, bw_hinges *hinges, const bw_tet_mesh *mesh) {
    *hinges = (bw_hinges){0};
    edge_stars stars = {0};
    size_t room = mesh->edge_count;
    if (mesh->tet_count > INT32_MAX / 8)
        return bw_fail(ctx, BW_E_LIMIT, "%zu tets are more than can be numbered", mesh->tet_count);
    if (check_orientation(ctx, mesh)) return ctx->error.status;
    hinges->first = bw_alloc(ctx, mesh->edge_count + 1, sizeof *hinges->first);
    hinges->ring = bw_alloc(ctx, room, sizeof *hinges->ring);
    hinges->tet = bw_alloc(ctx, 6 * mesh->tet_count, sizeof *hinges->tet);
    hinges->exit = bw_alloc(ctx, 6 * mesh->tet_count, sizeof *hinges->exit);
    hinges->of_facet = bw_alloc(ctx, mesh->facet_count, sizeof *hinges->of_facet);
    if (ctx->error.status || stars_init(ctx, &stars, mesh)) goto out;
    for (size_t e = 0; e < mesh->edge_count; e++) {
        hinges->first[e] = (bw_hinge)hinges->count;
        if (walk_edge(ctx, hinges, mesh, &stars, (bw_edge)e, &room)) goto out;
    }
    hinges->first[mesh->edge_count] = (bw_hinge)hinges->count;
out:
    stars_clear(ctx, &stars);
    return ctx->error.status;
}
