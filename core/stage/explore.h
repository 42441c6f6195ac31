/* Stage reduce, its first part if exploration is asked for: which walls of a base complex to keep (X 3), by explore/. */
#ifndef BW_STAGE_EXPLORE_H
#define BW_STAGE_EXPLORE_H

#include "explore/explore.h"

/* Requires a base complex. Takes the walls away that the choice leaves out and builds the complex anew, which then has found->best_blocks blocks and has passed
 * bw_complex_check (BW_E_CHECK otherwise). `hexes`: NULL, or hexahedra with the labels of this complex (hex/trivial.h); costs in bits want them (BW_E_USAGE).
 * choice->grids is not looked at. */
bw_status bw_explore_complex(bw_context *ctx, bw_cells *cells, bw_complex *complex, const bw_hex_mesh *hexes, const bw_explore_choice *choice, bw_explore_found *found);

#endif
