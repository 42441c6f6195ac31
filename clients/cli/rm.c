/* blockwright rm: removes a job that has ended. */
#include <stdio.h>

#include "remote.h"

static const cli_option options[] = {CLI_REMOTE_OPTIONS(cli_job_settings)};

static int delete(cli_http *http, const char *id) {
    char path[128];
    cli_reply reply;
    snprintf(path, sizeof path, "/v1/jobs/%s", id);
    if (!cli_http_call(http, "DELETE", path, NULL, &reply)) return cli_http_failed(http);
    int code = reply.status / 100 == 2 ? CLI_DONE : cli_http_refused(http, &reply);
    cli_reply_clear(&reply);
    if (code == CLI_DONE) printf("%s removed\n", id);
    return code;
}

static int run(const cli_command *self, int argc, char **argv) {
    return cli_run_on_job(self, argc, argv, delete);
}

const cli_command cli_command_rm = {
    .name = "rm",
    .synopsis = "ID [options]",
    .summary = "remove a job that has ended",
    .about = "Its state, its attempts, its log and its results are no longer to be had. A job that has\n"
             "not ended is left as it is and the exit code is 3: 'cancel' it first.",
    .examples = "  blockwright rm 65f0c1...e2",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
