/* How a failed job is told to people: one sentence, then the elements at fault, or the places if those are known.
 *
 *     blockwright: part.hexex: 3 facets are not seamless ... [not-seamless]
 *       facet 17 at (0.25, 0.5, 1)
 *       ... and 2 more
 *
 *     blockwright: part.hexex: 19 tets in 2 regions are inverted ... [inverted]
 *       12 tets around (0.25, 0.5, 1): 17, 18, 23, 24, 30, 31 ...
 *       7 tets around (3, 0.5, 1): 104, 105, 106, 107, 211, 214 ...
 *
 * The same form for a local run, a failed job of a daemon and a request that a daemon refused.
 */
#ifndef BW_CLI_FAILURE_H
#define BW_CLI_FAILURE_H

#include <jansson.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    const char *code, *message; /* borrowed */
    size_t count;               /* elements or regions at fault altogether */
    size_t shown;
} cli_failure;

/* `subject`: what failed (a file, a job), NULL if the message says it. */
void cli_failure_print(const char *subject, const cli_failure *failure);
/* Call once per known element; the first ten are shown. `position` may be NULL. */
void cli_failure_element(cli_failure *failure, const char *kind, int64_t id, const double *position);
/* Instead, where regions are known: once per known region. `ids`: `known` of its tets. */
void cli_failure_region(cli_failure *failure, uint64_t tets, const int64_t *ids, size_t known, const double position[3]);
void cli_failure_end(const cli_failure *failure);
/* Prints a problem document (RFC 9457: type "/problems/<code>", title, detail, class, elements, regions) whole and
 * returns the exit code for it: of its code if core knows it, else of its class, else of the HTTP status
 * `http` (400: usage, 413 and 429: limit, other 4xx: input, the rest: internal). */
int cli_failure_problem(const char *subject, const json_t *problem, long http);

#endif
