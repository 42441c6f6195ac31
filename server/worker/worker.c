/* blockwright-worker: runs one stage of one job and exits. Started by the spawner only (spawner.h tells with what); the one
 * place where the core and the service meet. It enters its sandbox (sandbox.h) before anything else, talks to the daemon over
 * descriptor 3 (worker_proto.h), reads the input from descriptor 4 and its file of parameters from 5, if that is open, and writes
 * "out" in its working directory. */
#include <blockwright.h>
#include <fcntl.h>
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/worker/sandbox.h"
#include "server/worker/worker_proto.h"

enum { PROGRESS_MS = 100, BASE_BYTES = 24 << 20 /* of the process itself: programs, libraries, stack */ };

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
    bool require_sandbox;
} arguments;

static bool read_arguments(int argc, char **argv, arguments *a) {
    memset(a, 0, sizeof *a);
    for (int i = 1; i + 1 < argc; i += 2) {
        if (strcmp(argv[i], "--stage") == 0) a->stage = argv[i + 1];
        else if (strcmp(argv[i], "--options") == 0) a->options = argv[i + 1];
        else if (strcmp(argv[i], "--memory") == 0) a->memory = strtoull(argv[i + 1], NULL, 10);
        else if (strcmp(argv[i], "--require-sandbox") == 0) a->require_sandbox = strcmp(argv[i + 1], "yes") == 0;
        else if (strcmp(argv[i], "--job") != 0 && strcmp(argv[i], "--attempt") != 0) return false; /* for ps only */
    }
    struct stat st;
    return argc % 2 == 1 && a->stage && a->options && fstat(BW_WORKER_CHANNEL, &st) == 0 && S_ISSOCK(st.st_mode);
}

static bool say_hello(const char *stage, int version, const bw_sandbox *sandbox) {
    char level[BW_SANDBOX_TEXT], hello[BW_SANDBOX_TEXT + 96];
    bw_sandbox_json(sandbox, level);
    int n = snprintf(hello, sizeof hello, "{\"stage\":\"%s\",\"version\":%d,\"sandbox\":%s}", stage, version, level);
    return bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_HELLO, hello, (size_t)n);
}

static bool say_ok(bool cut, bw_input_kind kind, uint64_t need) {
    static const char *const kinds[] = {[BW_KIND_AUTO] = "", [BW_KIND_TET] = ",\"kind\":\"tet\"", [BW_KIND_HEX] = ",\"kind\":\"hex\""};
    char text[96];
    int n = snprintf(text, sizeof text, "{\"status\":\"ok\"%s%s,\"need\":%" PRIu64 "}", cut ? ",\"cut\":true" : "", kinds[kind], need);
    return bw_send_frame(BW_WORKER_CHANNEL, BW_FRAME_RESULT, text, (size_t)n);
}

static bool say_result(const bw_context *ctx, bw_status status) {
    static const char lost[] = "{\"status\":\"memory-limit\"}";
    send_note(true);
    if (status == BW_OK) return say_ok(ctx->finished, ctx->input_kind, ctx->next_need ? ctx->next_need + BASE_BYTES : 0);
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

/* Fails closed: with a part of the sandbox missing, a daemon that requires it gets no work done. */
static bw_status check_sandbox(bw_context *ctx, const arguments *a, const bw_sandbox *sandbox) {
    if (!a->require_sandbox || bw_sandbox_complete(sandbox)) return BW_OK;
    return bw_fail(ctx, BW_E_INTERNAL, "the sandbox that this daemon requires is not complete here: %s", sandbox->missing);
}

static void prepare(bw_context *ctx, const arguments *a) {
    signal(SIGTERM, on_term);
    signal(SIGUSR1, on_finish);
    bw_context_init(ctx);
    ctx->memory.limit = (size_t)a->memory;
    ctx->cancel = &cancelled;
    ctx->finish = &finish;
    ctx->progress = on_progress;
    ctx->note = on_note;
    ctx->log = on_log;
    ctx->stage = a->stage;
}

int main(int argc, char **argv) {
    static const int readable[] = {BW_WORKER_INPUT, BW_WORKER_PARAMETERS};
    static bw_context ctx;
    arguments a;
    bw_stage stage = BW_STAGE_SANITIZE;
    bw_sandbox sandbox;
    bool known = read_arguments(argc, argv, &a), trial = known && strcmp(a.stage, BW_WORKER_TRIAL) == 0;
    if (!known || (!trial && bw_stage_from_name(a.stage, &stage) != BW_OK)) {
        fprintf(stderr, "blockwright-worker is started by blockwrightd, not by hand; see blockwright --help\n");
        return 2;
    }
    prepare(&ctx, &a);
    bw_sandbox_enter(readable, sizeof readable / sizeof *readable, &sandbox);
    if (!say_hello(a.stage, trial ? 0 : bw_stage_version(stage), &sandbox)) return 5;
    if (trial) return say_ok(false, BW_KIND_AUTO, 0) ? 0 : 5;
    bw_status status = check_sandbox(&ctx, &a, &sandbox);
    if (status == BW_OK) status = run_stage(&ctx, &a, stage);
    return say_result(&ctx, status) ? 0 : 5;
}
