#include "server/worker/admission.h"

#include <stdio.h>
#include <string.h>
#include <unistd.h>

enum { PATIENCE_MS = 30000, PROCESS_BYTES = 24 << 20, STATE_FACTOR = 12 };

static bool fits(const bw_admission *a, uint64_t need) {
    return a->running == 0 || (a->taken <= a->memory && need <= a->memory - a->taken);
}

bool bw_admission_ask(bw_admission *a, const char *job, uint64_t need, int64_t now) {
    bool first = strcmp(a->waiting, job) == 0;
    if (first) a->seen = true;
    if (!first && *a->waiting && now - a->since >= PATIENCE_MS) return false;
    if (fits(a, need)) {
        if (first) *a->waiting = '\0';
        return true;
    }
    if (!*a->waiting) {
        snprintf(a->waiting, sizeof a->waiting, "%s", job);
        a->since = now;
        a->seen = true;
    }
    return false;
}

void bw_admission_take(bw_admission *a, uint64_t need) {
    a->taken += need;
    a->running++;
}

void bw_admission_give(bw_admission *a, uint64_t need) {
    a->taken -= need;
    a->running--;
}

void bw_admission_begin(bw_admission *a) { a->seen = false; }

void bw_admission_end(bw_admission *a, bool complete) {
    if (complete && !a->seen) *a->waiting = '\0'; /* cancelled meanwhile, or its output was found in the cache */
}

static uint64_t bytes_of_a_byte(const char *start, size_t length) {
    enum { HEXEX = 7, TEXT = 26, BINARY = 45, COMPRESSED = 150 };
    if (length && start[0] >= '0' && start[0] <= '9') return HEXEX;
    if (strstr(start, "compressor=")) return COMPRESSED;
    bool text = memchr(start, '\0', length) == NULL && !strstr(start, "BINARY") && !strstr(start, "appended") && !strstr(start, "binary");
    return text ? TEXT : BINARY;
}

uint64_t bw_need_of_input(const char *start, size_t length, uint64_t bytes) {
    char text[BW_START_BYTES + 1];
    if (length > BW_START_BYTES) length = BW_START_BYTES;
    memcpy(text, start, length);
    text[length] = '\0';
    return PROCESS_BYTES + bytes_of_a_byte(text, length) * bytes;
}
uint64_t bw_need_of_state(uint64_t bytes) { return PROCESS_BYTES + STATE_FACTOR * bytes; }

static uint64_t number_in(const char *path) {
    unsigned long long n = 0;
    FILE *f = fopen(path, "r");
    if (f && fscanf(f, "%llu", &n) != 1) n = 0; /* "max" */
    if (f) fclose(f);
    return n;
}

uint64_t bw_machine_memory(void) {
    static const char *const groups[] = {"/sys/fs/cgroup/memory.max", "/sys/fs/cgroup/memory/memory.limit_in_bytes"};
    uint64_t bytes = (uint64_t)sysconf(_SC_PHYS_PAGES) * (uint64_t)sysconf(_SC_PAGESIZE);
    for (size_t i = 0; i < sizeof groups / sizeof *groups; i++) {
        uint64_t limit = number_in(groups[i]);
        if (limit && limit < bytes) bytes = limit;
    }
    return bytes;
}
