#include "server/joboptions.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static const bw_api_option *find(const char *name) {
    for (int i = 0; i < BW_API_OPTION_COUNT; i++)
        if (strcmp(bw_api_options[i].name, name) == 0) return &bw_api_options[i];
    return NULL;
}

static bool in_range(const bw_api_option *option, double value) {
    return (option->above_minimum ? value > option->minimum : value >= option->minimum) &&
           (option->below_maximum ? value < option->maximum : value <= option->maximum);
}

static json_t *canonical_list(const bw_api_option *option, json_t *value) {
    if (!json_is_array(value) || json_array_size(value) > option->length) return NULL;
    json_t *list = json_array(), *item;
    size_t index;
    json_array_foreach(value, index, item) {
        bool good = json_is_number(item) && in_range(option, json_number_value(item));
        if (good && json_array_append_new(list, json_real(json_number_value(item))) == 0) continue;
        json_decref(list);
        return NULL;
    }
    return list;
}

/* A set of names, in the order of the document. */
static json_t *canonical_set(const bw_api_option *option, json_t *value) {
    if (!json_is_array(value) || json_array_size(value) > option->length) return NULL;
    json_t *set = json_array(), *item;
    size_t index, known = 0;
    for (const char *const *v = option->values; *v; v++) {
        bool there = false;
        json_array_foreach(value, index, item) {
            bool same = json_is_string(item) && strcmp(*v, json_string_value(item)) == 0;
            there |= same, known += same;
        }
        if (there && json_array_append_new(set, json_string(*v)) != 0) goto fail;
    }
    if (known == json_array_size(value)) return set;
fail:
    json_decref(set);
    return NULL;
}

/* The value in its one canonical form, as a new reference; NULL if it is not a value of the option. */
static json_t *canonical(const bw_api_option *option, json_t *value) {
    switch (option->kind) {
    case BW_OPTION_ENUM:
        for (const char *const *v = option->values; json_is_string(value) && *v; v++)
            if (strcmp(*v, json_string_value(value)) == 0) return json_string(*v);
        return NULL;
    case BW_OPTION_NUMBER:
        if (!json_is_number(value) || !in_range(option, json_number_value(value))) return NULL;
        return json_real(json_number_value(value));
    case BW_OPTION_INTEGER:
        if (!json_is_integer(value) || !in_range(option, (double)json_integer_value(value))) return NULL;
        return json_integer(json_integer_value(value));
    case BW_OPTION_BOOLEAN:
        return json_is_boolean(value) ? json_boolean(json_is_true(value)) : NULL;
    case BW_OPTION_NUMBERS:
        return canonical_list(option, value);
    case BW_OPTION_ENUMS:
        return canonical_set(option, value);
    }
    return NULL;
}

static void explain(const bw_api_option *option, char *detail, size_t size) {
    int n = snprintf(detail, size, "option %s must be ", option->name);
    size_t at = n < 0 ? 0 : (size_t)n;
    if (option->kind == BW_OPTION_ENUM || option->kind == BW_OPTION_ENUMS) {
        if (option->kind == BW_OPTION_ENUMS) at += (size_t)snprintf(detail + at, at < size ? size - at : 0, "a list of up to %zu names, each ", option->length);
        for (const char *const *v = option->values; *v && at < size; v++)
            at += (size_t)snprintf(detail + at, size - at, "%s%s", v == option->values ? "one of " : ", ", *v);
    } else if (option->kind == BW_OPTION_BOOLEAN && at < size) {
        snprintf(detail + at, size - at, "true or false");
    } else if (at < size) {
        char list[60];
        snprintf(list, sizeof list, "a list of up to %zu numbers, each", option->length);
        snprintf(detail + at, size - at, "%s %s %.15g and %s %.15g",
                 option->kind == BW_OPTION_NUMBERS ? list : option->kind == BW_OPTION_INTEGER ? "an integer" : "a number",
                 option->above_minimum ? "greater than" : "at least", option->minimum,
                 option->below_maximum ? "less than" : "at most", option->maximum);
    }
}

bool bw_joboptions_check(const json_t *given, json_t **all, char *detail, size_t size) {
    json_t *object = json_object(), *value;
    const char *name;
    snprintf(detail, size, "out of memory");
    for (int i = 0; i < BW_API_OPTION_COUNT; i++) {
        json_t *start = json_loads(bw_api_options[i].default_json, JSON_DECODE_ANY, NULL);
        json_t *form = start ? canonical(&bw_api_options[i], start) : NULL;
        json_decref(start);
        if (json_object_set_new(object, bw_api_options[i].name, form) != 0) goto fail;
    }
    if (given && !json_is_object(given)) {
        snprintf(detail, size, "options must be an object");
        goto fail;
    }
    json_object_foreach((json_t *)given, name, value) {
        const bw_api_option *option = find(name);
        if (!option) {
            snprintf(detail, size, "there is no option '%.60s'", name);
            goto fail;
        }
        json_t *form = canonical(option, value);
        if (!form) {
            explain(option, detail, size);
            goto fail;
        }
        if (json_object_set_new(object, name, form) != 0) goto fail;
    }
    *all = object;
    return true;
fail:
    json_decref(object);
    return false;
}

bool bw_joboptions_has(const char *name) { return find(name); }

json_t *bw_joboptions_scalar(const char *text) {
    json_t *value = json_loads(text, JSON_DECODE_ANY, NULL);
    if (json_is_number(value) || json_is_boolean(value)) return value;
    json_decref(value);
    return json_string(text);
}

static json_t *list_value(const bw_api_option *option, const char *text) {
    json_t *list = json_array();
    for (const char *at = text; list && *text && at; at = strchr(at, ',') ? strchr(at, ',') + 1 : NULL) {
        char *word = strndup(at, strcspn(at, ","));
        json_t *item = !word ? NULL : option->kind == BW_OPTION_NUMBERS ? bw_joboptions_scalar(word) : json_string(word);
        free(word);
        if (json_array_append_new(list, item) == 0) continue;
        json_decref(list);
        return NULL;
    }
    return list;
}

json_t *bw_joboptions_value(const char *name, const char *text) {
    const bw_api_option *option = find(name);
    if (!option) return NULL;
    if (option->kind == BW_OPTION_NUMBERS || option->kind == BW_OPTION_ENUMS) return list_value(option, text);
    return option->kind == BW_OPTION_ENUM ? json_string(text) : bw_joboptions_scalar(text);
}

int bw_joboptions_stages(const json_t *all) {
    const char *until = json_string_value(json_object_get(all, "until"));
    for (int i = 0; i < BW_API_STAGE_COUNT; i++)
        if (until && strcmp(bw_api_stages[i].name, until) == 0) return i + 1;
    return BW_API_STAGE_COUNT;
}

static bool add_text(bw_digest *digest, const char *text) { return bw_digest_add(digest, text, strlen(text)); }

static bool add_stage(bw_digest *digest, const bw_api_stage *stage, const json_t *all) {
    char line[160];
    int n = snprintf(line, sizeof line, "%s %d\n", stage->name, stage->version);
    if (!bw_digest_add(digest, line, (size_t)n)) return false;
    for (const char *const *name = stage->options; *name; name++) {
        char *value = json_dumps(json_object_get(all, *name), JSON_ENCODE_ANY | JSON_COMPACT | JSON_REAL_PRECISION(17));
        if (!value) return false;
        bool good = add_text(digest, " ") && add_text(digest, *name) && add_text(digest, "=") && add_text(digest, value) &&
                    add_text(digest, "\n");
        free(value);
        if (!good) return false;
    }
    return true;
}

bool bw_cache_key(const char *input_sha256, const char *parameters_sha256, const json_t *all, int stage,
                  const char *owner, char key[BW_SHA256_TEXT]) {
    static const char format[] = "blockwright cache 1\n"; /* raise the number when what follows changes its meaning */
    bw_digest *digest = bw_digest_new();
    bool good = digest && add_text(digest, format) && add_text(digest, input_sha256) && add_text(digest, "\n");
    if (good && *parameters_sha256)
        good = add_text(digest, "parameters ") && add_text(digest, parameters_sha256) && add_text(digest, "\n");
    if (good && *owner) good = add_text(digest, "job ") && add_text(digest, owner) && add_text(digest, "\n");
    for (int i = 0; good && i <= stage; i++) good = add_stage(digest, &bw_api_stages[i], all);
    good = good && bw_digest_end(digest, key);
    bw_digest_free(digest);
    return good;
}
