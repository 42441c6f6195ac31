/* Exact points of the traced mesh: the vertices of a cell complex, and points added inside cells.
 *
 * Invariants
 *  1. Points 0 .. cells->vertex_count - 1 are the complex's vertices; the added ones follow. An added point
 *     belongs to one tet, and is a grid point of its chart or the mean of four complex vertices.
 *  2. A chart lists points of one tet with coordinates relative to the tet's corner 0, in doubles. With size
 *     the largest coordinate of the tet in that frame, each is off by at most 2^-49 size; every sign is
 *     decided from that bound, and in exact arithmetic where it does not decide.
 */
#ifndef BW_FORMAT_POINTS_H
#define BW_FORMAT_POINTS_H

#include "mesh/cells.h"

typedef int32_t bw_point;

typedef struct {
    int64_t value[3];   /* grid units, chart of `tet`; unused for a mean */
    bw_cvertex mean[4]; /* mean[0] is BW_NONE for a grid point */
    bw_tet tet;
} bw_added_point;

/* numerator, denominator in lowest terms, between 0 and 1, in the home chart of the facet */
typedef unsigned __int128 bw_fraction[2];

typedef struct {
    const bw_cells *cells; /* borrowed */
    int32_t *fraction_of;  /* [vertex] index into `fraction`; BW_NONE: no fraction, or not in a facet */
    bw_fraction *fraction;
    size_t fraction_count, fraction_room;
    bw_added_point *added;
    size_t added_count, added_room;
    mpz_t scratch[2];
    bool ready; /* scratch is initialised */
} bw_points;

/* Finds the fractional coordinates of all vertices in facets. O(n). */
bw_status bw_points_init(bw_context *ctx, bw_points *points, const bw_cells *cells);
void bw_points_clear(bw_context *ctx, bw_points *points);
bw_status bw_points_add(bw_context *ctx, bw_points *points, const bw_added_point *point, bw_point *out);
static inline size_t bw_points_count(const bw_points *points) {
    return points->cells->vertex_count + points->added_count;
}

/* Exact coordinates in the chart of `tet`, grid units; out is initialised by the caller. */
void bw_points_exact(const bw_points *points, bw_point point, bw_tet tet, mpq_t out[3]);
/* Position in the input's space, to double rounding. */
void bw_points_position(const bw_points *points, bw_point point, double out[3]);
/* Positions of all points; bw_free'd by the caller. O(n). */
bw_status bw_points_positions(bw_context *ctx, const bw_points *points, double (**out)[3]);
/* The three parameters as canonical rationals p/q, integers without a denominator, each with a NUL after it.
 * Returns the length of all three. Room: BW_POINT_TEXT bytes. */
enum { BW_POINT_TEXT = 1200 };
size_t bw_points_print(bw_points *points, bw_point point, bw_tet tet, char *text);

typedef struct {
    const bw_points *points; /* borrowed */
    bw_tet tet;
    int64_t origin[3];
    double size;
    size_t count;
    bw_point *point; /* [slot] */
    double (*at)[3]; /* [slot] */
    int32_t *slot;   /* [point]; meaningful where point[slot] is the point */
    size_t point_room, at_room, slot_room;
} bw_chart;

/* Starts the list for another tet. The chart is zero before the first call. */
bw_status bw_chart_open(bw_context *ctx, bw_chart *chart, const bw_points *points, bw_tet tet);
void bw_chart_clear(bw_context *ctx, bw_chart *chart);
/* Slot of a point, listed if it was not. The point lies in the closed tet. */
bw_status bw_chart_add(bw_context *ctx, bw_chart *chart, bw_point point, int32_t *slot);
static inline bool bw_chart_has(const bw_chart *chart, bw_point point) {
    size_t s = (size_t)chart->slot[point];
    return s < chart->count && chart->point[s] == point;
}

/* Determinant (six times the volume) of a tet of slots, in doubles. */
double bw_chart_volume(const bw_chart *chart, const int32_t slot[4]);
/* Its sign: 2 if the doubles do not decide. */
int bw_chart_sign_filtered(const bw_chart *chart, const int32_t slot[4]);
/* Its sign, exact. */
int bw_chart_sign(const bw_chart *chart, const int32_t slot[4]);
/* Whether three slots lie on one line, exact. */
bool bw_chart_collinear(const bw_chart *chart, const int32_t slot[3]);

#endif
