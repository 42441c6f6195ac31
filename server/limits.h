/* What a stage may take. */
#ifndef BW_SERVER_LIMITS_H
#define BW_SERVER_LIMITS_H

#include "server/config.h"

typedef struct {
    uint64_t memory, file, scratch; /* bytes: of memory, of one file, of all files together */
    int cpu_seconds, wall_seconds;
} bw_stage_limits;

bw_stage_limits bw_stage_limits_of(const bw_config *config); /* the daemon's own */

#endif
