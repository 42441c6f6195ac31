#include "server/limits.h"

bw_stage_limits bw_stage_limits_of(const bw_config *c) {
    uint64_t file = c->stage_output < c->stage_scratch ? c->stage_output : c->stage_scratch;
    return (bw_stage_limits){c->stage_memory, file, c->stage_scratch, c->stage_cpu_seconds, c->stage_wall_seconds};
}
