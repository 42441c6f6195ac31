/* What every benchmark says first, and how it takes times. */
#ifndef BW_TESTS_BENCH_MACHINE_H
#define BW_TESTS_BENCH_MACHINE_H

/* Prints processor, cores, memory, kernel, compiler, build type and commit (with "+" if files differ from it). */
void bench_print_machine(const char *title);
double bench_seconds(void); /* of a clock that never goes back */

/* Times of repeated runs, in seconds. */
typedef struct {
    double best, median;
} bench_times;
bench_times bench_summary(double *seconds, int count); /* sorts them */

#endif
