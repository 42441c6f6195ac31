/* What takes long when a stage has ended, its output being filed, holds up nobody else, and is done once. */
#include <dirent.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>

#include "bw_api.h"
#include "daemon_kit.h"

static kit_daemon d;

/* The first output of all takes `ms` to be synced. */
static void start(int ms, const char *const *arguments) {
    char rules[120];
    snprintf(rules, sizeof rules, "call=fsync|fdatasync,path=*/work/*/out*,do=delay:%d", ms);
    kit_shim(rules);
    kit_start(&d, NULL, arguments);
    kit_shim(NULL);
}

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

/* Waits until the worker of the job's first stage has begun, and ended, and its output is being filed. */
static void submit_and_wait_for_filing(const char *remark, char id[32]) {
    char script[100];
    bool begun = false;
    pid_t worker;
    snprintf(script, sizeof script, "%s log begun\n# %s\n", bw_api_stages[0].name, remark);
    kit_submit(&d, script, NULL, id);
    for (int i = 0; i < 2000 && !begun; i++) {
        kit_reply r = kit_get(&d, "/v1/jobs/%s/log", id);
        begun = strstr(r.body, "begun") != NULL;
        kit_free(&r);
        kit_sleep_ms(5);
    }
    for (int i = 0; i < 2000 && kit_workers(&d, &worker, 1); i++) kit_sleep_ms(5);
    assert_int_equal(kit_workers(&d, &worker, 1), 0);
}

static int entries_of_the_cache(void) {
    int n = 0;
    char path[200];
    for (unsigned i = 0; i < 256; i++) {
        snprintf(path, sizeof path, "%s/cache/%02x", d.data, i);
        DIR *folder = opendir(path);
        for (struct dirent *e; folder && (e = readdir(folder));) n += *e->d_name != '.';
        if (folder) closedir(folder);
    }
    return n;
}

static void other_jobs_begin_and_end_meanwhile(void **state) {
    (void)state;
    char slow[32], quick[32];
    start(4000, (const char *[]){"--workers", "2", NULL});
    submit_and_wait_for_filing("slow", slow);
    kit_submit(&d, "# quick\n", NULL, quick);
    json_t *job = kit_wait(&d, quick, 30), *first = kit_job(&d, slow);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_string_equal(kit_text(first, "state"), "running");
    assert_string_equal(kit_text(first, "stage"), bw_api_stages[0].name);
    json_decref(job);
    json_decref(first);
    job = kit_wait(&d, slow, 30);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_int_equal(json_array_size(json_object_get(job, "attempts")), BW_API_STAGE_COUNT);
    json_decref(job);
}

static void a_cancel_meanwhile_holds_and_nothing_is_kept(void **state) {
    (void)state;
    char id[32], path[100];
    start(2000, NULL);
    submit_and_wait_for_filing("not wanted", id);
    snprintf(path, sizeof path, "/v1/jobs/%s/cancel", id);
    kit_reply r = kit_request(&d, "POST", path, NULL, NULL, 0);
    assert_int_equal(r.status, 200);
    kit_free(&r);
    json_t *job = kit_wait(&d, id, 30);
    assert_string_equal(kit_text(job, "state"), "dismissed");
    assert_int_equal(json_array_size(json_object_get(job, "attempts")), 1);
    json_decref(job);
    assert_int_equal(entries_of_the_cache(), 0);
}

static void a_stop_waits_for_it_and_the_stage_is_not_done_again(void **state) {
    (void)state;
    char id[32];
    start(2000, NULL);
    submit_and_wait_for_filing("worth keeping", id);
    assert_int_equal(kit_stop(&d), 0);
    assert_int_equal(entries_of_the_cache(), 1);
    kit_restart(&d, NULL);
    json_t *job = kit_wait(&d, id, 30);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_int_equal(json_array_size(json_object_get(job, "attempts")), BW_API_STAGE_COUNT);
    json_decref(job);
}

static void a_kill_meanwhile_costs_the_stage_only(void **state) {
    (void)state;
    char id[32];
    start(60000, NULL);
    submit_and_wait_for_filing("killed", id);
    kit_kill(&d, SIGKILL);
    kit_restart(&d, NULL);
    json_t *job = kit_wait(&d, id, 30);
    assert_string_equal(kit_text(job, "state"), "successful");
    assert_int_equal(json_array_size(json_object_get(job, "attempts")), BW_API_STAGE_COUNT + 1);
    json_decref(job);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_teardown(other_jobs_begin_and_end_meanwhile, stop),
        cmocka_unit_test_teardown(a_cancel_meanwhile_holds_and_nothing_is_kept, stop),
        cmocka_unit_test_teardown(a_stop_waits_for_it_and_the_stage_is_not_done_again, stop),
        cmocka_unit_test_teardown(a_kill_meanwhile_costs_the_stage_only, stop),
    };
    return cmocka_run_group_tests_name("filing", tests, NULL, NULL);
}
