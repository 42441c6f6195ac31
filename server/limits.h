/* What a stage may take. */
#ifndef BW_SERVER_LIMITS_H
#define BW_SERVER_LIMITS_H

#include <jansson.h>

#include "server/config.h"

typedef struct {
    uint64_t memory, file, scratch; /* bytes: of memory, of one file, of all files together */
    int cpu_seconds, wall_seconds;
} bw_stage_limits;

/* The daemon's own, lowered to those that the job asked for (JSON as checked below; NULL: none). */
bw_stage_limits bw_stage_limits_of(const bw_config *config, const char *asked);
/* The member `limits` of a new job: an object of positive numbers. False: `detail` tells what is wrong. */
bool bw_stage_limits_check(const json_t *asked, char *detail, size_t size);
/* The memory asked for, 0 if none was: what searches find depends on it. */
uint64_t bw_stage_limits_memory(const char *asked);

#endif
