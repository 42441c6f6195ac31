/* blockwright log: what the workers of a job had to say. */
#include <stdio.h>
#include <string.h>

#include "remote.h"
#include "stream.h"

static const double patience_seconds = 30; /* how long a daemon that did answer before is waited for */

typedef struct {
    cli_remote remote;
    bool follow;
    int64_t tail; /* 0: all */
} settings;

static const cli_option options[] = {
    CLI_REMOTE_OPTIONS(settings),
    {"follow", 'f', CLI_FLAG, offsetof(settings, follow), NULL, "go on until the job has ended", 0, 0},
    {"tail", 'n', CLI_INTEGER, offsetof(settings, tail), "N", "only the last N lines of what there is (and, with --follow, what comes)", 1, 10000},
};

static int show(cli_http *http, const char *path) {
    cli_reply reply;
    int code = CLI_DONE;
    if (!cli_http_call(http, "GET", path, NULL, &reply)) return cli_http_failed(http);
    if (reply.status == 200)
        cli_print_lines(stdout, reply.body, reply.size);
    else
        code = cli_http_refused(http, &reply);
    cli_reply_clear(&reply);
    return code;
}

static void on_event(void *user, const char *event, const char *data, size_t size) {
    if (!strcmp(event, "end")) *(bool *)user = true;
    if (strcmp(event, "log") != 0) return;
    cli_print_lines(stdout, data, size);
    putchar('\n');
    fflush(stdout);
}

/* A daemon that is restarted meanwhile is waited for, and tells what comes after the last line seen. */
static int follow(cli_http *http, const char *path) {
    bool ended = false;
    double heard = 0; /* when the daemon was last there; 0: never */
    cli_events events = {.fn = on_event, .user = &ended};
    int code = CLI_DONE;
    for (bool go_on = true; go_on;) {
        cli_reply reply;
        bool answered = cli_follow(http, path, &events, &reply), away = !answered || cli_reply_passes(&reply);
        if (reply.status == 200) heard = cli_now();
        go_on = !ended && (away || reply.status == 200);
        if (go_on && cli_now() - heard > patience_seconds) {
            code = answered ? cli_http_refused(http, &reply) : cli_http_failed(http);
            go_on = false;
        } else if (!away && reply.status != 200 && reply.status != 204) {
            code = cli_http_refused(http, &reply);
        }
        cli_reply_clear(&reply);
        if (go_on) cli_pause(0.5);
    }
    cli_events_clear(&events);
    return code;
}

static int run(const cli_command *self, int argc, char **argv) {
    settings s = {0};
    cli_operands operands;
    char path[200];
    if (!cli_parse(self, argc, argv, &s, &operands, 1, 1) || !cli_check_id(self, operands.operand[0])) return CLI_USAGE;
    int n = snprintf(path, sizeof path, "/v1/jobs/%s/log%s", operands.operand[0], s.follow ? "?follow=true" : "");
    if (s.tail) snprintf(path + n, sizeof path - (size_t)n, "%ctail=%lld", s.follow ? '&' : '?', (long long)s.tail);
    cli_http *http = cli_http_open(&s.remote);
    int code = s.follow ? follow(http, path) : show(http, path);
    cli_http_close(http);
    return code;
}

const cli_command cli_command_log = {
    .name = "log",
    .synopsis = "ID [options]",
    .summary = "show what the workers of a job logged",
    .about = "Prints the log of job ID as far as it has been written, one line per message; with --follow\n"
             "also what is still to come. A daemon that is restarted meanwhile is waited for, and no\n"
             "line is lost or repeated.",
    .examples = "  blockwright log 65f0c1...e2\n"
                "  blockwright log 65f0c1...e2 --follow --tail 20",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
