/* blockwright cancel: asks a job to stop. */
#include "remote.h"

static const cli_option options[] = {CLI_REMOTE_OPTIONS(cli_job_settings)};

static int cancel(cli_http *http, const char *id) {
    return cli_ask_of_job(http, id, "cancel", "cancelling");
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
