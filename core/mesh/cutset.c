#include "mesh/cutset.h"

#include <stdlib.h>
#include <string.h>

typedef struct {
    bw_context *ctx;
    const bw_tet_mesh *mesh;
    const bw_hinges *hinges;
    const bw_seams *seams;
    const int64_t (*value)[4][3];
    bw_cutset *cut;
    int32_t *queue; /* of tets, facets or hinges; long enough for any of them */
    bw_rotation *across; /* [facet] rotation between the combed charts, from facet_tet[0] to facet_tet[1] */
} cutter;

void bw_cutset_clear(bw_context *ctx, bw_cutset *cut) {
    bw_free(ctx, cut->comb);
    bw_free(ctx, cut->shift);
    bw_free(ctx, cut->side);
    bw_free(ctx, cut->cut_sheet);
    bw_free(ctx, cut->align_sheet);
    bw_free(ctx, cut->align_axis);
    bw_free(ctx, cut->rotation);
    bw_free(ctx, cut->cut_count);
    memset(cut, 0, sizeof *cut);
}

static bw_rotation across(const cutter *w, bw_facet f, bw_tet from) {
    bw_rotation r = w->seams->rotation[f];
    return w->mesh->facet_tet[f][0] == from ? r : bw_rotation_inverse(r);
}

/* Shift of the next tet's chart so that its facet meets the combed one: the mean over the corners. Zero, relative to a neighbour with an
 * equal chart, if that is within the defect of the input: charts the input meant to be one stay one. */
static void comb_shift(cutter *w, bw_facet f, bw_tet from, bw_tet to) {
    int64_t low[3], high[3], sum[3] = {0, 0, 0};
    for (int i = 0; i < 3; i++) {
        int64_t a[3], b[3];
        bw_vertex v = w->mesh->facet[f][i];
        bw_cutset_combed(w->cut, from, w->value[from][bw_tet_corner(w->mesh, from, v)], a);
        bw_rotate(w->cut->comb[to], w->value[to][bw_tet_corner(w->mesh, to, v)], b);
        for (int k = 0; k < 3; k++) {
            int64_t d = a[k] - b[k] - w->cut->shift[from][k];
            sum[k] += d;
            if (i == 0 || d < low[k]) low[k] = d;
            if (i == 0 || d > high[k]) high[k] = d;
        }
    }
    bool same = w->cut->comb[from] == w->cut->comb[to];
    for (int k = 0; k < 3; k++) same = same && low[k] <= w->seams->defect && high[k] >= -w->seams->defect;
    for (int k = 0; k < 3; k++) w->cut->shift[to][k] = w->cut->shift[from][k] + (same ? 0 : sum[k] / 3);
}

/* Breadth first from the lowest tet of every component, so that trees are shallow and rounding does not add up along them. */
static void comb(cutter *w) {
    const bw_tet_mesh *mesh = w->mesh;
    uint8_t *seen = (uint8_t *)w->cut->side; /* [facet_count >= tet_count / 2] is too short: see bw_cutset_init */
    memset(seen, 0, mesh->tet_count);
    for (size_t root = 0; root < mesh->tet_count; root++) {
        size_t head = 0, tail = 0;
        if (seen[root]) continue;
        seen[root] = 1;
        w->queue[tail++] = (int32_t)root;
        while (head < tail) {
            bw_tet t = w->queue[head++];
            for (int i = 0; i < 4; i++) {
                bw_facet f = mesh->tet_facet[t][i];
                bw_tet next = bw_tet_across(mesh, f, t);
                if (next == BW_NONE || seen[next]) continue;
                seen[next] = 1;
                w->cut->comb[next] = bw_rotation_compose(w->cut->comb[t], bw_rotation_inverse(across(w, f, t)));
                comb_shift(w, f, t, next);
                w->queue[tail++] = next;
            }
        }
    }
}
