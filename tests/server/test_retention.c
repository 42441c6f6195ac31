/* Retention: whatever jobs, pins, reuses and times there were, nothing that is in use goes and nothing stays that is to go. The clock is a
 * number here; nobody waits. */
#include "queue_kit.h"

#include <dirent.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdatomic.h>
#include <sys/stat.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/metrics.h"
#include "server/retention.h"
#include "server/store.h"

enum { JOBS = 60, OUTPUTS = 24, BLOBS = 12, OWNERS = 3, STEPS = 1500, HOUR = 3600000 };

static bw_store *store;
static bw_config config;
static bw_retention *retention;
static uint64_t seed;
static int64_t now;

static int open_all(void **state) {
    if (open_queue(state) != 0 || bw_store_open(folder, &store) != BW_OK) return -1;
    memset(&config, 0, sizeof config);
    return bw_retention_open(&config, store, q, &retention) == BW_OK ? 0 : -1;
}

static int close_all(void **state) {
    bw_retention_close(retention);
    bw_store_close(store);
    return close_queue(state);
}

static unsigned pick(unsigned n) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (unsigned)(seed >> 33) % n;
}

static void start_random(void) {
    const char *given = getenv("BW_SEED");
    seed = given ? strtoull(given, NULL, 10) : (uint64_t)bw_mono_us();
    print_message("BW_SEED=%llu\n", (unsigned long long)seed);
    now = 1000000000;
}

/* ---- files ---- */

static void name_of(int number, char name[BW_SHA256_TEXT]) { snprintf(name, BW_SHA256_TEXT, "%02x%062x", number & 0xff, number); }

static void make_file(const char *kind, const char *name, size_t bytes) {
    char file[300];
    snprintf(file, sizeof file, "%s/%s/%.2s", folder, kind, name);
    mkdir(file, 0700);
    snprintf(file, sizeof file, "%s/%s/%.2s/%s", folder, kind, name, name);
    int fd = open(file, O_WRONLY | O_CREAT, 0600);
    assert_true(fd >= 0);
    assert_int_equal(ftruncate(fd, (off_t)bytes), 0);
    close(fd);
}

static bool there(const char *kind, const char *name) {
    char file[300];
    snprintf(file, sizeof file, "%s/%s/%.2s/%s", folder, kind, name, name);
    return access(file, F_OK) == 0;
}

static bool present(void *user, const char *sha256) { return bw_store_has_blob(user, sha256); }

/* ---- the model ---- */

typedef struct {
    char id[BW_JOB_ID_TEXT];
    bool there, pinned;
    bw_job_state state;
    int owner, input, output; /* output: number of the last one made, -1 none */
    int stage;
    int64_t finished;
} model;

static model jobs[JOBS];
static int64_t output_bytes[OUTPUTS], output_used[OUTPUTS]; /* 0: not there */
static int64_t blob_used[BLOBS][OWNERS];                    /* 0: no row */
static const char *const owners[OWNERS] = {"", "a", "b"};

static bool has_row(int output) {
    char key[BW_SHA256_TEXT];
    bool found;
    name_of(output, key);
    assert_int_equal(bw_queue_output(q, key, &found, NULL), BW_OK);
    return found;
}

static void do_upload(int blob, int owner) {
    char name[BW_SHA256_TEXT];
    name_of(blob, name);
    make_file("blobs", name, 10);
    bw_new_blob b = {.owner = owners[owner], .sha256 = name, .bytes = 10, .now = now, .present = present, .user = store};
    assert_int_equal(bw_queue_write(q, bw_write_blob, &b), BW_OK);
    assert_false(b.lacking);
    blob_used[blob][owner] = now;
}

static void do_submit(model *m) {
    bw_job job;
    m->owner = (int)pick(OWNERS);
    m->input = (int)pick(BLOBS);
    make_job(&job, owners[m->owner], 2, "{}", pick(2) ? "[\"x\"]" : NULL);
    name_of(m->input, job.input);
    job.created = now;
    job.pinned = m->pinned = pick(8) == 0;
    bw_submit s = {.jobs = &job, .count = 1, .present = present, .user = store};
    bool has = there("blobs", job.input);
    if (pick(2)) s.key = job.id, s.digest = "d", s.answer = "x";
    assert_int_equal(bw_queue_write(q, bw_write_submit, &s), BW_OK);
    assert_int_equal(s.result, has ? BW_SUBMIT_ACCEPTED : BW_SUBMIT_NO_BLOB);
    m->there = has;
    m->state = BW_JOB_QUEUED;
    m->output = -1;
    m->stage = 0;
    m->finished = 0;
    snprintf(m->id, sizeof m->id, "%s", job.id);
    if (has) blob_used[m->input][m->owner] = now;
    bw_job_clear(&job);
}

static void end_stage(model *m, int output) {
    m->output = output;
    m->state = ++m->stage == 2 ? BW_JOB_SUCCESSFUL : BW_JOB_RUNNING;
    m->finished = m->stage == 2 ? now : 0;
}

/* A stage made anew, as the dispatcher does it: file, then row. */
static void do_stage(model *m) {
    bw_job job = get_job(m->id);
    bool done;
    int output = (int)pick(OUTPUTS);
    char key[BW_SHA256_TEXT];
    name_of(output, key);
    if (has_row(output)) { /* it is in the cache */
        assert_int_equal(bw_queue_reuse(q, &job, key, m->stage == 1, now, &done), BW_OK);
        assert_true(done);
        assert_true(there("cache", key));
        if (output_used[output] < now - 60000) output_used[output] = now;
        end_stage(m, output);
    } else {
        assert_int_equal(bw_queue_claim(q, &job, now, &done), BW_OK);
        assert_true(done);
        int end = (int)pick(8);
        bw_made made = {.key = key, .bytes = 1000 + pick(9000), .manifest = m->stage == 1 ? "[]" : NULL};
        if (end > 1) make_file("cache", key, made.bytes);
        if (end == 0) assert_int_equal(bw_queue_fail(q, job.id, job.attempt, "syntax", "{}", now, NULL, &done), BW_OK);
        else if (end == 1) assert_int_equal(bw_queue_dismiss(q, job.id, job.attempt, now, NULL, &done), BW_OK);
        else assert_int_equal(bw_queue_advance(q, job.id, job.attempt, &made, now, NULL, &done), BW_OK);
        assert_true(done);
        if (end > 1) {
            output_bytes[output] = (int64_t)made.bytes;
            output_used[output] = now;
            end_stage(m, output);
        } else {
            m->state = end ? BW_JOB_DISMISSED : BW_JOB_FAILED;
            m->finished = now;
        }
    }
    bw_job_clear(&job);
}

static void do_pin(model *m) {
    bw_change c = {.id = m->id, .now = now};
    m->pinned = !m->pinned;
    assert_int_equal(bw_queue_write(q, m->pinned ? bw_write_pin : bw_write_unpin, &c), BW_OK);
    assert_int_equal(c.result, BW_CHANGE_DONE);
}

static void do_something(void) {
    model *m = &jobs[pick(JOBS)];
    unsigned what = pick(10);
    if (what < 2) do_upload((int)pick(BLOBS), (int)pick(OWNERS));
    else if (!m->there) do_submit(m);
    else if (what == 2) do_pin(m);
    else if (m->state < BW_JOB_SUCCESSFUL) do_stage(m);
    now += pick(20) == 0 ? pick(3 * HOUR) : pick(HOUR / 8);
}

/* ---- recounting ---- */

static bool expires(const model *m, const bw_policy *p) {
    int64_t before = m->state == BW_JOB_SUCCESSFUL ? p->finished_before : p->failed_before;
    return m->there && m->state >= BW_JOB_SUCCESSFUL && !m->pinned && m->finished < before;
}

static void check_jobs(const bw_policy *p) {
    for (int i = 0; i < JOBS; i++) {
        model *m = &jobs[i];
        bool gone = false;
        if (!m->there) continue;
        bool goes = expires(m, p);
        assert_int_equal(is_there(m->id), !goes);
        assert_int_equal(bw_queue_is_gone(q, m->id, &gone), BW_OK);
        assert_int_equal(gone, goes);
        if (goes) m->there = false;
    }
}

static bool holds_output(const model *m, int output) {
    return m->there && m->output == output && m->stage > 0 && (m->state < BW_JOB_SUCCESSFUL || m->stage == 2);
}

/* Rows and files in pairs; what is in use is there; beyond the limit only what is in use; of the rest the last used. */
static void check_outputs(const bw_policy *p) {
    int64_t total = 0, loose = 0, newest_gone = 0, oldest_left = INT64_MAX, bytes, last = 0;
    for (int o = 0; o < OUTPUTS; o++) {
        char key[BW_SHA256_TEXT];
        bool held = false, row = has_row(o);
        name_of(o, key);
        assert_int_equal(row, there("cache", key));
        for (int i = 0; i < JOBS; i++) held = held || holds_output(&jobs[i], o);
        assert_true(row || !held);
        if (row) total += output_bytes[o];
        if (row && !held) loose += output_bytes[o];
        if (row && !held && output_used[o] < oldest_left) oldest_left = output_used[o];
        if (!row && output_used[o] && output_used[o] >= newest_gone) newest_gone = output_used[o], last = output_bytes[o];
        if (!row) output_used[o] = 0;
    }
    assert_int_equal(bw_queue_cache_bytes(q, &bytes), BW_OK);
    assert_int_equal(bytes, total);
    assert_true(total <= p->cache_most || loose == 0);
    assert_true(newest_gone <= oldest_left);
    if (last) assert_true(total + 10000 > p->cache_most); /* no more than had to */
}

static void check_blobs(const bw_policy *p) {
    for (int b = 0; b < BLOBS; b++) {
        char name[BW_SHA256_TEXT];
        bool any = false;
        name_of(b, name);
        for (int o = 0; o < OWNERS; o++) {
            bool owns, named = false;
            int64_t used;
            for (int i = 0; i < JOBS; i++) named = named || (jobs[i].there && jobs[i].input == b && jobs[i].owner == o);
            assert_int_equal(bw_queue_owns_blob(q, owners[o], name, &owns, &used), BW_OK);
            assert_int_equal(owns, blob_used[b][o] && (named || blob_used[b][o] >= p->blobs_before));
            if (!owns) blob_used[b][o] = 0;
            any = any || owns;
        }
        assert_int_equal(there("blobs", name), any);
    }
}

static void check_owners(void) {
    for (int o = 0; o < OWNERS; o++) {
        bw_owner has;
        int64_t bytes = 0, alive = 0;
        for (int b = 0; b < BLOBS; b++) bytes += blob_used[b][o] ? 10 : 0;
        for (int i = 0; i < JOBS; i++) alive += jobs[i].there && jobs[i].owner == o;
        assert_int_equal(bw_queue_owner(q, owners[o], &has), BW_OK);
        assert_int_equal(has.bytes, bytes);
        assert_int_equal(has.waiting + has.running + has.finished, alive);
    }
}

static void collect_and_recount(void) {
    bw_policy p = {.now = now, .finished_before = pick(4) ? now - 20 * HOUR : 0, .failed_before = pick(4) ? now - 10 * HOUR : 0,
                   .gone_before = now - 500 * HOUR, .keys_before = now - 5 * HOUR, .blobs_before = now - 3 * HOUR, .cache_most = 30000 + pick(60000)};
    bw_retention_report planned = {0}, done = {0};
    assert_int_equal(bw_retention_pass(retention, &p, true, &planned), BW_OK);
    assert_int_equal(bw_retention_pass(retention, &p, false, &done), BW_OK);
    assert_memory_equal(&planned, &done, sizeof done);
    check_jobs(&p);
    check_outputs(&p);
    check_blobs(&p);
    check_owners();
    assert_int_equal(bw_retention_pass(retention, &p, true, &planned), BW_OK); /* nothing is left to do */
    for (int i = 0; i < BW_KEEP_COUNT; i++) assert_int_equal(planned.kinds[i].count, 0);
}

static void nothing_in_use_goes_and_nothing_stays_that_is_to_go(void **state) {
    (void)state;
    start_random();
    memset(jobs, 0, sizeof jobs);
    for (int i = 0; i < STEPS; i++) {
        do_something();
        if (i % 50 == 49) collect_and_recount();
    }
}

/* ---- what goes with a job ---- */

static void an_expired_job_leaves_its_id_for_a_while_and_nothing_else(void **state) {
    (void)state;
    bw_job job;
    bw_attempt *attempts;
    size_t count;
    bool gone, found;
    char owner[BW_OWNER_TEXT];
    bw_retention_report report;
    make_job(&job, "a", 1, "{}", "[\"x\"]");
    bw_submit s = {.jobs = &job, .count = 1, .key = "k", .digest = "d", .answer = "x"};
    assert_int_equal(bw_queue_write(q, bw_write_submit, &s), BW_OK);
    int log = bw_store_append_log(store, job.id);
    close(log);
    bw_change c = {.id = job.id, .now = 2000};
    assert_int_equal(bw_queue_write(q, bw_write_cancel, &c), BW_OK);
    bw_policy p = {.now = 3000, .failed_before = 2000, .keys_before = 1001, .gone_before = 2001};
    assert_int_equal(bw_retention_pass(retention, &p, false, &report), BW_OK);
    assert_true(is_there(job.id)); /* it ended at 2000, which is not before */
    assert_int_equal(report.kinds[BW_KEEP_KEYS].count, 1);
    p.failed_before = 2001;
    assert_int_equal(bw_retention_pass(retention, &p, false, &report), BW_OK);
    assert_int_equal(report.kinds[BW_KEEP_JOBS].count, 1);
    assert_false(is_there(job.id));
    assert_int_equal(bw_queue_attempts(q, job.id, &attempts, &count), BW_OK);
    assert_int_equal(count, 0);
    free(attempts);
    uint64_t bytes;
    assert_int_equal(bw_store_open_log(store, job.id, &bytes), -1);
    assert_int_equal(bw_queue_is_gone(q, job.id, &gone), BW_OK);
    assert_true(gone);
    assert_int_equal(bw_queue_job_owner(q, job.id, owner, &found), BW_OK);
    assert_true(found);
    assert_string_equal(owner, "a");
    p.gone_before = 3001;
    assert_int_equal(bw_retention_pass(retention, &p, false, &report), BW_OK);
    assert_int_equal(bw_queue_is_gone(q, job.id, &gone), BW_OK);
    assert_false(gone);
    assert_int_equal(bw_queue_write(q, bw_write_submit, &s), BW_OK); /* the key is free again */
    assert_int_equal(s.result, BW_SUBMIT_ACCEPTED);
    bw_job_clear(&job);
}

static void count_taken(void *user, bw_keep_kind kind, const char *name) {
    char shared[BW_SHA256_TEXT];
    (void)kind;
    name_of(0, shared);
    *(int *)user += strcmp(name, shared) == 0;
}

/* Between two steps of a collection jobs come and go. */
static void a_blob_stays_while_anyone_has_a_row_of_it(void **state) {
    (void)state;
    char name[BW_SHA256_TEXT];
    bw_job job;
    bool owns;
    int64_t used;
    int taken = 0;
    make_job(&job, "a", 1, "{}", NULL);
    name_of(0, job.input);
    job.created = 1000;
    bw_submit s = {.jobs = &job, .count = 1};
    assert_int_equal(bw_queue_write(q, bw_write_submit, &s), BW_OK);
    for (int i = 1; i <= BW_COLLECT_ROWS; i++) {
        bw_new_blob b = {.owner = "b", .sha256 = name, .bytes = 1, .now = 1000 + i};
        name_of(i % BW_COLLECT_ROWS, name); /* the last of b's is a's, too */
        assert_int_equal(bw_queue_write(q, bw_write_blob, &b), BW_OK);
    }
    bw_policy p = {.now = 3000, .blobs_before = 2000};
    bw_collect c = {.kind = BW_KEEP_BLOBS, .policy = &p, .take = count_taken, .user = &taken};
    assert_int_equal(bw_queue_collect(q, &c), BW_OK); /* a's is held */
    assert_true(c.more);
    bw_change cancel = {.id = job.id, .now = 2500}, gone = {.id = job.id, .now = 2600};
    assert_int_equal(bw_queue_write(q, bw_write_cancel, &cancel), BW_OK);
    assert_int_equal(bw_queue_write(q, bw_write_delete, &gone), BW_OK);
    assert_int_equal(bw_queue_collect(q, &c), BW_OK);
    assert_int_equal(bw_queue_owns_blob(q, "b", job.input, &owns, &used), BW_OK);
    assert_false(owns);
    assert_int_equal(bw_queue_owns_blob(q, "a", job.input, &owns, &used), BW_OK);
    assert_true(owns);
    assert_int_equal(taken, 0);
    c = (bw_collect){.kind = BW_KEEP_BLOBS, .policy = &p, .take = count_taken, .user = &taken};
    assert_int_equal(bw_queue_collect(q, &c), BW_OK);
    assert_int_equal(taken, 1);
    bw_job_clear(&job);
}

static void many_go_in_small_steps(void **state) {
    (void)state;
    enum { MANY = 100 };
    bw_job *many = calloc(MANY, sizeof *many);
    bw_queue_stats before, after;
    bw_retention_report report;
    for (int i = 0; i < MANY; i++) make_job(&many[i], "a", 1, "{}", NULL);
    bw_submit s = {.jobs = many, .count = MANY};
    assert_int_equal(bw_queue_write(q, bw_write_submit, &s), BW_OK);
    for (int i = 0; i < MANY; i++) {
        bw_change c = {.id = many[i].id, .now = 2000};
        assert_int_equal(bw_queue_write(q, bw_write_cancel, &c), BW_OK);
    }
    bw_queue_statistics(q, &before);
    bw_policy p = {.now = 3000, .failed_before = 2500};
    assert_int_equal(bw_retention_pass(retention, &p, false, &report), BW_OK);
    assert_int_equal(report.kinds[BW_KEEP_JOBS].count, MANY);
    bw_queue_statistics(q, &after);
    assert_true(after.writes - before.writes >= MANY / 32);
    bw_jobs_free(many, MANY);
}

/* ---- races ---- */

static atomic_int running;
static atomic_int lost, accepted, refused;

/* PUT, then POST at once, then the job goes: all the time on the same blob, whose grace is nothing. */
static void *put_and_post(void *user) {
    const char *owner = user;
    char name[BW_SHA256_TEXT];
    for (int i = 0; i < 300; i++) {
        bw_job job;
        name_of(i % 3, name);
        make_job(&job, owner, 1, "{}", NULL);
        memcpy(job.input, name, sizeof job.input);
        job.created = bw_now_ms();
        make_file("blobs", name, 10);
        bw_new_blob b = {.owner = owner, .sha256 = name, .bytes = 10, .now = bw_now_ms(), .present = present, .user = store};
        bw_submit s = {.jobs = &job, .count = 1, .present = present, .user = store};
        bw_queue_write(q, bw_write_blob, &b);
        bw_queue_write(q, bw_write_submit, &s);
        if (s.result == BW_SUBMIT_ACCEPTED) {
            accepted++;
            lost += !there("blobs", name); /* it has a job: nothing may take it now */
            bw_change c = {.id = job.id, .now = 1};
            bw_queue_write(q, bw_write_cancel, &c);
            lost += !there("blobs", name);
            bw_queue_write(q, bw_write_delete, &c);
        } else {
            refused++;
        }
        bw_job_clear(&job);
    }
    running--;
    return NULL;
}

/* The time of collection is ahead of that of the uploads: whatever no job names goes at once. */
static void a_job_that_was_accepted_has_its_blob_whatever_is_collected(void **state) {
    (void)state;
    pthread_t threads[2];
    bw_retention_report report;
    int64_t taken = 0;
    running = 2;
    lost = accepted = refused = 0;
    for (int i = 0; i < 2; i++) assert_int_equal(pthread_create(&threads[i], NULL, put_and_post, (void *)(uintptr_t)owners[1 + i]), 0);
    while (running) {
        bw_policy p = {.now = bw_now_ms(), .blobs_before = bw_now_ms() + 1000};
        assert_int_equal(bw_retention_pass(retention, &p, false, &report), BW_OK);
        taken += report.kinds[BW_KEEP_BLOBS].count;
    }
    for (int i = 0; i < 2; i++) pthread_join(threads[i], NULL);
    print_message("accepted %d, refused %d, collected %lld\n", (int)accepted, (int)refused, (long long)taken);
    assert_int_equal(lost, 0);
    assert_int_equal(accepted + refused, 600);
    assert_true(accepted > 0 && taken > 0);
}

/* ---- at start ---- */

static void a_start_puts_rows_and_files_in_pairs_and_fails_what_cannot_be(void **state) {
    (void)state;
    bw_job waits, ended, fine;
    bw_made made = {.bytes = 5, .manifest = "[]"};
    char names[4][BW_SHA256_TEXT];
    bool done, owns;
    int64_t used;
    for (int i = 0; i < 4; i++) name_of(i, names[i]);
    make_file("blobs", names[0], 10); /* without a row: of the time before blobs had owners */
    make_file("blobs", names[1], 10);
    make_file("cache", names[3], 5);  /* a rename without its row */
    make_job(&waits, "a", 1, "{}", NULL); /* its input has no file */
    assert_int_equal(bw_queue_insert(q, &waits), BW_OK);
    make_job(&ended, "a", 1, "{}", NULL);
    memcpy(ended.input, names[1], sizeof ended.input);
    assert_int_equal(bw_queue_insert(q, &ended), BW_OK);
    make_job(&fine, "a", 1, "{}", NULL);
    memcpy(fine.input, names[0], sizeof fine.input);
    assert_int_equal(bw_queue_insert(q, &fine), BW_OK);
    assert_int_equal(bw_queue_claim(q, &ended, 100, &done), BW_OK);
    made.key = names[2]; /* its results have no file */
    assert_int_equal(bw_queue_advance(q, ended.id, 1, &made, 200, NULL, &done), BW_OK);
    int64_t failed = bw_metric_value(BW_METRIC_JOBS_ENDED, BW_JOB_FAILED - BW_JOB_SUCCESSFUL, 0);
    assert_int_equal(bw_reconcile(store, q, 5000), BW_OK);
    assert_int_equal(bw_metric_value(BW_METRIC_JOBS_ENDED, BW_JOB_FAILED - BW_JOB_SUCCESSFUL, 0), failed + 2);
    assert_false(there("cache", names[3]));
    assert_true(there("blobs", names[0]));
    for (int i = 0; i < 2; i++) {
        bw_job lost_one = get_job(i ? waits.id : ended.id);
        assert_int_equal(lost_one.state, BW_JOB_FAILED);
        assert_non_null(strstr(lost_one.failure, "/problems/files-lost"));
        bw_job_clear(&lost_one);
    }
    bw_job still = get_job(fine.id);
    assert_int_equal(still.state, BW_JOB_QUEUED);
    bw_job_clear(&still);
    assert_int_equal(bw_queue_owns_blob(q, "a", hash, &owns, &used), BW_OK);
    assert_false(owns);
    bw_change c = {.id = ended.id, .now = 6000};
    assert_int_equal(bw_queue_write(q, bw_write_restart, &c), BW_OK);
    assert_int_equal(c.result, BW_CHANGE_DONE); /* its input is there: it can be made again */
    bw_job_clear(&waits);
    bw_job_clear(&ended);
    bw_job_clear(&fine);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(nothing_in_use_goes_and_nothing_stays_that_is_to_go, open_all, close_all),
        cmocka_unit_test_setup_teardown(an_expired_job_leaves_its_id_for_a_while_and_nothing_else, open_all, close_all),
        cmocka_unit_test_setup_teardown(a_blob_stays_while_anyone_has_a_row_of_it, open_all, close_all),
        cmocka_unit_test_setup_teardown(many_go_in_small_steps, open_all, close_all),
        cmocka_unit_test_setup_teardown(a_job_that_was_accepted_has_its_blob_whatever_is_collected, open_all, close_all),
        cmocka_unit_test_setup_teardown(a_start_puts_rows_and_files_in_pairs_and_fails_what_cannot_be, open_all, close_all),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
