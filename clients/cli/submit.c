/* blockwright submit: uploads a part, of one file or two, unless the daemon has it already, and creates a
 * job for it. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>

#include "joboptions.h"
#include "persist.h"
#include "remote.h"
#include "upload.h"

typedef struct {
    cli_remote remote;
    const char *name, *out, *tags, *key;
    int64_t priority;
    uint64_t limit_memory, limit_scratch;  /* 0: the daemon's */
    int64_t limit_cpu, limit_wall, limit_job_cpu, limit_job_wall; /* likewise */
    cli_job_options job;
    bool wait, quiet, pin;
} settings;

static const cli_option options[] = {
    CLI_REMOTE_OPTIONS(settings),
    CLI_JOB_OPTIONS(settings),
    {"name", 0, CLI_TEXT, offsetof(settings, name), "TEXT", "what to call the job (default: the file's name)",
     0, 0},
    {"priority", 0, CLI_INTEGER, offsetof(settings, priority), "N",
     "among your jobs those with a larger N start first, -100 to 100 (default 0)", -100, 100},
    {"tag", 0, CLI_TEXT, offsetof(settings, tags), "TAG,TAG,...", "words to find the job by: 'ls --tag'", 0, 0},
    {"idempotency-key", 0, CLI_TEXT, offsetof(settings, key), "KEY",
     "the same command sent again with the same KEY creates no second job", 0, 0},
    {"pin", 0, CLI_FLAG, offsetof(settings, pin), NULL, "keep the job, whatever its age, until it is unpinned or removed", 0, 0},
    {"limit-memory", 0, CLI_BYTES, offsetof(settings, limit_memory), "BYTES",
     "most memory each stage may take, e.g. 500M or 4G (default, and at most, the daemon's limit)", 0, 0},
    {"limit-scratch", 0, CLI_BYTES, offsetof(settings, limit_scratch), "BYTES", "most bytes of all files that a stage writes", 0, 0},
    {"limit-cpu", 0, CLI_INTEGER, offsetof(settings, limit_cpu), "SECONDS", "most processor time of a stage", 1, 1e9},
    {"limit-wall", 0, CLI_INTEGER, offsetof(settings, limit_wall), "SECONDS", "most time of a stage by the clock", 1, 1e9},
    {"limit-job-cpu", 0, CLI_INTEGER, offsetof(settings, limit_job_cpu), "SECONDS", "most processor time of all stages together", 1, 1e9},
    {"limit-job-wall", 0, CLI_INTEGER, offsetof(settings, limit_job_wall), "SECONDS", "most time that all stages run by the clock", 1, 1e9},
    {"wait", 'w', CLI_FLAG, offsetof(settings, wait), NULL, "watch the job; its end decides the exit code", 0,
     0},
    {"out", 'o', CLI_TEXT, offsetof(settings, out), "DIR", "wait, then fetch the results into DIR", 0, 0},
    {"quiet", 'q', CLI_FLAG, offsetof(settings, quiet), NULL, "print the job's id and errors, nothing else",
     0, 0},
};

/* The names under which the daemon has the part's files; `parameters` "": none. */
typedef struct {
    char input[CLI_HASH_TEXT], parameters[CLI_HASH_TEXT];
} blobs;

/* The words between the commas. */
static json_t *tag_list(const char *tags) {
    json_t *list = json_array();
    while (*tags) {
        size_t n = strcspn(tags, ",");
        if (n) json_array_append_new(list, json_stringn(tags, n));
        tags += n + (tags[n] == ',');
    }
    return list;
}

/* The limits that were given; NULL if none was. */
static json_t *limits(const settings *s) {
    json_t *object = json_object();
    if (s->limit_memory) json_object_set_new(object, "memory", json_integer((json_int_t)s->limit_memory));
    if (s->limit_scratch) json_object_set_new(object, "scratch", json_integer((json_int_t)s->limit_scratch));
    if (s->limit_cpu) json_object_set_new(object, "cpu_seconds", json_integer(s->limit_cpu));
    if (s->limit_wall) json_object_set_new(object, "wall_seconds", json_integer(s->limit_wall));
    if (s->limit_job_cpu) json_object_set_new(object, "job_cpu_seconds", json_integer(s->limit_job_cpu));
    if (s->limit_job_wall) json_object_set_new(object, "job_wall_seconds", json_integer(s->limit_job_wall));
    if (json_object_size(object)) return object;
    json_decref(object);
    return NULL;
}

static char *job_request(const settings *s, json_t *job_options, const char *file, const blobs *names) {
    const char *slash = strrchr(file, '/');
    const char *name = s->name ? s->name : slash ? slash + 1 : file;
    json_t *request = json_pack("{s:s, s:o}", "input", names->input, "options", json_incref(job_options));
    json_t *text = json_string(name); /* NULL if it is not UTF-8: then the job goes without a name */
    if (text) json_object_set_new(request, "name", text);
    if (*names->parameters) json_object_set_new(request, "parameters", json_string(names->parameters));
    if (s->priority) json_object_set_new(request, "priority", json_integer(s->priority));
    json_t *given = limits(s);
    if (given) json_object_set_new(request, "limits", given);
    if (s->pin) json_object_set_new(request, "pinned", json_true());
    if (s->tags) json_object_set_new(request, "tags", tag_list(s->tags));
    char *body = json_dumps(request, JSON_COMPACT | JSON_SORT_KEYS);
    json_decref(request);
    return body;
}

/* The request for a job, with a key, so that it may be sent twice: there will be one job. */
typedef struct {
    cli_http *http;
    char *body;
    char key[202];
} order;

static bool send_order(void *user, cli_reply *reply) {
    order *o = user;
    cli_http_header(o->http, "Idempotency-Key", o->key);
    return cli_http_call(o->http, "POST", "/v1/jobs", o->body, reply);
}

static bool make_key(const char *given, char *key, size_t size) {
    unsigned char random[16];
    if (given) return snprintf(key, size, "%s", given) < (int)size;
    if (getrandom(random, sizeof random, 0) != (ssize_t)sizeof random) return false;
    for (size_t i = 0; i < sizeof random; i++) snprintf(key + 2 * i, size - 2 * i, "%02x", random[i]);
    return true;
}

static json_t *place(cli_http *http, const char *key, char *body, int *code) {
    order o = {.http = http, .body = body};
    cli_persistence p;
    cli_reply reply;
    cli_persist_begin(&p, http, "job", NULL);
    *code = CLI_INTERNAL;
    if (!make_key(key, o.key, sizeof o.key)) cli_error("no random key for the job");
    else if (cli_persist(&p, send_order, &o, &reply, code)) return cli_http_parsed(http, &reply, code);
    return NULL;
}

static int submit(cli_http *http, const settings *s, json_t *job_options, const char *file) {
    blobs names = {0};
    int code = cli_upload(http, file, s->quiet, names.input);
    if (code == CLI_DONE && s->job.parameters)
        code = cli_upload(http, s->job.parameters, s->quiet, names.parameters);
    if (code != CLI_DONE) return code;
    char *body = job_request(s, job_options, file, &names);
    if (!body) {
        cli_error("out of memory");
        return CLI_INTERNAL;
    }
    json_t *job = place(http, s->key, body, &code);
    free(body);
    if (!job) return code;
    const char *id = json_string_value(json_object_get(job, "id"));
    if (!id || !cli_job_id_valid(id)) {
        cli_error("%s answered without a job id", cli_http_server(http));
        json_decref(job);
        return CLI_INTERNAL;
    }
    printf("%s\n", id);
    fflush(stdout);
    if (!s->quiet) fprintf(stderr, "job %s is at %s/v1/jobs/%s\n", id, cli_http_server(http), id);
    if (s->wait || s->out) code = cli_watch(http, id, s->quiet);
    if (code == CLI_DONE && s->out) code = cli_fetch(http, id, s->out, s->quiet);
    json_decref(job);
    return code;
}

/* 1 to 200 visible ASCII characters. */
static bool is_key(const char *text) {
    size_t n = 0;
    while (text[n] > 0x20 && text[n] < 0x7f) n++;
    return n > 0 && n <= 200 && !text[n];
}

static int run(const cli_command *self, int argc, char **argv) {
    settings s = {0};
    cli_operands operands;
    if (!cli_parse(self, argc, argv, &s, &operands, 1, 1)) return CLI_USAGE;
    if (s.name && strlen(s.name) > 200) return cli_usage_error(self, "--name is longer than 200 bytes");
    if (s.key && !is_key(s.key))
        return cli_usage_error(self, "--idempotency-key has 1 to 200 visible ASCII characters");
    const char *problem = "out of memory";
    json_t *job_options = cli_job_options_json(&s.job, &problem);
    if (!job_options) return cli_usage_error(self, "%s", problem);
    cli_http *http = cli_http_open(&s.remote);
    int code = submit(http, &s, job_options, operands.operand[0]);
    cli_http_close(http);
    json_decref(job_options);
    return code;
}

const cli_command cli_command_submit = {
    .name = "submit",
    .synopsis = "FILE [options]",
    .summary = "give a part to a daemon as a job",
    .about = "Uploads FILE, unless the daemon has it already, and creates a job for it. Both are tried\n"
             "again after a connection broke or the daemon was busy: there is one job in the end, and\n"
             "an upload of 64 MiB or more goes on where it was. A Medit mesh of tets has\n"
             "its parameters in a second file, which --parameters names. The job's id\n"
             "is printed on standard output as soon as the daemon has stored the job for good. With\n"
             "--wait the command stays until the job has ended and its exit code tells how; with --out\n"
             "it also fetches the results.",
    .examples = "  blockwright submit part.hexex\n"
                "  blockwright submit part.mesh --parameters part.parameters\n"
                "  blockwright submit part.hexex --complex bc --out result\n"
                "  blockwright submit part.hexex --priority 10 --tag nightly,wing --idempotency-key run-17\n"
                "  blockwright submit part.hexex --limit-memory 2G --limit-wall 600 --pin\n"
                "  blockwright submit part.hexex --quantize positive --target-hexes 5000 --out result\n"
                "  id=$(blockwright submit part.hexex --quiet) && blockwright watch \"$id\"",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
