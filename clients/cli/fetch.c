/* blockwright fetch: brings the results of a job home. */
#include <curl/curl.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "hash.h"
#include "remote.h"
#include "summary.h"

typedef struct {
    cli_remote remote;
    const char *out;
    bool quiet;
} settings;

static const cli_option options[] = {
    CLI_REMOTE_OPTIONS(settings),
    {"out", 'o', CLI_TEXT, offsetof(settings, out), "DIR",
     "folder for the results, made if missing (required)", 0, 0},
    {"quiet", 'q', CLI_FLAG, offsetof(settings, quiet), NULL, "no summary, only errors", 0, 0},
};

/* A result as the manifest describes it; texts are borrowed from the manifest. */
typedef struct {
    const char *name, *sha256;
    int64_t bytes;
} item;

/* A name that cannot leave the folder it is written to. */
static bool name_is_plain(const char *name) {
    return *name && *name != '.' && !strchr(name, '/') && strlen(name) < 200;
}

static bool read_item(const json_t *json, item *it) {
    it->name = json_string_value(json_object_get(json, "name"));
    it->sha256 = json_string_value(json_object_get(json, "sha256"));
    it->bytes = json_integer_value(json_object_get(json, "bytes"));
    return it->name && it->sha256 && name_is_plain(it->name) && it->bytes >= 0;
}

static int verify(FILE *file, const item *it) {
    char hex[CLI_HASH_TEXT];
    int64_t size;
    if (fflush(file) != 0 || !cli_hash_file(file, hex, &size)) {
        cli_error("%s cannot be read back: %s", it->name, strerror(errno));
        return CLI_INTERNAL;
    }
    if (size == it->bytes && !strcmp(hex, it->sha256)) return CLI_DONE;
    cli_error("%s arrived damaged: %lld bytes with SHA-256 %s, but %lld with %s were announced", it->name,
              (long long)size, hex, (long long)it->bytes, it->sha256);
    return CLI_INTERNAL;
}

static int download(cli_http *http, const char *id, const item *it, FILE *file) {
    char path[1024];
    cli_reply reply;
    char *escaped = curl_easy_escape(NULL, it->name, 0);
    if (!escaped) return CLI_INTERNAL;
    snprintf(path, sizeof path, "/v1/jobs/%s/results/%s", id, escaped);
    curl_free(escaped);
    int code = CLI_DONE;
    if (!cli_http_download(http, path, file, it->bytes, &reply)) {
        cli_error("%s could not be fetched: %s", it->name, cli_http_error(http));
        return CLI_INTERNAL;
    }
    if (reply.status != 200) code = cli_http_refused(http, &reply);
    cli_reply_clear(&reply);
    return code ? code : verify(file, it);
}

/* Downloads into a hidden file beside the target, then renames: DIR never shows half a result. */
static int fetch_item(cli_http *http, const char *id, const item *it, const char *out) {
    char part[4400], target[4400];
    snprintf(part, sizeof part, "%s/.%s.part", out, it->name);
    snprintf(target, sizeof target, "%s/%s", out, it->name);
    FILE *file = fopen(part, "w+b");
    if (!file) {
        cli_error("%s cannot be written: %s", part, strerror(errno));
        return CLI_INTERNAL;
    }
    int code = download(http, id, it, file);
    if (fclose(file) != 0 && code == CLI_DONE) {
        cli_error("%s cannot be written: %s", part, strerror(errno));
        code = CLI_INTERNAL;
    }
    if (code == CLI_DONE && rename(part, target) != 0) {
        cli_error("%s cannot be written: %s", target, strerror(errno));
        code = CLI_INTERNAL;
    }
    if (code != CLI_DONE) unlink(part);
    return code;
}

static int fetch_all(cli_http *http, const char *id, const json_t *manifest, const char *out) {
    size_t index;
    json_t *json;
    const json_t *list = json_object_get(manifest, "results");
    if (!json_is_array(list)) {
        cli_error("the list of results is not one this program understands");
        return CLI_INTERNAL;
    }
    if (json_array_size(list) == 0)
        cli_error("job %s has no results: it was asked to stop before encode", id);
    json_array_foreach(list, index, json) {
        item it;
        if (!read_item(json, &it)) {
            cli_error("the list of results has an entry this program does not accept");
            return CLI_INTERNAL;
        }
        int code = fetch_item(http, id, &it, out);
        if (code != CLI_DONE) return code;
    }
    return CLI_DONE;
}

static void print_summary(const char *out, const json_t *manifest, int64_t since) {
    size_t index;
    json_t *json;
    json_array_foreach(json_object_get(manifest, "results"), index, json) {
        const char *name = json_string_value(json_object_get(json, "name"));
        json_t *report = name && !strcmp(name, "report.json") ? cli_report_load(out) : NULL;
        if (report) cli_summary_print(report);
        json_decref(report);
    }
    cli_files_print(out, since);
}

int cli_fetch(cli_http *http, const char *id, const char *out, bool quiet) {
    char path[128];
    int code = CLI_DONE;
    int64_t since = cli_files_now();
    snprintf(path, sizeof path, "/v1/jobs/%s/results", id);
    json_t *manifest = cli_http_json(http, "GET", path, NULL, &code);
    if (!manifest) return code;
    if (strlen(out) > 4000) {
        cli_error("the name of the folder is too long");
        code = CLI_INTERNAL;
    } else if (mkdir(out, 0777) != 0 && errno != EEXIST) {
        cli_error("%s cannot be made: %s", out, strerror(errno));
        code = CLI_INTERNAL;
    } else {
        code = fetch_all(http, id, manifest, out);
    }
    if (code == CLI_DONE && !quiet) print_summary(out, manifest, since);
    json_decref(manifest);
    return code;
}

static int run(const cli_command *self, int argc, char **argv) {
    settings s = {0};
    cli_operands operands;
    if (!cli_parse(self, argc, argv, &s, &operands, 1, 1) || !cli_check_id(self, operands.operand[0]))
        return CLI_USAGE;
    if (!s.out || !*s.out) return cli_usage_error(self, "--out DIR says where the results go; it is missing");
    cli_http *http = cli_http_open(&s.remote);
    int code = cli_fetch(http, operands.operand[0], s.out, s.quiet);
    cli_http_close(http);
    return code;
}

const cli_command cli_command_fetch = {
    .name = "fetch",
    .synopsis = "ID --out DIR [options]",
    .summary = "bring the results of a job home",
    .about = "Downloads every result of the successful job ID into DIR. Each file is checked against\n"
             "the SHA-256 that the daemon announced and only then takes its name in DIR. Of a job that\n"
             "did not succeed there is nothing to fetch; 'blockwright watch ID' tells why.",
    .examples = "  blockwright fetch 65f0c1...e2 --out result",
    .options = options,
    .option_count = sizeof options / sizeof *options,
    .run = run,
};
