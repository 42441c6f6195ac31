/* kill -9 of the daemon and of workers at random moments: every accepted job ends successfully, once, with the right bytes. */
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "bw_api.h"
#include "daemon_kit.h"

enum { ROUNDS = 30, JOBS_MOST = 100, STAGES = BW_API_STAGE_COUNT, WORKER_KILLS_MOST = 2 };

typedef struct {
    char id[32], script[160];
    int killed[STAGES]; /* how often this test killed the worker of each stage */
} job;

static kit_daemon d;
static job jobs[JOBS_MOST];
static atomic_int job_count; /* entries below it do not change any more but for `killed` */
static atomic_bool enough;
static int daemon_kills, worker_kills, strange_answers;
static pthread_mutex_t address_lock = PTHREAD_MUTEX_INITIALIZER; /* d.address changes at a restart */
static const char *const two_workers[] = {"--workers", "2", NULL};

static int stop(void **state) {
    (void)state;
    kit_remove(&d);
    return 0;
}

/* Submits a job of its own script; counts it only if the daemon has said 201. False if the daemon was not there. */
static bool submit_one(unsigned *seed) {
    job *j = &jobs[job_count];
    char hash[BW_SHA256_TEXT], path[120], body[200];
    kit_reply r;
    pthread_mutex_lock(&address_lock);
    kit_daemon now = {.pid = 0};
    memcpy(now.address, d.address, sizeof now.address);
    pthread_mutex_unlock(&address_lock);
    snprintf(j->script, sizeof j->script, "* sleep %d\nencode bytes %d\n# %d\n", rand_r(seed) % 25,
             100 + rand_r(seed) % 30000, (int)job_count);
    kit_hash(j->script, strlen(j->script), hash);
    snprintf(path, sizeof path, "/v1/blobs/%s", hash);
    if (!kit_try(&now, "PUT", path, NULL, j->script, strlen(j->script), &r)) return false;
    kit_free(&r);
    int n = snprintf(body, sizeof body, "{\"input\":\"%s\"}", hash);
    if (!kit_try(&now, "POST", "/v1/jobs", "Content-Type: application/json", body, (size_t)n, &r)) return false;
    json_t *accepted = json_loads(r.body, 0, NULL);
    if (r.status != 201 || !accepted) strange_answers++;
    snprintf(j->id, sizeof j->id, "%s", kit_text(accepted, "id"));
    json_decref(accepted);
    kit_free(&r);
    job_count++;
    return true;
}

/* A client that goes on submitting while the daemon is killed under it. */
static void *submit_many(void *user) {
    unsigned seed = *(unsigned *)user;
    while (!enough && job_count < JOBS_MOST)
        if (submit_one(&seed)) kit_sleep_ms((int)(rand_r(&seed) % 40));
        else kit_sleep_ms(2);
    return NULL;
}

/* Finds which job and stage a worker process works on; -1 if it is none of ours. */
static int job_of(pid_t pid, int *stage) {
    char path[64], line[2048] = "";
    snprintf(path, sizeof path, "/proc/%d/cmdline", (int)pid);
    FILE *f = fopen(path, "r");
    size_t n = f ? fread(line, 1, sizeof line - 1, f) : 0;
    if (f) fclose(f);
    int found = -1;
    *stage = -1;
    for (size_t i = 0; i < n; i += strlen(line + i) + 1) {
        for (int k = 0; k < job_count; k++)
            if (strcmp(line + i, jobs[k].id) == 0) found = k;
        for (int s = 0; s < STAGES; s++)
            if (strcmp(line + i, bw_api_stages[s].name) == 0) *stage = s;
    }
    return *stage < 0 ? -1 : found;
}

/* A job whose worker dies three times in one stage fails, and rightly so: this test stops at two. */
static void kill_a_worker(void) {
    pid_t pids[8];
    int stage;
    size_t n = kit_workers(&d, pids, 8);
    if (!n) return;
    pid_t pid = pids[(size_t)rand() % n];
    int which = job_of(pid, &stage);
    if (which < 0 || jobs[which].killed[stage] >= WORKER_KILLS_MOST) return;
    jobs[which].killed[stage]++;
    if (kill(pid, SIGKILL) == 0) worker_kills++;
}

static void check_bytes(const job *j) {
    char expected[400];
    int at = snprintf(expected, sizeof expected, "%s", j->script);
    for (int s = 0; s < STAGES - 1; s++) /* every stage but the last adds its name to what it passes on */
        at += snprintf(expected + at, sizeof expected - (size_t)at, "# %s\n", bw_api_stages[s].name);
    kit_reply r = kit_get(&d, "/v1/jobs/%s/results/script.txt", j->id);
    assert_int_equal(r.status, 200);
    assert_string_equal(r.body, expected);
    kit_free(&r);
    json_error_t error;
    r = kit_get(&d, "/v1/jobs/%s/report", j->id);
    json_t *report = json_loads(r.body, 0, &error);
    long bytes = (long)json_integer_value(json_object_get(report, "data_bytes"));
    json_decref(report);
    kit_free(&r);
    r = kit_get(&d, "/v1/jobs/%s/results/data.bin", j->id);
    assert_true(r.status == 200 && (long)r.size == bytes);
    kit_free(&r);
}

/* Exactly one attempt of every stage ended well, in the order of the stages, and attempts count upwards. */
static void check_history(const json_t *all) {
    size_t i;
    json_t *attempt;
    int done = 0, last = 0;
    json_array_foreach(json_object_get(all, "attempts"), i, attempt) {
        int number = (int)json_integer_value(json_object_get(attempt, "attempt"));
        assert_true(number > last);
        last = number;
        if (strcmp(kit_text(attempt, "outcome"), "ok") != 0) continue;
        assert_true(done < STAGES);
        assert_string_equal(kit_text(attempt, "stage"), bw_api_stages[done++].name);
    }
    assert_int_equal(done, STAGES);
}

static void restart(void) {
    kit_daemon next = d;
    kit_restart(&next, two_workers);
    pthread_mutex_lock(&address_lock);
    d = next;
    pthread_mutex_unlock(&address_lock);
}

static void every_accepted_job_survives_kill_9(void **state) {
    (void)state;
    const char *given = getenv("BW_TEST_SEED");
    unsigned seed = given ? (unsigned)strtoul(given, NULL, 10) : (unsigned)time(NULL);
    print_message("seed %u (set BW_TEST_SEED to repeat)\n", seed);
    srand(seed);
    kit_start(&d, NULL, two_workers);
    pthread_t client;
    assert_int_equal(pthread_create(&client, NULL, submit_many, &seed), 0);
    for (int round = 0; round < ROUNDS; round++) {
        kit_sleep_ms(rand() % 120);
        kill_a_worker();
        kit_sleep_ms(rand() % 60);
        if (round % 4 == 3) continue;
        kit_kill(&d, SIGKILL);
        daemon_kills++;
        restart();
        if (rand() % 2) kill_a_worker();
    }
    enough = true;
    pthread_join(client, NULL);
    assert_int_equal(strange_answers, 0);
    for (int k = 0; k < job_count; k++) {
        json_t *all = kit_wait(&d, jobs[k].id, 60);
        if (strcmp(kit_text(all, "state"), "successful") != 0) {
            char *text = json_dumps(all, JSON_INDENT(1));
            fail_msg("job %d of %d: %s", k, (int)job_count, text);
        }
        check_history(all);
        json_decref(all);
        check_bytes(&jobs[k]);
    }
    print_message("%d jobs, %d kills of the daemon, %d of workers\n", (int)job_count, daemon_kills, worker_kills);
    assert_true(daemon_kills >= 20 && job_count > 0);
}

/* Jobs in a state, over all pages. */
static int count_jobs(const char *state) {
    int total = 0;
    char next[40] = "";
    do {
        kit_reply r = kit_get(&d, "/v1/jobs?limit=7&state=%s%s%s", state, *next ? "&cursor=" : "", next);
        json_t *page = kit_json(&r);
        total += (int)json_array_size(json_object_get(page, "jobs"));
        snprintf(next, sizeof next, "%s", kit_text(page, "next"));
        json_decref(page);
    } while (*next);
    return total;
}

/* A job whose 201 got lost with the daemon was accepted all the same: it may be there too, and it ends well too. */
static void no_job_is_in_the_queue_twice(void **state) {
    (void)state;
    for (int i = 0; i < 3000 && count_jobs("queued") + count_jobs("running") > 0; i++) kit_sleep_ms(20);
    assert_int_equal(count_jobs("queued") + count_jobs("running"), 0);
    assert_int_equal(count_jobs("failed"), 0);
    assert_int_equal(count_jobs("dismissed"), 0);
    int total = count_jobs("successful");
    assert_true(total >= job_count && total <= job_count + daemon_kills);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_accepted_job_survives_kill_9),
        cmocka_unit_test(no_job_is_in_the_queue_twice),
    };
    return cmocka_run_group_tests(tests, NULL, stop);
}
