/* blockwright finish: asks a job to settle for the best its search has found so far. */
#include "remote.h"

static const cli_option options[] = {CLI_REMOTE_OPTIONS(cli_job_settings)};

static int finish(cli_http *http, const char *id) {
    return cli_ask_of_job(http, id, "finish", "finishing");
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
