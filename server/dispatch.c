#include "server/dispatch.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <jansson.h>
#include <poll.h>
#include <pthread.h>
#include <signal.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/failure.h"
#include "server/joboptions.h"
#include "server/limits.h"
#include "server/log.h"
#include "server/metrics.h"
#include "server/worker/admission.h"
#include "server/worker/scratch.h"
#include "server/worker/session.h"
#include "server/worker/spawner.h"

enum { RETRY_PAUSE_MS = 100, MURMUR_MS = 250, PAGE = 8, SCRATCH_MS = 250, TRIAL_MS = 20000, WAITERS_MOST = 256 };

_Static_assert(RETRY_PAUSE_MS << BW_TRIES_MOST <= (int)BW_PAUSE_MOST_MS, "a clock that goes back is told from a long pause");

typedef enum { KEEP, STOP_CANCELLED, STOP_TIME, STOP_SCRATCH, STOP_FLOOD, STOP_PROTOCOL, STOP_DAEMON } stop_reason;

typedef struct {
    bool busy;
    uint64_t token;
    bw_job job; /* as claimed */
    char key[BW_SHA256_TEXT];
    bw_stage_limits limits;
    uint64_t need;      /* bytes it was admitted with */
    int64_t peak;       /* bytes of memory that it had at most; 0 until it has ended */
    int folder;         /* of the attempt; -1: closed */
    bw_session session; /* its progress and note under lock */
    bool asked;         /* it was sent SIGUSR1 */
    size_t told;        /* what it had said when watchers were last told, at most every MURMUR_MS */
    int64_t tell_at;
    int64_t started, deadline, kill_at, look_at; /* monotonic; kill_at 0: no SIGKILL pending; look_at: next look at the folder's size */
    stop_reason reason;
} slot;

typedef struct {
    char job[BW_JOB_ID_TEXT];
    bool seen; /* in this pass */
} waiter;

struct bw_dispatch {
    const bw_config *config;
    bw_store *store;
    bw_queue *queue;
    bw_watch *watch;
    int spawner, wake, fatal;
    uint64_t tokens;
    pthread_t thread;
    pthread_mutex_t lock; /* progress, note and job id of the slots, waiters and sandbox, for other threads */
    atomic_bool stopping, draining, alive;
    _Atomic uint64_t turns;
    slot *slots;
    bw_admission admission;
    waiter waiters[WAITERS_MOST]; /* under lock: jobs that the last pass left waiting for memory */
    size_t waiter_count;
    bw_sandbox sandbox; /* under lock: what the last worker told */
};

static const bw_api_stage *stage_of(const slot *s) { return &bw_api_stages[s->job.stage]; }

/* ---- what the worker says ---- */

static void stop_worker(bw_dispatch *d, slot *s, stop_reason reason, int signal) {
    if (s->reason != KEEP && signal == SIGKILL && s->kill_at == 0) return; /* it is on its way */
    if (s->reason == KEEP) s->reason = reason;
    bw_spawner_kill(d->spawner, s->token, signal);
    if (signal == SIGTERM) s->kill_at = bw_mono_ms() + d->config->cancel_grace_ms;
}

/* Tells the worker to settle for the best found, once, if the job's owner has asked for it and the worker is listening. */
static void ask_to_finish(bw_dispatch *d, slot *s) {
    if (!s->job.finish || s->asked || !s->session.decoder.hello || s->reason != KEEP) return;
    s->asked = true;
    bw_spawner_kill(d->spawner, s->token, SIGUSR1);
}

static void log_text(slot *s, const char *text) { bw_session_log(&s->session, text); }

static void note_sandbox(bw_dispatch *d, const bw_sandbox *sandbox) {
    pthread_mutex_lock(&d->lock);
    d->sandbox = *sandbox;
    pthread_mutex_unlock(&d->lock);
}

/* Takes what the worker has said and acts on it. */
static void listen_to(bw_dispatch *d, slot *s, bool all) {
    bool hello = s->session.decoder.hello;
    if (all) bw_session_drain(&s->session);
    else bw_session_read(&s->session);
    if (!hello && s->session.decoder.hello && s->session.state == BW_SAY_GOOD) {
        note_sandbox(d, &s->session.sandbox);
        ask_to_finish(d, s);
    }
    if (s->session.state == BW_SAY_BROKEN) stop_worker(d, s, STOP_PROTOCOL, SIGKILL);
    if (s->session.state == BW_SAY_FLOOD) stop_worker(d, s, STOP_FLOOD, SIGKILL);
}

/* ---- starting ---- */

static void release(bw_dispatch *d, slot *s) {
    bw_session_close(&s->session);
    if (s->folder >= 0) close(s->folder);
    bw_admission_give(&d->admission, s->need);
    bw_attempt_end(d->store, s->job.id, s->job.attempt);
    pthread_mutex_lock(&d->lock);
    bw_job_clear(&s->job);
    memset(&s->job, 0, sizeof s->job);
    s->busy = false;
    pthread_mutex_unlock(&d->lock);
}

/* The key of the output that the job's stage makes or has made. */
static bool key_of(const bw_job *job, const json_t *options, int stage, char key[BW_SHA256_TEXT]) {
    static const int searches = 3; /* reduce, the first stage that makes the best of the memory it has */
    bool own = job->cut && stage + 1 >= job->cut;
    char memory[40] = "";
    uint64_t asked = stage < searches ? 0 : bw_stage_limits_memory(job->limits);
    if (asked) snprintf(memory, sizeof memory, "memory %" PRIu64, asked);
    return bw_cache_key(job->input, job->parameters, options, stage, own ? job->id : memory, key);
}

/* The file that the stage reads: the upload, or the state that the stage before has left in the cache. */
static int open_input(bw_dispatch *d, const bw_job *job, const json_t *options, uint64_t *bytes) {
    char key[BW_SHA256_TEXT];
    if (job->stage == 0) return bw_store_open_blob(d->store, job->input, bytes);
    if (!key_of(job, options, job->stage - 1, key)) return -1;
    return bw_store_open_cached(d->store, key, NULL, bytes);
}

/* Is the state there that the stage reads? Retention keeps it, but it may have been lost in other ways, or never have come back from a backup. */
static bool has_input(bw_dispatch *d, const bw_job *job, const json_t *options) {
    char key[BW_SHA256_TEXT];
    return job->stage == 0 || !key_of(job, options, job->stage - 1, key) || bw_store_has_cached(d->store, key);
}

static bw_status give_up(bw_dispatch *d, slot *s, bw_problem problem, const char *detail, const json_t *error,
                         const bw_exceeded *exceeded);

/* The worker's ends of its channel and of its standard error. */
static bool open_session(bw_dispatch *d, slot *s, const bw_api_stage *stage, int log, int *channel, int *errors) {
    int pair[2] = {-1, -1}, tube[2] = {-1, -1};
    bool good = socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair) == 0 && pipe2(tube, O_CLOEXEC) == 0 &&
                fcntl(tube[0], F_SETFL, O_NONBLOCK) == 0;
    pthread_mutex_lock(&d->lock);
    bw_session_open(&s->session, stage, s->job.attempt, &d->lock, pair[0], tube[0], log);
    pthread_mutex_unlock(&d->lock);
    *channel = pair[1];
    *errors = tube[1];
    return good;
}

static bw_spawn spawn_of(const bw_dispatch *d, const slot *s) {
    bw_spawn spawn = {.token = s->token, .attempt = s->job.attempt, .memory = s->limits.memory, .file_size = s->limits.file,
                      .cpu_seconds = s->limits.cpu_seconds, .require_sandbox = d->config->require_sandbox};
    snprintf(spawn.job, sizeof spawn.job, "%s", s->job.id);
    snprintf(spawn.stage, sizeof spawn.stage, "%s", stage_of(s)->name);
    snprintf(spawn.options, sizeof spawn.options, "%s", s->job.options);
    return spawn;
}

static void close_all(const int *fds, size_t count) {
    for (size_t i = 0; i < count; i++)
        if (fds[i] >= 0) close(fds[i]);
}

/* Asks the spawner for the worker of a claimed job. What cannot be had is a system failure of the attempt. */
static bw_status launch(bw_dispatch *d, slot *s, const json_t *options) {
    bool wants_parameters = s->job.stage == 0 && *s->job.parameters;
    uint64_t bytes;
    int channel, errors, log = bw_store_append_log(d->store, s->job.id), input = open_input(d, &s->job, options, &bytes);
    int parameters = wants_parameters ? bw_store_open_blob(d->store, s->job.parameters, &bytes) : -1;
    bool there = input >= 0 && (parameters >= 0 || !wants_parameters);
    bw_spawn spawn = spawn_of(d, s);
    bool ready = open_session(d, s, stage_of(s), log, &channel, &errors) && there && log >= 0 && strlen(s->job.options) < sizeof spawn.options &&
                 bw_attempt_begin(d->store, s->job.id, s->job.attempt, &s->folder) == BW_OK;
    bw_spawn_files files = {channel, input, errors, s->folder, parameters};
    bw_status status = ready ? bw_spawner_spawn(d->spawner, &spawn, &files) : BW_OK;
    close_all((const int[]){input, parameters, channel, errors}, 4);
    if (ready) return status;
    if (!there) return give_up(d, s, BW_PROBLEM_FILES_LOST, "the input of the stage is gone", NULL, NULL);
    return give_up(d, s, BW_PROBLEM_IO, "cannot prepare the attempt", NULL, NULL);
}

static bool key_is_busy(const bw_dispatch *d, const char *key) {
    for (int i = 0; i < d->config->workers; i++)
        if (d->slots[i].busy && strcmp(d->slots[i].key, key) == 0) return true;
    return false;
}

static bool any_busy(const bw_dispatch *d) {
    for (int i = 0; i < d->config->workers; i++)
        if (d->slots[i].busy) return true;
    return false;
}

static slot *free_slot(bw_dispatch *d) {
    for (int i = 0; i < d->config->workers; i++)
        if (!d->slots[i].busy) return &d->slots[i];
    return NULL;
}

/* Is the stage's output in the cache? A row whose file has vanished is forgotten. */
static bw_status is_cached(bw_dispatch *d, const char *key, bool *cached) {
    bw_status status = bw_queue_output(d->queue, key, cached, NULL);
    if (status != BW_OK || !*cached || bw_store_has_cached(d->store, key)) return status;
    *cached = false;
    return bw_queue_forget_output(d->queue, key);
}

static bw_status occupy(bw_dispatch *d, slot *s, bw_job *job, const char *key, const json_t *options, uint64_t need) {
    pthread_mutex_lock(&d->lock);
    s->busy = true;
    s->job = *job;
    memset(job, 0, sizeof *job); /* moved */
    s->session.progress = 0;
    *s->session.note = '\0';
    pthread_mutex_unlock(&d->lock);
    snprintf(s->key, sizeof s->key, "%s", key);
    s->token = ++d->tokens;
    bw_count(BW_METRIC_CLAIMS, s->job.stage, 0, 1);
    if (s->job.attempt == 1) bw_observe(BW_METRIC_QUEUE_WAIT, 0, bw_age_ms(s->job.created));
    if (s->job.tries == 1) bw_count(BW_METRIC_CACHE_MISSES, s->job.stage, 0, 1);
    s->limits = bw_stage_limits_of(d->config, s->job.limits);
    s->need = need;
    s->peak = 0;
    s->started = bw_mono_ms();
    s->deadline = s->started + (int64_t)s->limits.wall_seconds * 1000;
    s->look_at = s->started + SCRATCH_MS;
    s->kill_at = 0;
    s->asked = false;
    s->told = 0;
    s->tell_at = 0;
    s->reason = KEEP;
    s->folder = -1;
    bw_admission_take(&d->admission, need);
    bw_event(BW_INFO, "stage.start", "job=%s stage=%s attempt=%d try=%d need=%" PRIu64, s->job.id, stage_of(s)->name, s->job.attempt,
             s->job.tries, need);
    return launch(d, s, options);
}

/* About how many bytes the job's next stage will take: as told by the stage before, or by the size of what it reads. No more than it may. */
static bw_status need_of(bw_dispatch *d, const bw_job *job, const json_t *options, uint64_t *need) {
    char key[BW_SHA256_TEXT];
    uint64_t bytes = 0, more = 0, most = bw_stage_limits_of(d->config, job->limits).memory;
    bw_status status = BW_OK;
    *need = 0;
    if (job->stage > 0 && key_of(job, options, job->stage - 1, key)) status = bw_queue_output_need(d->queue, key, need);
    if (!*need) {
        int input = open_input(d, job, options, &bytes), parameters = -1;
        if (job->stage == 0 && *job->parameters) parameters = bw_store_open_blob(d->store, job->parameters, &more);
        char start[BW_START_BYTES];
        ssize_t n = input < 0 ? 0 : pread(input, start, sizeof start, 0);
        close_all((const int[]){input, parameters}, 2);
        *need = job->stage == 0 ? bw_need_of_input(start, n > 0 ? (size_t)n : 0, bytes + more) : bw_need_of_state(bytes);
    }
    if (*need > most) *need = most;
    return status;
}

static waiter *find_waiter(bw_dispatch *d, const char *job) {
    for (size_t i = 0; i < d->waiter_count; i++)
        if (strcmp(d->waiters[i].job, job) == 0) return &d->waiters[i];
    return NULL;
}

static void note_waiter(bw_dispatch *d, const bw_job *job, uint64_t need) {
    pthread_mutex_lock(&d->lock);
    waiter *w = find_waiter(d, job->id);
    bool known = w != NULL;
    if (!known && d->waiter_count < WAITERS_MOST) {
        w = &d->waiters[d->waiter_count++];
        snprintf(w->job, sizeof w->job, "%s", job->id);
    }
    if (w) w->seen = true;
    pthread_mutex_unlock(&d->lock);
    if (!known)
        bw_event(BW_INFO, "job.waits", "job=%s for=memory need=%" PRIu64 " taken=%" PRIu64 " memory=%" PRIu64, job->id, need,
                 d->admission.taken, d->admission.memory);
}

static void forget_waiter(bw_dispatch *d, const char *job) {
    pthread_mutex_lock(&d->lock);
    waiter *w = find_waiter(d, job);
    if (w) *w = d->waiters[--d->waiter_count];
    pthread_mutex_unlock(&d->lock);
}

/* A pass over what waits. */
static void begin_pass(bw_dispatch *d) {
    d->admission.memory = d->config->memory;
    bw_admission_begin(&d->admission);
    pthread_mutex_lock(&d->lock);
    for (size_t i = 0; i < d->waiter_count; i++) d->waiters[i].seen = false;
    pthread_mutex_unlock(&d->lock);
}

/* `complete`: it was not ended by a lack of workers, so who was not seen waiting for memory does not. */
static void end_pass(bw_dispatch *d, bool complete) {
    bw_admission_end(&d->admission, complete);
    pthread_mutex_lock(&d->lock);
    for (size_t i = d->waiter_count; complete && i-- > 0;)
        if (!d->waiters[i].seen) d->waiters[i] = d->waiters[--d->waiter_count];
    pthread_mutex_unlock(&d->lock);
}

/* Claims the job's next stage and starts it, if there is memory enough. */
static bw_status claim_job(bw_dispatch *d, slot *s, bw_job *job, const char *key, const json_t *options, bool *taken) {
    uint64_t need;
    bw_status status = need_of(d, job, options, &need);
    if (status != BW_OK) return status;
    if (!bw_admission_ask(&d->admission, job->id, need, bw_mono_ms())) {
        note_waiter(d, job, need);
        return BW_OK;
    }
    forget_waiter(d, job->id);
    status = bw_queue_claim(d->queue, job, bw_now_ms(), taken);
    if (status == BW_OK && *taken) status = occupy(d, s, job, key, options, need);
    if (s->busy) bw_watch_notify(d->watch, s->job.id);
    return status;
}

/* Brings a waiting job as far as the cache reaches, then claims its next stage if a worker is free. *taken: at least one of
 * the two was done. */
static bw_status advance_job(bw_dispatch *d, bw_job *job, bool *taken) {
    bw_status status = BW_OK;
    bool done = true;
    *taken = false;
    json_t *options = json_loads(job->options, 0, NULL);
    while (options && done && status == BW_OK && job->state != BW_JOB_SUCCESSFUL) {
        char key[BW_SHA256_TEXT];
        bool cached;
        slot *s = free_slot(d);
        if (!key_of(job, options, job->stage, key) || key_is_busy(d, key)) break;
        status = is_cached(d, key, &cached);
        if (status != BW_OK || (!cached && !s)) break;
        if (!cached && !has_input(d, job, options)) {
            status = bw_queue_rewind(d->queue, job, bw_now_ms(), &done);
            bw_event(BW_WARN, "job.rewound", "job=%s", job->id);
            continue;
        }
        if (!cached) {
            status = claim_job(d, s, job, key, options, taken);
            break;
        }
        int stage = job->stage;
        bool results = stage == BW_API_STAGE_COUNT - 1;
        status = bw_queue_reuse(d->queue, job, key, results, bw_now_ms(), &done);
        *taken = *taken || done;
        if (status != BW_OK || !done) continue;
        bw_count(BW_METRIC_CACHE_HITS, stage, 0, 1);
        bw_event(BW_INFO, job->state == BW_JOB_SUCCESSFUL ? "job.successful" : "stage.reused", "job=%s attempt=%d",
                 job->id, job->attempt);
        bw_watch_notify(d->watch, job->id);
    }
    json_decref(options);
    return status;
}

/* One owner's turn: the first of its candidates that can be taken. One whose key is being made waits for that. */
static bw_status serve(bw_dispatch *d, const char *owner) {
    bw_status status = BW_OK;
    bool taken = false;
    size_t count = PAGE;
    for (int skip = 0; status == BW_OK && !taken && count == PAGE && skip < BW_LOOK_MOST; skip += PAGE) {
        bw_job *jobs;
        status = bw_queue_candidates(d->queue, owner, bw_now_ms(), skip, PAGE, &jobs, &count);
        if (status != BW_OK) return status;
        for (size_t i = 0; status == BW_OK && !taken && i < count; i++) {
            bw_cancel ignored;
            if (!jobs[i].cancel) {
                status = advance_job(d, &jobs[i], &taken);
                continue;
            }
            status = bw_queue_cancel(d->queue, jobs[i].id, bw_now_ms(), &ignored);
            bw_watch_notify(d->watch, jobs[i].id);
        }
        bw_jobs_free(jobs, count);
    }
    return status;
}

static bw_status start_waiting(bw_dispatch *d, int64_t *next_due) {
    bw_turn turn = {.served = -1};
    bw_status status = BW_OK;
    bool found = true;
    if (d->config->require_sandbox && !bw_sandbox_complete(&d->sandbox)) return BW_OK; /* fails closed; /readyz tells */
    begin_pass(d);
    while (free_slot(d)) {
        status = bw_queue_turn(d->queue, d->config->owner_running, &turn, &found);
        if (status != BW_OK || !found) break;
        status = serve(d, turn.owner);
        if (status != BW_OK) break;
    }
    end_pass(d, status == BW_OK && free_slot(d));
    return status == BW_OK ? bw_queue_next_due(d->queue, bw_now_ms(), next_due) : status;
}

/* ---- ending ---- */

static void tell_end(bw_dispatch *d, const slot *s, const char *outcome, bool booked) {
    bw_event(booked ? BW_INFO : BW_WARN, booked ? "stage.end" : "stage.outdated", "job=%s stage=%s attempt=%d outcome=%s ms=%" PRId64
             " need=%" PRIu64 " peak=%" PRId64, s->job.id, stage_of(s)->name, s->job.attempt, outcome, bw_mono_ms() - s->started, s->need, s->peak);
    if (booked) bw_watch_notify(d->watch, s->job.id);
}

/* Books the end of a cancelled attempt. The caller frees the slot. */
static bw_status dismiss(bw_dispatch *d, slot *s) {
    bool done;
    log_text(s, "cancelled"); /* before the job has ended: who follows its log then has all of it */
    bw_status status = bw_queue_dismiss(d->queue, s->job.id, s->job.attempt, bw_now_ms(), &done);
    tell_end(d, s, "cancelled", done);
    return status;
}

/* Books a failure: retried if it is the system's and there are tries left. Frees the slot. */
static bw_status give_up(bw_dispatch *d, slot *s, bw_problem problem, const char *detail, const json_t *error,
                         const bw_exceeded *exceeded) {
    const char *code = bw_problem_types[problem].code;
    int64_t now = bw_now_ms();
    bool done = false, retry = bw_failure_retryable(problem) && s->job.tries < BW_TRIES_MOST;
    bw_status status;
    char line[600];
    const char *message = detail ? detail : json_string_value(json_object_get(error, "message"));
    snprintf(line, sizeof line, "%s: %.500s", code, message ? message : "");
    log_text(s, line);
    bw_count(BW_METRIC_FAILURES, (int)problem, 0, 1);
    if (retry) {
        status = bw_queue_retry(d->queue, s->job.id, s->job.attempt, code, now + (RETRY_PAUSE_MS << s->job.tries), now,
                                &done);
    } else {
        char *failure = bw_failure_json(problem, stage_of(s)->name, detail, error, exceeded);
        status = failure ? bw_queue_fail(d->queue, s->job.id, s->job.attempt, code, failure, now, &done) : BW_E_MEMORY;
        free(failure);
        if (done) bw_event(BW_WARN, "job.failed", "job=%s problem=%s", s->job.id, code);
    }
    if (status == BW_OK && !done) status = dismiss(d, s); /* cancelled since it was judged, or not the job's attempt any more */
    else tell_end(d, s, code, done);
    release(d, s);
    return status;
}

/* An output that depends on when somebody asked for it is for the job of the asking only. */
static bool claim_output(slot *s) {
    json_t *options = json_loads(s->job.options, 0, NULL);
    if (!s->job.cut) s->job.cut = s->job.stage + 1;
    bool good = options && key_of(&s->job, options, s->job.stage, s->key);
    json_decref(options);
    return good;
}

/* What the worker says that the next stage will need; nonsense is nothing. */
static uint64_t told_need(const slot *s) {
    json_int_t need = json_integer_value(json_object_get(s->session.result, "need"));
    return need > 0 && need < (json_int_t)1 << 50 ? (uint64_t)need : 0;
}

/* The worker says it is done: files its output and books the stage. Frees the slot. */
static bw_status succeed(bw_dispatch *d, slot *s) {
    bw_made made = {.key = s->key, .need = told_need(s), .cut = json_is_true(json_object_get(s->session.result, "cut"))};
    json_t *manifest = NULL;
    bool done = false, last = s->job.stage + 1 == s->job.stage_count;
    bw_status status = made.cut && !claim_output(s) ? BW_E_MEMORY : BW_OK;
    if (status == BW_OK) status = bw_attempt_publish(d->store, s->job.id, s->job.attempt, s->key, &made.bytes, &manifest);
    if (status == BW_OK && (manifest != NULL) != (s->job.stage == BW_API_STAGE_COUNT - 1)) status = BW_E_CHECK;
    if (status != BW_OK) {
        json_decref(manifest);
        return give_up(d, s, status == BW_E_CHECK ? BW_PROBLEM_WORKER_PROTOCOL : BW_PROBLEM_IO,
                       status == BW_E_CHECK ? "the output is not what the stage has to write" : "cannot keep the output",
                       NULL, NULL);
    }
    char *text = manifest ? json_dumps(manifest, JSON_COMPACT) : NULL;
    json_decref(manifest);
    made.manifest = text;
    status = bw_queue_advance(d->queue, s->job.id, s->job.attempt, &made, bw_now_ms(), &done);
    free(text);
    if (status == BW_OK && !done) status = dismiss(d, s); /* as above */
    else tell_end(d, s, "ok", done);
    if (done && last) bw_event(BW_INFO, "job.successful", "job=%s", s->job.id);
    release(d, s);
    return status;
}

/* A limit of the stage was exceeded: what it is called, how much was allowed. */
static bw_status exceed(bw_dispatch *d, slot *s, bw_problem problem, const char *what, uint64_t allowed) {
    static const char *const words[][2] = {
        {"memory", "the stage needed more than the %llu bytes of memory it may have"},
        {"cpu_seconds", "the stage used up the %llu seconds of processor time it may have"},
        {"wall_seconds", "the stage ran longer than the %llu seconds it may"},
        {"file", "a file of the stage grew larger than the %llu bytes it may have"},
        {"scratch", "the files of the stage grew larger than the %llu bytes they may have together"},
        {"messages", "the worker said more than the %llu bytes it may"}};
    char detail[160] = "";
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        if (strcmp(words[i][0], what) == 0) snprintf(detail, sizeof detail, words[i][1], (unsigned long long)allowed);
    return give_up(d, s, problem, detail, NULL, &(bw_exceeded){what, allowed});
}

/* The worker was ended by a signal that it did not get from the daemon. */
static bw_status judge_signal(bw_dispatch *d, slot *s, int signal) {
    char detail[120];
    if (signal == SIGXCPU) return exceed(d, s, BW_PROBLEM_TIME_LIMIT, "cpu_seconds", (uint64_t)s->limits.cpu_seconds);
    if (signal == SIGXFSZ) return exceed(d, s, BW_PROBLEM_OUTPUT_LIMIT, "file", s->limits.file);
    if (signal == SIGSYS)
        return give_up(d, s, BW_PROBLEM_SANDBOX_VIOLATION, "the worker made a system call that no stage needs, and was ended for it", NULL, NULL);
    snprintf(detail, sizeof detail, "the worker was ended by signal %d (SIG%s)", signal, sigabbrev_np(signal));
    return give_up(d, s, BW_PROBLEM_WORKER_DIED, detail, NULL, NULL);
}

/* After the worker has ended on its own account, well or not. */
static bw_status judge_worker(bw_dispatch *d, slot *s, int wait_status) {
    char detail[120];
    const json_t *result = s->session.result;
    const char *code = json_string_value(json_object_get(result, "status"));
    if (s->reason == STOP_PROTOCOL) return give_up(d, s, BW_PROBLEM_WORKER_PROTOCOL, NULL, NULL, NULL);
    if (WIFSIGNALED(wait_status)) return judge_signal(d, s, WTERMSIG(wait_status));
    if (code && strcmp(code, "ok") == 0 && WEXITSTATUS(wait_status) == 0) {
        bool fits = bw_scratch_bytes(s->folder, s->limits.scratch) <= s->limits.scratch; /* it may have grown since the last look */
        return fits ? succeed(d, s) : exceed(d, s, BW_PROBLEM_OUTPUT_LIMIT, "scratch", s->limits.scratch);
    }
    if (code && strcmp(code, "memory-limit") == 0)
        return give_up(d, s, BW_PROBLEM_MEMORY_LIMIT, NULL, result, &(bw_exceeded){"memory", s->limits.memory});
    if (code && strcmp(code, "ok") != 0 && strcmp(code, "cancelled") != 0)
        return give_up(d, s, bw_failure_problem(code), NULL, result, NULL);
    snprintf(detail, sizeof detail, "the worker ended with code %d before it had a result", WEXITSTATUS(wait_status));
    return give_up(d, s, BW_PROBLEM_WORKER_DIED, detail, NULL, NULL);
}

static bw_status judge(bw_dispatch *d, slot *s, int wait_status) {
    bw_job now;
    bool found, done = false;
    listen_to(d, s, true);
    bw_status status = bw_queue_get(d->queue, s->job.id, &now, &found);
    bool cancelled = found && now.cancel;
    if (found) bw_job_clear(&now);
    if (status != BW_OK) return status;
    if (cancelled) {
        status = dismiss(d, s);
    } else if (s->reason == STOP_DAEMON) {
        status = bw_queue_interrupt(d->queue, s->job.id, s->job.attempt, bw_now_ms(), &done);
        tell_end(d, s, "interrupted", done);
    } else if (s->reason == STOP_TIME) {
        return exceed(d, s, BW_PROBLEM_TIME_LIMIT, "wall_seconds", (uint64_t)s->limits.wall_seconds);
    } else if (s->reason == STOP_SCRATCH) {
        return exceed(d, s, BW_PROBLEM_OUTPUT_LIMIT, "scratch", s->limits.scratch);
    } else if (s->reason == STOP_FLOOD) {
        return exceed(d, s, BW_PROBLEM_OUTPUT_LIMIT, "messages", BW_SAID_MOST);
    } else {
        return judge_worker(d, s, wait_status);
    }
    release(d, s);
    return status;
}

/* ---- the loop ---- */

static void measure(const slot *s, const bw_spawn_report *exit) {
    bw_observe(BW_METRIC_STAGE_SECONDS, s->job.stage, bw_mono_ms() - s->started);
    bw_observe(BW_METRIC_STAGE_PEAK, s->job.stage, exit->peak_bytes);
    bw_count(BW_METRIC_STAGE_CPU, s->job.stage, 0, (uint64_t)exit->cpu_ms);
}

static bw_status read_spawner(bw_dispatch *d) {
    bw_spawn_report r;
    bw_status status = BW_OK;
    bool gone = false;
    while (status == BW_OK && bw_spawner_report(d->spawner, &r, &gone)) {
        if (r.kind != BW_WORKER_EXITED) continue;
        for (int i = 0; i < d->config->workers; i++) {
            slot *s = &d->slots[i];
            if (!s->busy || s->token != r.token) continue;
            measure(s, &r);
            s->peak = r.peak_bytes;
            status = judge(d, s, r.wait_status);
            break;
        }
    }
    if (gone) bw_event(BW_ERROR, "spawner.gone", "running=%d", any_busy(d));
    return gone ? BW_E_IO : status;
}

/* Looks at the size of the attempt's folder from time to time: the sum of many files is nothing that the kernel limits. */
static void watch_scratch(bw_dispatch *d, slot *s, int64_t now) {
    if (s->reason != KEEP || now < s->look_at || s->folder < 0) return;
    s->look_at = now + SCRATCH_MS;
    if (bw_scratch_bytes(s->folder, s->limits.scratch) > s->limits.scratch) stop_worker(d, s, STOP_SCRATCH, SIGKILL);
}

/* Tells those who follow the job that its worker has said something. A slot is looked at every SCRATCH_MS at least, so the last of it is told, too. */
static void tell_listeners(bw_dispatch *d, slot *s, int64_t now) {
    if (s->session.said == s->told || now < s->tell_at) return;
    s->told = s->session.said;
    s->tell_at = now + MURMUR_MS;
    bw_watch_murmur(d->watch, s->job.id);
}

/* Cancels, finishes, limits and the end of the daemon. */
static bw_status watch_running(bw_dispatch *d, bool woken) {
    int64_t now = bw_mono_ms();
    for (int i = 0; i < d->config->workers; i++) {
        slot *s = &d->slots[i];
        if (!s->busy) continue;
        if (s->reason == KEEP && atomic_load(&d->stopping)) stop_worker(d, s, STOP_DAEMON, SIGTERM);
        if (s->reason == KEEP && now >= s->deadline) stop_worker(d, s, STOP_TIME, SIGKILL);
        if (s->reason == KEEP && woken) {
            bw_job job;
            bool found;
            bw_status status = bw_queue_get(d->queue, s->job.id, &job, &found);
            if (status != BW_OK) return status;
            s->job.finish = found && job.finish;
            if (found && job.cancel) stop_worker(d, s, STOP_CANCELLED, SIGTERM);
            else ask_to_finish(d, s);
            bw_job_clear(&job);
        }
        watch_scratch(d, s, now);
        tell_listeners(d, s, now);
        if (s->kill_at && now >= s->kill_at) {
            s->kill_at = 0;
            bw_spawner_kill(d->spawner, s->token, SIGKILL);
        }
    }
    return BW_OK;
}

static int sleep_ms(const bw_dispatch *d, int64_t next_due) {
    int64_t wait = 60000, now = bw_mono_ms();
    if (next_due && next_due - bw_now_ms() < wait) wait = next_due - bw_now_ms();
    for (int i = 0; i < d->config->workers; i++) {
        const slot *s = &d->slots[i];
        if (!s->busy) continue;
        if (s->reason == KEEP && s->deadline - now < wait) wait = s->deadline - now;
        if (s->reason == KEEP && s->look_at - now < wait) wait = s->look_at - now;
        if (s->kill_at && s->kill_at - now < wait) wait = s->kill_at - now;
    }
    return wait < 0 ? 0 : (int)wait + 1;
}

enum { POLLED_MOST = 2 + 2 * 256 };

static bw_status turn(bw_dispatch *d, struct pollfd *fds, int64_t *next_due) {
    nfds_t n = 0;
    uint64_t count;
    fds[n++] = (struct pollfd){d->wake, POLLIN, 0};
    fds[n++] = (struct pollfd){d->spawner, POLLIN, 0};
    for (int i = 0; i < d->config->workers; i++) {
        const slot *s = &d->slots[i];
        if (s->busy && s->session.channel >= 0) fds[n++] = (struct pollfd){s->session.channel, POLLIN, 0};
        if (s->busy && s->session.errors >= 0) fds[n++] = (struct pollfd){s->session.errors, POLLIN, 0};
    }
    if (poll(fds, n, sleep_ms(d, *next_due)) < 0 && errno != EINTR) return BW_E_IO;
    bool woken = fds[0].revents && read(d->wake, &count, sizeof count) > 0;
    for (int i = 0; i < d->config->workers; i++)
        if (d->slots[i].busy) listen_to(d, &d->slots[i], false);
    bw_status status = read_spawner(d);
    if (status == BW_OK) status = watch_running(d, woken);
    bool claims = !atomic_load(&d->stopping) && !atomic_load(&d->draining);
    if (!claims) *next_due = 0;
    if (status == BW_OK && claims) status = start_waiting(d, next_due);
    atomic_fetch_add(&d->turns, 1);
    return status;
}

static void *dispatch_main(void *user) {
    bw_dispatch *d = user;
    struct pollfd fds[POLLED_MOST];
    int64_t next_due = 0;
    bw_status status = start_waiting(d, &next_due);
    while (status == BW_OK && !(atomic_load(&d->stopping) && !any_busy(d))) status = turn(d, fds, &next_due);
    atomic_store(&d->alive, false);
    if (status != BW_OK) {
        uint64_t one = 1;
        bw_event(BW_ERROR, "dispatch.failed", "status=%d", (int)status);
        if (write(d->fatal, &one, sizeof one) < 0) abort();
    }
    return NULL;
}

/* ---- the trial of the sandbox ---- */

/* Has a worker enter its sandbox and tell of it, before any job is given to one. That it cannot be run is told by /readyz and by the jobs. */
static void try_sandbox(bw_dispatch *d) {
    slot s = {.token = ++d->tokens, .folder = -1};
    bw_spawn spawn = {.token = s.token, .memory = d->config->stage_memory, .file_size = d->config->stage_output, .cpu_seconds = 10,
                      .job = "trial", .stage = BW_WORKER_TRIAL, .options = "{}"};
    bw_spawn_report r = {.kind = BW_WORKER_STARTED};
    bool gone = false;
    int channel, errors, input = open("/dev/null", O_RDONLY | O_CLOEXEC);
    bool ready = open_session(d, &s, NULL, -1, &channel, &errors) && bw_attempt_begin(d->store, "trial", 0, &s.folder) == BW_OK &&
                 bw_spawner_spawn(d->spawner, &spawn, &(bw_spawn_files){channel, input, errors, s.folder, -1}) == BW_OK;
    close_all((const int[]){input, channel, errors}, 3);
    for (int64_t until = bw_mono_ms() + TRIAL_MS; ready && !gone && r.kind != BW_WORKER_EXITED && bw_mono_ms() < until;) {
        struct pollfd fd = {d->spawner, POLLIN, 0};
        if (poll(&fd, 1, TRIAL_MS) > 0) bw_spawner_report(d->spawner, &r, &gone);
    }
    if (r.kind != BW_WORKER_EXITED) bw_spawner_kill(d->spawner, s.token, SIGKILL);
    bw_session_drain(&s.session);
    d->sandbox = s.session.sandbox;
    if (!s.session.result) snprintf(d->sandbox.missing, sizeof d->sandbox.missing, "the worker could not be tried");
    bw_session_close(&s.session);
    if (s.folder >= 0) close(s.folder);
    bw_attempt_end(d->store, "trial", 0);
    bw_event(bw_sandbox_complete(&d->sandbox) ? BW_INFO : BW_WARN, "sandbox.tried", "landlock=%d seccomp=%d address_space=%d missing=\"%s\"",
             d->sandbox.landlock, d->sandbox.seccomp, d->sandbox.address_space, d->sandbox.missing);
}

bw_status bw_dispatch_start(const bw_config *config, bw_store *store, bw_queue *queue, bw_watch *watch, int spawner,
                            int fatal, bw_dispatch **out) {
    bw_dispatch *d = calloc(1, sizeof *d);
    if (!d) return BW_E_MEMORY;
    d->config = config;
    d->store = store;
    d->queue = queue;
    d->watch = watch;
    d->spawner = spawner;
    d->fatal = fatal;
    d->wake = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    d->slots = calloc((size_t)config->workers, sizeof *d->slots);
    pthread_mutex_init(&d->lock, NULL);
    atomic_store(&d->alive, true);
    if (d->slots && config->workers > 0) try_sandbox(d);
    if (d->wake >= 0 && d->slots && pthread_create(&d->thread, NULL, dispatch_main, d) == 0) {
        *out = d;
        return BW_OK;
    }
    if (d->wake >= 0) close(d->wake);
    free(d->slots);
    free(d);
    return BW_E_IO;
}

void bw_dispatch_wake(bw_dispatch *d) {
    uint64_t one = 1;
    while (write(d->wake, &one, sizeof one) < 0 && errno == EINTR) continue;
}

double bw_dispatch_progress(bw_dispatch *d, const char *job, char note[BW_NOTE_TEXT]) {
    double progress = 0;
    *note = '\0';
    pthread_mutex_lock(&d->lock);
    for (int i = 0; i < d->config->workers; i++) {
        const slot *s = &d->slots[i];
        if (!s->busy || strcmp(s->job.id, job) != 0) continue;
        progress = s->session.progress;
        memcpy(note, s->session.note, sizeof s->session.note);
    }
    pthread_mutex_unlock(&d->lock);
    return progress;
}

bool bw_dispatch_waits_for_memory(bw_dispatch *d, const char *job) {
    pthread_mutex_lock(&d->lock);
    bool waits = find_waiter(d, job) != NULL;
    pthread_mutex_unlock(&d->lock);
    return waits;
}

bw_sandbox bw_dispatch_sandbox(bw_dispatch *d) {
    pthread_mutex_lock(&d->lock);
    bw_sandbox sandbox = d->sandbox;
    pthread_mutex_unlock(&d->lock);
    return sandbox;
}

bool bw_dispatch_alive(bw_dispatch *d) { return atomic_load(&d->alive); }
uint64_t bw_dispatch_turns(bw_dispatch *d) { return atomic_load(&d->turns); }

void bw_dispatch_drain(bw_dispatch *d) {
    atomic_store(&d->draining, true);
    bw_dispatch_wake(d);
}

bool bw_dispatch_draining(bw_dispatch *d) { return atomic_load(&d->draining); }

int bw_dispatch_running(bw_dispatch *d) {
    int running = 0;
    pthread_mutex_lock(&d->lock);
    for (int i = 0; i < d->config->workers; i++) running += d->slots[i].busy;
    pthread_mutex_unlock(&d->lock);
    return running;
}

void bw_dispatch_stop(bw_dispatch *d) {
    if (!d) return;
    atomic_store(&d->stopping, true);
    bw_dispatch_wake(d);
    pthread_join(d->thread, NULL);
    for (int i = 0; i < d->config->workers; i++) /* busy only after a fatal error: recovered at the next start */
        if (d->slots[i].busy) release(d, &d->slots[i]);
    close(d->wake);
    pthread_mutex_destroy(&d->lock);
    free(d->slots);
    free(d);
}
