/* The daemon's metrics (server/metrics.h), read by a reader of their own (prometheus.h), and whoever else names them. */
#include "kit/kit.h"

#include <jansson.h>
#include <pthread.h>
#include <string.h>

#include "server/metrics.h"
#include "server/prometheus.h"

static char *written(void) {
    char *text;
    size_t size;
    FILE *f = open_memstream(&text, &size);
    bw_metrics_write(f);
    fclose(f);
    return text;
}

static void what_is_written_is_prometheus_text(void **state) {
    (void)state;
    bw_observe(BW_METRIC_FSYNC_SECONDS, 0, 1234);
    bw_count(BW_METRIC_REQUESTS, 3, 4, 7);
    char *text = written();
    prometheus_check(text);
    free(text);
}

static void the_reader_refuses_what_is_wrong(void **state) {
    (void)state;
    char labels[100];
    double le;
    prometheus_labels("a=\"x\",le=\"0.5\"", labels, sizeof labels, &le);
    assert_string_equal(labels, "a=x;");
    assert_true(le == 0.5);
    assert_false(prometheus_name("9a", 2));
    assert_false(prometheus_name("a-b", 3));
}

static void names_follow_the_conventions(void **state) {
    (void)state;
    for (int m = 0; m < BW_METRIC_COUNT; m++) {
        const char *name = bw_metric_name((bw_metric)m);
        size_t n = strlen(name);
        assert_true(strncmp(name, "blockwright_", 12) == 0 || strncmp(name, "process_", 8) == 0);
        assert_int_equal(bw_metric_kind_of((bw_metric)m) == BW_COUNTER, n > 6 && strcmp(name + n - 6, "_total") == 0);
        assert_null(strstr(name, "_ms"));
        if (bw_metric_kind_of((bw_metric)m) == BW_HISTOGRAM) assert_true(strstr(name, "_seconds") || strstr(name, "_bytes"));
        for (int o = 0; o < m; o++) assert_string_not_equal(name, bw_metric_name((bw_metric)o));
    }
}

static void a_value_falls_into_the_first_bucket_that_holds_it(void **state) {
    (void)state;
    bw_observe(BW_METRIC_STAGE_SECONDS, 1, 10);  /* the bound itself belongs to its bucket */
    bw_observe(BW_METRIC_STAGE_SECONDS, 1, 11);
    bw_observe(BW_METRIC_STAGE_SECONDS, 1, 10000000);
    char *text = written();
    assert_true(prometheus_value(text, "blockwright_stage_seconds_bucket{stage=\"trace\",le=\"0.01\"}") == 1);
    assert_true(prometheus_value(text, "blockwright_stage_seconds_bucket{stage=\"trace\",le=\"0.05\"}") == 2);
    assert_true(prometheus_value(text, "blockwright_stage_seconds_bucket{stage=\"trace\",le=\"7200\"}") == 2);
    assert_true(prometheus_value(text, "blockwright_stage_seconds_bucket{stage=\"trace\",le=\"+Inf\"}") == 3);
    assert_true(prometheus_value(text, "blockwright_stage_seconds_sum{stage=\"trace\"}") == 10000.021);
    free(text);
}

enum { THREADS = 4, TIMES = 20000 };
static void *count_much(void *user) {
    for (int i = 0; i < TIMES; i++) {
        bw_count(BW_METRIC_CLAIMS, 2, 0, 1);
        bw_observe(BW_METRIC_STAGE_PEAK, 2, *(int *)user);
        bw_gauge_add(BW_METRIC_CONNECTIONS, 0, i % 2 ? -1 : 1);
    }
    return NULL;
}

static void nothing_is_lost_among_threads(void **state) {
    pthread_t threads[THREADS];
    int value = 5;
    (void)state;
    for (int i = 0; i < THREADS; i++) assert_int_equal(pthread_create(&threads[i], NULL, count_much, &value), 0);
    for (int i = 0; i < 20; i++) { /* read while it is written */
        char *text = written();
        prometheus_check(text);
        free(text);
    }
    for (int i = 0; i < THREADS; i++) pthread_join(threads[i], NULL);
    assert_int_equal(bw_metric_value(BW_METRIC_CLAIMS, 2, 0), THREADS * TIMES);
    assert_int_equal(bw_metric_value(BW_METRIC_STAGE_PEAK, 2, 0), THREADS * TIMES);
    assert_int_equal(bw_metric_value(BW_METRIC_CONNECTIONS, 0, 0), 0);
    char *text = written();
    assert_true(prometheus_value(text, "blockwright_stage_peak_bytes_sum{stage=\"build\"}") == THREADS * TIMES * 5);
    free(text);
}

static void the_process_is_measured(void **state) {
    (void)state;
    bw_metrics_read_process();
    assert_true(bw_metric_value(BW_METRIC_PROCESS_MEMORY, 0, 0) > 1 << 20);
    assert_true(bw_metric_value(BW_METRIC_PROCESS_FILES, 0, 0) >= 3);
    assert_true(bw_metric_value(BW_METRIC_PROCESS_START, 0, 0) > 1000000000000);
}

/* ---- who else names metrics ---- */

static bool is_metric(const char *name, size_t n) {
    static const char *const suffixes[] = {"", "_bucket", "_sum", "_count"};
    for (int m = 0; m < BW_METRIC_COUNT; m++)
        for (int s = 0; s < (bw_metric_kind_of((bw_metric)m) == BW_HISTOGRAM ? 4 : 1); s++) {
            char known[120];
            snprintf(known, sizeof known, "%s%s", bw_metric_name((bw_metric)m), suffixes[s]);
            if (strlen(known) == n && strncmp(known, name, n) == 0) return true;
        }
    return false;
}

/* Every word of the file that begins with `prefix` must be a metric. How many there are. */
static size_t check_names(const char *text, const char *prefix) {
    size_t count = 0;
    for (const char *at = text; (at = strstr(at, prefix)); count++) {
        size_t n = strspn(at, "abcdefghijklmnopqrstuvwxyz_0123456789");
        if (!is_metric(at, n)) fail_msg("there is no metric %.*s", (int)n, at);
        at += n;
    }
    return count;
}

static void the_readme_lists_every_metric(void **state) {
    (void)state;
    char *text = kit_read_file(BW_SOURCE_DIR "/server/README.md", NULL), quoted[120];
    for (int m = 0; m < BW_METRIC_COUNT; m++) {
        snprintf(quoted, sizeof quoted, "`%s`", bw_metric_name((bw_metric)m));
        if (!strstr(text, quoted)) fail_msg("server/README.md does not tell of %s", quoted);
    }
    assert_true(check_names(text, "blockwright_") >= 20);
    free(text);
}

static void the_dashboard_shows_metrics_that_exist(void **state) {
    (void)state;
    char *text = kit_read_file(BW_SOURCE_DIR "/deploy/grafana.json", NULL);
    json_error_t error;
    json_t *board = json_loads(text, JSON_REJECT_DUPLICATES, &error), *panels = json_object_get(board, "panels"), *panel, *target;
    size_t i, j;
    if (!board) fail_msg("line %d: %s", error.line, error.text);
    assert_true(json_array_size(panels) >= 8);
    json_array_foreach(panels, i, panel) {
        assert_true(json_array_size(json_object_get(panel, "targets")) > 0);
        json_array_foreach(json_object_get(panel, "targets"), j, target) {
            const char *expr = json_string_value(json_object_get(target, "expr"));
            assert_non_null(expr);
            assert_true(check_names(expr, "blockwright_") + check_names(expr, "process_") > 0);
        }
    }
    json_decref(board);
    free(text);
}

static const struct CMUnitTest tests[] = {
    cmocka_unit_test(what_is_written_is_prometheus_text),
    cmocka_unit_test(the_reader_refuses_what_is_wrong),
    cmocka_unit_test(names_follow_the_conventions),
    cmocka_unit_test(a_value_falls_into_the_first_bucket_that_holds_it),
    cmocka_unit_test(nothing_is_lost_among_threads),
    cmocka_unit_test(the_process_is_measured),
    cmocka_unit_test(the_readme_lists_every_metric),
    cmocka_unit_test(the_dashboard_shows_metrics_that_exist),
};
KIT_MAIN(tests)
