/* How much memory a stage will need, before it starts. */
#ifndef BW_NEED_H
#define BW_NEED_H

#include "blockwright.h"
#include "format/state.h"

/* About the largest sum of heap blocks, in bytes, that `stage` will have with the state that the stage before has left, from counts of that state
 * and what the options ask for. `used`: bytes of heap blocks that the state has. need.c tells how it was fitted. */
uint64_t bw_need(const bw_options *options, bw_stage stage, const bw_state *state, size_t used);

#endif
