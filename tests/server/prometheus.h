/* A reader of Prometheus' text format (0.0.4) that shares nothing with what writes it, and is strict where the format is lax. Everything
 * asserts. Include after cmocka.
 *
 *   - every family has one HELP and one TYPE, in this order, directly before its samples, and occurs once
 *   - names and labels are well formed, no series occurs twice, values are numbers, counters are not negative and end in _total
 *   - of a histogram's series: buckets with rising bounds and not falling counts, the last is +Inf and equals _count; a _sum
 */
#ifndef BW_TESTS_PROMETHEUS_H
#define BW_TESTS_PROMETHEUS_H

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    const char *family, *type; /* of the last TYPE line */
    char open[300];            /* labels without le of the histogram series under way, "" after its _count */
    bool has_open, has_sum;
    double bound, bucket;
    size_t families, samples;
} prometheus_state;

static bool prometheus_name(const char *text, size_t n) {
    if (!n || (text[0] >= '0' && text[0] <= '9')) return false;
    return strspn(text, "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_:") >= n;
}

static double prometheus_number(const char *text) {
    char *end;
    if (strcmp(text, "+Inf") == 0) return INFINITY;
    double value = strtod(text, &end);
    if (end == text || *end) fail_msg("'%s' is not a number", text);
    return value;
}

/* Copies the labels but le to `rest`; *le is its value, NAN if there is none. */
static void prometheus_labels(const char *text, char *rest, size_t room, double *le) {
    *rest = '\0';
    *le = NAN;
    for (size_t used = 0; *text;) {
        size_t n = strcspn(text, "=");
        char value[200];
        size_t size = 0;
        if (!prometheus_name(text, n) || text[n] != '=' || text[n + 1] != '"') fail_msg("bad label: %s", text);
        const char *c = text + n + 2;
        for (; *c && *c != '"' && size + 1 < sizeof value; c++) {
            if (*c == '\\' && !strchr("\\\"n", *++c)) fail_msg("bad escape: %s", text);
            value[size++] = *c;
        }
        value[size] = '\0';
        assert_int_equal(*c, '"');
        if (n == 2 && strncmp(text, "le", 2) == 0) *le = prometheus_number(value);
        else used += (size_t)snprintf(rest + used, room - used, "%.*s=%s;", (int)n, text, value);
        assert_true(used < room);
        text = c + 1;
        if (*text == ',') text++;
        else assert_int_equal(*text, '\0');
    }
}

static void prometheus_histogram(prometheus_state *s, const char *suffix, const char *labels, double le, double value) {
    if (strcmp(suffix, "_bucket") == 0) {
        assert_true(!isnan(le));
        if (!s->has_open) snprintf(s->open, sizeof s->open, "%s", labels), s->has_open = true, s->has_sum = false, s->bound = -INFINITY, s->bucket = 0;
        assert_string_equal(s->open, labels);
        assert_true(le > s->bound && value >= s->bucket);
        s->bound = le;
        s->bucket = value;
        return;
    }
    assert_true(s->has_open && isnan(le) && isinf(s->bound));
    assert_string_equal(s->open, labels);
    if (strcmp(suffix, "_sum") == 0) {
        s->has_sum = true;
        return;
    }
    assert_string_equal(suffix, "_count");
    assert_true(s->has_sum && value == s->bucket);
    s->has_open = false;
}

static void prometheus_sample(prometheus_state *s, char *line) {
    size_t n = strcspn(line, "{ "), length = strlen(s->family);
    char *value = strrchr(line, ' '), labels[300] = "", *open = strchr(line, '{');
    double le = NAN;
    assert_non_null(value);
    *value++ = '\0';
    if (open) {
        char *close = line + strlen(line) - 1;
        assert_int_equal(*close, '}');
        *close = '\0';
        prometheus_labels(open + 1, labels, sizeof labels, &le);
        *open = '\0';
    }
    if (strncmp(line, s->family, length) != 0 || !prometheus_name(line, n)) fail_msg("a sample of %s outside its family: %s", s->family, line);
    double number = prometheus_number(value);
    if (strcmp(s->type, "histogram") == 0) {
        prometheus_histogram(s, line + length, labels, le, number);
    } else {
        assert_string_equal(line, s->family);
        assert_true(isnan(le));
    }
    if (strcmp(s->type, "counter") == 0) assert_true(number >= 0 && strstr(s->family, "_total"));
    s->samples++;
}

static void prometheus_check(const char *text) {
    char *copy = strdup(text), *rest = copy;
    prometheus_state s = {.family = NULL};
    char last[200] = "";
    assert_true(*text && text[strlen(text) - 1] == '\n');
    for (char *line; (line = strsep(&rest, "\n")) && rest;) {
        char name[200], type[20];
        if (strncmp(line, "# HELP ", 7) == 0) {
            assert_false(s.has_open);
            assert_int_equal(sscanf(line, "# HELP %199s %*c", name), 1);
            assert_true(strlen(line) > 7 + strlen(name) + 2);
            snprintf(last, sizeof last, "%s", name);
            char again[230];
            snprintf(again, sizeof again, "# HELP %s ", name);
            assert_null(strstr(strstr(text, again) + 1, again));
        } else if (strncmp(line, "# TYPE ", 7) == 0) {
            assert_int_equal(sscanf(line, "# TYPE %199s %19s", name, type), 2);
            assert_string_equal(name, last);
            assert_true(!strcmp(type, "counter") || !strcmp(type, "gauge") || !strcmp(type, "histogram"));
            s.type = strchr(line + 7, ' ') + 1;
            strchr(line + 7, ' ')[0] = '\0';
            s.family = line + 7;
            s.families++;
        } else {
            char series[500];
            snprintf(series, sizeof series, "\n%.*s ", (int)(strrchr(line, ' ') - line), line);
            assert_null(strstr(strstr(text, series) + 1, series));
            prometheus_sample(&s, line);
        }
    }
    assert_false(s.has_open);
    assert_true(s.families > 0 && s.samples >= s.families);
    free(copy);
}

/* The value of a series, written as in the text: name{label="value"}. */
static double prometheus_value(const char *text, const char *series) {
    char line[400];
    snprintf(line, sizeof line, "\n%s ", series);
    const char *at = strstr(text, line);
    if (!at) fail_msg("there is no %s", series);
    return strtod(at + strlen(line), NULL);
}

#endif
