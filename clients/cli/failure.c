#include "failure.h"

#include <stdio.h>
#include <string.h>

#include "base/status.h"
#include "command.h"
#include "terminal.h"

enum { ELEMENTS_SHOWN = 10, IDS_SHOWN = 6 };

void cli_failure_print(const char *subject, const cli_failure *failure) {
    fputs("blockwright: ", stderr);
    if (subject) {
        cli_print_safe(stderr, subject);
        fputs(": ", stderr);
    }
    cli_print_safe(stderr, failure->message);
    fputs(" [", stderr);
    cli_print_safe(stderr, failure->code);
    fputs("]\n", stderr);
}

void cli_failure_element(cli_failure *failure, const char *kind, int64_t id, const double *position) {
    if (failure->shown >= ELEMENTS_SHOWN) return;
    failure->shown++;
    fputs("  ", stderr);
    cli_print_safe(stderr, kind);
    fprintf(stderr, " %lld", (long long)id);
    if (position) fprintf(stderr, " at (%.9g, %.9g, %.9g)", position[0], position[1], position[2]);
    fputc('\n', stderr);
}

void cli_failure_region(cli_failure *failure, uint64_t tets, const int64_t *ids, size_t known, const double position[3]) {
    if (failure->shown >= ELEMENTS_SHOWN) return;
    failure->shown++;
    fprintf(stderr, "  %llu tet%s around (%.9g, %.9g, %.9g)", (unsigned long long)tets, tets == 1 ? "" : "s", position[0],
            position[1], position[2]);
    for (size_t i = 0; i < known && i < IDS_SHOWN; i++) fprintf(stderr, "%s %lld", i ? "," : ":", (long long)ids[i]);
    fputs(tets > IDS_SHOWN ? " ...\n" : "\n", stderr);
}

void cli_failure_end(const cli_failure *failure) {
    if (failure->count > failure->shown && failure->shown > 0)
        fprintf(stderr, "  ... and %zu more\n", failure->count - failure->shown);
}

static void json_element(cli_failure *failure, const json_t *element) {
    const char *kind = json_string_value(json_object_get(element, "kind"));
    const json_t *id = json_object_get(element, "id");
    const json_t *at = json_object_get(element, "position");
    double position[3];
    if (!kind || !json_is_integer(id)) return;
    for (size_t i = 0; i < 3; i++) position[i] = json_number_value(json_array_get(at, i));
    cli_failure_element(failure, kind, json_integer_value(id), json_array_size(at) == 3 ? position : NULL);
}

static void json_region(cli_failure *failure, const json_t *region) {
    const json_t *ids = json_object_get(region, "ids"), *at = json_object_get(region, "position");
    int64_t id[IDS_SHOWN];
    size_t known = 0;
    double position[3];
    for (; known < IDS_SHOWN && known < json_array_size(ids); known++) id[known] = json_integer_value(json_array_get(ids, known));
    for (size_t i = 0; i < 3; i++) position[i] = json_number_value(json_array_get(at, i));
    cli_failure_region(failure, (uint64_t)json_integer_value(json_object_get(region, "tets")), id, known, position);
}

static int exit_of_class(const char *class_) {
    if (!strcmp(class_, bw_class_name(BW_CLASS_INPUT))) return CLI_INPUT;
    return !strcmp(class_, bw_class_name(BW_CLASS_LIMIT)) ? CLI_LIMIT : CLI_INTERNAL;
}

static int exit_of_http(long http) {
    if (http == 400) return CLI_USAGE;
    if (http == 413 || http == 429) return CLI_LIMIT;
    return http >= 400 && http < 500 ? CLI_INPUT : CLI_INTERNAL;
}

static int exit_of_problem(const char *code, const char *class_, long http) {
    bw_status status = bw_status_from_code(code);
    if (!strcmp(bw_status_code(status), code)) return bw_status_exit(status);
    return class_ ? exit_of_class(class_) : exit_of_http(http);
}

static const char *text_of(const json_t *object, const char *key) {
    return json_string_value(json_object_get(object, key));
}

int cli_failure_problem(const char *subject, const json_t *problem, long http) {
    const char *type = text_of(problem, "type"), *detail = text_of(problem, "detail");
    const char *title = text_of(problem, "title");
    const char *slash = type ? strrchr(type, '/') : NULL;
    const char *code = slash ? slash + 1 : type ? type : "unknown";
    const char *message = detail ? detail : title ? title : "no reason was given";
    bool places = json_array_size(json_object_get(problem, "regions")) > 0;
    const json_t *list = json_object_get(problem, places ? "regions" : "elements");
    const json_t *count = json_object_get(problem, places ? "region_count" : "element_count");
    cli_failure f = {code, message, json_array_size(list), 0};
    if (json_is_integer(count)) f.count = (size_t)json_integer_value(count);
    cli_failure_print(subject, &f);
    size_t index;
    json_t *item;
    json_array_foreach(list, index, item) {
        if (places) json_region(&f, item);
        else json_element(&f, item);
    }
    cli_failure_end(&f);
    return exit_of_problem(code, text_of(problem, "class"), http);
}
