/* The whole pipeline on arbitrary .hexex, as a worker is given it: the first byte chooses the options, the rest is the input. Whatever the
 * mesh and its map are, a job ends well, or is refused as input or by a limit, with a report that can be read; nothing else. */
#include "fuzz.h"

#include <dirent.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "blockwright.h"
#include "format/report_json.h"

enum { BUDGET = 64 << 20, CELLS_MOST = 2000 };

static char folder[64];

static void remove_results(void) {
    char name[600];
    DIR *d = opendir(folder);
    for (struct dirent *e; d && (e = readdir(d));) {
        snprintf(name, sizeof name, "%s/%s", folder, e->d_name);
        unlink(name);
    }
    if (d) closedir(d);
    rmdir(folder);
}

static void expect_report(bw_status status) {
    static bw_report report;
    static char text[1 << 20], name[100];
    snprintf(name, sizeof name, "%s/report.json", folder);
    FILE *file = fopen(name, "rb");
    FUZZ_EXPECT(file);
    size_t size = fread(text, 1, sizeof text, file);
    fclose(file);
    bw_context ctx;
    bw_context_init(&ctx);
    FUZZ_EXPECT(bw_report_from_json(&ctx, text, size, &report) == BW_OK && report.error.status == status);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static int fd = -1;
    char input[32];
    if (!size || size > 1 << 16) return 0;
    if (fd < 0) fd = memfd_create("input", 0);
    snprintf(input, sizeof input, "/proc/self/fd/%d", fd);
    snprintf(folder, sizeof folder, "/dev/shm/bw-fuzz-run-%ld", (long)getpid());
    FUZZ_EXPECT(ftruncate(fd, 0) == 0 && pwrite(fd, data + 1, size - 1, 0) == (ssize_t)(size - 1));
    bw_context ctx;
    bw_options options;
    bw_options_defaults(&options);
    options.complex = *data & 1 ? BW_COMPLEX_BC : BW_COMPLEX_MC;
    options.reduce = (bw_reduce_mode)(*data >> 1 & 3) % 3;
    if ((*data >> 1 & 3) == 3) {
        options.complex = BW_COMPLEX_SERIAL;
        options.quantize = *data & 1 ? BW_QUANTIZE_NONNEGATIVE : BW_QUANTIZE_POSITIVE;
        options.time_limit = 0.5;
    }
    options.self_adjacent = *data & 8 ? BW_SELF_ADJACENT_SPLIT : BW_SELF_ADJACENT_ALLOW;
    options.effort = *data >> 4 & 1;
    options.vtk = *data >> 5 & 1;
    options.tolerance = *data & 64 ? 0.05 : 1e-4;
    options.repair = *data >> 7 & 1;
    options.max_cells = CELLS_MOST;
    bw_context_init(&ctx);
    ctx.memory.limit = BUDGET;
    bw_status status = bw_run(&ctx, &options, input, folder);
    bw_class class_ = bw_status_class(status);
    if (status != BW_OK && class_ != BW_CLASS_INPUT && class_ != BW_CLASS_LIMIT) fprintf(stderr, "%s\n", ctx.error.message);
    FUZZ_EXPECT(status == ctx.error.status && (status == BW_OK || class_ == BW_CLASS_INPUT || class_ == BW_CLASS_LIMIT));
    FUZZ_EXPECT(ctx.memory.used == 0);
    expect_report(status);
    remove_results();
    return 0;
}
