/* Owners: whose turn it is, what they may have, what they ask for; lists by tag, keys of requests. */
#include "queue_kit.h"

/* Claims what comes next, as the dispatcher does; "" if nothing does. */
static void next_claim(char id[BW_JOB_ID_TEXT], int64_t running_most) {
    bw_turn turn = {.served = -1};
    bool found, done = false;
    bw_job *jobs;
    size_t n;
    *id = '\0';
    assert_int_equal(bw_queue_turn(q, running_most, &turn, &found), BW_OK);
    if (!found) return;
    assert_int_equal(bw_queue_candidates(q, turn.owner, 2000, 0, 1, &jobs, &n), BW_OK);
    assert_int_equal(n, 1);
    assert_int_equal(bw_queue_claim(q, jobs, 2000, &done), BW_OK);
    assert_true(done);
    snprintf(id, BW_JOB_ID_TEXT, "%s", jobs->id);
    bw_jobs_free(jobs, n);
}

static void the_job_of_b_starts_next_after_a_thousand_of_a(void **state) {
    (void)state;
    enum { MANY = 1000 };
    bw_job *jobs = calloc(MANY, sizeof *jobs), b;
    char id[BW_JOB_ID_TEXT];
    for (int i = 0; i < MANY; i++) make_job(&jobs[i], "a", 4, "{}", NULL);
    bw_submit submit = {.jobs = jobs, .count = MANY};
    assert_int_equal(bw_queue_write(q, bw_write_submit, &submit), BW_OK);
    next_claim(id, 0);
    assert_string_equal(id, jobs[0].id);
    put_job(&b, "b", 4);
    next_claim(id, 0);
    assert_string_equal(id, b.id);
    next_claim(id, 0);
    assert_string_equal(id, jobs[1].id);
    bw_jobs_free(jobs, MANY);
    bw_job_clear(&b);
}

static void owners_take_turns_in_the_order_of_their_last_ones(void **state) {
    (void)state;
    bw_job jobs[9];
    char id[BW_JOB_ID_TEXT];
    const char *const names[] = {"c", "a", "b"};
    for (int i = 0; i < 9; i++) put_job(&jobs[i], names[i / 3], 4);
    const int order[] = {3, 6, 0, 4, 7, 1, 5, 8, 2}; /* a, b, c: at first by name */
    for (int i = 0; i < 9; i++) {
        next_claim(id, 0);
        assert_string_equal(id, jobs[order[i]].id);
    }
    next_claim(id, 0);
    assert_string_equal(id, "");
    for (int i = 0; i < 9; i++) bw_job_clear(&jobs[i]);
}

static void started_then_priority_then_age_decides_among_an_owners_jobs(void **state) {
    (void)state;
    bw_job jobs[5];
    const int priorities[5] = {0, -100, 100, 0, 100}, order[4] = {2, 4, 0, 3};
    char id[BW_JOB_ID_TEXT];
    bool done;
    for (int i = 0; i < 5; i++) {
        make_job(&jobs[i], "a", 4, "{}", NULL);
        jobs[i].priority = priorities[i];
        assert_int_equal(bw_queue_insert(q, &jobs[i]), BW_OK);
    }
    assert_int_equal(bw_queue_reuse(q, &jobs[1], "", false, 1500, &done), BW_OK); /* has started: before all others */
    next_claim(id, 0);
    assert_string_equal(id, jobs[1].id);
    for (int i = 0; i < 4; i++) {
        next_claim(id, 0);
        assert_string_equal(id, jobs[order[i]].id);
    }
    for (int i = 0; i < 5; i++) bw_job_clear(&jobs[i]);
}

static void an_owner_with_enough_running_is_passed_over(void **state) {
    (void)state;
    bw_job jobs[4];
    char id[BW_JOB_ID_TEXT];
    for (int i = 0; i < 4; i++) put_job(&jobs[i], i < 3 ? "a" : "b", 4);
    const int order[] = {0, 3, 1};
    for (int i = 0; i < 3; i++) {
        next_claim(id, 2);
        assert_string_equal(id, jobs[order[i]].id);
    }
    next_claim(id, 2);
    assert_string_equal(id, "");
    for (int i = 0; i < 4; i++) bw_job_clear(&jobs[i]);
}

static void a_job_that_pauses_is_no_candidate_and_its_time_is_known(void **state) {
    (void)state;
    bw_job job, *list;
    size_t n;
    int64_t due;
    bool done;
    put_job(&job, "a", 4);
    assert_int_equal(bw_queue_claim(q, &job, 100, &done), BW_OK);
    assert_int_equal(bw_queue_retry(q, job.id, 1, "io", 5000, 200, NULL, &done), BW_OK);
    assert_int_equal(bw_queue_next_due(q, 4999, &due), BW_OK);
    assert_int_equal(due, 5000);
    assert_int_equal(bw_queue_next_due(q, 5000, &due), BW_OK);
    assert_int_equal(due, 0);
    assert_int_equal(bw_queue_candidates(q, "a", 4999, 0, 8, &list, &n), BW_OK);
    assert_int_equal(n, 0);
    bw_jobs_free(list, n);
    assert_int_equal(bw_queue_candidates(q, "a", 5000, 0, 8, &list, &n), BW_OK);
    assert_int_equal(n, 1);
    bw_jobs_free(list, n);
    bw_job_clear(&job);
}

/* ---- limits ---- */

static bw_submit_result submit(bw_job *jobs, size_t n, bw_limits limits) {
    bw_submit s = {.jobs = jobs, .count = n, .limits = limits};
    assert_int_equal(bw_queue_write(q, bw_write_submit, &s), BW_OK);
    return s.result;
}

static void a_batch_over_the_limit_of_jobs_is_refused_whole(void **state) {
    (void)state;
    bw_job jobs[5];
    bw_owner has;
    bw_limits limits = {.queued = 4};
    for (int i = 0; i < 5; i++) make_job(&jobs[i], "a", 4, "{}", NULL);
    assert_int_equal(submit(jobs, 5, limits), BW_SUBMIT_TOO_MANY);
    assert_int_equal(bw_queue_owner(q, "a", &has), BW_OK);
    assert_int_equal(has.waiting, 0);
    assert_int_equal(submit(jobs, 4, limits), BW_SUBMIT_ACCEPTED);
    assert_int_equal(submit(jobs + 4, 1, limits), BW_SUBMIT_TOO_MANY);
    bool done;
    assert_int_equal(bw_queue_claim(q, jobs, 1, &done), BW_OK);
    assert_int_equal(submit(jobs + 4, 1, limits), BW_SUBMIT_TOO_MANY); /* running ones count too */
    assert_int_equal(bw_queue_dismiss(q, jobs->id, 1, 2, NULL, &done), BW_OK);
    assert_int_equal(submit(jobs + 4, 1, limits), BW_SUBMIT_ACCEPTED);
    bw_change again = {.id = jobs->id, .now = 3, .limits = limits};
    assert_int_equal(bw_queue_write(q, bw_write_restart, &again), BW_OK);
    assert_int_equal(again.result, BW_CHANGE_TOO_MANY);
    again.limits.queued = 5;
    assert_int_equal(bw_queue_write(q, bw_write_restart, &again), BW_OK);
    assert_int_equal(again.result, BW_CHANGE_DONE);
    for (int i = 0; i < 5; i++) bw_job_clear(&jobs[i]);
}

static void the_bytes_of_a_blob_count_once_per_owner(void **state) {
    (void)state;
    static const char other[] = "ffff456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";
    bw_job jobs[4];
    bw_owner has;
    bw_limits limits = {.bytes = 25};
    for (int i = 0; i < 4; i++) make_job(&jobs[i], i < 3 ? "a" : "b", 4, "{}", NULL);
    snprintf(jobs[0].parameters, sizeof jobs[0].parameters, "%s", other);
    jobs[0].parameters_bytes = 15;
    assert_int_equal(submit(jobs, 2, limits), BW_SUBMIT_ACCEPTED);
    assert_int_equal(bw_queue_owner(q, "a", &has), BW_OK);
    assert_int_equal(has.bytes, 25);
    assert_int_equal(submit(jobs + 2, 1, limits), BW_SUBMIT_ACCEPTED); /* names what it has */
    bw_job_clear(&jobs[1]);
    make_job(&jobs[1], "a", 4, "{}", NULL);
    jobs[1].input[0] = 'e';
    jobs[1].input_bytes = 1;
    assert_int_equal(submit(jobs + 1, 1, limits), BW_SUBMIT_TOO_LARGE);
    assert_int_equal(submit(jobs + 3, 1, limits), BW_SUBMIT_ACCEPTED);
    assert_int_equal(bw_queue_owner(q, "b", &has), BW_OK);
    assert_int_equal(has.bytes, 10);
    for (int i = 0; i < 4; i++) bw_job_clear(&jobs[i]);
}

/* ---- keys of requests ---- */

static void a_key_with_the_same_digest_gets_the_same_answer_and_another_is_a_conflict(void **state) {
    (void)state;
    bw_job job;
    bw_owner has;
    make_job(&job, "a", 4, "{}", NULL);
    bw_submit s = {.jobs = &job, .count = 1, .key = "k", .digest = "d", .answer = "first"};
    assert_int_equal(bw_queue_write(q, bw_write_submit, &s), BW_OK);
    assert_int_equal(s.result, BW_SUBMIT_ACCEPTED);
    assert_null(s.stored);
    bw_queue_close(q);
    assert_int_equal(bw_queue_open(path, &q), BW_OK);
    bw_job_id_make(job.id);
    s.answer = "second";
    s.limits.queued = 1; /* an answer that is known costs nothing */
    assert_int_equal(bw_queue_write(q, bw_write_submit, &s), BW_OK);
    assert_int_equal(s.result, BW_SUBMIT_KNOWN);
    assert_string_equal(s.stored, "first");
    s.digest = "e";
    assert_int_equal(bw_queue_write(q, bw_write_submit, &s), BW_OK);
    assert_int_equal(s.result, BW_SUBMIT_CONFLICT);
    assert_null(s.stored);
    assert_int_equal(bw_queue_owner(q, "a", &has), BW_OK);
    assert_int_equal(has.waiting, 1);
    snprintf(job.owner, sizeof job.owner, "b"); /* keys are each owner's own */
    assert_int_equal(bw_queue_write(q, bw_write_submit, &s), BW_OK);
    assert_int_equal(s.result, BW_SUBMIT_ACCEPTED);
    bw_job_clear(&job);
}

/* ---- restart and removal ---- */

static void a_restarted_job_keeps_its_stages_and_counts_its_attempts_on(void **state) {
    (void)state;
    bw_job job, now;
    bool done;
    put_job(&job, "a", 3);
    assert_int_equal(bw_queue_claim(q, &job, 1, &done), BW_OK);
    assert_int_equal(bw_queue_advance(q, job.id, 1, &(bw_made){hash, 1, 0, NULL, false, NULL}, 2, NULL, &done), BW_OK);
    now = get_job(job.id);
    assert_int_equal(bw_queue_claim(q, &now, 3, &done), BW_OK);
    assert_int_equal(bw_queue_fail(q, job.id, 2, "syntax", "{}", 4, NULL, &done), BW_OK);
    bw_job_clear(&now);
    bw_change again = {.id = job.id, .now = 5};
    assert_int_equal(bw_queue_write(q, bw_write_restart, &again), BW_OK);
    assert_int_equal(again.result, BW_CHANGE_DONE);
    now = get_job(job.id);
    assert_true(now.state == BW_JOB_QUEUED && now.stage == 1 && now.attempt == 2 && now.tries == 0 && !now.failure && !now.finished);
    bw_queue_fail(q, job.id, 2, "syntax", "{}", 6, NULL, &done); /* the old attempt can end nothing */
    assert_false(done);
    assert_int_equal(bw_queue_claim(q, &now, 7, &done), BW_OK);
    assert_true(done && now.attempt == 3);
    bw_job_clear(&now);
    bw_job_clear(&job);
}

static void only_an_ended_job_is_removed_and_its_id_is_remembered(void **state) {
    (void)state;
    bw_job job;
    bool done, gone;
    make_job(&job, "a", 1, "{}", "[\"x\",\"y\"]");
    assert_int_equal(bw_queue_insert(q, &job), BW_OK);
    bw_change remove = {.id = job.id, .now = 9};
    assert_int_equal(bw_queue_write(q, bw_write_delete, &remove), BW_OK);
    assert_int_equal(remove.result, BW_CHANGE_TOO_EARLY);
    assert_int_equal(bw_queue_claim(q, &job, 1, &done), BW_OK);
    assert_int_equal(bw_queue_advance(q, job.id, 1, &(bw_made){hash, 1, 0, "[]", false, NULL}, 2, NULL, &done), BW_OK);
    assert_int_equal(bw_queue_is_gone(q, job.id, &gone), BW_OK);
    assert_false(gone);
    assert_int_equal(bw_queue_write(q, bw_write_delete, &remove), BW_OK);
    assert_int_equal(remove.result, BW_CHANGE_DONE);
    assert_false(is_there(job.id));
    assert_int_equal(bw_queue_is_gone(q, job.id, &gone), BW_OK);
    assert_true(gone);
    assert_int_equal(bw_queue_write(q, bw_write_delete, &remove), BW_OK);
    assert_int_equal(remove.result, BW_CHANGE_UNKNOWN);
    bw_job_clear(&job);
}

/* ---- lists ---- */

static int64_t page(bw_filter filter, int64_t before, int limit, char ids[][BW_JOB_ID_TEXT], size_t *n) {
    bw_job *jobs;
    int64_t next;
    assert_int_equal(bw_queue_list(q, &filter, before, limit, &jobs, n, &next), BW_OK);
    for (size_t i = 0; i < *n; i++) snprintf(ids[i], BW_JOB_ID_TEXT, "%s", jobs[i].id);
    bw_jobs_free(jobs, *n);
    return next;
}

/* The newest job before `i` that passes; -1: none. What the jobs are is told by their place. */
static int next_match(const bw_filter *filter, int i) {
    for (i--; i >= 0; i--)
        if ((filter->state < 0 || (filter->state == BW_JOB_DISMISSED) == (i % 5 == 0)) && (!filter->owner || i % 2) &&
            (!filter->tag || i % 3))
            return i;
    return -1;
}

/* All pages of a filter give the jobs that match, newest first, each once. */
static void pages_of_every_filter_give_each_job_once(void **state) {
    (void)state;
    enum { N = 60 };
    bw_job jobs[N], *got;
    bw_cancel ignored;
    for (int i = 0; i < N; i++) {
        make_job(&jobs[i], i % 2 ? "a" : "b", 4, "{}", i % 3 ? "[\"red\",\"red\",\"big one\"]" : NULL);
        assert_int_equal(bw_queue_insert(q, &jobs[i]), BW_OK);
        if (i % 5 == 0) assert_int_equal(bw_queue_cancel(q, jobs[i].id, 1, &ignored), BW_OK);
    }
    for (int f = 0; f < 12; f++) {
        bw_filter filter = {.state = f & 1 ? BW_JOB_DISMISSED : f & 8 ? BW_JOB_QUEUED : -1, .owner = f & 2 ? "a" : NULL,
                            .tag = f & 4 ? "red" : NULL};
        char ids[7][BW_JOB_ID_TEXT];
        size_t n;
        int64_t before = 0;
        int expected = next_match(&filter, N);
        do {
            before = page(filter, before, 7, ids, &n);
            for (size_t at = 0; at < n; at++, expected = next_match(&filter, expected)) {
                assert_true(expected >= 0);
                assert_string_equal(ids[at], jobs[expected].id);
            }
        } while (before);
        assert_int_equal(expected, -1);
    }
    size_t n;
    int64_t next;
    bw_filter big = {.state = -1, .tag = "big one"};
    assert_int_equal(bw_queue_list(q, &big, 0, 1, &got, &n, &next), BW_OK);
    assert_string_equal(got->tags, "[\"big one\",\"red\"]");
    bw_jobs_free(got, n);
    for (int i = 0; i < N; i++) bw_job_clear(&jobs[i]);
}

/* A filter that hardly anything passes looks at a bounded number of rows per page, and still comes to the end. */
static void a_page_looks_at_a_bounded_number_of_rows(void **state) {
    (void)state;
    enum { N = 2500 };
    bw_job *jobs = calloc(N, sizeof *jobs);
    char ids[7][BW_JOB_ID_TEXT];
    size_t n;
    for (int i = 0; i < N; i++) make_job(&jobs[i], i ? "a" : "b", 4, "{}", "[\"red\"]");
    assert_int_equal(submit(jobs, 1, (bw_limits){0}), BW_SUBMIT_ACCEPTED);
    assert_int_equal(submit(jobs + 1, N - 1, (bw_limits){0}), BW_SUBMIT_ACCEPTED);
    bw_filter filter = {.state = -1, .owner = "b", .tag = "red"};
    int64_t before = 0;
    int pages = 0, found = 0;
    do {
        before = page(filter, before, 7, ids, &n);
        found += (int)n;
        pages++;
    } while (before);
    assert_int_equal(found, 1);
    assert_string_equal(ids[0], jobs[0].id);
    assert_int_equal(pages, 3);
    bw_jobs_free(jobs, N);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(the_job_of_b_starts_next_after_a_thousand_of_a, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(owners_take_turns_in_the_order_of_their_last_ones, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(started_then_priority_then_age_decides_among_an_owners_jobs, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(an_owner_with_enough_running_is_passed_over, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_job_that_pauses_is_no_candidate_and_its_time_is_known, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_batch_over_the_limit_of_jobs_is_refused_whole, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(the_bytes_of_a_blob_count_once_per_owner, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_key_with_the_same_digest_gets_the_same_answer_and_another_is_a_conflict, open_queue,
                                        close_queue),
        cmocka_unit_test_setup_teardown(a_restarted_job_keeps_its_stages_and_counts_its_attempts_on, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(only_an_ended_job_is_removed_and_its_id_is_remembered, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(pages_of_every_filter_give_each_job_once, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_page_looks_at_a_bounded_number_of_rows, open_queue, close_queue),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
