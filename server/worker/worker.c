/* blockwright-worker: runs one stage of one job and exits. Started by the spawner only (spawner.h tells with what); the one
 * place where the core and the service meet. It talks to the daemon over descriptor 3 (worker_proto.h), reads the input
 * from descriptor 4 and its file of parameters from 5, if that is open, and writes "out" in its working directory. */
#include <blockwright.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/worker/worker_proto.h"

enum { PROGRESS_MS = 100 };

static volatile sig_atomic_t cancelled, finish;
static char pending[BW_FRAME_NOTE_MOST + 1]; /* a note that came too soon after the one before */
static int64_t last_progress;

static void on_term(int signal) {
    (void)signal;
    cancelled = 1;
}

static void on_finish(int signal) {
    (void)signal;
    finish = 1;
}

/* Sends the pending note, not oftener than every PROGRESS_MS unless it is the last. */
static void send_note(bool last_one) {
    static int64_t last;
    int64_t now = bw_mono_ms();
    if (!*pending || (!last_one && last && now - last < PROGRESS_MS)) return;
    last = now;
    bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_NOTE, pending, strlen(pending));
    *pending = '\0';
}

static void on_progress(void *user, const char *stage, double fraction) {
    int64_t now = bw_mono_ms();
    (void)user, (void)stage;
    send_note(false);
    if (now - last_progress < PROGRESS_MS || !(fraction >= 0 && fraction <= 1)) return;
    last_progress = now;
    bw_send_progress(BW_WORKER_CHANNEL, fraction);
}

static void on_log(void *user, const char *line) {
    (void)user;
    bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_LOG, line, strlen(line));
}

static void on_note(void *user, const char *text) {
    (void)user;
    snprintf(pending, sizeof pending, "%s", text);
    send_note(false);
}

typedef struct {
    const char *stage, *options;
    unsigned long long memory;
} arguments;

static bool read_arguments(int argc, char **argv, arguments *a) {
    memset(a, 0, sizeof *a);
    for (int i = 1; i + 1 < argc; i += 2) {
        if (strcmp(argv[i], "--stage") == 0) a->stage = argv[i + 1];
        else if (strcmp(argv[i], "--options") == 0) a->options = argv[i + 1];
        else if (strcmp(argv[i], "--memory") == 0) a->memory = strtoull(argv[i + 1], NULL, 10);
        else if (strcmp(argv[i], "--job") != 0 && strcmp(argv[i], "--attempt") != 0) return false; /* for ps only */
    }
    struct stat st;
    return argc % 2 == 1 && a->stage && a->options && fstat(BW_WORKER_CHANNEL, &st) == 0 && S_ISSOCK(st.st_mode);
}

static bool say_hello(bw_stage stage) {
    char hello[96];
    int n = snprintf(hello, sizeof hello, "{\"stage\":\"%s\",\"version\":%d}", bw_stage_name(stage),
                     bw_stage_version(stage));
    return bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_HELLO, hello, (size_t)n);
}

static bool say_result(const bw_context *ctx, bw_status status) {
    static const char ok[] = "{\"status\":\"ok\"}", cut[] = "{\"status\":\"ok\",\"cut\":true}", lost[] = "{\"status\":\"memory-limit\"}";
    send_note(true);
    if (status == BW_OK) return bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_RESULT, ctx->finished ? cut : ok, strlen(ctx->finished ? cut : ok));
    char *error = bw_error_json(ctx);
    const char *text = error ? error : lost;
    bool sent = bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_RESULT, text, strlen(text));
    free(error);
    return sent;
}

static bw_status run_stage(bw_context *ctx, const arguments *a, bw_stage stage) {
    char input[32], parameters[32];
    bw_options options;
    bw_options_defaults(&options);
    bw_status status = bw_options_from_json(ctx, &options, a->options, strlen(a->options));
    if (status != BW_OK) return status;
    snprintf(input, sizeof input, "/proc/self/fd/%d", BW_WORKER_INPUT);
    snprintf(parameters, sizeof parameters, "/proc/self/fd/%d", BW_WORKER_PARAMETERS);
    if (fcntl(BW_WORKER_PARAMETERS, F_GETFD) >= 0) options.parameters = parameters;
    status = bw_stage_run(ctx, &options, stage, input, "out");
    if (status != BW_OK && ctx->error.status == BW_OK) bw_fail(ctx, status, "%s failed", a->stage);
    return status;
}

int main(int argc, char **argv) {
    static bw_context ctx;
    arguments a;
    bw_stage stage;
    if (!read_arguments(argc, argv, &a) || bw_stage_from_name(a.stage, &stage) != BW_OK) {
        fprintf(stderr, "blockwright-worker is started by blockwrightd, not by hand; see blockwright --help\n");
        return 2;
    }
    signal(SIGTERM, on_term);
    signal(SIGUSR1, on_finish);
    bw_context_init(&ctx);
    ctx.memory.limit = (size_t)a.memory;
    ctx.cancel = &cancelled;
    ctx.finish = &finish;
    ctx.progress = on_progress;
    ctx.note = on_note;
    ctx.log = on_log;
    ctx.stage = a.stage;
    if (!say_hello(stage)) return 5;
    bw_status status = run_stage(&ctx, &a, stage);
    return say_result(&ctx, status) ? 0 : 5;
}
