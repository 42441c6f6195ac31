/* blockwright retry: puts a job that failed or was cancelled back into the queue. */
#include "remote.h"

static const cli_option options[] = {CLI_REMOTE_OPTIONS(cli_job_settings)};

static int retry(cli_http *http, const char *id) {
    return cli_ask_of_job(http, id, "retry", NULL);
}

static int run(const cli_command *self, int argc, char **argv) {
    return cli_run_on_job(self, argc, argv, retry);
}

const cli_command cli_command_retry = {
    .name = "retry",
    .synopsis = "ID [options]",
    .summary = "try a failed or cancelled job again",
    .about = "The job keeps its id and goes on after the last stage that was done; its attempts go on\n"
             "counting. A job that was successful, or has not ended yet, is left as it is and the exit\n"
             "code is 3.",
    .examples = "  blockwright retry 65f0c1...e2 && blockwright watch 65f0c1...e2",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
