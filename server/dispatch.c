#include "server/dispatch.h"

#include <errno.h>
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
#include "server/log.h"
#include "server/metrics.h"
#include "server/worker/spawner.h"
#include "server/worker/worker_proto.h"

enum { LOG_MOST = 4 << 20, TERM_GRACE_MS = 3000, RETRY_PAUSE_MS = 100, PAGE = 8 };

_Static_assert(RETRY_PAUSE_MS << BW_TRIES_MOST <= (int)BW_PAUSE_MOST_MS, "a clock that goes back is told from a long pause");
_Static_assert((int)BW_NOTE_TEXT > (int)BW_FRAME_NOTE_MOST, "a note has to fit");

typedef enum { KEEP, STOP_CANCELLED, STOP_TIME, STOP_PROTOCOL, STOP_DAEMON } stop_reason;

typedef struct {
    bool busy;
    uint64_t token;
    bw_job job; /* as claimed */
    char key[BW_SHA256_TEXT];
    int channel, log; /* -1: closed */
    size_t logged;
    double progress;         /* under lock */
    char note[BW_NOTE_TEXT]; /* under lock; printable ASCII */
    bool asked;              /* it was sent SIGUSR1 */
    int64_t started, deadline, kill_at; /* monotonic; kill_at 0: no SIGKILL pending */
    stop_reason reason;
    json_t *result;
    bw_decoder decoder;
} slot;

struct bw_dispatch {
    const bw_config *config;
    bw_store *store;
    bw_queue *queue;
    bw_watch *watch;
    int spawner, wake, fatal;
    uint64_t tokens;
    pthread_t thread;
    pthread_mutex_t lock; /* progress, note and job id of the slots, for other threads */
    atomic_bool stopping, draining, alive;
    _Atomic uint64_t turns;
    slot *slots;
};

static const bw_api_stage *stage_of(const slot *s) { return &bw_api_stages[s->job.stage]; }

/* ---- what the worker says ---- */

static void stop_worker(bw_dispatch *d, slot *s, stop_reason reason, int signal) {
    if (s->reason == KEEP) s->reason = reason;
    bw_spawner_kill(d->spawner, s->token, signal);
    if (signal == SIGTERM) s->kill_at = bw_mono_ms() + TERM_GRACE_MS;
}

/* Tells the worker to settle for the best found, once, if the job's owner has asked for it and the worker is listening. */
static void ask_to_finish(bw_dispatch *d, slot *s) {
    if (!s->job.finish || s->asked || !s->decoder.hello || s->reason != KEEP) return;
    s->asked = true;
    bw_spawner_kill(d->spawner, s->token, SIGUSR1);
}

static void append_log(slot *s, const char *text, size_t size) {
    char line[1200], time[BW_TIME_TEXT];
    if (s->log < 0 || s->logged > LOG_MOST) return;
    if (size > 1000) size = 1000;
    int n = snprintf(line, sizeof line, "%s %s#%d ", bw_time_text(bw_now_ms(), time), stage_of(s)->name, s->job.attempt);
    size_t at = (size_t)n;
    for (size_t i = 0; i < size; i++) line[at++] = (unsigned char)text[i] < 0x20 || text[i] == 0x7f ? ' ' : text[i];
    line[at++] = '\n';
    if (write(s->log, line, at) < 0) s->logged = LOG_MOST; /* the log is not worth the job */
    s->logged += at;
}

static void log_text(slot *s, const char *text) { append_log(s, text, strlen(text)); }

/* The worker must be of the same build as the daemon: same stage, same version of its algorithm. */
static bool hello_fits(const slot *s, const bw_frame *frame) {
    json_t *hello = json_loadb((const char *)frame->data, frame->size, JSON_REJECT_DUPLICATES, NULL);
    const char *stage = json_string_value(json_object_get(hello, "stage"));
    json_int_t version = json_integer_value(json_object_get(hello, "version"));
    bool fits = stage && strcmp(stage, stage_of(s)->name) == 0 && version == stage_of(s)->version;
    json_decref(hello);
    return fits;
}

static void take_note(bw_dispatch *d, slot *s, const bw_frame *frame) {
    pthread_mutex_lock(&d->lock);
    for (size_t i = 0; i < frame->size; i++) s->note[i] = frame->data[i] >= 0x20 && frame->data[i] < 0x7f ? (char)frame->data[i] : '?';
    s->note[frame->size] = '\0';
    pthread_mutex_unlock(&d->lock);
    log_text(s, s->note);
}

static bool take_frame(bw_dispatch *d, slot *s, const bw_frame *frame) {
    switch (frame->type) {
    case BW_FRAME_HELLO:
        if (!hello_fits(s, frame)) return false;
        ask_to_finish(d, s);
        return true;
    case BW_FRAME_PROGRESS:
        pthread_mutex_lock(&d->lock);
        s->progress = bw_frame_progress(frame);
        pthread_mutex_unlock(&d->lock);
        return true;
    case BW_FRAME_LOG:
        append_log(s, (const char *)frame->data, frame->size);
        return true;
    case BW_FRAME_NOTE:
        take_note(d, s, frame);
        return true;
    case BW_FRAME_RESULT:
        s->result = json_loadb((const char *)frame->data, frame->size, JSON_REJECT_DUPLICATES, NULL);
        return json_is_string(json_object_get(s->result, "status"));
    }
    return false;
}

/* Takes everything that has arrived. */
static void read_channel(bw_dispatch *d, slot *s) {
    bw_frame frame;
    while (s->channel >= 0 && s->reason != STOP_PROTOCOL) {
        size_t room;
        void *space = bw_decoder_space(&s->decoder, &room);
        ssize_t n = recv(s->channel, space, room, MSG_DONTWAIT);
        if (n < 0 && errno == EINTR) continue;
        if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return;
        if (n <= 0) {
            close(s->channel);
            s->channel = -1;
            return;
        }
        bw_decoder_filled(&s->decoder, (size_t)n);
        bool good = true;
        while (good && bw_decoder_next(&s->decoder, &frame)) good = take_frame(d, s, &frame);
        if (!good || s->decoder.status != BW_OK) {
            log_text(s, "the worker broke the protocol");
            close(s->channel);
            s->channel = -1;
            stop_worker(d, s, STOP_PROTOCOL, SIGKILL);
        }
    }
}

/* ---- starting ---- */

static void release(bw_dispatch *d, slot *s) {
    if (s->channel >= 0) close(s->channel);
    if (s->log >= 0) close(s->log);
    json_decref(s->result);
    bw_attempt_end(d->store, s->job.id, s->job.attempt);
    pthread_mutex_lock(&d->lock);
    bw_job_clear(&s->job);
    memset(&s->job, 0, sizeof s->job);
    s->result = NULL;
    s->busy = false;
    pthread_mutex_unlock(&d->lock);
}

/* The key of the output that the job's stage makes or has made. */
static bool key_of(const bw_job *job, const json_t *options, int stage, char key[BW_SHA256_TEXT]) {
    bool own = job->cut && stage + 1 >= job->cut;
    return bw_cache_key(job->input, job->parameters, options, stage, own ? job->id : "", key);
}

/* The file that the stage reads: the upload, or the state that the stage before has left in the cache. */
static int open_input(bw_dispatch *d, const bw_job *job, const json_t *options) {
    char key[BW_SHA256_TEXT];
    uint64_t bytes;
    if (job->stage == 0) return bw_store_open_blob(d->store, job->input, &bytes);
    if (!key_of(job, options, job->stage - 1, key)) return -1;
    return bw_store_open_cached(d->store, key, NULL, &bytes);
}

static bw_status give_up(bw_dispatch *d, slot *s, bw_problem problem, const char *detail, const json_t *error);

/* Asks the spawner for the worker of a claimed job. What cannot be had is a system failure of the attempt. */
static bw_status launch(bw_dispatch *d, slot *s, const json_t *options) {
    bool wants_parameters = s->job.stage == 0 && *s->job.parameters;
    uint64_t bytes;
    int pair[2] = {-1, -1}, folder = -1, input = open_input(d, &s->job, options);
    int parameters = wants_parameters ? bw_store_open_blob(d->store, s->job.parameters, &bytes) : -1;
    bw_spawn spawn = {.token = s->token, .attempt = s->job.attempt, .memory = d->config->stage_memory,
                      .file_size = d->config->stage_output, .cpu_seconds = d->config->stage_cpu_seconds};
    snprintf(spawn.job, sizeof spawn.job, "%s", s->job.id);
    snprintf(spawn.stage, sizeof spawn.stage, "%s", stage_of(s)->name);
    snprintf(spawn.options, sizeof spawn.options, "%s", s->job.options);
    s->log = bw_store_append_log(d->store, s->job.id);
    bool there = input >= 0 && (parameters >= 0 || !wants_parameters);
    bool ready = there && s->log >= 0 && strlen(s->job.options) < sizeof spawn.options &&
                 bw_attempt_begin(d->store, s->job.id, s->job.attempt, &folder) == BW_OK &&
                 socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair) == 0;
    bw_spawn_files files = {pair[1], input, s->log, folder, parameters};
    bw_status status = ready ? bw_spawner_spawn(d->spawner, &spawn, &files) : BW_OK;
    if (input >= 0) close(input);
    if (parameters >= 0) close(parameters);
    if (folder >= 0) close(folder);
    if (pair[1] >= 0) close(pair[1]);
    s->channel = pair[0];
    if (ready) return status;
    return give_up(d, s, BW_PROBLEM_IO, !there ? "the input of the stage is gone" : "cannot prepare the attempt", NULL);
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

static bw_status occupy(bw_dispatch *d, slot *s, bw_job *job, const char *key, const json_t *options) {
    pthread_mutex_lock(&d->lock);
    s->busy = true;
    s->job = *job;
    memset(job, 0, sizeof *job); /* moved */
    s->progress = 0;
    *s->note = '\0';
    pthread_mutex_unlock(&d->lock);
    snprintf(s->key, sizeof s->key, "%s", key);
    s->token = ++d->tokens;
    bw_count(BW_METRIC_CLAIMS, s->job.stage, 0, 1);
    if (s->job.tries == 1) bw_count(BW_METRIC_CACHE_MISSES, s->job.stage, 0, 1);
    s->started = bw_mono_ms();
    s->deadline = s->started + (int64_t)d->config->stage_wall_seconds * 1000;
    s->kill_at = 0;
    s->asked = false;
    s->logged = 0;
    s->reason = KEEP;
    s->result = NULL;
    s->channel = s->log = -1;
    bw_decoder_init(&s->decoder);
    bw_event(BW_INFO, "stage.start", "job=%s stage=%s attempt=%d try=%d", s->job.id, stage_of(s)->name, s->job.attempt,
             s->job.tries);
    return launch(d, s, options);
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
        if (!cached) {
            status = bw_queue_claim(d->queue, job, bw_now_ms(), &done);
            *taken = *taken || done;
            if (status == BW_OK && done) status = occupy(d, s, job, key, options);
            if (s->busy) bw_watch_notify(d->watch, s->job.id);
            break;
        }
        int stage = job->stage;
        bool results = stage == BW_API_STAGE_COUNT - 1;
        status = bw_queue_reuse(d->queue, job, results ? key : "", bw_now_ms(), &done);
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
    while (free_slot(d)) {
        status = bw_queue_turn(d->queue, 0, &turn, &found);
        if (status != BW_OK || !found) break;
        status = serve(d, turn.owner);
        if (status != BW_OK) break;
    }
    return status == BW_OK ? bw_queue_next_due(d->queue, bw_now_ms(), next_due) : status;
}

/* ---- ending ---- */

static void tell_end(bw_dispatch *d, const slot *s, const char *outcome, bool booked) {
    bw_event(booked ? BW_INFO : BW_WARN, booked ? "stage.end" : "stage.outdated", "job=%s stage=%s attempt=%d outcome=%s ms=%" PRId64,
             s->job.id, stage_of(s)->name, s->job.attempt, outcome, bw_mono_ms() - s->started);
    if (booked) bw_watch_notify(d->watch, s->job.id);
}

/* Books the end of a cancelled attempt. The caller frees the slot. */
static bw_status dismiss(bw_dispatch *d, slot *s) {
    bool done;
    bw_status status = bw_queue_dismiss(d->queue, s->job.id, s->job.attempt, bw_now_ms(), &done);
    log_text(s, "cancelled");
    tell_end(d, s, "cancelled", done);
    return status;
}

/* Books a failure: retried if it is the system's and there are tries left. Frees the slot. */
static bw_status give_up(bw_dispatch *d, slot *s, bw_problem problem, const char *detail, const json_t *error) {
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
        char *failure = bw_failure_json(problem, stage_of(s)->name, detail, error);
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

/* The worker says it is done: files its output and books the stage. Frees the slot. */
static bw_status succeed(bw_dispatch *d, slot *s) {
    uint64_t bytes;
    json_t *manifest = NULL;
    bool done = false, last = s->job.stage + 1 == s->job.stage_count;
    bool cut = json_is_true(json_object_get(s->result, "cut"));
    bw_status status = cut && !claim_output(s) ? BW_E_MEMORY : BW_OK;
    if (status == BW_OK) status = bw_attempt_publish(d->store, s->job.id, s->job.attempt, s->key, &bytes, &manifest);
    if (status == BW_OK && (manifest != NULL) != (s->job.stage == BW_API_STAGE_COUNT - 1)) status = BW_E_CHECK;
    if (status != BW_OK) {
        json_decref(manifest);
        return give_up(d, s, status == BW_E_CHECK ? BW_PROBLEM_WORKER_PROTOCOL : BW_PROBLEM_IO,
                       status == BW_E_CHECK ? "the output is not what the stage has to write" : "cannot keep the output",
                       NULL);
    }
    char *text = manifest ? json_dumps(manifest, JSON_COMPACT) : NULL;
    json_decref(manifest);
    status = bw_queue_advance(d->queue, s->job.id, s->job.attempt, s->key, bytes, text, cut, bw_now_ms(), &done);
    free(text);
    if (status == BW_OK && !done) status = dismiss(d, s); /* as above */
    else tell_end(d, s, "ok", done);
    if (done && last) bw_event(BW_INFO, "job.successful", "job=%s", s->job.id);
    release(d, s);
    return status;
}

/* After the worker has ended on its own account, well or not. */
static bw_status judge_worker(bw_dispatch *d, slot *s, int wait_status) {
    char detail[120];
    int signal = WIFSIGNALED(wait_status) ? WTERMSIG(wait_status) : 0;
    const char *code = json_string_value(json_object_get(s->result, "status"));
    if (signal == SIGXCPU) return give_up(d, s, BW_PROBLEM_TIME_LIMIT, "the stage used up its processor time", NULL);
    if (signal == SIGXFSZ) return give_up(d, s, BW_PROBLEM_OUTPUT_LIMIT, "a file of the stage grew too large", NULL);
    if (s->reason == STOP_PROTOCOL) return give_up(d, s, BW_PROBLEM_WORKER_PROTOCOL, NULL, NULL);
    if (signal) {
        snprintf(detail, sizeof detail, "the worker was ended by signal %d (SIG%s)", signal, sigabbrev_np(signal));
        return give_up(d, s, BW_PROBLEM_WORKER_DIED, detail, NULL);
    }
    if (code && strcmp(code, "ok") == 0 && WEXITSTATUS(wait_status) == 0) return succeed(d, s);
    if (code && strcmp(code, "ok") != 0 && strcmp(code, "cancelled") != 0)
        return give_up(d, s, bw_failure_problem(code), NULL, s->result);
    snprintf(detail, sizeof detail, "the worker ended with code %d before it had a result", WEXITSTATUS(wait_status));
    return give_up(d, s, BW_PROBLEM_WORKER_DIED, detail, NULL);
}

static bw_status judge(bw_dispatch *d, slot *s, int wait_status) {
    bw_job now;
    bool found, done = false;
    read_channel(d, s);
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
        return give_up(d, s, BW_PROBLEM_TIME_LIMIT, "the stage ran longer than it may", NULL);
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
            status = judge(d, s, r.wait_status);
            break;
        }
    }
    if (gone) bw_event(BW_ERROR, "spawner.gone", "running=%d", any_busy(d));
    return gone ? BW_E_IO : status;
}

/* Cancels, finishes, deadlines and the end of the daemon. */
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
        if (s->kill_at && s->kill_at - now < wait) wait = s->kill_at - now;
    }
    return wait < 0 ? 0 : (int)wait + 1;
}

static bw_status turn(bw_dispatch *d, struct pollfd *fds, int64_t *next_due) {
    slot *of[258];
    nfds_t n = 0;
    uint64_t count;
    fds[n++] = (struct pollfd){d->wake, POLLIN, 0};
    fds[n++] = (struct pollfd){d->spawner, POLLIN, 0};
    for (int i = 0; i < d->config->workers; i++) {
        slot *s = &d->slots[i];
        if (!s->busy || s->channel < 0) continue;
        of[n] = s;
        fds[n++] = (struct pollfd){s->channel, POLLIN, 0};
    }
    if (poll(fds, n, sleep_ms(d, *next_due)) < 0 && errno != EINTR) return BW_E_IO;
    bool woken = fds[0].revents && read(d->wake, &count, sizeof count) > 0;
    for (nfds_t i = 2; i < n; i++)
        if (fds[i].revents && of[i]->channel == fds[i].fd) read_channel(d, of[i]);
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
    struct pollfd fds[258];
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
        progress = s->progress;
        memcpy(note, s->note, sizeof s->note);
    }
    pthread_mutex_unlock(&d->lock);
    return progress;
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
