/* blockwright log: what the workers of a job had to say. */
#include <stdio.h>

#include "remote.h"

static const cli_option options[] = {CLI_REMOTE_OPTIONS(cli_job_settings)};

static int show(cli_http *http, const char *id) {
    cli_reply reply;
    char path[128];
    int code = CLI_DONE;
    snprintf(path, sizeof path, "/v1/jobs/%s/log", id);
    if (!cli_http_call(http, "GET", path, NULL, &reply)) return cli_http_failed(http);
    if (reply.status == 200)
        cli_print_lines(stdout, reply.body, reply.size);
    else
        code = cli_http_refused(http, &reply);
    cli_reply_clear(&reply);
    return code;
}

static int run(const cli_command *self, int argc, char **argv) {
    return cli_run_on_job(self, argc, argv, show);
}

const cli_command cli_command_log = {
    .name = "log",
    .synopsis = "ID [options]",
    .summary = "show what the workers of a job logged",
    .about = "Prints the log of job ID as far as it has been written, one line per message.",
    .examples = "  blockwright log 65f0c1...e2",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
