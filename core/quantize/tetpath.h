/* Paths of tets along arcs, with the vector that is walked, carried from chart to chart.
 *
 * From one edge of the cell complex to the next the path turns around their common vertex, through tets that hold it. Where that vertex lies on a singular
 * curve there are several ways around; each is as good, for the transition along it is the one the vector is carried by.
 */
#ifndef BW_QUANTIZE_TETPATH_H
#define BW_QUANTIZE_TETPATH_H

#include "complex/complex.h"

typedef struct {
    bw_context *ctx;
    const bw_cells *cells;
    const bw_complex *complex;
    bw_tet *tet;       /* the path */
    size_t count, room;
    int64_t vector[3]; /* walked so far, in the chart of the last tet */
    bw_tet *queue;     /* scratch */
    int32_t *before;
    size_t queue_room, before_room;
} bw_tet_path;

void bw_tet_path_init(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_tet_path *path);
void bw_tet_path_clear(bw_tet_path *path);

/* Starts anew in a tet. */
bw_status bw_tet_path_start(bw_tet_path *path, bw_tet tet);
/* On to a tet that holds an element (`kind` and `carrier` as in cells.h), around a vertex of the cell complex that the last tet and it hold. */
bw_status bw_tet_path_turn(bw_tet_path *path, bw_cvertex around, bw_carrier kind, int32_t carrier);
/* Along an arc of a length; the last tet holds its start (or the path is empty: it then begins at the arc). */
bw_status bw_tet_path_follow(bw_tet_path *path, bw_arc_use use, int64_t length);

#endif
