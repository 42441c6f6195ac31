/* blockwright log: what the workers of a job had to say. */
#include <stdio.h>

#include "remote.h"

typedef struct {
    const char *server;
} settings;

static const cli_option options[] = {CLI_SERVER_OPTION(settings)};

static int run(const cli_command *self, int argc, char **argv) {
    settings s = {0};
    cli_operands operands;
    cli_reply reply;
    char path[128];
    int code = CLI_DONE;
    if (!cli_parse(self, argc, argv, &s, &operands, 1, 1) || !cli_check_id(self, operands.operand[0]))
        return CLI_USAGE;
    cli_http *http = cli_http_open(s.server);
    snprintf(path, sizeof path, "/v1/jobs/%s/log", operands.operand[0]);
    if (!cli_http_call(http, "GET", path, NULL, &reply)) {
        code = cli_http_failed(http);
    } else {
        if (reply.status == 200)
            cli_print_lines(stdout, reply.body, reply.size);
        else
            code = cli_http_refused(http, &reply);
        cli_reply_clear(&reply);
    }
    cli_http_close(http);
    return code;
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
