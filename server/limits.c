#include "server/limits.h"

#include <stdio.h>
#include <string.h>

static const char *const names[] = {"memory", "scratch", "cpu_seconds", "wall_seconds", "job_cpu_seconds", "job_wall_seconds"};

static uint64_t lower(const json_t *asked, const char *name, uint64_t own) {
    json_int_t n = json_integer_value(json_object_get(asked, name));
    return n > 0 && (uint64_t)n < own ? (uint64_t)n : own;
}

/* `job`: the daemon's own for all stages together, 0 for none. */
static bw_time_limit time_limit(const json_t *asked, const char *of_stage, int stage, const char *of_job, int job, int64_t spent_ms) {
    static const uint64_t none = INT64_MAX / 1000;
    uint64_t total = lower(asked, of_job, job ? (uint64_t)job : none);
    bw_time_limit l = {.what = of_stage, .allowed = lower(asked, of_stage, (uint64_t)stage)};
    int64_t left = (int64_t)total * 1000 - spent_ms;
    l.left_ms = (int64_t)l.allowed * 1000;
    return left < l.left_ms ? (bw_time_limit){of_job, total, left > 0 ? left : 0} : l;
}

bw_stage_limits bw_stage_limits_of(const bw_config *c, const char *asked, const bw_spent *spent) {
    json_t *o = asked ? json_loads(asked, 0, NULL) : NULL;
    bw_stage_limits l = {.memory = lower(o, "memory", c->stage_memory), .scratch = lower(o, "scratch", c->stage_scratch)};
    l.cpu = time_limit(o, "cpu_seconds", c->stage_cpu_seconds, "job_cpu_seconds", c->job_cpu_seconds, spent->cpu_ms);
    l.wall = time_limit(o, "wall_seconds", c->stage_wall_seconds, "job_wall_seconds", c->job_wall_seconds, spent->wall_ms);
    uint64_t file = c->stage_output;
    l.file = file < l.scratch ? file : l.scratch;
    json_decref(o);
    return l;
}

bool bw_stage_limits_check(const json_t *asked, char *detail, size_t size) {
    const char *name;
    json_t *value;
    snprintf(detail, size, "limits must be an object");
    if (!json_is_object(asked)) return false;
    json_object_foreach((json_t *)asked, name, value) {
        bool known = false;
        for (size_t i = 0; i < sizeof names / sizeof *names; i++) known |= strcmp(names[i], name) == 0;
        if (!known) snprintf(detail, size, "there is no limit '%.60s'", name);
        else if (!json_is_integer(value) || json_integer_value(value) < 1) snprintf(detail, size, "limit %s must be a positive integer", name);
        else continue;
        return false;
    }
    return true;
}

uint64_t bw_stage_limits_memory(const char *asked) {
    json_t *o = asked ? json_loads(asked, 0, NULL) : NULL;
    json_int_t n = json_integer_value(json_object_get(o, "memory"));
    json_decref(o);
    return n > 0 ? (uint64_t)n : 0;
}
