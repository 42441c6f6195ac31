/* What a stage may take. */
#ifndef BW_SERVER_LIMITS_H
#define BW_SERVER_LIMITS_H

#include <jansson.h>

#include "server/config.h"
#include "server/queue/queue.h"

/* Processor time, or time by the clock, that a stage may take: what any stage may, or what the job has left of what all its stages may together,
 * whichever is less. */
typedef struct {
    const char *what; /* which of the two, as the API calls it: "cpu_seconds" or "job_cpu_seconds", likewise with wall */
    uint64_t allowed; /* seconds, by that limit */
    int64_t left_ms;  /* for this stage; 0: nothing is left */
} bw_time_limit;

typedef struct {
    uint64_t memory, file, scratch; /* bytes: of memory, of one file, of all files together */
    bw_time_limit cpu, wall;
} bw_stage_limits;

/* The daemon's own, lowered to those that the job asked for (JSON as checked below; NULL: none) and to what it has not spent. */
bw_stage_limits bw_stage_limits_of(const bw_config *config, const char *asked, const bw_spent *spent);
/* The member `limits` of a new job: an object of positive numbers. False: `detail` tells what is wrong. */
bool bw_stage_limits_check(const json_t *asked, char *detail, size_t size);
/* The memory asked for, 0 if none was: what searches find depends on it. */
uint64_t bw_stage_limits_memory(const char *asked);

#endif
