#include "remote.h"

bool cli_check_id(const cli_command *self, const char *id) {
    if (cli_job_id_valid(id)) return true;
    cli_usage_error(self, "'%s' is not a job id", id);
    return false;
}

const char *cli_text_of(const json_t *object, const char *key) {
    const char *text = json_string_value(json_object_get(object, key));
    return text ? text : "";
}

int cli_run_on_job(const cli_command *self, int argc, char **argv, int (*act)(cli_http *http, const char *id)) {
    cli_job_settings s = {0};
    cli_operands operands;
    if (!cli_parse(self, argc, argv, &s, &operands, 1, 1) || !cli_check_id(self, operands.operand[0]))
        return CLI_USAGE;
    cli_http *http = cli_http_open(&s.remote);
    int code = act(http, operands.operand[0]);
    cli_http_close(http);
    return code;
}
