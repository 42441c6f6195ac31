/* Failures of jobs as problem documents (RFC 9457 with the members class, stage, element_count, elements). */
#ifndef BW_SERVER_FAILURE_H
#define BW_SERVER_FAILURE_H

#include <jansson.h>
#include <stdbool.h>
#include <stdint.h>

#include "bw_api.h"

/* The problem type of a code; BW_PROBLEM_INTERNAL for an unknown one or one that jobs cannot fail with. */
bw_problem bw_failure_problem(const char *code);
bool bw_failure_retryable(bw_problem problem); /* of class system */
/* A new problem document: {type, title, status, detail?}. */
json_t *bw_problem_document(bw_problem problem, const char *detail);
/* A limit that was exceeded: its name in the API ("memory", "cpu_seconds", ...) and how much was allowed, in bytes or seconds. */
typedef struct {
    const char *what;
    uint64_t allowed;
} bw_exceeded;

/* The failure of a job as malloc'ed JSON. `error` is what the worker said ({message, element_count, elements}) or NULL;
 * `detail`, if not NULL, is used instead of its message; `exceeded` may be NULL. */
char *bw_failure_json(bw_problem problem, const char *stage, const char *detail, const json_t *error, const bw_exceeded *exceeded);

#endif
