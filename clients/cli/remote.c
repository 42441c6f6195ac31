#include "remote.h"

#include <stdio.h>

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

int cli_run_on_daemon(const cli_command *self, int argc, char **argv, void *settings, int (*act)(cli_http *http, const void *settings)) {
    cli_operands operands;
    if (!cli_parse(self, argc, argv, settings, &operands, 0, 0)) return CLI_USAGE;
    cli_http *http = cli_http_open(settings);
    int code = act(http, settings);
    cli_http_close(http);
    return code;
}

int cli_ask_of_job(cli_http *http, const char *id, const char *verb, const char *pending) {
    char path[128];
    int code = CLI_DONE;
    snprintf(path, sizeof path, "/v1/jobs/%s/%s", id, verb);
    json_t *job = cli_http_json(http, "POST", path, NULL, &code);
    if (!job) return code;
    bool noted = pending && json_is_true(json_object_get(job, pending));
    printf("%s ", id);
    cli_print_safe(stdout, noted ? pending : cli_text_of(job, "state"));
    putchar('\n');
    json_decref(job);
    return code;
}
