/* blockwright watch: follows a job to its end. */
#include <stdio.h>
#include <string.h>

#include "failure.h"
#include "remote.h"
#include "stream.h"

static const double patience_seconds = 30; /* how long a daemon that did answer before is waited for */

typedef struct {
    cli_remote remote;
    bool quiet;
} settings;

static const cli_option options[] = {
    CLI_REMOTE_OPTIONS(settings),
    {"quiet", 'q', CLI_FLAG, offsetof(settings, quiet), NULL, "no progress, only how it ended", 0, 0},
};

/* The job as it is now; a daemon that does not answer is asked again for `patience` seconds. NULL: *exit_code
 * is set and the reason said. */
static json_t *ask(cli_http *http, const char *id, double patience, int *exit_code) {
    char path[128];
    cli_reply reply;
    double started = cli_now();
    snprintf(path, sizeof path, "/v1/jobs/%s", id);
    for (;;) {
        bool answered = cli_http_call(http, "GET", path, NULL, &reply), late = cli_now() - started > patience;
        if (answered && (late || !cli_reply_passes(&reply))) break;
        if (late) {
            *exit_code = cli_http_failed(http);
            return NULL;
        }
        cli_reply_clear(&reply);
        cli_pause(0.5);
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

typedef struct {
    cli_progress progress;
    char note[204];    /* as shown last */
    json_int_t attempt; /* what happened in earlier ones is of the past */
} view;

/* The best that a search has found so far is a line of its own, when it has changed. */
static void show_note(view *v, const json_t *from) {
    char now[204];
    cli_safe(now, sizeof now, cli_text_of(from, "note"));
    if (v->progress.quiet || !*now || !strcmp(now, v->note)) return;
    cli_progress_clear(&v->progress);
    fprintf(stderr, "  %s so far\n", now);
    memcpy(v->note, now, sizeof now);
}

static void show(view *v, const json_t *job) {
    const json_t *attempts = json_object_get(job, "attempts");
    bool running = !strcmp(cli_text_of(job, "state"), "running");
    v->attempt = json_integer_value(json_object_get(json_array_get(attempts, json_array_size(attempts) - 1), "attempt"));
    show_note(v, job);
    cli_progress_show(&v->progress, running ? cli_text_of(job, "stage") : "queued",
                      json_number_value(json_object_get(job, "progress")));
}

/* A change of the job's state or stage. */
static void show_change(view *v, const json_t *data) {
    double count = json_number_value(json_object_get(data, "stage_count"));
    bool running = !strcmp(cli_text_of(data, "state"), "running");
    if (json_integer_value(json_object_get(data, "attempt")) < v->attempt || count < 1) return;
    cli_progress_show(&v->progress, running ? cli_text_of(data, "stage") : "queued",
                      json_number_value(json_object_get(data, "stages_done")) / count);
}

static void on_event(void *user, const char *event, const char *text, size_t size) {
    view *v = user;
    json_t *data = json_loadb(text, size, 0, NULL);
    if (!strcmp(event, "progress"))
        cli_progress_show(&v->progress, cli_text_of(data, "stage"), json_number_value(json_object_get(data, "progress")));
    else if (!strcmp(event, "note")) show_note(v, data);
    else if (!strcmp(event, "stage") || (!strcmp(event, "state") && strcmp(cli_text_of(data, "change"), "successful") != 0)) show_change(v, data);
    json_decref(data);
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
    char path[128];
    int exit_code = CLI_INTERNAL;
    view v = {0};
    cli_events events = {.fn = on_event, .user = &v};
    snprintf(path, sizeof path, "/v1/jobs/%s/events", id);
    cli_progress_open(&v.progress, quiet);
    json_t *job = ask(http, id, 0, &exit_code);
    for (bool first = true; job && !ended(job); first = false) {
        cli_reply reply;
        show(&v, job);
        json_decref(job);
        if (!first) cli_pause(0.5);
        cli_follow(http, path, &events, &reply); /* why it ended, or that there is none, the job tells */
        cli_reply_clear(&reply);
        job = ask(http, id, patience_seconds, &exit_code);
    }
    cli_events_clear(&events);
    cli_progress_clear(&v.progress);
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
