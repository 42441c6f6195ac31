/* Cells and tets of a layout. Vertices on common faces, edges and nodes are shared by construction: they are
 * numbered by the element they lie on and counted from its lowest node. A cell is coned from its first vertex
 * in a fixed order of all vertices, and so is each of its quads: neighbours split their common quad alike. */
#include <math.h>
#include <string.h>

#include "models/build.h"

static int32_t vertex_on_edge(const bw_build *w, int32_t block, const int index[3], int axis, int corner) {
    const bw_layout_block *b = &w->layout.block[block];
    int k = (corner >> (axis + 1) % 3 & 1) | (corner >> (axis + 2) % 3 & 1) << 1;
    int low = corner & ~(1 << axis), d = index[axis];
    if (b->corner[low] > b->corner[low | 1 << axis]) d = bw_layout_cells(&w->layout, block, axis) - d;
    return w->edge_first[b->edge[4 * axis + k]] + d - 1;
}

static int32_t vertex_on_face(const bw_build *w, int32_t block, const int index[3], int axis, int side) {
    const bw_layout_block *b = &w->layout.block[block];
    int a[2] = {axis == 0 ? 1 : 0, axis == 2 ? 1 : 2}, base = side << axis, lowest = 0;
    int32_t node[4];
    for (int i = 0; i < 4; i++) node[i] = b->corner[base | (i & 1) << a[0] | (i >> 1) << a[1]];
    for (int i = 1; i < 4; i++)
        if (node[i] < node[lowest]) lowest = i;
    int n[2], d[2];
    for (int i = 0; i < 2; i++) {
        n[i] = bw_layout_cells(&w->layout, block, a[i]);
        d[i] = lowest >> i & 1 ? n[i] - index[a[i]] : index[a[i]];
    }
    int first = node[lowest ^ 1] < node[lowest ^ 2] ? 0 : 1;
    return w->face_first[b->face[2 * axis + side]] + d[first] - 1 + (d[!first] - 1) * (n[first] - 1);
}

/* Also tells on which element (index into layout.star) the vertex lies. */
static int32_t locate(const bw_build *w, int32_t block, const int index[3], size_t *element) {
    const bw_layout *l = &w->layout;
    const bw_layout_block *b = &l->block[block];
    int n[3], inside = 0, corner = 0, free_axis = 0, fixed_axis = 0;
    for (int a = 0; a < 3; a++) {
        n[a] = bw_layout_cells(l, block, a);
        bool in = index[a] > 0 && index[a] < n[a];
        inside += in;
        if (in) free_axis = a;
        if (!in) fixed_axis = a;
        corner |= (index[a] == n[a]) << a;
    }
    if (inside == 0) {
        *element = (size_t)b->corner[corner];
        return b->corner[corner];
    }
    if (inside == 1) {
        int k = (corner >> (free_axis + 1) % 3 & 1) | (corner >> (free_axis + 2) % 3 & 1) << 1;
        *element = l->node_count + (size_t)b->edge[4 * free_axis + k];
        return vertex_on_edge(w, block, index, free_axis, corner);
    }
    if (inside == 2) {
        int side = corner >> fixed_axis & 1;
        *element = l->node_count + l->edge_count + (size_t)b->face[2 * fixed_axis + side];
        return vertex_on_face(w, block, index, fixed_axis, side);
    }
    *element = l->node_count + l->edge_count + l->face_count + (size_t)block;
    return w->block_first[block] + index[0] - 1 + (n[0] - 1) * (index[1] - 1 + (n[1] - 1) * (index[2] - 1));
}

int32_t bw_grid_vertex(const bw_build *w, int32_t block, const int index[3]) {
    size_t element;
    return locate(w, block, index, &element);
}

/* Numbers the grid vertices; counts vertices and cells. */
static bw_status number_vertices(bw_build *w, size_t *cells) {
    const bw_layout *l = &w->layout;
    w->edge_first = bw_alloc(w->ctx, l->edge_count, sizeof *w->edge_first);
    w->face_first = bw_alloc(w->ctx, l->face_count, sizeof *w->face_first);
    w->block_first = bw_alloc(w->ctx, l->block_count, sizeof *w->block_first);
    if (w->ctx->error.status) return w->ctx->error.status;
    double total = 0; /* guards the sums below */
    for (size_t b = 0; b < l->block_count; b++) {
        double n = 1;
        for (int a = 0; a < 3; a++) n *= bw_layout_cells(l, (int32_t)b, a) + 1;
        total += n;
    }
    if (total > 4e7)
        return bw_fail(w->ctx, BW_E_USAGE, "a model of %.0f million cells is too large", total * 1e-6);
    int32_t next = (int32_t)l->node_count;
    for (size_t e = 0; e < l->edge_count; e++) {
        w->edge_first[e] = next;
        next += l->sheet[l->edge[e].sheet].cells - 1;
    }
    for (int32_t b = 0; b < (int32_t)l->block_count; b++) {
        int n[3];
        for (int a = 0; a < 3; a++) n[a] = bw_layout_cells(l, b, a);
        for (int k = 0; k < 6; k++) {
            int32_t f = l->block[b].face[k];
            if (l->face[f].block[0] != b) continue;
            w->face_first[f] = next;
            next += (n[(k / 2 + 1) % 3] - 1) * (n[(k / 2 + 2) % 3] - 1);
        }
        w->block_first[b] = next;
        next += (n[0] - 1) * (n[1] - 1) * (n[2] - 1);
        *cells += (size_t)n[0] * (size_t)n[1] * (size_t)n[2];
    }
    w->model->vertex_count = (size_t)next;
    return BW_OK;
}

static void grid_parameter(const bw_build *w, int32_t block, const int index[3], double u[3],
                           double local[3]) {
    for (int a = 0; a < 3; a++) {
        int n = bw_layout_cells(&w->layout, block, a);
        u[a] = bw_layout_length(&w->layout, block, a) / n * index[a]; /* exact: lengths are made so */
        local[a] = (double)index[a] / n;
    }
}

static void place_vertices(bw_build *w) {
    for (size_t v = 0; v < w->model->vertex_count; v++) w->star[v] = -1;
    for (int32_t b = 0; b < (int32_t)w->layout.block_count; b++) {
        int n[3], i[3];
        for (int a = 0; a < 3; a++) n[a] = bw_layout_cells(&w->layout, b, a);
        for (i[2] = 0; i[2] <= n[2]; i[2]++)
            for (i[1] = 0; i[1] <= n[1]; i[1]++)
                for (i[0] = 0; i[0] <= n[0]; i[0]++) {
                    size_t element;
                    int32_t v = locate(w, b, i, &element);
                    if (w->star[v] >= 0) continue;
                    double local[3];
                    w->star[v] = (int32_t)element;
                    grid_parameter(w, b, i, w->home[v], local);
                    bw_layout_point(&w->layout, b, local, w->model->position[v]);
                }
    }
}

/* With noise the order of vertices is random, so the diagonals are; without it they run all the same way. */
static uint64_t priority(const bw_build *w, int32_t vertex) {
    uint64_t state = w->options->seed ^ (uint64_t)vertex * 0xd6e8feb86659fd93u;
    uint64_t high = w->options->noise > 0 ? bw_random(&state) & 0xffffffff : 0;
    return high << 32 | (uint32_t)vertex;
}

static void add_tet(bw_build *w, size_t tet, const int corner[4], const int32_t vertex[8],
                    const double u[8][3]) {
    static const int mirrored[4] = {0, 1, 3, 2}, straight[4] = {0, 1, 2, 3};
    bool positive = bw_volume6(u[corner[0]], u[corner[1]], u[corner[2]], u[corner[3]]) > 0;
    for (int i = 0; i < 4; i++) {
        int c = corner[(positive ? straight : mirrored)[i]];
        w->model->tet[tet][i] = vertex[c];
        memcpy(w->model->parameter[tet][i], u[c], sizeof u[c]);
    }
}

/* The three quads that do not touch the cell's first vertex make two tets each with it. */
static void split_cell(bw_build *w, size_t cell, int32_t block, const int index[3]) {
    int32_t vertex[8];
    uint64_t order[8];
    double u[8][3], unused[3];
    int first = 0;
    for (int c = 0; c < 8; c++) {
        int at[3] = {index[0] + (c & 1), index[1] + (c >> 1 & 1), index[2] + (c >> 2)};
        vertex[c] = bw_grid_vertex(w, block, at);
        order[c] = priority(w, vertex[c]);
        grid_parameter(w, block, at, u[c], unused);
        if (order[c] < order[first]) first = c;
    }
    size_t tet = 6 * cell;
    for (int axis = 0; axis < 3; axis++) {
        int a = 1 << (axis + 1) % 3, b = 1 << (axis + 2) % 3, base = ~first & 1 << axis;
        int quad[4] = {base, base | a, base | a | b, base | b}, q = 0;
        for (int i = 1; i < 4; i++)
            if (order[quad[i]] < order[quad[q]]) q = i;
        for (int i = 1; i <= 2; i++, tet++) {
            int corner[4] = {first, quad[q], quad[(q + i) % 4], quad[(q + i + 1) % 4]};
            add_tet(w, tet, corner, vertex, (const double(*)[3])u);
            w->tet_block[tet] = block;
            w->tet_cell[tet] = (int32_t)cell;
        }
    }
}

static void split_cells(bw_build *w) {
    size_t cell = 0;
    for (int32_t b = 0; b < (int32_t)w->layout.block_count; b++) {
        int n[3], i[3];
        for (int a = 0; a < 3; a++) n[a] = bw_layout_cells(&w->layout, b, a);
        for (i[2] = 0; i[2] < n[2]; i[2]++)
            for (i[1] = 0; i[1] < n[1]; i[1]++)
                for (i[0] = 0; i[0] < n[0]; i[0]++) split_cell(w, cell++, b, i);
    }
}

bw_status bw_grid_make(bw_build *w) {
    size_t cells = 0;
    bw_status status = number_vertices(w, &cells);
    if (status) return status;
    bw_model *m = w->model;
    m->tet_count = 6 * cells;
    m->position = bw_alloc(w->ctx, m->vertex_count, sizeof *m->position);
    m->tet = bw_alloc(w->ctx, m->tet_count, sizeof *m->tet);
    m->parameter = bw_alloc(w->ctx, m->tet_count, sizeof *m->parameter);
    w->star = bw_alloc(w->ctx, m->vertex_count, sizeof *w->star);
    w->home = bw_alloc(w->ctx, m->vertex_count, sizeof *w->home);
    w->tet_block = bw_alloc(w->ctx, m->tet_count, sizeof *w->tet_block);
    w->tet_cell = bw_alloc(w->ctx, m->tet_count, sizeof *w->tet_cell);
    if (w->ctx->error.status) return w->ctx->error.status;
    place_vertices(w);
    split_cells(w);
    return BW_OK;
}
