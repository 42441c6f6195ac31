/* Memory among running stages: each has a need, and no more are started than the machine's memory is enough for.
 *
 * Invariants
 *  1. The needs of what runs add up to `memory` at most; a need that is larger runs alone.
 *  2. Jobs behind one that waits for memory may pass it, but only for PATIENCE_MS; then nothing is started until it is.
 */
#ifndef BW_SERVER_ADMISSION_H
#define BW_SERVER_ADMISSION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

typedef struct {
    uint64_t memory, taken; /* bytes */
    int running;
    char waiting[32]; /* the job that has waited longest, ""; */
    int64_t since;    /* ms, monotonic */
    bool seen;        /* in this pass */
} bw_admission;

/* May this job's stage start now? Jobs are asked for in the order in which they should start, pass by pass. */
bool bw_admission_ask(bw_admission *admission, const char *job, uint64_t need, int64_t now);
void bw_admission_take(bw_admission *admission, uint64_t need); /* it has started */
void bw_admission_give(bw_admission *admission, uint64_t need); /* it has ended */
/* A pass over the waiting jobs begins / has ended; `complete`: all of them were asked for or could have been. */
void bw_admission_begin(bw_admission *admission);
void bw_admission_end(bw_admission *admission, bool complete);

/* About what sanitize needs for an input of so many bytes. `start`: its first `length` bytes, for the formats differ in how compact they are. Measured
 * (heap blocks a byte of the file): hexex 2 to 6, hex meshes as text 24; binary and compressed ones are taken by their ratio to that. Whoever
 * lies there wins nothing but a turn: limits are limits. */
enum { BW_START_BYTES = 512 };
uint64_t bw_need_of_input(const char *start, size_t length, uint64_t bytes);
/* For a state file of which no need is known. */
uint64_t bw_need_of_state(uint64_t bytes);
uint64_t bw_machine_memory(void); /* bytes of this machine, or of its control group if that is less */

#endif
