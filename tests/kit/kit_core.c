#include "kit/kit.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

uint64_t kit_seed(void) {
    static bool known;
    static uint64_t seed = 1;
    if (known) return seed;
    const char *wish = getenv("BW_SEED");
    if (wish && !strcmp(wish, "random")) {
        if (getrandom(&seed, sizeof seed, 0) != sizeof seed) fail_msg("getrandom: %s", strerror(errno));
    } else if (wish && *wish) {
        char *end;
        seed = strtoull(wish, &end, 0);
        if (*end) fail_msg("BW_SEED=%s is not a number", wish);
    }
    known = true;
    printf("seed %llu (BW_SEED sets it)\n", (unsigned long long)seed);
    fflush(stdout);
    return seed;
}

kit_random kit_random_of(uint64_t seed, uint64_t stream) {
    kit_random random = {seed ^ (stream * 0xd1342543de82ef95u)};
    kit_random_next(&random);
    return random;
}

kit_random kit_random_start(uint64_t stream) { return kit_random_of(kit_seed(), stream); }

uint64_t kit_random_next(kit_random *random) {
    uint64_t z = random->state += 0x9e3779b97f4a7c15u;
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    return z ^ (z >> 31);
}

uint64_t kit_random_below(kit_random *random, uint64_t bound) {
    return (uint64_t)(((unsigned __int128)kit_random_next(random) * bound) >> 64);
}

double kit_random_unit(kit_random *random) { return (double)(kit_random_next(random) >> 11) * 0x1p-53; }

double kit_random_range(kit_random *random, double low, double high) {
    return low + (high - low) * kit_random_unit(random);
}

double kit_random_bits(kit_random *random) {
    for (;;) {
        uint64_t bits = kit_random_next(random);
        if ((bits >> 52 & 0x7ff) == 0x7ff) continue;
        double value;
        memcpy(&value, &bits, sizeof value);
        return value;
    }
}

static const char *name_of(bw_status status) { return status == BW_OK ? "ok" : bw_status_code(status); }

void kit_expect_status_(const bw_context *ctx, bw_status status, bw_status expected, const char *file, int line) {
    if (status != expected) {
        print_error("status %s, expected %s; message: %s\n", name_of(status), name_of(expected), ctx->error.message);
        _fail(file, line);
    }
    if (status != ctx->error.status) {
        print_error("returned %s, but the context holds %s\n", name_of(status), name_of(ctx->error.status));
        _fail(file, line);
    }
}

size_t kit_fail_each_allocation(bw_status (*body)(bw_context *ctx, void *user), void *user) {
    for (uint64_t n = 1;; n++) {
        bw_context ctx;
        bw_context_init(&ctx);
        ctx.memory.fail_at = n;
        bw_status status = body(&ctx, user);
        if (ctx.memory.used) fail_msg("allocation %llu: %zu bytes leak", (unsigned long long)n, ctx.memory.used);
        bool refused = ctx.memory.calls >= n;
        if (status == BW_OK && refused) fail_msg("allocation %llu failed unnoticed", (unsigned long long)n);
        if (status == BW_OK) return (size_t)n;
        if (status != BW_E_MEMORY || !refused)
            fail_msg("allocation %llu: %s: %s", (unsigned long long)n, bw_status_code(status), ctx.error.message);
    }
}
