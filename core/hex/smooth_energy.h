/* Energies of a hex mesh as functions of what its vertices are free to do (smooth.h). Internal to hex/smooth*.c. */
#ifndef BW_HEX_SMOOTH_ENERGY_H
#define BW_HEX_SMOOTH_ENERGY_H

#include "hex/smooth.h"

/* Vertex v is at  base[v] + unit[v] * sum over i < freedom[v] of  x[first[v] + i] * direction[v][i].
 *
 * Only active vertices move; energies are those of the hexes that have one. */
typedef struct {
    bw_context *ctx;
    bw_hex_mesh *mesh;          /* of it: connectivity, and positions as the energies' working place */
    const bw_hex_surface *surface;
    bw_hex_surface_hold *hold;  /* [vertex] */
    uint8_t *loose;             /* [vertex] may leave what holds it, by `leave` times its unit */
    double leave;
    double (*base)[3], (*direction)[3][3], *unit;
    uint8_t *freedom;
    size_t *first;              /* [vertex]; of active ones */
    size_t *corner_begin;       /* [vertex + 1] */
    uint32_t *corner;           /* 8 * hex + corner, by vertex */
    double (*rest)[3];          /* [hex] edges of its ideal box */
    double (*slope)[3];         /* [8 * hex + corner] gradient with respect to that vertex */
    double *least;              /* [hex] scaled Jacobian, as measured last */
    uint8_t *bad;               /* [hex] corners that are not positive */
    uint8_t *active;            /* [vertex] */
    bw_hvertex *moving;         /* active vertices, ascending */
    bw_hex *touched;            /* hexes with any of them, ascending */
    size_t moving_count, touched_count;
    double *sum;                /* [chunk of touched] */
    double epsilon, size;       /* of the foldover-free energy */
    double sharpness;           /* of the energy of scaled Jacobians; 0: none of it */
    const double *x;            /* of the evaluation under way */
    double *gradient;
    uint64_t work;              /* evaluations of a hex's energy */
} bw_smoother;

bw_status bw_smoother_init(bw_context *ctx, bw_hex_mesh *mesh, const bw_hex_surface *surface, bw_smoother *s);
void bw_smoother_clear(bw_context *ctx, bw_smoother *s);
/* Makes the vertices of hexes active whose scaled Jacobian is below `threshold`, and those of hexes around them, `rings` times. Before: bw_smoother_measure. */
void bw_smoother_activate(bw_smoother *s, double threshold, int rings);
/* Base positions of active vertices from the mesh, moved to what holds them, and directions to move in; the number of variables. */
bw_status bw_smoother_frame(bw_context *ctx, bw_smoother *s, size_t *variables);
/* A bw_lbfgs_energy. */
double bw_smoother_energy(void *user, const double *x, double *gradient);
/* Positions of active vertices for x, into the mesh. */
bw_status bw_smoother_place(bw_context *ctx, bw_smoother *s, const double *x);
/* Measures touched hexes anew; the state of all. */
bw_status bw_smoother_measure(bw_context *ctx, bw_smoother *s, bw_smooth_state *state);
/* Ideal boxes of touched hexes from the present lengths of edges, none shorter than `floor` times the hexahedron's mean. */
void bw_smoother_rest(bw_smoother *s, double floor);

#endif
