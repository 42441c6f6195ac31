/* How an attempt has ended: the table in dispatch.h, row by row. */
#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>

#include "server/clock.h"
#include "server/dispatch/slot.h"
#include "server/log.h"
#include "server/metrics.h"

enum { RETRY_PAUSE_MS = 100 };

_Static_assert(RETRY_PAUSE_MS << BW_TRIES_MOST <= (int)BW_PAUSE_MOST_MS, "a clock that goes back is told from a long pause");

static void tell_end(bw_dispatch *d, const bw_slot *s, const char *outcome, bool booked) {
    bw_event(booked ? BW_INFO : BW_WARN, booked ? "stage.end" : "stage.outdated", "job=%s stage=%s attempt=%d outcome=%s ms=%" PRId64
             " need=%" PRIu64 " peak=%" PRId64, s->job.id, bw_slot_stage(s)->name, s->job.attempt, outcome, bw_mono_ms() - s->started, s->need, s->peak);
    if (booked) bw_watch_notify(d->watch, s->job.id);
}

/* Books the end of a cancelled attempt. The caller frees the slot. */
static bw_status dismiss(bw_dispatch *d, bw_slot *s) {
    bool done;
    bw_slot_log(s, "cancelled"); /* before the job has ended: who follows its log then has all of it */
    bw_status status = bw_queue_dismiss(d->queue, s->job.id, s->job.attempt, bw_now_ms(), &s->spent, &done);
    tell_end(d, s, "cancelled", done);
    return status;
}

bw_status bw_slot_give_up(bw_dispatch *d, bw_slot *s, bw_problem problem, const char *detail, const json_t *error,
                         const bw_exceeded *exceeded) {
    const char *code = bw_problem_types[problem].code;
    int64_t now = bw_now_ms();
    bool done = false, retry = bw_failure_retryable(problem) && s->job.tries < BW_TRIES_MOST;
    bw_status status;
    char line[600];
    const char *message = detail ? detail : json_string_value(json_object_get(error, "message"));
    snprintf(line, sizeof line, "%s: %.500s", code, message ? message : "");
    bw_slot_log(s, line);
    bw_count(BW_METRIC_FAILURES, (int)problem, 0, 1);
    if (retry) {
        status = bw_queue_retry(d->queue, s->job.id, s->job.attempt, code, now + (RETRY_PAUSE_MS << s->job.tries), now,
                                &s->spent, &done);
    } else {
        char *failure = bw_failure_json(problem, bw_slot_stage(s)->name, detail, error, exceeded);
        status = failure ? bw_queue_fail(d->queue, s->job.id, s->job.attempt, code, failure, now, &s->spent, &done) : BW_E_MEMORY;
        free(failure);
        if (done) bw_event(BW_WARN, "job.failed", "job=%s problem=%s", s->job.id, code);
    }
    if (status == BW_OK && !done) status = dismiss(d, s); /* cancelled since it was judged, or not the job's attempt any more */
    else tell_end(d, s, code, done);
    bw_slot_release(d, s);
    return status;
}

/* An output that depends on when somebody asked for it is for the job of the asking only. */
static bool claim_output(bw_slot *s) {
    json_t *options = json_loads(s->job.options, 0, NULL);
    if (!s->job.cut) s->job.cut = s->job.stage + 1;
    bool good = options && bw_stage_key(&s->job, options, s->job.stage, s->key);
    json_decref(options);
    return good;
}

/* What the worker says that the next stage will need; nonsense is nothing. */
static uint64_t told_need(const bw_slot *s) {
    json_int_t need = json_integer_value(json_object_get(s->session.result, "need"));
    return need > 0 && need < (json_int_t)1 << 50 ? (uint64_t)need : 0;
}

/* What it says that the job's input is; NULL: nothing, or nonsense. */
static const char *told_kind(const bw_slot *s) {
    const char *kind = json_string_value(json_object_get(s->session.result, "kind"));
    return !kind ? NULL : strcmp(kind, "tet") == 0 ? "tet" : strcmp(kind, "hex") == 0 ? "hex" : NULL;
}

/* An output that was filed and not booked goes again, unless another job has made the same and booked it. Only this thread books outputs, and
 * key_is_busy (choose.c) sees to it that nobody else is filing this one. */
static void withdraw(bw_dispatch *d, const char *key) {
    bool booked = true;
    if (bw_queue_output(d->queue, key, &booked, NULL) == BW_OK && !booked) bw_store_drop_cached(d->store, key);
}

/* The worker says it is done: its output is filed, then booked. */
static bw_status succeed(bw_dispatch *d, bw_slot *s) {
    bool cut = json_is_true(json_object_get(s->session.result, "cut"));
    if (cut && !claim_output(s)) return bw_slot_give_up(d, s, BW_PROBLEM_IO, "cannot keep the output", NULL, NULL);
    s->output.made = (bw_made){.key = s->key, .need = told_need(s), .kind = told_kind(s), .cut = cut};
    bw_slot_file(d, s);
    return BW_OK;
}

/* What is to be booked of the output, or what is wrong with it. */
static bw_status filed(bw_slot *s, char **manifest) {
    bw_filing *o = &s->output;
    bool last = s->job.stage == BW_API_STAGE_COUNT - 1;
    if (o->status != BW_OK) return o->status;
    if ((o->manifest != NULL) != last) return BW_E_CHECK;
    *manifest = last ? json_dumps(o->manifest, JSON_COMPACT) : NULL;
    return last && !*manifest ? BW_E_MEMORY : BW_OK; /* without it the job would be successful and have no results */
}

bw_status bw_slot_book(bw_dispatch *d, bw_slot *s) {
    bool done = false, last = s->job.stage + 1 == s->job.stage_count;
    char *manifest = NULL;
    if (!s->output.fits) return bw_slot_exceed(d, s, BW_PROBLEM_OUTPUT_LIMIT, "scratch", s->limits.scratch);
    bw_status status = filed(s, &manifest);
    if (status != BW_OK) {
        withdraw(d, s->key);
        return bw_slot_give_up(d, s, status == BW_E_CHECK ? BW_PROBLEM_WORKER_PROTOCOL : BW_PROBLEM_IO,
                       status == BW_E_CHECK ? "the output is not what the stage has to write" : "cannot keep the output",
                       NULL, NULL);
    }
    s->output.made.manifest = manifest;
    status = bw_queue_advance(d->queue, s->job.id, s->job.attempt, &s->output.made, bw_now_ms(), &s->spent, &done);
    free(manifest);
    if (status == BW_OK && !done) withdraw(d, s->key);
    if (status == BW_OK && !done) status = dismiss(d, s); /* cancelled since it was judged, or not the job's attempt any more */
    else tell_end(d, s, "ok", done);
    if (done && last) bw_event(BW_INFO, "job.successful", "job=%s", s->job.id);
    bw_slot_release(d, s);
    return status;
}

bw_status bw_slot_exceed(bw_dispatch *d, bw_slot *s, bw_problem problem, const char *what, uint64_t allowed) {
    static const char *const words[][2] = {
        {"memory", "the stage needed more than the %llu bytes of memory it may have"},
        {"cpu_seconds", "the stage used up the %llu seconds of processor time it may have"},
        {"wall_seconds", "the stage ran longer than the %llu seconds it may"},
        {"job_cpu_seconds", "the stages of the job used up the %llu seconds of processor time they may have together"},
        {"job_wall_seconds", "the stages of the job ran longer than the %llu seconds they may together"},
        {"file", "a file of the stage grew larger than the %llu bytes it may have"},
        {"scratch", "the files of the stage grew larger than the %llu bytes they may have together"},
        {"messages", "the worker said more than the %llu bytes it may"}};
    char detail[160] = "";
    for (size_t i = 0; i < sizeof words / sizeof *words; i++)
        if (strcmp(words[i][0], what) == 0) snprintf(detail, sizeof detail, words[i][1], (unsigned long long)allowed);
    return bw_slot_give_up(d, s, problem, detail, NULL, &(bw_exceeded){what, allowed});
}

/* The worker was ended by a signal that it did not get from the daemon. */
static bw_status judge_signal(bw_dispatch *d, bw_slot *s, int signal) {
    char detail[120];
    if (signal == SIGXCPU) return bw_slot_exceed(d, s, BW_PROBLEM_TIME_LIMIT, s->limits.cpu.what, s->limits.cpu.allowed);
    if (signal == SIGXFSZ) return bw_slot_exceed(d, s, BW_PROBLEM_OUTPUT_LIMIT, "file", s->limits.file);
    if (signal == SIGSYS)
        return bw_slot_give_up(d, s, BW_PROBLEM_SANDBOX_VIOLATION, "the worker made a system call that no stage needs, and was ended for it", NULL, NULL);
    snprintf(detail, sizeof detail, "the worker was ended by signal %d (SIG%s)", signal, sigabbrev_np(signal));
    return bw_slot_give_up(d, s, BW_PROBLEM_WORKER_DIED, detail, NULL, NULL);
}

/* After the worker has ended on its own account, well or not. */
static bw_status judge_worker(bw_dispatch *d, bw_slot *s, int wait_status) {
    char detail[120];
    const json_t *result = s->session.result;
    const char *code = json_string_value(json_object_get(result, "status"));
    if (s->reason == BW_STOP_PROTOCOL) return bw_slot_give_up(d, s, BW_PROBLEM_WORKER_PROTOCOL, NULL, NULL, NULL);
    if (WIFSIGNALED(wait_status)) return judge_signal(d, s, WTERMSIG(wait_status));
    if (code && strcmp(code, "ok") == 0 && WEXITSTATUS(wait_status) == 0) return succeed(d, s);
    if (code && strcmp(code, "memory-limit") == 0)
        return bw_slot_give_up(d, s, BW_PROBLEM_MEMORY_LIMIT, NULL, result, &(bw_exceeded){"memory", s->limits.memory});
    if (code && strcmp(code, "ok") != 0 && strcmp(code, "cancelled") != 0)
        return bw_slot_give_up(d, s, bw_failure_problem(code), NULL, result, NULL);
    snprintf(detail, sizeof detail, "the worker ended with code %d before it had a result", WEXITSTATUS(wait_status));
    return bw_slot_give_up(d, s, BW_PROBLEM_WORKER_DIED, detail, NULL, NULL);
}

bw_status bw_slot_judge(bw_dispatch *d, bw_slot *s, int wait_status) {
    bw_job now;
    bool found, done = false;
    bw_slot_listen(d, s, true);
    bw_status status = bw_queue_get(d->queue, s->job.id, &now, &found);
    bool cancelled = found && now.cancel;
    if (found) bw_job_clear(&now);
    if (status != BW_OK) return status;
    if (cancelled) {
        status = dismiss(d, s);
    } else if (s->reason == BW_STOP_DAEMON) {
        status = bw_queue_interrupt(d->queue, s->job.id, s->job.attempt, bw_now_ms(), &done);
        tell_end(d, s, "interrupted", done);
    } else if (s->reason == BW_STOP_TIME) {
        return bw_slot_exceed(d, s, BW_PROBLEM_TIME_LIMIT, s->limits.wall.what, s->limits.wall.allowed);
    } else if (s->reason == BW_STOP_SCRATCH) {
        return bw_slot_exceed(d, s, BW_PROBLEM_OUTPUT_LIMIT, "scratch", s->limits.scratch);
    } else if (s->reason == BW_STOP_FLOOD) {
        return bw_slot_exceed(d, s, BW_PROBLEM_OUTPUT_LIMIT, "messages", BW_SAID_MOST);
    } else {
        return judge_worker(d, s, wait_status);
    }
    bw_slot_release(d, s);
    return status;
}
