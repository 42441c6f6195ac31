/* The queue: durable inserts per second, one caller alone and 64 at once; with a million rows (or as many as asked for) times of get,
 * list and claim; recovery with 100 000 open attempts.
 *     bench_queue [ROWS [FOLDER]]     FOLDER: on the disk to be measured; /tmp
 */
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "machine.h"
#include "server/files.h"
#include "server/queue/writer.h"

enum { THREADS = 64, SECONDS = 3, OWNERS = 10, CHUNK = 1000, GETS = 5000, LISTS = 2000, CLAIMS = 1000, OPEN = 100000 };

static bw_queue *q;
static atomic_bool over;
static const char hash[] = "0123456789abcdef0123456789abcdef0123456789abcdef0123456789abcdef";

static void must(bw_status status, const char *what) {
    if (status == BW_OK) return;
    fprintf(stderr, "%s: %s\n", what, "failed");
    exit(1);
}

static void make(bw_job *job, int i) {
    memset(job, 0, sizeof *job);
    bw_job_id_make(job->id);
    memcpy(job->input, hash, sizeof hash);
    snprintf(job->owner, sizeof job->owner, "owner-%d", i % OWNERS);
    job->options = strdup("{\"complex\":\"mc\",\"effort\":1,\"until\":\"encode\"}");
    job->tags = i % 10 ? NULL : strdup("[\"nightly\"]");
    job->stage_count = 8;
    job->priority = i % 7 - 3;
    job->created = 1700000000000 + i;
    job->input_bytes = 1000;
}

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static void tell(const char *what, double *seconds, size_t n) {
    if (!n) return;
    qsort(seconds, n, sizeof *seconds, by_value);
    printf("%-20s p50 %7.3f ms   p99 %7.3f ms   max %7.3f ms\n", what, 1e3 * seconds[n / 2], 1e3 * seconds[n * 99 / 100], 1e3 * seconds[n - 1]);
    fflush(stdout);
}

/* ---- inserts ---- */

typedef struct {
    size_t count;
    double seconds[1 << 16]; /* of the first ones */
} inserts;

static void *insert_loop(void *user) {
    inserts *all = user;
    for (; !atomic_load(&over); all->count++) {
        bw_job job;
        make(&job, (int)all->count);
        double from = bench_seconds();
        must(bw_queue_insert(q, &job), "insert");
        if (all->count < 1 << 16) all->seconds[all->count] = bench_seconds() - from;
        bw_job_clear(&job);
    }
    return NULL;
}

static void time_inserts(int threads) {
    pthread_t thread[THREADS];
    inserts *all = calloc((size_t)threads, sizeof *all);
    size_t sum = 0;
    bw_queue_stats before, after;
    bw_queue_statistics(q, &before);
    atomic_store(&over, false);
    double from = bench_seconds();
    for (int i = 0; i < threads; i++) pthread_create(&thread[i], NULL, insert_loop, &all[i]);
    while (bench_seconds() - from < SECONDS) nanosleep(&(struct timespec){0, 50000000}, NULL);
    atomic_store(&over, true);
    for (int i = 0; i < threads; i++) pthread_join(thread[i], NULL), sum += all[i].count;
    double seconds = bench_seconds() - from, *times = calloc(sum, sizeof *times);
    size_t n = 0;
    for (int i = 0; i < threads; i++)
        for (size_t k = 0; k < all[i].count && k < 1 << 16; k++) times[n++] = all[i].seconds[k];
    bw_queue_statistics(q, &after);
    printf("insert, %2d at once   %8.0f /s   %.1f per commit\n", threads, (double)sum / seconds,
           (double)(after.writes - before.writes) / (double)(after.commits - before.commits));
    tell("  each", times, n);
    free(times);
    free(all);
}

/* ---- many rows ---- */

typedef struct {
    int from, count;
    char (*ids)[BW_JOB_ID_TEXT];
} filling;

static bw_status fill(bw_writer *w, void *user) {
    const filling *f = user;
    bw_job *jobs = calloc(CHUNK, sizeof *jobs);
    bw_status status = jobs ? BW_OK : BW_E_MEMORY;
    for (int at = 0; status == BW_OK && at < f->count; at += CHUNK) {
        int n = f->count - at < CHUNK ? f->count - at : CHUNK;
        for (int o = 0; status == BW_OK && o < OWNERS; o++) { /* a submission has one owner */
            int k = 0;
            for (int i = 0; i < n; i++)
                if ((f->from + at + i) % OWNERS == o) make(&jobs[k], f->from + at + i), memcpy(f->ids[f->from + at + i], jobs[k++].id, BW_JOB_ID_TEXT);
            bw_submit submit = {.jobs = jobs, .count = (size_t)k};
            if (k) status = bw_write_submit(w, &submit);
            for (int i = 0; i < k; i++) bw_job_clear(&jobs[i]);
        }
    }
    free(jobs);
    return status;
}

/* Nine in ten have ended. */
static bw_status end_most(bw_writer *w, void *user) {
    (void)user;
    return bw_sql_script(&w->sql, "UPDATE jobs SET state = 2 + seq % 3, finished = created + 1000 WHERE seq % 10 <> 0");
}

static bw_status open_many(bw_writer *w, void *user) {
    (void)user;
    char sql[300];
    snprintf(sql, sizeof sql, "UPDATE jobs SET open = 1, state = 1, attempt = attempt + 1, tries = 1 WHERE seq IN"
             " (SELECT seq FROM jobs WHERE open = 0 ORDER BY seq LIMIT %d);"
             "INSERT OR IGNORE INTO attempts (job, attempt, stage, reused, started) SELECT id, attempt, 'sanitize', 0, 1 FROM jobs WHERE open = 1",
             OPEN);
    return bw_sql_script(&w->sql, sql);
}

static void time_gets(char (*ids)[BW_JOB_ID_TEXT], int rows) {
    double seconds[GETS];
    for (int i = 0; i < GETS; i++) {
        bw_job job;
        bool found;
        const char *id = ids[(int)((uint64_t)i * 2654435761u % (uint64_t)rows)];
        double from = bench_seconds();
        must(bw_queue_get(q, id, &job, &found), "get");
        seconds[i] = bench_seconds() - from;
        if (!found) must(BW_E_IO, "a job that was inserted");
        bw_job_clear(&job);
    }
    tell("get", seconds, GETS);
}

static void time_lists(const char *what, bw_filter filter, int rows) {
    double seconds[LISTS];
    for (int i = 0; i < LISTS; i++) {
        bw_job *jobs;
        size_t n;
        int64_t next, before = 1 + (int64_t)((uint64_t)i * 2654435761u % (uint64_t)rows);
        double from = bench_seconds();
        must(bw_queue_list(q, &filter, before, 50, &jobs, &n, &next), "list");
        seconds[i] = bench_seconds() - from;
        bw_jobs_free(jobs, n);
    }
    tell(what, seconds, LISTS);
}

static void time_claims(void) {
    double look[CLAIMS], take[CLAIMS];
    for (int i = 0; i < CLAIMS; i++) {
        bw_turn turn = {.served = -1};
        bw_job *jobs;
        size_t n;
        bool found, done;
        double from = bench_seconds();
        must(bw_queue_turn(q, 1000000, &turn, &found), "turn");
        must(bw_queue_candidates(q, turn.owner, 1800000000000, 0, 8, &jobs, &n), "candidates");
        look[i] = bench_seconds() - from;
        if (!n) must(BW_E_IO, "a job that waits");
        must(bw_queue_claim(q, jobs, 1800000000000, &done), "claim");
        take[i] = bench_seconds() - from;
        bw_jobs_free(jobs, n);
    }
    tell("whose turn", look, CLAIMS);
    tell("and durable claim", take, CLAIMS);
}

static void time_recovery(void) {
    int recovered;
    double from = bench_seconds();
    must(bw_queue_write(q, open_many, NULL), "opening");
    printf("%d attempts opened in %.1f s\n", OPEN, bench_seconds() - from);
    from = bench_seconds();
    must(bw_queue_recover(q, 1900000000000, &recovered), "recovery");
    printf("recovery             %.2f s for %d open attempts\n", bench_seconds() - from, recovered);
}

int main(int argc, char **argv) {
    int rows = argc > 1 ? atoi(argv[1]) : 1000000;
    char folder[200], path[220];
    snprintf(folder, sizeof folder, "%.150s/bw-bench-queue-XXXXXX", argc > 2 ? argv[2] : "/tmp");
    if (rows < 10 * CLAIMS || !mkdtemp(folder)) {
        fprintf(stderr, "bench_queue [ROWS >= %d [FOLDER]]\n", 10 * CLAIMS);
        return 2;
    }
    bench_print_machine("queue");
    snprintf(path, sizeof path, "%s/jobs.db", folder);
    must(bw_queue_open(path, &q), "open");
    time_inserts(1);
    time_inserts(THREADS);
    char(*ids)[BW_JOB_ID_TEXT] = calloc((size_t)rows, sizeof *ids);
    double from = bench_seconds();
    for (int at = 0; at < rows; at += 100000) {
        filling f = {at, rows - at < 100000 ? rows - at : 100000, ids};
        must(bw_queue_write(q, fill, &f), "fill");
    }
    must(bw_queue_write(q, end_most, NULL), "end");
    printf("%d rows made in %.0f s\n", rows, bench_seconds() - from);
    time_gets(ids, rows);
    time_lists("list", (bw_filter){.state = -1}, rows);
    time_lists("list owner, state", (bw_filter){.state = 0, .owner = "owner-3"}, rows);
    time_lists("list tag", (bw_filter){.state = -1, .tag = "nightly"}, rows);
    time_lists("list tag, owner none", (bw_filter){.state = -1, .tag = "nightly", .owner = "owner-3"}, rows);
    time_claims();
    time_inserts(THREADS);
    time_recovery();
    bw_queue_close(q);
    bw_remove_tree(folder);
    free(ids);
    return 0;
}
