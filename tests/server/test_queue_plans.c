/* No statement of the queue walks over a table: each is run once, then SQLite is asked how it goes about all that were prepared.
 * So the cost of an operation is O(log n) in the number of jobs, but for those that are about all rows and say so here. */
#include "queue_kit.h"

#include "server/queue/retention.h"

#include "server/queue/writer.h"

/* Statements that may look at all rows of a table. */
static const char *const whole[] = {
    "SELECT 1 FROM jobs LIMIT 1",                /* health: the first row */
    "SELECT total(waiting), total(running), total(finished)," /* metrics: owners, of whom there are few */
    " ifnull((SELECT created FROM jobs WHERE state = 0 ORDER BY seq LIMIT 1), 0) FROM owners",
    "DELETE FROM outputs WHERE NOT present(key)" /* at the start: every file of the cache is looked for anyway */
};
/* Indexes with rows of open attempts only. */
static const char *const small[] = {"jobs_open", "attempts_open"};

/* What triggers do is not in the plans of the statements that fire them. */
static const char *const fired[] = {
    "UPDATE owners SET waiting = waiting - 1 WHERE owner = 'x'",
    "DELETE FROM tags WHERE seq = 1",
    "DELETE FROM events WHERE job = 'x'",
    "UPDATE owners SET bytes = bytes - 1 WHERE owner = 'x'",
};

static bool is_whole(const char *sql) {
    for (size_t i = 0; i < sizeof whole / sizeof *whole; i++)
        if (!strcmp(whole[i], sql)) return true;
    return false;
}

/* One line of a plan: does it walk over a table, or sort? */
static bool is_slow(const char *line) {
    for (size_t i = 0; i < sizeof small / sizeof *small; i++)
        if (strstr(line, small[i])) return false;
    if (strstr(line, "USE TEMP B-TREE FOR ORDER BY")) return true;
    return !strncmp(line, "SCAN ", 5) && line[5] != '(' && !strstr(line, "VIRTUAL TABLE") && !strstr(line, "CONSTANT ROW");
}

static int slow_lines(sqlite3 *db, const char *sql, bool tell) {
    char *text = sqlite3_mprintf("EXPLAIN QUERY PLAN %s", sql);
    sqlite3_stmt *stmt;
    int slow = 0;
    assert_int_equal(sqlite3_prepare_v2(db, text, -1, &stmt, NULL), SQLITE_OK);
    while (sqlite3_step(stmt) == SQLITE_ROW) {
        const char *line = (const char *)sqlite3_column_text(stmt, 3);
        if (!is_slow(line)) continue;
        slow++;
        if (tell) print_message("%s\n    %s\n", sql, line);
    }
    sqlite3_finalize(stmt);
    sqlite3_free(text);
    return slow;
}

static bool keep(void *user, const char *key) {
    (void)user, (void)key;
    return true;
}

static void see_event(void *user, int64_t seq, const char *job, const char *kind, const char *data, int64_t at) {
    (void)user, (void)seq, (void)job, (void)kind, (void)data, (void)at;
}

static void use_retention(void) {
    const bw_policy policy = {9, 9, 9, 9, 9, 9, 1};
    bw_job job;
    int64_t bytes;
    bool done;
    put_job(&job, "a", 4);
    assert_int_equal(bw_queue_rewind(q, &job, 1, &done), BW_OK);
    bw_change c = {.id = job.id, .now = 1};
    assert_int_equal(bw_queue_write(q, bw_write_pin, &c), BW_OK);
    assert_int_equal(bw_queue_write(q, bw_write_unpin, &c), BW_OK);
    assert_int_equal(bw_queue_has_job(q, job.id, &done), BW_OK);
    assert_int_equal(bw_queue_adopt_blob(q, hash + 1, 1, 1, &done), BW_OK);
    assert_int_equal(bw_queue_cache_bytes(q, &bytes), BW_OK);
    assert_int_equal(bw_queue_claim(q, &job, 1, &done), BW_OK);
    assert_int_equal(bw_queue_advance(q, job.id, 1, &(bw_made){hash, 10, 0, NULL, false, NULL}, 1, NULL, &done), BW_OK);
    for (int i = 0; i < 2 * BW_KEEP_COUNT; i++) {
        bw_collect x = {.kind = (bw_keep_kind)(i / 2), .dry = i % 2 == 0, .policy = &policy};
        assert_int_equal(bw_queue_collect(q, &x), BW_OK);
    }
    bw_job_clear(&job);
}

/* Every function of queue.h, on every path that has a statement of its own. */
static void use_everything(void) {
    bw_job job, *list;
    bw_attempt *attempts;
    bw_owner owner;
    bw_turn turn = {.served = -1};
    bw_cancel cancelled;
    size_t n;
    int64_t number;
    int count;
    bool done;
    char *manifest;
    for (int round = 0; round < 8; round++) {
        make_job(&job, "a", round == 7 ? 1 : 4, "{}", "[\"t\"]");
        snprintf(job.parameters, sizeof job.parameters, "%064d", round);
        char key[8];
        snprintf(key, sizeof key, "k%d", round);
        bw_submit s = {.jobs = &job, .count = 1, .key = key, .digest = "d", .answer = "x", .limits = {100, 100, 10000}};
        assert_int_equal(bw_queue_write(q, bw_write_submit, &s), BW_OK);
        assert_int_equal(bw_queue_turn(q, 3, &turn, &done), BW_OK);
        assert_int_equal(bw_queue_candidates(q, "a", 10, 0, 8, &list, &n), BW_OK);
        bw_jobs_free(list, n);
        bw_change c = {.id = job.id, .now = 1};
        assert_int_equal(bw_queue_write(q, bw_write_finish, &c), BW_OK);
        assert_int_equal(round ? bw_queue_claim(q, &job, 1, &done) : bw_queue_reuse(q, &job, "", false, 1, &done), BW_OK);
        assert_int_equal(bw_queue_write(q, bw_write_cancel, &c), BW_OK);
        if (round == 1) assert_int_equal(bw_queue_fail(q, job.id, 1, "syntax", "{}", 2, NULL, &done), BW_OK);
        if (round == 2) assert_int_equal(bw_queue_retry(q, job.id, 1, "io", 9, 2, NULL, &done), BW_OK);
        if (round == 3) assert_int_equal(bw_queue_dismiss(q, job.id, 1, 2, NULL, &done), BW_OK);
        if (round == 4) assert_int_equal(bw_queue_interrupt(q, job.id, 1, 2, &done), BW_OK);
        if (round == 5) assert_int_equal(bw_queue_recover(q, 2, &count), BW_OK);
        if (round >= 6) assert_int_equal(bw_queue_advance(q, job.id, 1, &(bw_made){hash, 1, 0, "[]", false, NULL}, 2, NULL, &done), BW_OK);
        assert_int_equal(bw_queue_cancel(q, job.id, 3, &cancelled), BW_OK);
        assert_int_equal(bw_queue_attempts(q, job.id, &attempts, &n), BW_OK);
        free(attempts);
        assert_int_equal(bw_queue_write(q, bw_write_restart, &c), BW_OK);
        assert_int_equal(bw_queue_cancel(q, job.id, 3, &cancelled), BW_OK);
        assert_int_equal(bw_queue_write(q, bw_write_delete, &c), BW_OK);
        is_there(job.id);
        assert_int_equal(bw_queue_is_gone(q, job.id, &done), BW_OK);
        bw_job_clear(&job);
    }
    for (int f = 0; f < 8; f++) {
        bw_filter filter = {f & 1 ? 0 : -1, f & 2 ? "a" : NULL, f & 4 ? "t" : NULL};
        assert_int_equal(bw_queue_list(q, &filter, 0, 5, &list, &n, &number), BW_OK);
        bw_jobs_free(list, n);
    }
    for (int j = 0; j < 3; j++) {
        bw_journal journal = {.job = j == 1 ? job.id : NULL, .owner = j == 2 ? "a" : NULL, .limit = 5};
        assert_int_equal(bw_queue_journal(q, &journal, see_event, NULL), BW_OK);
    }
    bw_job_state state;
    assert_int_equal(bw_queue_journal_end(q, &number), BW_OK);
    assert_int_equal(bw_queue_state(q, job.id, &state, &done), BW_OK);
    assert_int_equal(bw_queue_owner(q, "a", &owner), BW_OK);
    bw_load load;
    assert_int_equal(bw_queue_load(q, &load), BW_OK);
    assert_int_equal(bw_queue_next_due(q, 1, &number), BW_OK);
    assert_int_equal(bw_queue_output(q, hash, &done, &manifest), BW_OK);
    free(manifest);
    assert_int_equal(bw_queue_sweep_outputs(q, keep, NULL, &count), BW_OK);
    assert_int_equal(bw_queue_forget_output(q, hash), BW_OK);
    assert_true(bw_queue_healthy(q));
    use_retention();
}

static int slow_statements(const bw_sql *sql, int *statements) {
    int slow = 0;
    for (size_t i = 0; i < BW_SQL_STATEMENTS_MOST; i++) {
        const char *text = sql->known[i].text;
        if (!text || is_whole(text) || strncmp(text, "PRAGMA", 6) == 0) continue;
        (*statements)++;
        slow += slow_lines(sql->db, text, true) > 0;
    }
    return slow;
}

static void no_statement_walks_over_a_table(void **state) {
    (void)state;
    int statements = 0, slow = 0;
    use_everything();
    slow += slow_statements(&q->writer.sql, &statements);
    slow += slow_statements(&q->readers[0], &statements);
    for (size_t i = 0; i < sizeof fired / sizeof *fired; i++) slow += slow_lines(q->writer.sql.db, fired[i], true);
    print_message("%d statements\n", statements);
    assert_int_equal(slow, 0);
    assert_true(statements > 40);
}

static void one_that_does_is_seen(void **state) {
    (void)state;
    assert_true(slow_lines(q->writer.sql.db, "SELECT * FROM jobs WHERE name = 'x'", false) > 0);
    assert_true(slow_lines(q->writer.sql.db, "SELECT * FROM jobs WHERE state = 1 ORDER BY due", false) > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(no_statement_walks_over_a_table, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(one_that_does_is_seen, open_queue, close_queue),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
