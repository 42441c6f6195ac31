#include "server/metrics.h"

#include <dirent.h>
#include <inttypes.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#include "bw_api.h"
#include "server/clock.h"
#include "server/retention.h"

/* ---- labels ---- */

typedef struct {
    const char *label;
    int count;
    const char *(*value)(int i);
} dimension;

static const char *stage_name(int i) { return bw_api_stages[i].name; }
static const char *end_name(int i) { return bw_job_state_names[BW_JOB_SUCCESSFUL + i]; }
static const char *problem_code(int i) { return bw_problem_types[i].code; }
static const char *operation_name(int i) { return i < BW_OP_COUNT ? bw_endpoints[i].id : "none"; }

static const char *class_name(int i) {
    static const char *const names[] = {"1xx", "2xx", "3xx", "4xx", "5xx"};
    return names[i];
}

static const char *phase_name(int i) {
    static const char *const names[] = {"waiting", "running", "ended"};
    return names[i];
}

static const char *keep_name(int i) { return bw_keep_names[i]; }

static const char *version(int i) {
    (void)i;
    return BW_VERSION;
}

static const dimension by_stage = {"stage", BW_API_STAGE_COUNT, stage_name}, by_end = {"state", BW_JOB_COUNT - BW_JOB_SUCCESSFUL, end_name},
                       by_problem = {"problem", BW_PROBLEM_COUNT, problem_code}, by_class = {"class", 5, class_name},
                       by_operation = {"operation", BW_OP_COUNT + 1, operation_name}, by_phase = {"state", 3, phase_name},
                       by_version = {"version", 1, version}, by_keep = {"kind", BW_KEEP_COUNT, keep_name};

/* ---- the table ---- */

#define S(seconds) ((int64_t)((seconds) * 1000)) /* ms */
#define U(seconds) ((int64_t)((seconds) * 1000000)) /* us */
static const int64_t request_bounds[] = {U(.001), U(.0025), U(.005), U(.01), U(.025), U(.05), U(.1), U(.25), U(1), U(5), U(30), 0};
static const int64_t fsync_bounds[] = {U(.0001), U(.0005), U(.001), U(.0025), U(.005), U(.01), U(.025), U(.1), U(.5), U(2), U(10), 0};
static const int64_t stage_bounds[] = {S(.01), S(.05), S(.1), S(.5), S(1), S(5), S(15), S(60), S(300), S(1800), S(7200), 0};
static const int64_t byte_bounds[] = {1 << 24, 1 << 26, 1 << 28, 1 << 29, 1 << 30, (int64_t)1 << 31, (int64_t)1 << 32,
                                      (int64_t)1 << 34, (int64_t)1 << 36, 0};

typedef struct {
    const char *name, *help;
    bw_metric_kind kind;
    int64_t unit; /* stored numbers in one of what is shown */
    const dimension *by[2];
    const int64_t *bounds; /* of a histogram; ends with 0 */
} row;

enum { ONE = 1, MS = 1000, US = 1000000 };

static const row rows[] = {
    [BW_METRIC_BUILD] = {"blockwright_build_info", "Version of the daemon.", BW_GAUGE, ONE, {&by_version}, 0},
    [BW_METRIC_READY] = {"blockwright_ready", "Whether /readyz says yes.", BW_GAUGE, ONE, {0}, 0},
    [BW_METRIC_JOBS] = {"blockwright_jobs", "Jobs that wait for a worker, have one, or have ended.", BW_GAUGE, ONE, {&by_phase}, 0},
    [BW_METRIC_QUEUE_AGE] = {"blockwright_queue_oldest_seconds", "Age of the oldest job that waits for its first stage.", BW_GAUGE, MS, {0}, 0},
    [BW_METRIC_QUEUE_WAIT] = {"blockwright_queue_wait_seconds", "From a job's acceptance to its first worker, if nothing of it was in the cache.",
                              BW_HISTOGRAM, MS, {0}, stage_bounds},
    [BW_METRIC_JOBS_ACCEPTED] = {"blockwright_jobs_accepted_total", "Jobs answered with 201.", BW_COUNTER, ONE, {0}, 0},
    [BW_METRIC_JOBS_ENDED] = {"blockwright_jobs_ended_total", "Jobs that have come to an end.", BW_COUNTER, ONE, {&by_end}, 0},
    [BW_METRIC_CLAIMS] = {"blockwright_stage_claims_total", "Stages given to a worker.", BW_COUNTER, ONE, {&by_stage}, 0},
    [BW_METRIC_FAILURES] = {"blockwright_failures_total", "Stages that failed, also those tried again.", BW_COUNTER, ONE, {&by_problem}, 0},
    [BW_METRIC_STAGE_SECONDS] = {"blockwright_stage_seconds", "Time of a worker by the clock.", BW_HISTOGRAM, MS, {&by_stage}, stage_bounds},
    [BW_METRIC_STAGE_CPU] = {"blockwright_stage_cpu_seconds_total", "Processor time of workers.", BW_COUNTER, MS, {&by_stage}, 0},
    [BW_METRIC_STAGE_PEAK] = {"blockwright_stage_peak_bytes", "Most memory a worker had.", BW_HISTOGRAM, ONE, {&by_stage}, byte_bounds},
    [BW_METRIC_CACHE_HITS] = {"blockwright_cache_hits_total", "Stages whose output was there already.", BW_COUNTER, ONE, {&by_stage}, 0},
    [BW_METRIC_CACHE_MISSES] = {"blockwright_cache_misses_total", "Stages whose output had to be made.", BW_COUNTER, ONE, {&by_stage}, 0},
    [BW_METRIC_CACHE_BYTES] = {"blockwright_cache_written_bytes_total", "Stage outputs filed.", BW_COUNTER, ONE, {0}, 0},
    [BW_METRIC_CACHE_SIZE] = {"blockwright_cache_bytes", "Stage outputs that are kept.", BW_GAUGE, ONE, {0}, 0},
    [BW_METRIC_COLLECTED] = {"blockwright_collected_total", "What retention has removed.", BW_COUNTER, ONE, {&by_keep}, 0},
    [BW_METRIC_COLLECTED_BYTES] = {"blockwright_collected_bytes_total", "Bytes of the outputs and blobs among it.", BW_COUNTER, ONE, {&by_keep}, 0},
    [BW_METRIC_UPLOAD_BYTES] = {"blockwright_upload_bytes_total", "Bytes of uploads received.", BW_COUNTER, ONE, {0}, 0},
    [BW_METRIC_REQUESTS] = {"blockwright_http_requests_total", "Requests answered.", BW_COUNTER, ONE, {&by_operation, &by_class}, 0},
    [BW_METRIC_REQUEST_SECONDS] = {"blockwright_http_request_seconds", "From a request's headers to the end of its answer.", BW_HISTOGRAM, US,
                                   {&by_operation}, request_bounds},
    [BW_METRIC_REPLY_BYTES] = {"blockwright_http_reply_bytes_total", "Content of answers.", BW_COUNTER, ONE, {0}, 0},
    [BW_METRIC_REQUESTS_ACTIVE] = {"blockwright_http_requests_active", "Requests under way.", BW_GAUGE, ONE, {0}, 0},
    [BW_METRIC_CONNECTIONS] = {"blockwright_http_connections", "Open connections.", BW_GAUGE, ONE, {0}, 0},
    [BW_METRIC_STREAMS] = {"blockwright_http_streams", "Open streams of events and logs.", BW_GAUGE, ONE, {0}, 0},
    [BW_METRIC_FSYNC_SECONDS] = {"blockwright_fsync_seconds", "Files and folders synced, but for those of the database.", BW_HISTOGRAM, US, {0},
                                 fsync_bounds},
    [BW_METRIC_COMMIT_SECONDS] = {"blockwright_commit_seconds", "Commits of the database, each for all that waited.", BW_HISTOGRAM, US, {0},
                                  fsync_bounds},
    [BW_METRIC_WRITES_WAITING] = {"blockwright_writes_waiting", "Changes that wait for the next commit.", BW_GAUGE, ONE, {0}, 0},
    [BW_METRIC_WAL_BYTES] = {"blockwright_wal_bytes", "Size of the database's write-ahead log.", BW_GAUGE, ONE, {0}, 0},
    [BW_METRIC_DISK_FREE] = {"blockwright_disk_free_bytes", "Room left for the data folder.", BW_GAUGE, ONE, {0}, 0},
    [BW_METRIC_WORKERS] = {"blockwright_workers", "Stages that may run at the same time.", BW_GAUGE, ONE, {0}, 0},
    [BW_METRIC_PROCESS_CPU] = {"process_cpu_seconds_total", "Processor time of the daemon, without its workers.", BW_COUNTER, MS, {0}, 0},
    [BW_METRIC_PROCESS_MEMORY] = {"process_resident_memory_bytes", "Memory of the daemon.", BW_GAUGE, ONE, {0}, 0},
    [BW_METRIC_PROCESS_FILES] = {"process_open_fds", "Open descriptors of the daemon.", BW_GAUGE, ONE, {0}, 0},
    [BW_METRIC_PROCESS_FILES_MOST] = {"process_max_fds", "Most descriptors it may have open.", BW_GAUGE, ONE, {0}, 0},
    [BW_METRIC_PROCESS_START] = {"process_start_time_seconds", "When the daemon was started, since 1970.", BW_GAUGE, MS, {0}, 0},
};
_Static_assert(sizeof rows / sizeof *rows == BW_METRIC_COUNT, "a metric without a row");

/* ---- the numbers ---- */

/* A series is one number, or for a histogram one per bucket (the last is +Inf) and the sum, and they lie one after another. */
static _Atomic int64_t *numbers;
static size_t starts[BW_METRIC_COUNT];
static pthread_once_t once = PTHREAD_ONCE_INIT;

static size_t extent(const dimension *d) { return d ? (size_t)d->count : 1; }

static size_t bucket_count(const row *r) {
    size_t n = 0;
    while (r->bounds && r->bounds[n]) n++;
    return n + 1;
}

static size_t series_size(const row *r) { return r->kind == BW_HISTOGRAM ? bucket_count(r) + 1 : 1; }

static void make_numbers(void) {
    size_t total = 0;
    for (int i = 0; i < BW_METRIC_COUNT; i++) {
        starts[i] = total;
        total += extent(rows[i].by[0]) * extent(rows[i].by[1]) * series_size(&rows[i]);
    }
    numbers = calloc(total, sizeof *numbers);
    if (!numbers) abort(); /* some kilobytes at the start */
    numbers[starts[BW_METRIC_BUILD]] = 1;
}

static _Atomic int64_t *series(bw_metric metric, int first, int second) {
    const row *r = &rows[metric];
    pthread_once(&once, make_numbers);
    return numbers + starts[metric] + ((size_t)first * extent(r->by[1]) + (size_t)second) * series_size(r);
}

static void add(_Atomic int64_t *number, int64_t more) { atomic_fetch_add_explicit(number, more, memory_order_relaxed); }
static int64_t get(_Atomic int64_t *number) { return atomic_load_explicit(number, memory_order_relaxed); }

void bw_count(bw_metric metric, int first, int second, uint64_t more) { add(series(metric, first, second), (int64_t)more); }
void bw_gauge_add(bw_metric metric, int first, int64_t change) { add(series(metric, first, 0), change); }

void bw_gauge(bw_metric metric, int first, int64_t value) {
    atomic_store_explicit(series(metric, first, 0), value, memory_order_relaxed);
}

void bw_observe(bw_metric metric, int first, int64_t value) {
    const row *r = &rows[metric];
    _Atomic int64_t *s = series(metric, first, 0);
    size_t bucket = 0;
    while (r->bounds[bucket] && value > r->bounds[bucket]) bucket++;
    add(s + bucket, 1);
    add(s + bucket_count(r), value);
}

int64_t bw_metric_value(bw_metric metric, int first, int second) {
    const row *r = &rows[metric];
    _Atomic int64_t *s = series(metric, first, second);
    int64_t sum = 0;
    for (size_t i = 0; i < (r->kind == BW_HISTOGRAM ? bucket_count(r) : 1); i++) sum += get(s + i);
    return sum;
}

const char *bw_metric_name(bw_metric metric) { return rows[metric].name; }
bw_metric_kind bw_metric_kind_of(bw_metric metric) { return rows[metric].kind; }

/* ---- the process ---- */

static int64_t count_descriptors(void) {
    int64_t n = -3; /* ., .., and the one that reads */
    DIR *dir = opendir("/proc/self/fd");
    if (!dir) return 0;
    while (readdir(dir)) n++;
    closedir(dir);
    return n;
}

static int64_t resident_bytes(void) {
    long pages = 0;
    FILE *f = fopen("/proc/self/statm", "re");
    if (!f) return 0;
    if (fscanf(f, "%*d %ld", &pages) != 1) pages = 0;
    fclose(f);
    return (int64_t)pages * sysconf(_SC_PAGESIZE);
}

/* Field 22 of /proc/self/stat is the start in clock ticks since the machine was started. */
static int64_t start_ms(void) {
    char line[1024] = "";
    unsigned long long ticks = 0;
    struct timespec up;
    FILE *f = fopen("/proc/self/stat", "re");
    if (!f) return 0;
    char *end = fgets(line, sizeof line, f) ? strrchr(line, ')') : NULL;
    fclose(f);
    if (!end || sscanf(end + 2, "%*c %*d %*d %*d %*d %*d %*u %*u %*u %*u %*u %*u %*u %*d %*d %*d %*d %*d %*d %llu", &ticks) != 1)
        return 0;
    clock_gettime(CLOCK_BOOTTIME, &up);
    int64_t since_boot = (int64_t)(ticks * 1000 / (unsigned long long)sysconf(_SC_CLK_TCK));
    return bw_now_ms() - ((int64_t)up.tv_sec * 1000 + up.tv_nsec / 1000000) + since_boot;
}

void bw_metrics_read_process(void) {
    struct rusage usage;
    struct rlimit files;
    if (getrusage(RUSAGE_SELF, &usage) == 0)
        bw_gauge(BW_METRIC_PROCESS_CPU, 0,
                 ((int64_t)usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) * 1000 +
                     (usage.ru_utime.tv_usec + usage.ru_stime.tv_usec) / 1000);
    if (getrlimit(RLIMIT_NOFILE, &files) == 0) bw_gauge(BW_METRIC_PROCESS_FILES_MOST, 0, (int64_t)files.rlim_cur);
    bw_gauge(BW_METRIC_PROCESS_MEMORY, 0, resident_bytes());
    bw_gauge(BW_METRIC_PROCESS_FILES, 0, count_descriptors());
    if (bw_metric_value(BW_METRIC_PROCESS_START, 0, 0) == 0) bw_gauge(BW_METRIC_PROCESS_START, 0, start_ms());
}

/* ---- the text ---- */

static void write_number(FILE *to, int64_t value, int64_t unit) {
    if (unit == 1) fprintf(to, "%" PRId64 "\n", value);
    else fprintf(to, "%.15g\n", (double)value / (double)unit);
}

/* NAME{label="value",...,more}. The values are words of our own tables and need no escapes. */
static void write_name(FILE *to, const row *r, const char *suffix, const int at[2], const char *more) {
    const char *before = "{";
    fprintf(to, "%s%s", r->name, suffix);
    for (int i = 0; i < 2 && r->by[i]; i++, before = ",")
        fprintf(to, "%s%s=\"%s\"", before, r->by[i]->label, r->by[i]->value(at[i]));
    if (more) fprintf(to, "%s%s", before, more);
    fprintf(to, more || r->by[0] ? "} " : " ");
}

/* Buckets are added up as they are read, so the last one and the count are always the same number. */
static void write_histogram(FILE *to, const row *r, const int at[2], _Atomic int64_t *s) {
    int64_t count = 0;
    size_t buckets = bucket_count(r);
    for (size_t i = 0; i < buckets; i++) {
        char bound[48] = "le=\"+Inf\"";
        if (i + 1 < buckets) snprintf(bound, sizeof bound, "le=\"%.15g\"", (double)r->bounds[i] / (double)r->unit);
        count += get(s + i);
        write_name(to, r, "_bucket", at, bound);
        fprintf(to, "%" PRId64 "\n", count);
    }
    write_name(to, r, "_sum", at, NULL);
    write_number(to, get(s + buckets), r->unit);
    write_name(to, r, "_count", at, NULL);
    fprintf(to, "%" PRId64 "\n", count);
}

void bw_metrics_write(FILE *to) {
    static const char *const kinds[] = {"counter", "gauge", "histogram"};
    for (int m = 0; m < BW_METRIC_COUNT; m++) {
        const row *r = &rows[m];
        fprintf(to, "# HELP %s %s\n# TYPE %s %s\n", r->name, r->help, r->name, kinds[r->kind]);
        for (int a = 0; a < (int)extent(r->by[0]); a++)
            for (int b = 0; b < (int)extent(r->by[1]); b++) {
                const int at[2] = {a, b};
                _Atomic int64_t *s = series((bw_metric)m, a, b);
                if (r->kind == BW_HISTOGRAM) {
                    write_histogram(to, r, at, s);
                } else {
                    write_name(to, r, "", at, NULL);
                    write_number(to, get(s), r->unit);
                }
            }
    }
}
