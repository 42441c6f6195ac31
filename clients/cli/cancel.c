/* blockwright cancel: asks a job to stop. */
#include <stdio.h>

#include "remote.h"

typedef struct {
    const char *server;
} settings;

static const cli_option options[] = {CLI_SERVER_OPTION(settings)};

static int run(const cli_command *self, int argc, char **argv) {
    settings s = {0};
    cli_operands operands;
    char path[128];
    int code = CLI_DONE;
    if (!cli_parse(self, argc, argv, &s, &operands, 1, 1) || !cli_check_id(self, operands.operand[0]))
        return CLI_USAGE;
    cli_http *http = cli_http_open(s.server);
    snprintf(path, sizeof path, "/v1/jobs/%s/cancel", operands.operand[0]);
    json_t *job = cli_http_json(http, "POST", path, NULL, &code);
    const char *state = json_string_value(json_object_get(job, "state"));
    bool stopping = json_is_true(json_object_get(job, "cancelling"));
    if (job) printf("%s ", operands.operand[0]);
    if (job) cli_print_safe(stdout, stopping ? "cancelling" : state ? state : "?"), putchar('\n');
    json_decref(job);
    cli_http_close(http);
    return code;
}

const cli_command cli_command_cancel = {
    .name = "cancel",
    .synopsis = "ID [options]",
    .summary = "ask a job to stop",
    .about = "A queued job is dismissed at once, a running one as soon as its worker has stopped.\n"
             "Cancelling twice does no harm; a job that has already ended by itself is left as it is\n"
             "and the exit code is 3.",
    .examples = "  blockwright cancel 65f0c1...e2",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
