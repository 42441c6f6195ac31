/* The queue: what is inserted stays, attempts are fenced by their number, every transition of queue.h's table. */
#include <setjmp.h>
#include <sqlite3.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "server/files.h"
#include "server/metrics.h"
#include "server/queue/queue.h"

static char folder[64], path[96];
static bw_queue *q;
static const char hash[] = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";
static const char side[] = "fedcba9876543210fedcba9876543210fedcba9876543210fedcba9876543210";

static int open_queue(void **state) {
    (void)state;
    snprintf(folder, sizeof folder, "/tmp/bw-queue-XXXXXX");
    assert_non_null(mkdtemp(folder));
    snprintf(path, sizeof path, "%s/jobs.db", folder);
    return bw_queue_open(path, &q) == BW_OK ? 0 : -1;
}

static int close_queue(void **state) {
    (void)state;
    bw_queue_close(q);
    bw_remove_tree(folder);
    return 0;
}

static int64_t ended(bw_job_state state) { return bw_metric_value(BW_METRIC_JOBS_ENDED, (int)state - BW_JOB_SUCCESSFUL, 0); }

static void reopen(void) {
    bw_queue_close(q);
    assert_int_equal(bw_queue_open(path, &q), BW_OK);
}

static void insert(bw_job *job, int stages) {
    memset(job, 0, sizeof *job);
    bw_job_id_make(job->id);
    snprintf(job->input, sizeof job->input, "%s", hash);
    snprintf(job->parameters, sizeof job->parameters, "%s", side);
    job->options = strdup("{}");
    job->name = strdup("caf\xc3\xa9 \"quoted\" '; --");
    job->stage_count = stages;
    job->created = 1000;
    assert_int_equal(bw_queue_insert(q, job), BW_OK);
}

static bw_job get(const char *id) {
    bw_job job;
    bool found;
    assert_int_equal(bw_queue_get(q, id, &job, &found), BW_OK);
    assert_true(found);
    return job;
}

static void expect(const char *id, bw_job_state state, bool open, int stage) {
    bw_job job = get(id);
    assert_int_equal(job.state, state);
    assert_int_equal(job.open, open);
    assert_int_equal(job.stage, stage);
    bw_job_clear(&job);
}

static void claim(bw_job *job) {
    bool done;
    assert_int_equal(bw_queue_claim(q, job, 2000, &done), BW_OK);
    assert_true(done);
}

static size_t waiting(int64_t now) {
    bw_job *jobs;
    size_t n;
    assert_int_equal(bw_queue_candidates(q, "", now, 0, 100, &jobs, &n), BW_OK);
    bw_jobs_free(jobs, n);
    return n;
}

static void a_job_keeps_what_it_was_inserted_with(void **state) {
    (void)state;
    bw_job job;
    insert(&job, 4);
    reopen();
    bw_job now = get(job.id);
    assert_string_equal(now.name, job.name);
    assert_string_equal(now.input, hash);
    assert_string_equal(now.parameters, side);
    assert_int_equal(now.state, BW_JOB_QUEUED);
    assert_int_equal(now.created, 1000);
    bw_job_clear(&now);
    bw_job_clear(&job);
}

static void a_job_goes_through_its_stages_to_success(void **state) {
    (void)state;
    bw_job job;
    bool done;
    insert(&job, 2);
    claim(&job);
    expect(job.id, BW_JOB_RUNNING, true, 0);
    assert_int_equal(waiting(9000), 0);
    assert_int_equal(bw_queue_advance(q, job.id, 1, &(bw_made){hash, 5, 77, NULL, false, NULL}, 3000, NULL, &done), BW_OK);
    uint64_t need;
    assert_int_equal(bw_queue_output_need(q, hash, &need), BW_OK);
    assert_int_equal(need, 77);
    assert_int_equal(bw_queue_output_need(q, "no such key", &need), BW_OK);
    assert_int_equal(need, 0);
    assert_true(done);
    expect(job.id, BW_JOB_RUNNING, false, 1);
    bw_job_clear(&job);
    job = get(job.id);
    claim(&job);
    assert_int_equal(bw_queue_advance(q, job.id, 2, &(bw_made){hash, 5, 77, "[]", false, NULL}, 4000, NULL, &done), BW_OK);
    bw_job now = get(job.id);
    assert_int_equal(now.state, BW_JOB_SUCCESSFUL);
    assert_int_equal(now.finished, 4000);
    assert_string_equal(now.result_key, hash);
    bw_job_clear(&now);
    bw_job_clear(&job);
}

/* Whatever an outdated attempt reports, nothing changes. */
static void an_attempt_that_is_not_the_jobs_any_more_changes_nothing(void **state) {
    (void)state;
    bw_job job;
    bool done;
    int recovered;
    insert(&job, 4);
    claim(&job);
    assert_int_equal(bw_queue_recover(q, 2500, &recovered), BW_OK);
    assert_int_equal(recovered, 1);
    for (int again = 0; again < 2; again++) {
        bw_queue_advance(q, job.id, 1, &(bw_made){hash, 5, 77, NULL, false, NULL}, 3000, NULL, &done);
        assert_false(done);
        bw_queue_fail(q, job.id, 1, "io", "{}", 3000, NULL, &done);
        assert_false(done);
        bw_queue_retry(q, job.id, 1, "io", 0, 3000, NULL, &done);
        assert_false(done);
        bw_queue_dismiss(q, job.id, 1, 3000, NULL, &done);
        assert_false(done);
        bw_queue_interrupt(q, job.id, 1, 3000, &done);
        assert_false(done);
        expect(job.id, again ? BW_JOB_RUNNING : BW_JOB_QUEUED, again != 0, 0);
        bool found;
        assert_int_equal(bw_queue_output(q, hash, &found, NULL), BW_OK);
        assert_false(found);
        bw_queue_claim(q, &job, 3500, &done); /* `job` still says attempt 1: right, the recovery made no new number */
        assert_int_equal(done, !again);
    }
    bw_job_clear(&job);
}

static void a_job_is_claimed_only_once(void **state) {
    (void)state;
    bw_job job, copy;
    bool done;
    insert(&job, 4);
    copy = get(job.id);
    claim(&job);
    assert_int_equal(bw_queue_claim(q, &copy, 2000, &done), BW_OK);
    assert_false(done);
    assert_int_equal(bw_queue_reuse(q, &copy, "", false, 2000, &done), BW_OK);
    assert_false(done);
    bw_job_clear(&copy);
    bw_job_clear(&job);
}

static void tries_are_counted_at_the_claim_and_given_back_when_the_daemon_died(void **state) {
    (void)state;
    bw_job job;
    bool done;
    int recovered;
    insert(&job, 4);
    claim(&job);
    assert_int_equal(bw_queue_retry(q, job.id, 1, "io", 5000, 2100, NULL, &done), BW_OK);
    assert_int_equal(waiting(4999), 0);
    assert_int_equal(waiting(5000), 1);
    bw_job_clear(&job);
    job = get(job.id);
    assert_int_equal(job.tries, 1);
    claim(&job);
    assert_int_equal(job.tries, 2);
    reopen();
    assert_int_equal(bw_queue_recover(q, 6000, &recovered), BW_OK);
    bw_job_clear(&job);
    job = get(job.id);
    assert_int_equal(job.tries, 1);
    assert_int_equal(job.attempt, 2);
    bw_job_clear(&job);
}

static void expect_spent(const char *id, int64_t wall_ms, int64_t cpu_ms) {
    bw_job job = get(id);
    assert_int_equal(job.spent.wall_ms, wall_ms);
    assert_int_equal(job.spent.cpu_ms, cpu_ms);
    bw_job_clear(&job);
}

static void claim_again(const char *id) {
    bw_job job = get(id);
    claim(&job);
    bw_job_clear(&job);
}

static void what_workers_take_adds_up_until_the_job_begins_anew(void **state) {
    (void)state;
    const bw_spent spent = {1000, 300};
    bw_job job;
    bool done;
    int recovered;
    insert(&job, 4);
    claim(&job);
    assert_int_equal(bw_queue_retry(q, job.id, 1, "io", 0, 2100, &spent, &done), BW_OK);
    expect_spent(job.id, 1000, 300);
    assert_int_equal(bw_queue_retry(q, job.id, 1, "io", 0, 2100, &spent, &done), BW_OK); /* not the open attempt any more */
    expect_spent(job.id, 1000, 300);
    claim_again(job.id);
    assert_int_equal(bw_queue_interrupt(q, job.id, 2, 2200, &done), BW_OK);
    claim_again(job.id);
    assert_int_equal(bw_queue_recover(q, 2300, &recovered), BW_OK);
    expect_spent(job.id, 1000, 300); /* what the daemon's end cost is not the job's */
    claim_again(job.id);
    assert_int_equal(bw_queue_advance(q, job.id, 4, &(bw_made){hash, 5, 77, NULL, false, NULL}, 2400, &spent, &done), BW_OK);
    reopen();
    expect_spent(job.id, 2000, 600);
    bw_job now = get(job.id);
    assert_int_equal(bw_queue_rewind(q, &now, 2450, &done), BW_OK);
    assert_int_equal(now.spent.wall_ms, 0);
    expect_spent(job.id, 0, 0);
    claim(&now);
    bw_job_clear(&now);
    assert_int_equal(bw_queue_fail(q, job.id, 5, "time-limit", "{}", 2500, &spent, &done), BW_OK);
    assert_true(done);
    expect_spent(job.id, 1000, 300);
    bw_change again = {.id = job.id, .now = 2600};
    assert_int_equal(bw_queue_write(q, bw_write_restart, &again), BW_OK);
    expect_spent(job.id, 0, 0);
    claim_again(job.id);
    assert_int_equal(bw_queue_dismiss(q, job.id, 6, 2700, &spent, &done), BW_OK);
    expect_spent(job.id, 1000, 300);
    bw_job_clear(&job);
}

static void a_daemon_that_dies_of_a_job_again_and_again_gives_it_up(void **state) {
    (void)state;
    bw_job job;
    int recovered, rounds = 0;
    int64_t failed = ended(BW_JOB_FAILED);
    insert(&job, 4);
    while (job.state != BW_JOB_FAILED && rounds <= BW_INTERRUPTIONS_MOST) {
        claim(&job);
        assert_int_equal(bw_queue_recover(q, 3000, &recovered), BW_OK);
        bw_job_clear(&job);
        job = get(job.id);
        rounds++;
    }
    assert_int_equal(rounds, BW_INTERRUPTIONS_MOST + 1);
    assert_int_equal(job.state, BW_JOB_FAILED);
    assert_int_equal(ended(BW_JOB_FAILED), failed + 1);
    bw_job_clear(&job);
}

static void cancelling_is_idempotent_in_every_state(void **state) {
    (void)state;
    bw_job job;
    bw_cancel result;
    bool done;
    int recovered;
    assert_int_equal(bw_queue_cancel(q, "nobody", 1, &result), BW_OK);
    assert_int_equal(result, BW_CANCEL_UNKNOWN);
    insert(&job, 4);
    for (int i = 0; i < 2; i++) {
        bw_queue_cancel(q, job.id, 1500 + i, &result);
        assert_int_equal(result, BW_CANCEL_DISMISSED);
        expect(job.id, BW_JOB_DISMISSED, false, 0);
    }
    bw_job_clear(&job);
    insert(&job, 4);
    claim(&job);
    for (int i = 0; i < 2; i++) {
        bw_queue_cancel(q, job.id, 2500, &result);
        assert_int_equal(result, BW_CANCEL_NOTED);
        expect(job.id, BW_JOB_RUNNING, true, 0);
    }
    int64_t dismissed = ended(BW_JOB_DISMISSED);
    assert_int_equal(bw_queue_recover(q, 2600, &recovered), BW_OK); /* a noted cancel survives the daemon */
    assert_int_equal(ended(BW_JOB_DISMISSED), dismissed + 1);
    expect(job.id, BW_JOB_DISMISSED, false, 0);
    bw_job_clear(&job);
    insert(&job, 1);
    claim(&job);
    bw_queue_advance(q, job.id, 1, &(bw_made){hash, 1, 77, "[]", false, NULL}, 3000, NULL, &done);
    bw_queue_cancel(q, job.id, 3100, &result);
    assert_int_equal(result, BW_CANCEL_TOO_LATE);
    expect(job.id, BW_JOB_SUCCESSFUL, false, 1);
    bw_job_clear(&job);
}

static void a_cancel_that_was_noted_wins_over_the_end_of_the_attempt(void **state) {
    (void)state;
    bw_job job;
    bw_cancel result;
    bool done;
    for (int end = 0; end < 2; end++) {
        insert(&job, 1);
        claim(&job);
        bw_queue_cancel(q, job.id, 2500, &result);
        assert_int_equal(result, BW_CANCEL_NOTED);
        if (end == 0) assert_int_equal(bw_queue_advance(q, job.id, 1, &(bw_made){hash, 1, 0, "[]", false, NULL}, 3000, NULL, &done), BW_OK);
        else assert_int_equal(bw_queue_fail(q, job.id, 1, "syntax", "{}", 3000, NULL, &done), BW_OK);
        assert_false(done);
        expect(job.id, BW_JOB_RUNNING, true, 0);
        assert_int_equal(bw_queue_dismiss(q, job.id, 1, 3001, NULL, &done), BW_OK);
        assert_true(done);
        expect(job.id, BW_JOB_DISMISSED, false, 0);
        bw_job_clear(&job);
    }
}

static void a_retry_comes_also_when_the_clock_was_set_back(void **state) {
    (void)state;
    const int64_t day = 86400000;
    bw_job job;
    bool done;
    insert(&job, 4);
    claim(&job);
    assert_int_equal(bw_queue_retry(q, job.id, 1, "io", day + 1000, day, NULL, &done), BW_OK);
    assert_int_equal(waiting(day), 0);
    assert_int_equal(waiting(5000), 1);
    bw_job_clear(&job);
}

static void a_finish_is_noted_for_good_and_stops_nothing(void **state) {
    (void)state;
    bw_job job, now;
    bw_finish result;
    bool done;
    int recovered;
    assert_int_equal(bw_queue_finish(q, "nobody", &result), BW_OK);
    assert_int_equal(result, BW_FINISH_UNKNOWN);
    insert(&job, 4);
    for (int i = 0; i < 2; i++) {
        assert_int_equal(bw_queue_finish(q, job.id, &result), BW_OK);
        assert_int_equal(result, BW_FINISH_NOTED);
        expect(job.id, BW_JOB_QUEUED, false, 0);
    }
    claim(&job);
    assert_int_equal(bw_queue_recover(q, 2600, &recovered), BW_OK);
    reopen();
    now = get(job.id);
    assert_true(now.finish && !now.cut && now.state == BW_JOB_QUEUED);
    claim(&now);
    bw_queue_finish(q, job.id, &result);
    assert_int_equal(result, BW_FINISH_NOTED);
    expect(job.id, BW_JOB_RUNNING, true, 0);
    bw_queue_advance(q, job.id, now.attempt, &(bw_made){hash, 5, 77, NULL, false, NULL}, 3000, NULL, &done);
    assert_true(done);
    bw_job_clear(&now);
    for (int i = 0; i < 2; i++) { /* the first stage that was cut is remembered */
        now = get(job.id);
        assert_true(now.finish && now.cut == (i ? 2 : 0) && now.stage == 1 + i);
        claim(&now);
        bw_queue_advance(q, job.id, now.attempt, &(bw_made){hash, 5, 77, NULL, true, NULL}, 3100, NULL, &done);
        assert_true(done);
        bw_job_clear(&now);
    }
    bw_job_clear(&job);
    char id[BW_JOB_ID_TEXT];
    snprintf(id, sizeof id, "%s", job.id);
    job = get(id);
    assert_int_equal(job.cut, 2);
    claim(&job);
    bw_queue_advance(q, job.id, job.attempt, &(bw_made){hash, 5, 77, "[]", false, NULL}, 3200, NULL, &done);
    expect(job.id, BW_JOB_SUCCESSFUL, false, 4);
    bw_queue_finish(q, job.id, &result);
    assert_int_equal(result, BW_FINISH_TOO_LATE);
    bw_job_clear(&job);
}

static void a_cancel_ends_a_job_that_was_asked_to_finish(void **state) {
    (void)state;
    bw_job job;
    bw_finish result;
    bw_cancel cancel;
    bool done;
    insert(&job, 4);
    claim(&job);
    bw_queue_finish(q, job.id, &result);
    bw_queue_cancel(q, job.id, 2500, &cancel);
    assert_int_equal(cancel, BW_CANCEL_NOTED);
    assert_int_equal(bw_queue_dismiss(q, job.id, job.attempt, 2600, NULL, &done), BW_OK);
    expect(job.id, BW_JOB_DISMISSED, false, 0);
    bw_queue_finish(q, job.id, &result);
    assert_int_equal(result, BW_FINISH_TOO_LATE);
    bw_job_clear(&job);
}

static bool nothing_is_present(void *user, const char *key) {
    (void)user, (void)key;
    return false;
}

static void cache_rows_without_files_are_forgotten(void **state) {
    (void)state;
    bw_job job;
    bool done, found;
    int forgotten;
    char *manifest;
    insert(&job, 1);
    claim(&job);
    bw_queue_advance(q, job.id, 1, &(bw_made){hash, 1, 77, "[7]", false, NULL}, 3000, NULL, &done);
    assert_int_equal(bw_queue_output(q, hash, &found, &manifest), BW_OK);
    assert_true(found);
    assert_string_equal(manifest, "[7]");
    free(manifest);
    assert_int_equal(bw_queue_sweep_outputs(q, nothing_is_present, NULL, &forgotten), BW_OK);
    assert_int_equal(forgotten, 1);
    assert_int_equal(bw_queue_output(q, hash, &found, NULL), BW_OK);
    assert_false(found);
    bw_job_clear(&job);
}

static void the_file_of_a_newer_daemon_is_refused_and_left_alone(void **state) {
    (void)state;
    sqlite3 *db;
    bw_queue *other;
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, "PRAGMA user_version = 99", NULL, NULL, NULL), SQLITE_OK);
    assert_int_equal(bw_queue_open(path, &other), BW_E_VERSION);
    assert_int_equal(sqlite3_exec(db, "PRAGMA user_version = 1", NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
}

/* The file as the first version made it, with a job that waits and one that is done. */
static const char version_1[] =
    "CREATE TABLE jobs ("
    " seq INTEGER PRIMARY KEY AUTOINCREMENT, id TEXT NOT NULL UNIQUE, name TEXT, input TEXT NOT NULL,"
    " options TEXT NOT NULL, state INTEGER NOT NULL, open INTEGER NOT NULL DEFAULT 0, cancel INTEGER NOT NULL DEFAULT 0,"
    " stage INTEGER NOT NULL DEFAULT 0, stage_count INTEGER NOT NULL, attempt INTEGER NOT NULL DEFAULT 0,"
    " tries INTEGER NOT NULL DEFAULT 0, interruptions INTEGER NOT NULL DEFAULT 0, due INTEGER NOT NULL DEFAULT 0,"
    " created INTEGER NOT NULL, started INTEGER NOT NULL DEFAULT 0, finished INTEGER NOT NULL DEFAULT 0,"
    " failure TEXT, result_key TEXT NOT NULL DEFAULT '');"
    "CREATE INDEX jobs_waiting ON jobs(seq) WHERE open = 0 AND state IN (0, 1);"
    "CREATE INDEX jobs_by_state ON jobs(state, seq);"
    "CREATE TABLE attempts ("
    " job TEXT NOT NULL REFERENCES jobs(id), attempt INTEGER NOT NULL, stage TEXT NOT NULL, reused INTEGER NOT NULL,"
    " started INTEGER NOT NULL, finished INTEGER NOT NULL DEFAULT 0, outcome TEXT NOT NULL DEFAULT '',"
    " PRIMARY KEY (job, attempt)) WITHOUT ROWID;"
    "CREATE INDEX attempts_open ON attempts(job) WHERE finished = 0;"
    "CREATE TABLE outputs (key TEXT PRIMARY KEY, bytes INTEGER NOT NULL, manifest TEXT, created INTEGER NOT NULL)"
    " WITHOUT ROWID;"
    "INSERT INTO jobs (id, input, options, state, stage_count, created) VALUES ('old', 'abc', '{}', 0, 4, 1000);"
    "INSERT INTO jobs (id, input, options, state, stage_count, created) VALUES ('done', 'abc', '{}', 2, 4, 1000);"
    "PRAGMA user_version = 1;";

static void a_file_of_version_1_keeps_its_jobs_and_goes_on(void **state) {
    (void)state;
    sqlite3 *db;
    bw_job next;
    bw_owner counts;
    bw_queue_close(q);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(sqlite3_open(path, &db), SQLITE_OK);
    assert_int_equal(sqlite3_exec(db, version_1, NULL, NULL, NULL), SQLITE_OK);
    sqlite3_close(db);
    assert_int_equal(bw_queue_open(path, &q), BW_OK);
    bw_job now = get("old");
    assert_string_equal(now.input, "abc");
    assert_string_equal(now.parameters, "");
    assert_string_equal(now.owner, "");
    assert_int_equal(now.spent.wall_ms, 0);
    claim(&now);
    bw_job_clear(&now);
    insert(&next, 4);
    now = get(next.id);
    assert_string_equal(now.parameters, side);
    assert_int_equal(bw_queue_owner(q, "", &counts), BW_OK);
    assert_int_equal(counts.waiting, 1);
    assert_int_equal(counts.running, 1);
    assert_int_equal(counts.finished, 1);
    bw_job_clear(&now);
    bw_job_clear(&next);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_job_keeps_what_it_was_inserted_with, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_job_goes_through_its_stages_to_success, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(an_attempt_that_is_not_the_jobs_any_more_changes_nothing, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_job_is_claimed_only_once, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(tries_are_counted_at_the_claim_and_given_back_when_the_daemon_died, open_queue,
                                        close_queue),
        cmocka_unit_test_setup_teardown(what_workers_take_adds_up_until_the_job_begins_anew, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_daemon_that_dies_of_a_job_again_and_again_gives_it_up, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(cancelling_is_idempotent_in_every_state, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_cancel_that_was_noted_wins_over_the_end_of_the_attempt, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_retry_comes_also_when_the_clock_was_set_back, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_finish_is_noted_for_good_and_stops_nothing, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_cancel_ends_a_job_that_was_asked_to_finish, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(cache_rows_without_files_are_forgotten, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_file_of_version_1_keeps_its_jobs_and_goes_on, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(the_file_of_a_newer_daemon_is_refused_and_left_alone, open_queue, close_queue),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
