/* blockwright cancel: asks a job to stop. */
#include <stdio.h>

#include "remote.h"

static const cli_option options[] = {CLI_REMOTE_OPTIONS(cli_job_settings)};

static int cancel(cli_http *http, const char *id) {
    char path[128];
    int code = CLI_DONE;
    snprintf(path, sizeof path, "/v1/jobs/%s/cancel", id);
    json_t *job = cli_http_json(http, "POST", path, NULL, &code);
    if (!job) return code;
    bool stopping = json_is_true(json_object_get(job, "cancelling"));
    printf("%s ", id);
    cli_print_safe(stdout, stopping ? "cancelling" : cli_text_of(job, "state"));
    putchar('\n');
    json_decref(job);
    return code;
}

static int run(const cli_command *self, int argc, char **argv) {
    return cli_run_on_job(self, argc, argv, cancel);
}

const cli_command cli_command_cancel = {
    .name = "cancel",
    .synopsis = "ID [options]",
    .summary = "ask a job to stop",
    .about = "A queued job is dismissed at once, a running one as soon as its worker has stopped.\n"
             "Cancelling twice does no harm; a job that has already ended by itself is left as it is\n"
             "and the exit code is 3. Nothing of the job is kept; to keep the best that its search has\n"
             "found, 'finish' it.",
    .examples = "  blockwright cancel 65f0c1...e2",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
