/* blockwright watch: follows a job to its end. */
#include <stdio.h>
#include <string.h>
#include <time.h>

#include "failure.h"
#include "remote.h"

static const double patience_seconds = 30; /* how long a daemon that did answer before is waited for */

typedef struct {
    cli_remote remote;
    bool quiet;
} settings;

static const cli_option options[] = {
    CLI_REMOTE_OPTIONS(settings),
    {"quiet", 'q', CLI_FLAG, offsetof(settings, quiet), NULL, "no progress, only how it ended", 0, 0},
};

static void pause_seconds(double seconds) {
    struct timespec t = {(time_t)seconds, (long)((seconds - (double)(time_t)seconds) * 1e9)};
    nanosleep(&t, NULL);
}

/* The job as it is now; a daemon that does not answer is asked again for `patience` seconds. NULL: *exit_code
 * is set and the reason said. */
static json_t *ask(cli_http *http, const char *id, double patience, int *exit_code) {
    char path[128];
    cli_reply reply;
    double started = cli_now();
    snprintf(path, sizeof path, "/v1/jobs/%s", id);
    while (!cli_http_call(http, "GET", path, NULL, &reply)) {
        if (cli_now() - started > patience) {
            *exit_code = cli_http_failed(http);
            return NULL;
        }
        pause_seconds(0.5);
    }
    json_t *job = reply.status == 200 ? json_loads(reply.body ? reply.body : "", 0, NULL) : NULL;
    if (!job) *exit_code = cli_http_refused(http, &reply);
    cli_reply_clear(&reply);
    return job;
}

static bool ended(const json_t *job) {
    const char *state = cli_text_of(job, "state");
    return strcmp(state, "queued") != 0 && strcmp(state, "running") != 0;
}

/* The best that a search has found so far is a line of its own, when it has changed. */
static void show_note(cli_progress *progress, const json_t *job, char *shown, size_t size) {
    char now[204];
    cli_safe(now, sizeof now, cli_text_of(job, "note"));
    if (progress->quiet || !*now || !strcmp(now, shown)) return;
    cli_progress_clear(progress);
    fprintf(stderr, "  %s so far\n", now);
    snprintf(shown, size, "%s", now);
}

static void show(cli_progress *progress, const json_t *job) {
    bool running = !strcmp(cli_text_of(job, "state"), "running");
    cli_progress_show(progress, running ? cli_text_of(job, "stage") : "queued",
                      json_number_value(json_object_get(job, "progress")));
}

static int exit_of_job(const char *id, const json_t *job) {
    const char *state = cli_text_of(job, "state");
    char subject[96];
    if (!strcmp(state, "successful")) return CLI_DONE;
    snprintf(subject, sizeof subject, "job %s", id);
    if (!strcmp(state, "failed")) {
        const json_t *failure = json_object_get(job, "failure");
        return cli_failure_problem(subject, failure,
                                   (long)json_integer_value(json_object_get(failure, "status")));
    }
    if (!strcmp(state, "dismissed")) {
        cli_error("%s was cancelled", subject);
        return CLI_LIMIT;
    }
    cli_error("%s is in a state this program does not know: %s", subject, state);
    return CLI_INTERNAL;
}

int cli_watch(cli_http *http, const char *id, bool quiet) {
    double wait = 0.05;
    char note[204] = "";
    int exit_code = CLI_INTERNAL;
    cli_progress progress;
    cli_progress_open(&progress, quiet);
    json_t *job = ask(http, id, 0, &exit_code);
    while (job && !ended(job)) {
        show_note(&progress, job, note, sizeof note);
        show(&progress, job);
        json_decref(job);
        pause_seconds(wait);
        if (wait < 0.5) wait *= 1.5;
        job = ask(http, id, patience_seconds, &exit_code);
    }
    cli_progress_clear(&progress);
    if (!job) return exit_code;
    exit_code = exit_of_job(id, job);
    json_decref(job);
    return exit_code;
}

static int run(const cli_command *self, int argc, char **argv) {
    settings s = {0};
    cli_operands operands;
    if (!cli_parse(self, argc, argv, &s, &operands, 1, 1) || !cli_check_id(self, operands.operand[0]))
        return CLI_USAGE;
    cli_http *http = cli_http_open(&s.remote);
    int code = cli_watch(http, operands.operand[0], s.quiet);
    if (code == CLI_DONE) printf("%s successful\n", operands.operand[0]);
    cli_http_close(http);
    return code;
}

const cli_command cli_command_watch = {
    .name = "watch",
    .synopsis = "ID [options]",
    .summary = "follow a job until it has ended",
    .about = "Shows the stage and the progress of job ID, and the best that a search has found so far,\n"
             "until it is successful, failed or dismissed.\n"
             "The exit code is the one that 'blockwright run' would have ended with, so scripts can\n"
             "rely on it. A daemon that is restarted meanwhile is waited for: its jobs go on where\n"
             "they were.",
    .examples = "  blockwright watch 65f0c1...e2\n"
                "  blockwright watch 65f0c1...e2 --quiet && blockwright fetch 65f0c1...e2 --out result",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
