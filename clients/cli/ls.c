/* blockwright ls: the jobs of a daemon. */
#include <curl/curl.h>
#include <stdio.h>
#include <string.h>

#include "remote.h"

enum { PAGE_MAX = 200 }; /* the most a daemon gives at once */

typedef struct {
    cli_remote remote;
    const char *state, *tag;
    int64_t limit;
} settings;

static const cli_option options[] = {
    CLI_REMOTE_OPTIONS(settings),
    {"state", 0, CLI_CHOICE, offsetof(settings, state), "queued|running|successful|failed|dismissed",
     "only jobs in this state", 0, 0},
    {"tag", 0, CLI_TEXT, offsetof(settings, tag), "TAG", "only jobs with this tag", 0, 0},
    {"limit", 'n', CLI_INTEGER, offsetof(settings, limit), "N", "the newest N jobs (default 50)", 1, 1e9},
};

static void print_job(const json_t *job) {
    const char *complex = cli_text_of(json_object_get(job, "options"), "complex");
    char id[65], state[32], stage[32], kind[16], created[20];
    printf("%-24s  %-10s  %3.0f %%  %-13s  %-3s  %-19s  ", cli_safe(id, sizeof id, cli_text_of(job, "id")),
           cli_safe(state, sizeof state, cli_text_of(job, "state")),
           100 * json_number_value(json_object_get(job, "progress")),
           cli_safe(stage, sizeof stage, cli_text_of(job, "stage")),
           cli_safe(kind, sizeof kind, *complex ? complex : "mc"),
           cli_safe(created, sizeof created, cli_text_of(job, "created")));
    cli_print_safe(stdout, cli_text_of(job, "name"));
    putchar('\n');
}

/* Adds &name=value to a path; false if it does not fit. */
static bool add_query(char *path, size_t size, const char *name, const char *value) {
    char *escaped = curl_easy_escape(NULL, value, 0);
    size_t n = strlen(path);
    if (!escaped) return false;
    n += (size_t)snprintf(path + n, size - n, "&%s=%s", name, escaped);
    curl_free(escaped);
    return n < size;
}

static bool page_path(char *path, size_t size, const settings *s, int64_t left, const char *cursor) {
    snprintf(path, size, "/v1/jobs?limit=%d", (int)(left < PAGE_MAX ? left : PAGE_MAX));
    return (!s->state || add_query(path, size, "state", s->state)) && (!s->tag || add_query(path, size, "tag", s->tag)) &&
           (!*cursor || add_query(path, size, "cursor", cursor));
}

static int list(cli_http *http, const void *of) {
    const settings *s = of;
    char path[1024], cursor[256] = "";
    int64_t left = s->limit;
    int code = CLI_DONE;
    do {
        if (!page_path(path, sizeof path, s, left, cursor)) return CLI_INTERNAL;
        json_t *page = cli_http_json(http, "GET", path, NULL, &code);
        if (!page) return code;
        size_t index;
        json_t *job;
        json_array_foreach(json_object_get(page, "jobs"), index, job) print_job(job);
        left -= (int64_t)json_array_size(json_object_get(page, "jobs"));
        snprintf(cursor, sizeof cursor, "%s", cli_text_of(page, "next"));
        json_decref(page);
    } while (left > 0 && *cursor);
    return CLI_DONE;
}

static int run(const cli_command *self, int argc, char **argv) {
    return cli_run_on_daemon(self, argc, argv, &(settings){.limit = 50}, list);
}

const cli_command cli_command_ls = {
    .name = "ls",
    .synopsis = "[options]",
    .summary = "list the jobs of a daemon",
    .about = "One line per job, the newest first: id, state, progress, stage, complex, time of\n"
             "creation, name.",
    .examples = "  blockwright ls\n"
                "  blockwright ls --state failed -n 10\n"
                "  blockwright ls --tag nightly",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
