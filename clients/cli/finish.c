/* blockwright finish: asks a job to settle for the best its search has found so far. */
#include <stdio.h>

#include "remote.h"

static const cli_option options[] = {CLI_REMOTE_OPTIONS(cli_job_settings)};

static int finish(cli_http *http, const char *id) {
    char path[128];
    int code = CLI_DONE;
    snprintf(path, sizeof path, "/v1/jobs/%s/finish", id);
    json_t *job = cli_http_json(http, "POST", path, NULL, &code);
    if (!job) return code;
    bool noted = json_is_true(json_object_get(job, "finishing"));
    printf("%s ", id);
    cli_print_safe(stdout, noted ? "finishing" : cli_text_of(job, "state"));
    putchar('\n');
    json_decref(job);
    return code;
}

static int run(const cli_command *self, int argc, char **argv) {
    return cli_run_on_job(self, argc, argv, finish);
}

const cli_command cli_command_finish = {
    .name = "finish",
    .synopsis = "ID [options]",
    .summary = "ask a job to settle for the best found",
    .about = "A search (--explore) that runs ends with the best it has found so far, one that is still to\n"
             "come ends at its first chance; the job goes on with that to its end and has results like any\n"
             "other. 'watch' shows the best so far. Stages that do not search are not touched. Asking\n"
             "twice does no harm; a job that has already ended is left as it is and the exit code is 3.\n"
             "To have nothing of a job, 'cancel' it.",
    .examples = "  blockwright finish 65f0c1...e2 && blockwright watch 65f0c1...e2",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
