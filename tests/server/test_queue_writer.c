/* The writer thread: writes that wait share a commit, one that fails is undone alone, what was told of is in the file, and the
 * write-ahead log stays small. */
#include "queue_kit.h"

#include <fcntl.h>
#include <semaphore.h>
#include <stdatomic.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

enum { MANY = 100 };

static sem_t entered, leave;

/* Keeps the thread busy until leave is posted. */
static bw_status hold(bw_writer *w, void *user) {
    (void)w, (void)user;
    sem_post(&entered);
    sem_wait(&leave);
    return BW_OK;
}

typedef struct {
    bw_job job;
    bw_submit submit;
    bw_status status;
    sem_t told;
    bool fails;
} put;

static bw_status do_put(bw_writer *w, void *user) {
    put *p = user;
    p->submit = (bw_submit){.jobs = &p->job, .count = 1};
    bw_status status = bw_write_submit(w, &p->submit);
    return p->fails ? BW_E_MEMORY : status;
}

static void put_told(void *user, bw_status status) {
    put *p = user;
    p->status = status;
    sem_post(&p->told);
}

static put *make_puts(size_t n) {
    put *puts = calloc(n, sizeof *puts);
    for (size_t i = 0; i < n; i++) {
        make_job(&puts[i].job, "", 4, "{}", NULL);
        puts[i].status = BW_E_INTERNAL;
        sem_init(&puts[i].told, 0, 0);
    }
    return puts;
}

static void free_puts(put *puts, size_t n) {
    for (size_t i = 0; i < n; i++) bw_job_clear(&puts[i].job);
    free(puts);
}

/* Posts all of them while the thread is held, so that they wait together; returns when all are told of. */
static void post_together(put *puts, size_t n) {
    sem_init(&entered, 0, 0);
    sem_init(&leave, 0, 0);
    assert_int_equal(bw_queue_post(q, hold, NULL, NULL), BW_OK);
    sem_wait(&entered);
    for (size_t i = 0; i < n; i++) assert_int_equal(bw_queue_post(q, do_put, &puts[i], put_told), BW_OK);
    sem_post(&leave);
    for (size_t i = 0; i < n; i++) sem_wait(&puts[i].told);
}

static void writes_that_wait_together_share_a_commit(void **state) {
    (void)state;
    bw_queue_stats before, after;
    put *puts = make_puts(MANY);
    bw_queue_statistics(q, &before);
    post_together(puts, MANY);
    bw_queue_statistics(q, &after);
    assert_int_equal(after.writes - before.writes, MANY + 1);
    assert_int_equal(after.commits - before.commits, 2); /* the one that held the thread, and all others */
    assert_int_equal(after.batch_most, MANY);
    assert_int_equal(after.waiting, 0);
    for (size_t i = 0; i < MANY; i++) assert_true(puts[i].status == BW_OK && is_there(puts[i].job.id));
    free_puts(puts, MANY);
}

static void a_batch_is_bounded(void **state) {
    (void)state;
    bw_queue_stats after;
    put *puts = make_puts(600);
    post_together(puts, 600);
    bw_queue_statistics(q, &after);
    assert_int_equal(after.batch_most, 256);
    free_puts(puts, 600);
}

static void a_write_that_fails_is_undone_alone(void **state) {
    (void)state;
    bw_owner counts;
    put *puts = make_puts(5);
    puts[0].fails = puts[3].fails = true;
    post_together(puts, 5);
    for (int i = 0; i < 5; i++) {
        assert_int_equal(puts[i].status, puts[i].fails ? BW_E_MEMORY : BW_OK);
        assert_int_equal(is_there(puts[i].job.id), !puts[i].fails);
    }
    assert_int_equal(bw_queue_owner(q, "", &counts), BW_OK);
    assert_int_equal(counts.waiting, 3);
    assert_true(bw_queue_healthy(q));
    free_puts(puts, 5);
}

static void a_lone_write_that_fails_is_undone(void **state) {
    (void)state;
    put *p = make_puts(1);
    p->fails = true;
    assert_int_equal(bw_queue_write(q, do_put, p), BW_E_MEMORY);
    assert_false(is_there(p->job.id));
    p->fails = false;
    assert_int_equal(bw_queue_write(q, do_put, p), BW_OK);
    assert_true(is_there(p->job.id));
    free_puts(p, 1);
}

static void closing_waits_for_all_that_was_posted(void **state) {
    (void)state;
    put *puts = make_puts(MANY);
    for (size_t i = 0; i < MANY; i++) assert_int_equal(bw_queue_post(q, do_put, &puts[i], put_told), BW_OK);
    bw_queue_close(q);
    for (size_t i = 0; i < MANY; i++) assert_int_equal(sem_trywait(&puts[i].told), 0);
    assert_int_equal(bw_queue_open(path, &q), BW_OK);
    for (size_t i = 0; i < MANY; i++) assert_true(is_there(puts[i].job.id));
    free_puts(puts, MANY);
}

/* ---- the files at a moment ---- */

static void copy_file(const char *from, const char *to) {
    char block[65536];
    int in = open(from, O_RDONLY), out = open(to, O_WRONLY | O_CREAT | O_TRUNC, 0600);
    ssize_t n;
    if (in < 0 || out < 0) abort();
    while ((n = read(in, block, sizeof block)) > 0)
        if (write(out, block, (size_t)n) != n) abort();
    close(in);
    close(out);
}

static atomic_int told;
static int told_at_copy;
static char copy[112];

/* In the writer thread: nothing else changes the files meanwhile. They are what a kill -9 would leave. */
static void count_and_copy(void *user, bw_status status) {
    char from[128], to[128];
    put *p = user;
    p->status = status;
    if (atomic_fetch_add(&told, 1) + 1 == 200) {
        told_at_copy = 200;
        snprintf(from, sizeof from, "%s-wal", path);
        snprintf(to, sizeof to, "%s-wal", copy);
        copy_file(path, copy);
        copy_file(from, to);
    }
    sem_post(&p->told);
}

static void what_was_told_of_is_in_the_files_a_crash_leaves(void **state) {
    (void)state;
    put *puts = make_puts(300);
    bw_queue *saved;
    told = 0;
    snprintf(copy, sizeof copy, "%s/copy.db", folder);
    for (size_t i = 0; i < 300; i++) {
        assert_int_equal(bw_queue_post(q, do_put, &puts[i], count_and_copy), BW_OK);
        if (i % 7 == 0) sem_wait(&puts[i].told); /* commits of all sizes */
    }
    for (size_t i = 0; i < 300; i++)
        if (i % 7) sem_wait(&puts[i].told);
    assert_int_equal(told_at_copy, 200);
    assert_int_equal(bw_queue_open(copy, &saved), BW_OK);
    bw_job *jobs;
    bw_filter all = {.state = -1};
    size_t n;
    int64_t next;
    assert_int_equal(bw_queue_list(saved, &all, 0, 300, &jobs, &n, &next), BW_OK);
    assert_true(n >= 200); /* writes are told of in the order of their numbers */
    for (size_t i = 0; i < 200; i++) assert_string_equal(jobs[n - 1 - i].id, puts[i].job.id);
    bw_jobs_free(jobs, n);
    bw_queue_close(saved);
    free_puts(puts, 300);
}

static int64_t wal_size(void) {
    struct stat st;
    char wal[128];
    snprintf(wal, sizeof wal, "%s-wal", path);
    return stat(wal, &st) == 0 ? (int64_t)st.st_size : 0;
}

static void the_log_is_bounded_and_cut_when_nothing_is_written(void **state) {
    (void)state;
    enum { BIG = 60000, JOBS = 1200 }; /* 72 MB */
    char *options = malloc(BIG);
    int64_t most = 0;
    memset(options, 'x', BIG - 1);
    options[BIG - 1] = '\0';
    for (int i = 0; i < JOBS; i += 40) {
        bw_job jobs[40];
        for (int k = 0; k < 40; k++) make_job(&jobs[k], "", 4, options, NULL);
        bw_submit submit = {.jobs = jobs, .count = 40};
        assert_int_equal(bw_queue_write(q, bw_write_submit, &submit), BW_OK);
        for (int k = 0; k < 40; k++) bw_job_clear(&jobs[k]);
        if (wal_size() > most) most = wal_size();
    }
    free(options);
    assert_true(most > 0 && most <= 40 << 20);
    for (int i = 0; i < 300 && wal_size(); i++) nanosleep(&(struct timespec){0, 100000000}, NULL);
    assert_int_equal(wal_size(), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(writes_that_wait_together_share_a_commit, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_batch_is_bounded, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_write_that_fails_is_undone_alone, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(a_lone_write_that_fails_is_undone, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(closing_waits_for_all_that_was_posted, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(what_was_told_of_is_in_the_files_a_crash_leaves, open_queue, close_queue),
        cmocka_unit_test_setup_teardown(the_log_is_bounded_and_cut_when_nothing_is_written, open_queue, close_queue),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
