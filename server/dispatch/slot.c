#include "server/dispatch/slot.h"

#include <fcntl.h>
#include <inttypes.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/files.h"
#include "server/joboptions.h"
#include "server/log.h"
#include "server/metrics.h"
#include "server/worker/spawner.h"

enum { TRIAL_MS = 20000 };

void bw_slot_stop(bw_dispatch *d, bw_slot *s, bw_stop reason, int signal) {
    if (s->reason != BW_KEEP && signal == SIGKILL && s->kill_at == 0) return; /* it is on its way */
    if (s->reason == BW_KEEP) s->reason = reason;
    bw_spawner_kill(d->spawner, s->token, signal);
    if (signal == SIGTERM) s->kill_at = bw_mono_ms() + d->config->cancel_grace_ms;
}

void bw_slot_ask_to_finish(bw_dispatch *d, bw_slot *s) {
    if (!s->job.finish || s->asked || !s->session.decoder.hello || s->reason != BW_KEEP) return;
    s->asked = true;
    bw_spawner_kill(d->spawner, s->token, SIGUSR1);
}

static void note_sandbox(bw_dispatch *d, const bw_sandbox *sandbox) {
    pthread_mutex_lock(&d->lock);
    d->sandbox = *sandbox;
    pthread_mutex_unlock(&d->lock);
}

void bw_slot_listen(bw_dispatch *d, bw_slot *s, bool all) {
    bool hello = s->session.decoder.hello;
    if (all) bw_session_drain(&s->session);
    else bw_session_read(&s->session);
    if (!hello && s->session.decoder.hello && s->session.state == BW_SAY_GOOD) {
        note_sandbox(d, &s->session.sandbox);
        bw_slot_ask_to_finish(d, s);
    }
    if (s->session.state == BW_SAY_BROKEN) bw_slot_stop(d, s, BW_STOP_PROTOCOL, SIGKILL);
    if (s->session.state == BW_SAY_FLOOD) bw_slot_stop(d, s, BW_STOP_FLOOD, SIGKILL);
}

void bw_slot_release(bw_dispatch *d, bw_slot *s) {
    bw_session_close(&s->session);
    if (s->folder >= 0) close(s->folder);
    bw_admission_give(&d->admission, s->need);
    bw_dispatch_remove(d, s->job.id, s->job.attempt);
    json_decref(s->output.manifest);
    s->output.manifest = NULL;
    s->filing = false;
    pthread_mutex_lock(&d->lock);
    bw_job_clear(&s->job);
    memset(&s->job, 0, sizeof s->job);
    s->busy = false;
    pthread_mutex_unlock(&d->lock);
}

bool bw_stage_key(const bw_job *job, const json_t *options, int stage, char key[BW_SHA256_TEXT]) {
    static const int searches = 3; /* reduce, the first stage that makes the best of the memory it has */
    bool own = job->cut && stage + 1 >= job->cut;
    char memory[40] = "";
    uint64_t asked = stage < searches ? 0 : bw_stage_limits_memory(job->limits);
    if (asked) snprintf(memory, sizeof memory, "memory %" PRIu64, asked);
    return bw_cache_key(job->input, job->parameters, options, stage, own ? job->id : memory, key);
}

int bw_stage_input(bw_dispatch *d, const bw_job *job, const json_t *options, uint64_t *bytes) {
    char key[BW_SHA256_TEXT];
    if (job->stage == 0) return bw_store_open_blob(d->store, job->input, bytes);
    if (!bw_stage_key(job, options, job->stage - 1, key)) return -1;
    return bw_store_open_cached(d->store, key, NULL, bytes);
}

/* The worker's ends of its channel and of its standard error. */
static bool open_session(bw_dispatch *d, bw_slot *s, const bw_api_stage *stage, int log, int *channel, int *errors) {
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

static bw_spawn spawn_of(const bw_dispatch *d, const bw_slot *s) {
    bw_spawn spawn = {.token = s->token, .attempt = s->job.attempt, .memory = s->limits.memory, .file_size = s->limits.file,
                      .cpu_seconds = (int)((s->limits.cpu.left_ms + 999) / 1000), .require_sandbox = d->config->require_sandbox};
    snprintf(spawn.job, sizeof spawn.job, "%s", s->job.id);
    snprintf(spawn.stage, sizeof spawn.stage, "%s", bw_slot_stage(s)->name);
    snprintf(spawn.options, sizeof spawn.options, "%s", s->job.options);
    return spawn;
}

/* Of which time the job has nothing left. NULL: it has some. */
static const bw_time_limit *used_up(const bw_stage_limits *l) { return !l->wall.left_ms ? &l->wall : !l->cpu.left_ms ? &l->cpu : NULL; }

/* Asks the spawner for the worker of a claimed job. What cannot be had is a system failure of the attempt, what it may not have is one of limits. */
static bw_status launch(bw_dispatch *d, bw_slot *s, const json_t *options) {
    const bw_time_limit *over = used_up(&s->limits);
    bool wants_parameters = s->job.stage == 0 && *s->job.parameters;
    uint64_t bytes;
    int channel, errors, log = bw_store_append_log(d->store, s->job.id), input = bw_stage_input(d, &s->job, options, &bytes);
    int parameters = wants_parameters ? bw_store_open_blob(d->store, s->job.parameters, &bytes) : -1;
    bool there = input >= 0 && (parameters >= 0 || !wants_parameters);
    bw_spawn spawn = spawn_of(d, s);
    bool ready = open_session(d, s, bw_slot_stage(s), log, &channel, &errors) && !over && there && log >= 0 && strlen(s->job.options) < sizeof spawn.options &&
                 bw_attempt_begin(d->store, s->job.id, s->job.attempt, &s->folder) == BW_OK;
    bw_spawn_files files = {channel, input, errors, s->folder, parameters};
    bw_status status = ready ? bw_spawner_spawn(d->spawner, &spawn, &files) : BW_OK;
    bw_close_all((const int[]){input, parameters, channel, errors}, 4);
    if (ready) return status;
    if (over) return bw_slot_exceed(d, s, BW_PROBLEM_TIME_LIMIT, over->what, over->allowed);
    if (!there) return bw_slot_give_up(d, s, BW_PROBLEM_FILES_LOST, "the input of the stage is gone", NULL, NULL);
    return bw_slot_give_up(d, s, BW_PROBLEM_IO, "cannot prepare the attempt", NULL, NULL);
}

bw_status bw_slot_occupy(bw_dispatch *d, bw_slot *s, bw_job *job, const char *key, const json_t *options, uint64_t need) {
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
    s->limits = bw_stage_limits_of(d->config, s->job.limits, &s->job.spent);
    s->need = need;
    s->peak = 0;
    s->spent = (bw_spent){0};
    s->started = bw_mono_ms();
    s->deadline = s->started + s->limits.wall.left_ms;
    s->look_at = s->started + BW_SCRATCH_LOOK_MS;
    s->kill_at = 0;
    s->asked = false;
    s->told = 0;
    s->tell_at = 0;
    s->reason = BW_KEEP;
    s->folder = -1;
    bw_admission_take(&d->admission, need);
    bw_event(BW_INFO, "stage.start", "job=%s stage=%s attempt=%d try=%d need=%" PRIu64, s->job.id, bw_slot_stage(s)->name, s->job.attempt,
             s->job.tries, need);
    return launch(d, s, options);
}

/* ---- the trial of the sandbox ---- */

/* That it cannot be run is told by /readyz and by the jobs. */
void bw_dispatch_try_sandbox(bw_dispatch *d) {
    bw_slot s = {.token = ++d->tokens, .folder = -1};
    bw_spawn spawn = {.token = s.token, .memory = d->config->stage_memory, .file_size = d->config->stage_output, .cpu_seconds = 10,
                      .job = "trial", .stage = BW_WORKER_TRIAL, .options = "{}"};
    bw_spawn_report r = {.kind = BW_WORKER_STARTED};
    bool gone = false;
    int channel, errors, input = open("/dev/null", O_RDONLY | O_CLOEXEC);
    bool ready = open_session(d, &s, NULL, -1, &channel, &errors) && bw_attempt_begin(d->store, "trial", 0, &s.folder) == BW_OK &&
                 bw_spawner_spawn(d->spawner, &spawn, &(bw_spawn_files){channel, input, errors, s.folder, -1}) == BW_OK;
    bw_close_all((const int[]){input, channel, errors}, 3);
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
