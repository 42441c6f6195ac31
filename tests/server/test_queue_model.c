/* The queue against a model in memory: thousands of random operations, with outdated attempts, restarts and reopenings among them.
 * After each one the job is as the model says; at intervals the owners' counters equal a recount of the rows, the journal has one
 * event for every change, and the turn is the model's. BW_SEED chooses another sequence. */
#include "queue_kit.h"

#include <sqlite3.h>
#include <time.h>

enum { JOBS = 60, OWNERS = 4, STEPS = 4000, STAGES = 3 };

typedef struct {
    char id[BW_JOB_ID_TEXT];
    int owner;
    bool there, gone, open, cancel, finish;
    int state, stage, attempt, tries, interruptions, events;
} model;

static model jobs[JOBS];
static int64_t served[OWNERS]; /* number of its last turn */
static int64_t turns;
static const char *const owners[OWNERS] = {"", "ada", "bob", "cyd"};
static uint64_t random_state;

static uint32_t pick(uint32_t n) {
    random_state = random_state * UINT64_C(6364136223846793005) + UINT64_C(1442695040888963407);
    return (uint32_t)(random_state >> 33) % n;
}

static bool waits(const model *m) { return m->there && !m->open && m->state <= BW_JOB_RUNNING; }
static bool has_ended(const model *m) { return m->there && m->state > BW_JOB_RUNNING; }

static void compare(const model *m) {
    bw_job job;
    bool found, gone;
    assert_int_equal(bw_queue_get(q, m->id, &job, &found), BW_OK);
    assert_int_equal(found, m->there);
    assert_int_equal(bw_queue_is_gone(q, m->id, &gone), BW_OK);
    assert_int_equal(gone, m->gone);
    if (!found) return;
    assert_int_equal(job.state, m->state);
    assert_int_equal(job.open, m->open);
    assert_int_equal(job.stage, m->stage);
    assert_int_equal(job.attempt, m->attempt);
    assert_int_equal(job.tries, m->tries);
    assert_int_equal(job.cancel, m->cancel);
    assert_int_equal(job.finish, m->finish);
    assert_string_equal(job.owner, owners[m->owner]);
    bw_job_clear(&job);
}

/* ---- operations: each does the same to the queue and to the model ---- */

static void do_insert(model *m) {
    bw_job job;
    if (m->there) return;
    memset(m, 0, sizeof *m);
    m->owner = (int)pick(OWNERS);
    make_job(&job, owners[m->owner], STAGES, "{}", pick(2) ? "[\"red\"]" : NULL);
    snprintf(m->id, sizeof m->id, "%s", job.id);
    assert_int_equal(bw_queue_insert(q, &job), BW_OK);
    bw_job_clear(&job);
    m->there = true;
    m->events = 1;
}

static void take_turn(model *m) { served[m->owner] = ++turns; }

static void do_claim(model *m, bool reuse) {
    bool done, outdated = pick(4) == 0, right = waits(m) && !outdated;
    bw_job job = {.attempt = m->attempt - outdated, .stage = m->stage, .stage_count = STAGES};
    snprintf(job.id, sizeof job.id, "%s", m->id);
    if (reuse) assert_int_equal(bw_queue_reuse(q, &job, "", false, 5, &done), BW_OK);
    else assert_int_equal(bw_queue_claim(q, &job, 5, &done), BW_OK);
    assert_int_equal(done, right);
    if (!right) return;
    take_turn(m);
    m->attempt++;
    m->events++;
    m->state = BW_JOB_RUNNING;
    if (reuse) {
        m->stage++;
        m->tries = m->interruptions = 0;
        if (m->stage == STAGES) m->state = BW_JOB_SUCCESSFUL;
    } else {
        m->open = true;
        m->tries++;
    }
}

static void do_end(model *m) {
    int attempt = m->attempt - (pick(4) == 0), kind = (int)pick(5);
    bool done, right = m->there && m->open && attempt == m->attempt && !(m->cancel && (kind == 0 || kind == 2)); /* a cancel wins */
    char key[BW_SHA256_TEXT];
    snprintf(key, sizeof key, "%064x", pick(1000));
    int64_t due = 10 + pick(10);
    if (kind == 0) assert_int_equal(bw_queue_advance(q, m->id, attempt, &(bw_made){key, 3, 0, "[]", false, NULL}, 6, NULL, &done), BW_OK);
    if (kind == 1) assert_int_equal(bw_queue_retry(q, m->id, attempt, "io", due, 6, NULL, &done), BW_OK);
    if (kind == 2) assert_int_equal(bw_queue_fail(q, m->id, attempt, "syntax", "{}", 6, NULL, &done), BW_OK);
    if (kind == 3) assert_int_equal(bw_queue_dismiss(q, m->id, attempt, 6, NULL, &done), BW_OK);
    if (kind == 4) assert_int_equal(bw_queue_interrupt(q, m->id, attempt, 6, &done), BW_OK);
    assert_int_equal(done, right);
    if (!right) return;
    m->open = false;
    m->events++;
    if (kind == 0) {
        m->stage++;
        m->tries = m->interruptions = 0;
    }
    m->tries -= kind == 4;
    m->state = kind == 0 ? (m->stage == STAGES ? BW_JOB_SUCCESSFUL : BW_JOB_RUNNING)
               : kind == 2 ? BW_JOB_FAILED : kind == 3 ? BW_JOB_DISMISSED : BW_JOB_QUEUED;
}

static void change(model *m, bw_write_fn fn, bw_change_result expected) {
    bw_change c = {.id = m->id, .now = 7};
    assert_int_equal(bw_queue_write(q, fn, &c), BW_OK);
    assert_int_equal(c.result, expected);
}

static void do_cancel(model *m) {
    bool late = m->state == BW_JOB_SUCCESSFUL || m->state == BW_JOB_FAILED;
    change(m, bw_write_cancel, !m->there ? BW_CHANGE_UNKNOWN : late ? BW_CHANGE_TOO_LATE : m->open ? BW_CHANGE_NOTED : BW_CHANGE_DONE);
    if (!m->there || late) return;
    if (m->open) {
        m->events += !m->cancel;
    } else {
        m->events += m->state != BW_JOB_DISMISSED;
        if (m->state == BW_JOB_DISMISSED) return; /* nothing more is written */
        m->state = BW_JOB_DISMISSED;
    }
    m->cancel = true;
}

static void do_finish(model *m) {
    change(m, bw_write_finish, !m->there ? BW_CHANGE_UNKNOWN : has_ended(m) ? BW_CHANGE_TOO_LATE : BW_CHANGE_NOTED);
    if (!m->there || has_ended(m)) return;
    m->events += !m->finish;
    m->finish = true;
}

static void do_restart(model *m) {
    change(m, bw_write_restart, !m->there ? BW_CHANGE_UNKNOWN : !has_ended(m) ? BW_CHANGE_TOO_EARLY
                                : m->state == BW_JOB_SUCCESSFUL ? BW_CHANGE_TOO_LATE : BW_CHANGE_DONE);
    if (!has_ended(m) || m->state == BW_JOB_SUCCESSFUL) return;
    m->state = BW_JOB_QUEUED;
    m->cancel = m->finish = false;
    m->tries = m->interruptions = 0;
    m->events++;
}

static void do_delete(model *m) {
    change(m, bw_write_delete, !m->there ? BW_CHANGE_UNKNOWN : has_ended(m) ? BW_CHANGE_DONE : BW_CHANGE_TOO_EARLY);
    if (!has_ended(m)) return;
    m->there = false;
    m->gone = true;
    m->events = 0;
}

static void do_recover(bool reopen) {
    int recovered, expected = 0;
    if (reopen) {
        bw_queue_close(q);
        assert_int_equal(bw_queue_open(path, &q), BW_OK);
    }
    assert_int_equal(bw_queue_recover(q, 8, &recovered), BW_OK);
    for (model *m = jobs; m < jobs + JOBS; m++) {
        if (!m->there || !m->open) continue;
        expected++;
        m->open = false;
        m->events++;
        if (m->cancel) {
            m->state = BW_JOB_DISMISSED;
        } else if (m->interruptions >= BW_INTERRUPTIONS_MOST) {
            m->state = BW_JOB_FAILED;
        } else {
            m->state = BW_JOB_QUEUED;
            m->tries--;
            m->interruptions++;
        }
    }
    assert_int_equal(recovered, expected);
}

/* ---- the whole ---- */

static void check_counters(void) {
    for (int o = 0; o < OWNERS; o++) {
        bw_owner is, should = {0};
        for (const model *m = jobs; m < jobs + JOBS; m++) {
            if (!m->there || m->owner != o) continue;
            should.waiting += waits(m);
            should.running += m->open;
            should.finished += has_ended(m);
        }
        assert_int_equal(bw_queue_owner(q, owners[o], &is), BW_OK);
        assert_int_equal(is.waiting, should.waiting);
        assert_int_equal(is.running, should.running);
        assert_int_equal(is.finished, should.finished);
    }
}

/* The order of turns is that of the model: owners with waiting jobs by their last turn, those without one by name first. */
static void check_turns(void) {
    bw_turn turn = {.served = -1};
    bool found = true;
    int64_t last = -1;
    int met = 0, expected = 0;
    for (int o = 0; o < OWNERS; o++) {
        bool any = false;
        for (const model *m = jobs; m < jobs + JOBS; m++) any = any || (m->owner == o && waits(m));
        expected += any;
    }
    while (found) {
        assert_int_equal(bw_queue_turn(q, 0, &turn, &found), BW_OK);
        if (!found) break;
        int o = 0;
        while (strcmp(owners[o], turn.owner)) o++;
        assert_true(served[o] > last || (served[o] == 0 && last <= 0));
        last = served[o];
        met++;
    }
    assert_int_equal(met, expected);
}

static int count_rows(sqlite3 *db, const char *sql, const char *id) {
    sqlite3_stmt *stmt;
    assert_int_equal(sqlite3_prepare_v2(db, sql, -1, &stmt, NULL), SQLITE_OK);
    sqlite3_bind_text(stmt, 1, id, -1, SQLITE_STATIC);
    assert_int_equal(sqlite3_step(stmt), SQLITE_ROW);
    int n = sqlite3_column_int(stmt, 0);
    sqlite3_finalize(stmt);
    return n;
}

/* One event per change, nothing left of what was deleted, one open attempt per open job. */
static void check_rows(void) {
    sqlite3 *db;
    assert_int_equal(sqlite3_open_v2(path, &db, SQLITE_OPEN_READONLY, NULL), SQLITE_OK);
    for (const model *m = jobs; m < jobs + JOBS; m++) {
        if (!*m->id) continue;
        assert_int_equal(count_rows(db, "SELECT count(*) FROM events WHERE job = ?", m->id), m->events);
        assert_int_equal(count_rows(db, "SELECT count(*) FROM attempts WHERE job = ?", m->id), m->there ? m->attempt : 0);
        assert_int_equal(count_rows(db, "SELECT count(*) FROM attempts WHERE job = ? AND finished = 0", m->id), m->there && m->open);
    }
    assert_int_equal(count_rows(db, "SELECT count(*) FROM tags WHERE seq NOT IN (SELECT seq FROM jobs)", ""), 0);
    assert_int_equal(count_rows(db, "SELECT count(*) FROM events e JOIN jobs j ON j.id = e.job WHERE e.seq ="
                                " (SELECT max(seq) FROM events WHERE job = j.id) AND json_extract(e.data, '$.attempt') <> j.attempt",
                                ""), 0);
    sqlite3_close(db);
}

static void a_random_sequence_leaves_what_the_model_says(void **state) {
    (void)state;
    const char *given = getenv("BW_SEED");
    random_state = given ? strtoull(given, NULL, 10) : (uint64_t)time(NULL);
    print_message("seed %llu\n", (unsigned long long)random_state);
    for (int i = 0; i < STEPS; i++) {
        model *m = &jobs[pick(JOBS)];
        uint32_t kind = pick(40);
        if (kind < 8 && *m->id == '\0') do_insert(m);
        else if (kind < 8) do_insert(m->gone && !m->there ? m : &jobs[pick(JOBS)]);
        else if (!*m->id) continue;
        else if (kind < 17) do_claim(m, false);
        else if (kind < 19) do_claim(m, true);
        else if (kind < 28) do_end(m);
        else if (kind < 31) do_cancel(m);
        else if (kind < 33) do_finish(m);
        else if (kind < 36) do_restart(m);
        else if (kind < 39) do_delete(m);
        else do_recover(pick(4) == 0);
        if (*m->id) compare(m);
        if (i % 50) continue;
        check_counters();
        check_turns();
        if (i % 500 == 0) check_rows();
    }
    do_recover(true);
    for (const model *m = jobs; m < jobs + JOBS; m++)
        if (*m->id) compare(m);
    check_counters();
    check_rows();
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(a_random_sequence_leaves_what_the_model_says, open_queue, close_queue),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
