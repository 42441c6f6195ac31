/* The shapes: which blocks, where, and how many of them the base complex has.
 *
 * Most shapes are boxes of a lattice, or prisms over plane quads with straight and circular edges, possibly bent by a
 * warp from this pseudo-space to space. Columns of the table below are counted by reasoning, given at each shape;
 * tests compare them with a count on the layout and on the tets.
 */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "models/build.h"

typedef void (*shape)(bw_layout *layout, int count);

/* --- boxes of a lattice ---------------------------------------------------------------------------------------- */

static int64_t lattice_key(int i, int j, int k) { return (i + 1) + 64 * (j + 1) + 4096 * (k + 1); }

/* The box between the lattice planes i, j, k and their successors. Indices may start at -1. */
static void box(bw_layout *l, const double *x, const double *y, const double *z, int i, int j, int k) {
    int64_t key[8];
    double point[8][3];
    for (int c = 0; c < 8; c++) {
        int a = i + (c & 1), b = j + (c >> 1 & 1), d = k + (c >> 2);
        key[c] = lattice_key(a, b, d);
        point[c][0] = x[a], point[c][1] = y[b], point[c][2] = z[d];
    }
    bw_layout_block_add(l, key, (const double(*)[3])point, 0);
}

static void declare(bw_layout *l, int blocks_bc, int euler, int singular_inside) {
    l->blocks_bc = blocks_bc;
    l->euler = euler;
    l->singular_inside = singular_inside;
}

static void cuboid(bw_layout *l, int count) {
    static const double x[] = {0, 2.3}, y[] = {0, 1.4}, z[] = {0, 1};
    (void)count;
    box(l, x, y, z, 0, 0, 0);
    declare(l, 1, 1, 0);
}

static const struct {
    bw_model_info info;
    shape make;
} table[] = {
    {{"cuboid", "a box", 1, 1, 0}, cuboid},
};
enum { SHAPES = sizeof table / sizeof *table };

const bw_model_info *bw_model_list(size_t *count) {
    static bw_model_info info[SHAPES];
    for (size_t i = 0; i < SHAPES; i++) info[i] = table[i].info;
    *count = SHAPES;
    return info;
}

bw_status bw_shape_make(const char *name, int count, bw_layout *l) {
    for (size_t i = 0; i < SHAPES; i++) {
        if (strcmp(table[i].info.name, name)) continue;
        table[i].make(l, count);
        return l->ctx->error.status;
    }
    return bw_fail(l->ctx, BW_E_USAGE, "there is no sample model named \"%.40s\"", name);
}
