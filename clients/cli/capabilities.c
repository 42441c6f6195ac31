/* blockwright capabilities: what a daemon can do, and how much of it one may ask for. */
#include <stdio.h>
#include <string.h>

#include "remote.h"

typedef struct {
    cli_remote remote;
    bool json;
} settings;

static const cli_option options[] = {
    CLI_REMOTE_OPTIONS(settings),
    {"json", 0, CLI_FLAG, offsetof(settings, json), NULL, "the daemon's answer as it is, for programs", 0, 0},
};

enum { WORD = 48 };

/* A value of an option; of a list, its items. */
static void print_value(const json_t *value) {
    if (json_is_string(value)) cli_print_safe(stdout, json_string_value(value));
    else if (json_is_integer(value)) printf("%" JSON_INTEGER_FORMAT, json_integer_value(value));
    else if (json_is_real(value)) printf("%g", json_real_value(value));
    else if (json_is_boolean(value)) fputs(json_is_true(value) ? "yes" : "no", stdout);
    else if (!json_array_size(value)) putchar('-');
    for (size_t i = 0; i < json_array_size(value); i++) {
        if (i) putchar(' ');
        print_value(json_array_get(value, i));
    }
}

/* ---- stages and their options ---- */

static void print_bound(const json_t *schema, const char *key, const char *word) {
    const json_t *bound = json_object_get(schema, key);
    if (bound) printf(" %s ", word), print_value(bound);
}

/* What an option takes: its words, or its range. */
static void print_range(const json_t *schema) {
    const char *type = cli_text_of(schema, "type");
    const json_t *words = json_object_get(schema, "enum");
    if (words) print_value(words);
    else if (!strcmp(type, "array")) fputs("several of: ", stdout), print_range(json_object_get(schema, "items"));
    else fputs(!strcmp(type, "boolean") ? "no yes" : !strcmp(type, "integer") ? "whole number" : !strcmp(type, "number") ? "number" : "text", stdout);
    print_bound(schema, "minimum", "from");
    print_bound(schema, "exclusiveMinimum", "above");
    print_bound(schema, "maximum", "to");
    print_bound(schema, "exclusiveMaximum", "below");
}

static void print_option(const char *name, const json_t *schema) {
    char word[WORD];
    printf("  %-16s ", cli_safe(word, sizeof word, name));
    print_range(schema);
    fputs("; default ", stdout);
    print_value(json_object_get(schema, "default"));
    putchar('\n');
}

static bool of_a_stage(const json_t *stages, const char *name) {
    size_t i, k;
    json_t *stage, *option;
    json_array_foreach(stages, i, stage) {
        json_array_foreach(json_object_get(stage, "options"), k, option) {
            if (json_is_string(option) && !strcmp(json_string_value(option), name)) return true;
        }
    }
    return false;
}

static void print_stages(const json_t *all) {
    json_t *schemas = json_object_get(all, "options"), *stages = json_object_get(all, "stages"), *stage, *option, *schema;
    char word[WORD];
    const char *name;
    size_t i, k;
    puts("Options of a job, by the stage that they are for:");
    json_object_foreach(schemas, name, schema) {
        if (!of_a_stage(stages, name)) print_option(name, schema);
    }
    json_array_foreach(stages, i, stage) {
        printf("\n%s, version %" JSON_INTEGER_FORMAT "\n", cli_safe(word, sizeof word, cli_text_of(stage, "name")),
               json_integer_value(json_object_get(stage, "version")));
        json_array_foreach(json_object_get(stage, "options"), k, option) {
            name = json_string_value(option);
            if (name) print_option(name, json_object_get(schemas, name));
        }
    }
}

/* ---- formats ---- */

static void print_formats(const json_t *formats) {
    char name[WORD], title[WORD];
    json_t *format;
    size_t i;
    puts("\nInput formats, told by content:");
    json_array_foreach(json_object_get(formats, "input"), i, format) {
        printf("  %-16s %-22s ", cli_safe(name, sizeof name, cli_text_of(format, "name")), cli_safe(title, sizeof title, cli_text_of(format, "title")));
        print_value(json_object_get(format, "kinds"));
        fputs("  ", stdout);
        print_value(json_object_get(format, "suffixes"));
        puts(json_is_true(json_object_get(format, "parameters")) ? "  parameters of tets in a file of their own" : "");
    }
    fputs("\nFormats of hex meshes:\n  ", stdout);
    print_value(json_object_get(formats, "output"));
    putchar('\n');
}

/* ---- limits ---- */

typedef enum { COUNT, BYTES, SECONDS } unit;

typedef struct {
    const char *key, *text;
    unit unit;
} line;

static const line request_lines[] = {
    {"upload_bytes", "one upload", BYTES},
    {"uploads", "resumable uploads at the same time", COUNT},
    {"owner_bytes", "inputs of an owner together", BYTES},
    {"owner_jobs", "jobs of an owner that wait or run", COUNT},
    {"owner_running", "stages of an owner at the same time", COUNT},
    {"owner_uploads", "resumable uploads of an owner", COUNT},
    {"owner_streams", "event streams of an owner", COUNT},
    {"owner_rate", "requests of an owner a second", COUNT},
    {"workers", "stages at the same time", COUNT},
};
static const line stage_lines[] = {
    {"memory", "memory of all stages that run", BYTES},
    {"stage_memory", "memory of a stage", BYTES},
    {"stage_output", "one file of a stage", BYTES},
    {"stage_scratch", "all files of a stage", BYTES},
    {"stage_cpu_seconds", "processor time of a stage", SECONDS},
    {"stage_wall_seconds", "time of a stage", SECONDS},
    {"job_cpu_seconds", "processor time of all stages of a job", SECONDS},
    {"job_wall_seconds", "time of all stages of a job", SECONDS},
};

static void print_limits(const json_t *from, const line *lines, size_t count) {
    for (size_t i = 0; i < count; i++) {
        const json_t *value = json_object_get(from, lines[i].key);
        char number[24];
        if (!value) continue; /* a daemon of before has not got it */
        printf("  %-38s ", lines[i].text);
        if (!json_is_number(value)) puts("unlimited");
        else if (lines[i].unit == COUNT) printf("%.0f\n", json_number_value(value));
        else if (lines[i].unit == SECONDS) printf("%.0f s\n", json_number_value(value));
        else puts(cli_bytes(number, (uint64_t)json_number_value(value)));
    }
}

static void print_sandbox(const json_t *worker) {
    static const char *const names[][2] = {
        {"address_space", "address space"}, {"no_new_privileges", "no new privileges"}, {"seccomp", "seccomp"}, {"landlock", "Landlock"}};
    const char *missing = cli_text_of(worker, "missing"), *comma = "";
    printf("\nWorkers are confined by:\n  ");
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        const json_t *value = json_object_get(worker, names[i][0]);
        if (!json_is_true(value) && json_integer_value(value) <= 0) continue;
        printf("%s%s", comma, names[i][1]);
        comma = ", ";
    }
    puts(*comma ? "" : "nothing");
    if (json_is_true(json_object_get(worker, "sandbox_required"))) puts("  none is started without all of it");
    if (*missing) fputs("  missing: ", stdout), cli_print_safe(stdout, missing), putchar('\n');
}

/* ---- */

static void print_all(const char *server, const json_t *all) {
    char version[WORD];
    printf("blockwrightd %s at %s\n\n", cli_safe(version, sizeof version, cli_text_of(all, "version")), server);
    print_stages(all);
    print_formats(json_object_get(all, "formats"));
    puts("\nLimits of what is asked; an owner may have others of its own:");
    print_limits(json_object_get(all, "limits"), request_lines, sizeof request_lines / sizeof *request_lines);
    puts("\nLimits of stages:");
    print_limits(json_object_get(all, "worker"), stage_lines, sizeof stage_lines / sizeof *stage_lines);
    print_sandbox(json_object_get(all, "worker"));
}

static int show(cli_http *http, const void *of) {
    const settings *s = of;
    cli_reply reply;
    int code = CLI_DONE;
    if (!cli_http_call(http, "GET", "/v1/capabilities", NULL, &reply)) return cli_http_failed(http);
    json_t *all = reply.status == 200 && reply.body ? json_loads(reply.body, 0, NULL) : NULL;
    if (!json_is_object(all)) {
        code = cli_http_refused(http, &reply);
    } else if (s->json) {
        cli_print_lines(stdout, reply.body, reply.size);
        if (reply.body[reply.size - 1] != '\n') putchar('\n');
    } else {
        print_all(cli_http_server(http), all);
    }
    json_decref(all);
    cli_reply_clear(&reply);
    return code;
}

static int run(const cli_command *self, int argc, char **argv) {
    return cli_run_on_daemon(self, argc, argv, &(settings){0}, show);
}

const cli_command cli_command_capabilities = {
    .name = "capabilities",
    .synopsis = "[options]",
    .summary = "show what a daemon can do",
    .about = "Prints the stages of a job with their versions, the options of each with what they take and\n"
             "their defaults, the formats in and out, the limits that are set at the moment, and what\n"
             "confines workers. No access token is needed. With --json it is the daemon's answer, as\n"
             "api/openapi.yaml describes it.",
    .examples = "  blockwright capabilities\n"
                "  blockwright capabilities --server https://mesh.example.org:8443\n"
                "  blockwright capabilities --json | jq .options.quantize",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
