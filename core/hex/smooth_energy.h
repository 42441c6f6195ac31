/* Energies of a hex mesh as functions of what its vertices are free to do (smooth.h). Internal to hex/smooth*.c. */
#ifndef BW_HEX_SMOOTH_ENERGY_H
#define BW_HEX_SMOOTH_ENERGY_H

#include "hex/smooth.h"

/* Of what moves, each vertex m at  base + unit * sum over i < freedom of  x[first + i] * direction[i]. */
typedef struct {
    double base[3], direction[3][3], unit;
    size_t first;
    uint8_t freedom;
} bw_smooth_frame;

/* Only active vertices move; energies are those of the hexes that have one. What is large is kept for these alone. */
typedef struct {
    bw_context *ctx;
    bw_hex_mesh *mesh;          /* of it: connectivity, and positions as the energies' working place */
    const bw_hex_surface *surface;
    bw_hex_surface_hold *hold;  /* [vertex] */
    uint8_t *loose;             /* [vertex] may leave what holds it, by `leave` times its unit */
    double leave;
    double *least;              /* [hex] scaled Jacobian, as measured last */
    uint8_t *bad;               /* [hex] corners that are not positive */
    int32_t *rank;              /* [vertex] in `moving`; BW_NONE: not active */
    size_t moving_count, touched_count;
    bw_hvertex *moving;         /* active vertices, ascending */
    bw_hex *touched;            /* hexes with any of them, ascending */
    bw_smooth_frame *frame;     /* [moving] */
    uint32_t *corner_begin;     /* [moving + 1] */
    uint32_t *corner;           /* 8 * place in touched + corner, by moving vertex */
    double (*rest)[3];          /* [touched] edges of its ideal box */
    double (*slope)[3];         /* [8 * place in touched + corner] gradient with respect to that vertex */
    double *sum;                /* [chunk of touched] */
    size_t moving_room[3], touched_room[5]; /* of moving, frame, corner_begin; of touched, rest, corner, slope, sum */
    double epsilon;             /* of the foldover-free energy */
    double sharpness;           /* of the energy of scaled Jacobians; 0: none of it */
    const double *x;            /* of the evaluation under way */
    double *gradient;
    uint64_t work;              /* evaluations of a hex's energy */
} bw_smoother;

/* Nothing is active. Moves every vertex to what holds it after the state before that was measured. */
bw_status bw_smoother_init(bw_context *ctx, bw_hex_mesh *mesh, const bw_hex_surface *surface, bw_smooth_state *before, bw_smoother *s);
void bw_smoother_clear(bw_context *ctx, bw_smoother *s);
/* Makes the vertices of hexes active whose scaled Jacobian is below `threshold`, and those of hexes around them, `rings` times. */
bw_status bw_smoother_activate(bw_context *ctx, bw_smoother *s, double threshold, int rings);
/* Base positions of active vertices from the mesh, moved to what holds them, and directions to move in; the number of variables. */
bw_status bw_smoother_frame(bw_context *ctx, bw_smoother *s, size_t *variables);
/* A bw_lbfgs_energy. */
double bw_smoother_energy(void *user, const double *x, double *gradient);
/* Positions of active vertices for x, into the mesh. */
bw_status bw_smoother_place(bw_context *ctx, bw_smoother *s, const double *x);
/* Measures touched hexes anew; the state of all. */
bw_status bw_smoother_measure(bw_context *ctx, bw_smoother *s, bw_smooth_state *state);
/* Ideal boxes of touched hexes from the present lengths of edges, none shorter than `floor` times the hexahedron's mean. */
bw_status bw_smoother_rest(bw_context *ctx, bw_smoother *s, double floor);
/* Moves p to what holds a vertex. */
void bw_smoother_project(const bw_smoother *s, bw_hvertex v, double p[3]);

#endif
