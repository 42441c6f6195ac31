/* Private to the sample models: pieces that shapes are put together from. Callers' keys must stay below 2^40.
 */
#ifndef BW_TESTS_MODELS_SHAPES_H
#define BW_TESTS_MODELS_SHAPES_H

#include "models/layout.h"

/* Numbers that are known of a shape (see bw_model_info). */
static inline void bw_declare(bw_layout *layout, int blocks_bc, int euler, int singular_inside) {
    layout->blocks_bc = blocks_bc;
    layout->euler = euler;
    layout->singular_inside = singular_inside;
}

/* A node of a plane figure that is extruded along `axis`: u is axis + 1, v is axis + 2 (modulo 3). */
typedef struct {
    int64_t key;
    double u, v;
} bw_spot;

int64_t bw_spot_key(const bw_spot *spot, int layer); /* layer 0..7 */
/* The prism over a quad (counter-clockwise) from level[layer] to level[layer + 1]. */
void bw_prism(bw_layout *layout, int axis, const bw_spot quad[4], const double *level, int layer);
/* The edge from a to b on one layer is an arc around (u, v). */
void bw_prism_arc(bw_layout *layout, int axis, const bw_spot *a, const bw_spot *b, const double *level,
                  int layer, double u, double v);
/* Four prisms between two quads of spots, the outer one around the inner one, both counter-clockwise. */
void bw_prism_ring(bw_layout *layout, int axis, const bw_spot outer[4], const bw_spot inner[4],
                   const double *level, int layer);
/* Four spots on a circle at start + 0, 1, 2, 3 quarter turns, keys from `key` on. */
void bw_circle(double u, double v, double radius, double start, int64_t key, bw_spot out[4]);
void bw_circle_arcs(bw_layout *layout, int axis, const bw_spot spot[4], const double *level, int layer,
                    double u, double v);

void bw_shape_tee(bw_layout *layout, int count);
void bw_shape_plate(bw_layout *layout, int count);
void bw_shape_part(bw_layout *layout, int count);
void bw_shape_bearing(bw_layout *layout, int count);

#endif
