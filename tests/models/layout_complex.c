/* The base complex of a layout: an independent count for the numbers that the shapes declare. */
#include "models/layout.h"

static bool has_edge(const bw_layout *l, int32_t face, int32_t edge) {
    int n = 0;
    for (int i = 0; i < 4; i++)
        n += l->face[face].node[i] == l->edge[edge].node[0] || l->face[face].node[i] == l->edge[edge].node[1];
    return n == 2;
}

static bool share_block(const bw_layout_face *f, const bw_layout_face *g) {
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++)
            if (f->block[i] >= 0 && f->block[i] == g->block[j]) return true;
    return false;
}

/* Does the wall on `face` go on into `other` across their common edge? */
static bool continues(const bw_layout *l, int32_t face, int32_t other, int32_t edge) {
    return other != face && l->face[other].block[1] >= 0 && !l->edge[edge].boundary &&
           !bw_layout_singular(l, edge) && has_edge(l, face, edge) && has_edge(l, other, edge) &&
           !share_block(&l->face[face], &l->face[other]);
}

static void spread(const bw_layout *l, bool *wall) {
    int32_t faces = (int32_t)l->face_count, edges = (int32_t)l->edge_count;
    for (bool changed = true; changed;) {
        changed = false;
        for (int32_t f = 0; f < faces; f++)
            for (int32_t e = 0; wall[f] && e < edges; e++)
                for (int32_t g = 0; has_edge(l, f, e) && g < faces; g++)
                    if (!wall[g] && continues(l, f, g, e)) wall[g] = changed = true;
    }
}

static int32_t root_of(int32_t *parent, int32_t i) {
    while (parent[i] != i) i = parent[i] = parent[parent[i]];
    return i;
}

bw_status bw_layout_base_complex(const bw_layout *l, int *blocks) {
    bool *wall = bw_alloc(l->ctx, l->face_count, sizeof *wall);
    int32_t *parent = bw_alloc(l->ctx, l->block_count, sizeof *parent);
    bw_status status = l->ctx->error.status;
    if (status) goto out;
    for (int32_t f = 0; f < (int32_t)l->face_count; f++)
        for (int32_t e = 0; e < (int32_t)l->edge_count; e++)
            if (l->face[f].block[1] >= 0 && bw_layout_singular(l, e) && has_edge(l, f, e)) wall[f] = true;
    spread(l, wall);
    for (size_t b = 0; b < l->block_count; b++) parent[b] = (int32_t)b;
    *blocks = (int)l->block_count;
    for (size_t f = 0; f < l->face_count; f++) {
        if (wall[f] || l->face[f].block[1] < 0) continue;
        int32_t x = root_of(parent, l->face[f].block[0]), y = root_of(parent, l->face[f].block[1]);
        *blocks -= x != y;
        parent[x > y ? x : y] = x > y ? y : x;
    }
out:
    bw_free(l->ctx, wall);
    bw_free(l->ctx, parent);
    return status;
}
