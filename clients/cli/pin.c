/* blockwright pin, blockwright unpin: whether a job goes by its age. */
#include <stdio.h>

#include "remote.h"

static const cli_option options[] = {CLI_REMOTE_OPTIONS(cli_job_settings)};

static int set(cli_http *http, const char *method, const char *id) {
    char path[128];
    int code = CLI_DONE;
    snprintf(path, sizeof path, "/v1/jobs/%s/pin", id);
    json_t *job = cli_http_json(http, method, path, NULL, &code);
    if (!job) return code;
    printf("%s %s\n", id, json_is_true(json_object_get(job, "pinned")) ? "pinned" : "unpinned");
    json_decref(job);
    return code;
}

static int pin(cli_http *http, const char *id) {
    return set(http, "PUT", id);
}

static int unpin(cli_http *http, const char *id) {
    return set(http, "DELETE", id);
}

static int run_pin(const cli_command *self, int argc, char **argv) {
    return cli_run_on_job(self, argc, argv, pin);
}

static int run_unpin(const cli_command *self, int argc, char **argv) {
    return cli_run_on_job(self, argc, argv, unpin);
}

const cli_command cli_command_pin = {
    .name = "pin",
    .synopsis = "ID [options]",
    .summary = "keep a job, whatever its age",
    .about = "Jobs that have ended are removed, with their results, when they are as old as the daemon's\n"
             "operator has set; a pinned one stays until it is unpinned or removed ('rm'). It can be\n"
             "pinned in any state; 'submit --pin' does it from the start. Pinning twice does no harm.",
    .examples = "  blockwright pin 65f0c1...e2",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run_pin,
};

const cli_command cli_command_unpin = {
    .name = "unpin",
    .synopsis = "ID [options]",
    .summary = "let a pinned job go by age again",
    .about = "The job is removed when its time has come, which may be at once if it ended long ago.\n"
             "Unpinning a job that is not pinned does no harm.",
    .examples = "  blockwright unpin 65f0c1...e2",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run_unpin,
};
