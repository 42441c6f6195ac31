#include "server/failure.h"

#include <string.h>

bw_problem bw_failure_problem(const char *code) {
    for (int i = 0; code && i < BW_PROBLEM_COUNT; i++)
        if (bw_problem_types[i].failure_class && strcmp(bw_problem_types[i].code, code) == 0) return (bw_problem)i;
    return BW_PROBLEM_INTERNAL;
}

bool bw_failure_retryable(bw_problem problem) {
    const char *class_ = bw_problem_types[problem].failure_class;
    return class_ && strcmp(class_, "system") == 0;
}

json_t *bw_problem_document(bw_problem problem, const char *detail) {
    const bw_problem_type *t = &bw_problem_types[problem];
    json_t *document = json_pack("{s:s, s:s, s:i}", "type", t->type, "title", t->title, "status", t->http);
    if (document && detail && *detail) {
        json_t *text = json_string(detail);
        json_object_set_new(document, "detail", text ? text : json_string("(not valid UTF-8)"));
    }
    return document;
}

static bool is_point(const json_t *value) {
    bool numbers = json_array_size(value) == 3;
    for (size_t i = 0; numbers && i < 3; i++) numbers = json_is_number(json_array_get(value, i));
    return numbers;
}

/* One element as the worker lists it, reduced to the members and types that the API promises. NULL if it has none. */
static json_t *clean_element(const json_t *element) {
    const char *kind = json_string_value(json_object_get(element, "kind"));
    json_t *id = json_object_get(element, "id"), *position = json_object_get(element, "position");
    if (!kind || !json_is_integer(id)) return NULL;
    json_t *clean = json_pack("{s:s, s:O}", "kind", kind, "id", id);
    if (clean && is_point(position)) json_object_set(clean, "position", position);
    return clean;
}

/* Likewise a region. */
static json_t *clean_region(const json_t *region) {
    json_t *tets = json_object_get(region, "tets"), *position = json_object_get(region, "position");
    json_t *box = json_object_get(region, "box"), *ids = json_array(), *id;
    json_t *low = json_array_get(box, 0), *high = json_array_get(box, 1);
    size_t i;
    json_array_foreach(json_object_get(region, "ids"), i, id) {
        if (json_is_integer(id)) json_array_append(ids, id);
    }
    if (json_is_integer(tets) && is_point(position) && is_point(low) && is_point(high))
        return json_pack("{s:O, s:o, s:O, s:[O, O]}", "tets", tets, "ids", ids, "position", position, "box", low, high);
    json_decref(ids);
    return NULL;
}

/* Copies a list and the count of what it lists, if it lists anything that is as it should be. */
static void add_list(json_t *document, const json_t *error, const char *name, const char *count_name,
                     json_t *(*clean)(const json_t *)) {
    json_t *given = json_object_get(error, name), *count = json_object_get(error, count_name);
    json_t *list = json_array(), *item;
    size_t i;
    json_array_foreach(given, i, item) {
        json_t *good = clean(item);
        if (good) json_array_append_new(list, good);
    }
    if (json_array_size(list) > 0 && json_is_integer(count)) {
        json_object_set(document, count_name, count);
        json_object_set(document, name, list);
    }
    json_decref(list);
}

char *bw_failure_json(bw_problem problem, const char *stage, const char *detail, const json_t *error, const bw_exceeded *exceeded) {
    if (!detail) detail = json_string_value(json_object_get(error, "message"));
    json_t *document = bw_problem_document(problem, detail);
    const char *class_ = bw_problem_types[problem].failure_class;
    if (!document) return NULL;
    json_object_set_new(document, "class", json_string(class_ ? class_ : "system"));
    json_object_set_new(document, "stage", json_string(stage));
    if (exceeded)
        json_object_set_new(document, "limit", json_pack("{s:s, s:I}", "what", exceeded->what, "allowed", (json_int_t)exceeded->allowed));
    add_list(document, error, "elements", "element_count", clean_element);
    add_list(document, error, "regions", "region_count", clean_region);
    char *text = json_dumps(document, JSON_COMPACT);
    json_decref(document);
    return text;
}
