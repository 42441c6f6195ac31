/* The state of a job between two stages, and its file: what one worker leaves for the next.
 *
 * A state grows: after sanitize it holds mesh and map, after trace the cell complex too, after build the block complex too, after quantize
 * integer lengths if they were asked for, then an integer-grid map, after extract its hex mesh; a job of hexahedra keeps those of the input from sanitize on; the report always. The file is a container (container.h) with one section per array; reading copies the arrays into the job's
 * own blocks. State files are written and read by this program only and carry a checksum: once that is right, sizes and
 * offsets are checked all the same, so that reading and writing are safe whatever the file is; what the elements say is trusted.
 *
 * To add an array: one line in describe() of state.c, and raise the version of the stage that fills it (bw_stage_version).
 */
#ifndef BW_FORMAT_STATE_H
#define BW_FORMAT_STATE_H

#include "format/report_json.h"
#include "hex/hexmesh.h"
#include "igm/igm.h"

typedef struct {
    bw_tet_mesh mesh;
    bw_grid_map map;
    bw_cells cells; /* borrows mesh and map of the same state: a bw_state must not be moved */
    bw_complex complex;
    int64_t *length; /* [arc] integer lengths (stage quantize); NULL: none */
    bw_igm igm;      /* if has_igm */
    bw_hex_mesh hex; /* stage extract; if has_hex */
    bw_hex_mesh source;        /* the input of a job of hexahedra, whose tets are `mesh` (hex/trivial.h); if has_source. Labelled by stage extract */
    bw_vertex *source_vertex;  /* [vertex of source] its number in the input; NULL: the same */
    bw_report report;
    bool has_cells, has_complex, has_igm, has_hex, has_source;
} bw_state;

void bw_state_init(bw_state *state);
void bw_state_clear(bw_context *ctx, bw_state *state);

/* Writes the state that stage `stage` leaves. BW_E_IO, BW_E_MEMORY. */
bw_status bw_state_write(bw_context *ctx, bw_state *state, const char *stage, int version, const char *path);
/* Reads the state left by stage `stage` in this version. BW_E_IO, BW_E_VERSION, BW_E_MEMORY. */
bw_status bw_state_read(bw_context *ctx, bw_state *state, const char *stage, int version, const char *path);

#endif
