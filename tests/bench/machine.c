#include "machine.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/utsname.h>
#include <time.h>
#include <unistd.h>

static void print_processor(void) {
    FILE *file = fopen("/proc/cpuinfo", "r");
    char line[256];
    const char *name = "unknown processor";
    while (file && fgets(line, sizeof line, file))
        if (!strncmp(line, "model name", 10) && strchr(line, ':')) {
            line[strcspn(line, "\n")] = 0;
            name = strchr(line, ':') + 2;
            break;
        }
    printf("machine   %s, %ld cores, %.1f GiB\n", name, sysconf(_SC_NPROCESSORS_ONLN),
           (double)sysconf(_SC_PHYS_PAGES) * (double)sysconf(_SC_PAGE_SIZE) / 0x1p30);
    if (file) fclose(file);
}

static void print_output_of(const char *label, const char *command) {
    char line[256] = "";
    FILE *pipe = popen(command, "r");
    if (pipe && !fgets(line, sizeof line, pipe)) *line = 0;
    if (pipe) pclose(pipe);
    line[strcspn(line, "\n")] = 0;
    printf("%s%s\n", label, *line ? line : "unknown");
}

void bench_print_machine(const char *title) {
    struct utsname os;
    printf("%s\n", title);
    print_processor();
    if (uname(&os) == 0) printf("system    %s %s\n", os.sysname, os.release);
#ifdef __clang__
    printf("compiler  %s, %s\n", __VERSION__, BW_BUILD_TYPE);
#else
    printf("compiler  gcc %s, %s\n", __VERSION__, BW_BUILD_TYPE);
#endif
    fflush(stdout);
    print_output_of("commit    ", "git -C '" BW_SOURCE_DIR "' rev-parse --short=12 HEAD 2>/dev/null | tr -d '\\n'; "
                                  "git -C '" BW_SOURCE_DIR "' diff --quiet HEAD 2>/dev/null || echo +");
}

double bench_seconds(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static int ascending(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

bench_times bench_summary(double *seconds, int count) {
    qsort(seconds, (size_t)count, sizeof *seconds, ascending);
    return (bench_times){seconds[0], seconds[count / 2]};
}
