/* What every test leans on: temporary files, other programs, seeded randomness, the shared data, failing allocations.
 *
 * Linked into each test executable (tests/CMakeLists.txt). Include it instead of cmocka.h: it brings the headers that
 * cmocka needs in the order it needs them. A helper that cannot do its work fails the running test with a message;
 * none returns an error.
 */
#ifndef BW_TESTS_KIT_H
#define BW_TESTS_KIT_H

#include <setjmp.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "base/context.h"

/* ---- files ---------------------------------------------------------------------------------------------------- */

/* Folder of this test process, made on the first call and removed with all it holds at exit (kept if BW_KEEP is set). */
const char *kit_temp_dir(void);
/* "<temp dir>/<name>", printf-like. Owned by the kit; valid until exit. */
const char *kit_temp_path(const char *format, ...) __attribute__((format(printf, 1, 2)));
void kit_write_file(const char *path, const void *data, size_t size);
void kit_write_text(const char *path, const char *text);
/* The whole file, with a NUL after it; free() it. size may be NULL. */
char *kit_read_file(const char *path, size_t *size);
bool kit_exists(const char *path);

/* ---- programs ------------------------------------------------------------------------------------------------- */

typedef struct {
    int exit;    /* exit code; -1 if a signal ended it */
    int signal;  /* the signal; 0 if none */
    char *out;   /* standard output, NUL-terminated */
    char *err;   /* standard error, NUL-terminated */
    size_t out_size, err_size;
} kit_result;

/* Runs argv (NULL-terminated; argv[0] is looked up in PATH unless it has a slash) with empty standard input and waits. */
kit_result kit_run(const char *const argv[]);
void kit_result_clear(kit_result *result);
/* "<build>/bin/<name>": where the executables of this build are. Owned by the kit. */
const char *kit_program(const char *name);

/* ---- randomness ----------------------------------------------------------------------------------------------- */

/* Generator state: splitmix64, the same numbers on every machine. */
typedef struct {
    uint64_t state;
} kit_random;

/* The seed of this run: BW_SEED if set (a number, or the word "random"), else 1. Printed once. */
uint64_t kit_seed(void);
/* A generator that depends on the seed and on `stream`, so that tests in one program do not share numbers. */
kit_random kit_random_start(uint64_t stream);
kit_random kit_random_of(uint64_t seed, uint64_t stream); /* what a run with BW_SEED=seed gets */
uint64_t kit_random_next(kit_random *random);
uint64_t kit_random_below(kit_random *random, uint64_t bound); /* 0 .. bound-1; bound > 0 */
double kit_random_unit(kit_random *random);                    /* [0, 1) */
double kit_random_range(kit_random *random, double low, double high);
double kit_random_bits(kit_random *random); /* any finite double, every bit pattern alike */

/* ---- shared data ---------------------------------------------------------------------------------------------- */

/* "<checkout>/../shared/<name>". Where it is absent, prints SKIP with the path and skips the running test: it does not
 * return then. Owned by the kit. */
const char *kit_shared(const char *name);
/* Sorted names in a folder that end with `suffix`; kit_names_free() the list. */
char **kit_names(const char *folder, const char *suffix, size_t *count);
void kit_names_free(char **names, size_t count);
/* Skips the running test, visibly. */
void kit_skip(const char *format, ...) __attribute__((format(printf, 1, 2), noreturn));
/* Exit code of a test program: `failed` if not 0, 77 (CTest: skipped) if every one of `tests` was skipped, else 0. */
int kit_exit(int failed, size_t tests);

/* main() of a test program: runs the array `tests` and gives the exit code. */
#define KIT_MAIN(tests)                                                                                               \
    int main(void) {                                                                                                  \
        return kit_exit(cmocka_run_group_tests(tests, NULL, NULL), sizeof(tests) / sizeof *(tests));                  \
    }

/* ---- contexts and failing allocations -------------------------------------------------------------------------- */

/* Fails the test, with the context's message, unless status is `expected` (and, for a failure, recorded in ctx). */
#define kit_expect_status(ctx, status, expected) kit_expect_status_((ctx), (status), (expected), __FILE__, __LINE__)
void kit_expect_status_(const bw_context *ctx, bw_status status, bw_status expected, const char *file, int line);
#define kit_expect_ok(ctx, status) kit_expect_status((ctx), (status), BW_OK)

/* Runs `body` with the first allocation failing, then the second, ... until it succeeds. Each failing run must return
 * BW_E_MEMORY and each run must leave no byte in use. Returns the number of runs. `body` frees all it took. */
size_t kit_fail_each_allocation(bw_status (*body)(bw_context *ctx, void *user), void *user);

#endif
