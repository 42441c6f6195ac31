#include "server/http/access.h"
#include "server/http/operations.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "server/clock.h"
#include "server/http/job_read.h"
#include "server/http/reply.h"

enum { PAGE_DEFAULT = 50, PAGE_MOST = 200 };

/* ---- as JSON ---- */

static void set_time(json_t *object, const char *name, int64_t ms) {
    char text[BW_TIME_TEXT];
    if (ms) json_object_set_new(object, name, json_string(bw_time_text(ms, text)));
}

static json_t *attempts_json(bw_request *r, const char *id) {
    bw_attempt *attempts;
    size_t count;
    json_t *list = json_array();
    if (bw_queue_attempts(r->services->queue, id, &attempts, &count) != BW_OK) return list;
    for (size_t i = 0; i < count; i++) {
        const bw_attempt *a = &attempts[i];
        json_t *item = json_pack("{s:i, s:s, s:b}", "attempt", a->attempt, "stage", a->stage, "reused", a->reused);
        set_time(item, "started", a->started);
        set_time(item, "finished", a->finished);
        if (*a->outcome) json_object_set_new(item, "outcome", json_string(a->outcome));
        json_array_append_new(list, item);
    }
    free(attempts);
    return list;
}

static double job_progress(bw_request *r, const bw_job *job, char note[BW_NOTE_TEXT]) {
    *note = '\0';
    double stage = job->open ? bw_dispatch_progress(r->services->dispatch, job->id, note) : 0;
    return job->state == BW_JOB_SUCCESSFUL ? 1 : (job->stage + stage) / job->stage_count;
}

static json_t *links_json(const bw_job *job) {
    char self[64];
    snprintf(self, sizeof self, "/v1/jobs/%s", job->id);
    json_t *links = json_pack("{s:s, s:s+}", "self", self, "log", self, "/log");
    if (job->state == BW_JOB_SUCCESSFUL) {
        json_object_set_new(links, "results", json_sprintf("%s/results", self));
        json_object_set_new(links, "report", json_sprintf("%s/report", self));
    }
    return links;
}

static json_t *job_json(bw_request *r, const bw_job *job) {
    int stage = job->stage < job->stage_count ? job->stage : job->stage_count - 1;
    char note[BW_NOTE_TEXT];
    double progress = job_progress(r, job, note);
    json_t *o = json_pack("{s:s, s:s, s:s, s:s, s:i, s:i, s:f}", "id", job->id, "state", bw_job_state_names[job->state],
                          "input", job->input, "stage", bw_api_stages[stage].name, "stage_index", job->stage,
                          "stage_count", job->stage_count, "progress", progress);
    if (!o) return NULL;
    if (*job->owner) json_object_set_new(o, "owner", json_string(job->owner));
    if (job->name) json_object_set_new(o, "name", json_string(job->name));
    json_object_set_new(o, "priority", json_integer(job->priority));
    json_object_set_new(o, "pinned", json_boolean(job->pinned));
    json_object_set_new(o, "tags", job->tags ? json_loads(job->tags, 0, NULL) : json_array());
    if (*job->kind) json_object_set_new(o, "kind", json_string(job->kind));
    if (*job->parameters) json_object_set_new(o, "parameters", json_string(job->parameters));
    if (job->cancel && job->state == BW_JOB_RUNNING) json_object_set_new(o, "cancelling", json_true());
    if (job->finish && (job->state == BW_JOB_QUEUED || job->state == BW_JOB_RUNNING)) json_object_set_new(o, "finishing", json_true());
    if (!job->open && bw_dispatch_waits_for_memory(r->services->dispatch, job->id)) json_object_set_new(o, "waits_for", json_string("memory"));
    if (*note) json_object_set_new(o, "note", json_string(note));
    json_object_set_new(o, "options", json_loads(job->options, 0, NULL));
    if (job->limits) json_object_set_new(o, "limits", json_loads(job->limits, 0, NULL));
    json_object_set_new(o, "spent", json_pack("{s:f, s:f}", "cpu_seconds", (double)job->spent.cpu_ms / 1000, "wall_seconds", (double)job->spent.wall_ms / 1000));
    set_time(o, "created", job->created);
    set_time(o, "started", job->started);
    set_time(o, "finished", job->finished);
    json_object_set_new(o, "attempts", attempts_json(r, job->id));
    if (job->failure) json_object_set_new(o, "failure", json_loads(job->failure, 0, NULL));
    json_object_set_new(o, "links", links_json(job));
    return o;
}

void bw_http_reply_no_job(bw_request *r, const char *id) {
    bool gone;
    if (bw_queue_is_gone(r->services->queue, id, &gone) != BW_OK) bw_reply_storage(r);
    else if (gone) bw_reply_problem(r, BW_PROBLEM_JOB_GONE, "the job %.60s was deleted, or removed by its age", id);
    else bw_reply_problem(r, BW_PROBLEM_NO_SUCH_JOB, "there is no job '%.60s'", id);
}

/* Reads a job, or replies. The caller clears it. */
static bool load_job(bw_request *r, const char *id, bw_job *job) {
    bool found;
    if (bw_queue_get(r->services->queue, id, job, &found) != BW_OK) {
        bw_reply_storage(r);
        return false;
    }
    if (!found) bw_http_reply_no_job(r, id);
    return found;
}

bool bw_http_load_job(bw_request *r, bw_job *job) { return load_job(r, r->parameters[0], job); }

/* ---- lists ---- */

static bool query_state(bw_request *r, int *state) {
    const char *text = bw_request_query(r, "state");
    *state = -1;
    for (int i = 0; text && i < BW_JOB_COUNT; i++)
        if (strcmp(text, bw_job_state_names[i]) == 0) *state = i;
    if (text && *state < 0) bw_reply_problem(r, BW_PROBLEM_INVALID_PARAMETER, "there is no state '%.40s'", text);
    return !text || *state >= 0;
}

static bool query_tag(bw_request *r, const char **tag) {
    *tag = bw_request_query(r, "tag");
    if (!*tag || bw_http_is_tag(*tag)) return true;
    bw_reply_problem(r, BW_PROBLEM_INVALID_PARAMETER, "a tag has 1 to %d bytes", BW_TAG_BYTES_MOST);
    return false;
}

void bw_http_job_list(bw_request *r) {
    int64_t limit, before, next;
    bw_filter filter = {.state = -1};
    bw_job *jobs;
    size_t count;
    if (!bw_request_number(r, "limit", 1, PAGE_MOST, PAGE_DEFAULT, &limit) ||
        !bw_request_number(r, "cursor", 1, INT64_MAX, 0, &before) || !query_state(r, &filter.state) ||
        !query_tag(r, &filter.tag) || !bw_http_owner_wanted(r, &filter.owner))
        return;
    if (bw_queue_list(r->services->queue, &filter, before, (int)limit, &jobs, &count, &next) != BW_OK) {
        bw_reply_storage(r);
        return;
    }
    json_t *list = json_array(), *page = json_pack("{s:o}", "jobs", list);
    for (size_t i = 0; i < count; i++) json_array_append_new(list, job_json(r, &jobs[i]));
    if (next) json_object_set_new(page, "next", json_sprintf("%lld", (long long)next));
    bw_jobs_free(jobs, count);
    bw_reply_json(r, 200, page);
}

/* ---- waiting ---- */

typedef struct {
    bw_watcher watcher;
    char id[BW_PARAMETER_MOST];
    unsigned status; /* of the answer */
    int seconds;     /* that the client prefers to wait; 0: not at all */
    int64_t until;   /* monotonic; 0: no longer */
} job_answer;

static bool has_ended(const bw_job *job) { return job->state != BW_JOB_QUEUED && job->state != BW_JOB_RUNNING; }

static void on_news(void *user, bw_watch_reason reason) {
    bw_request *r = user;
    job_answer *a = r->state;
    if (reason != BW_WATCH_NEWS) a->until = 0;
    bw_request_resume(r);
}

static void send_job(bw_request *r, const job_answer *a, const bw_job *job) {
    char text[64];
    bw_reply_json(r, a->status, job_json(r, job));
    snprintf(text, sizeof text, "/v1/jobs/%s", job->id);
    if (a->status == 201) bw_reply_header(r, "Location", text);
    snprintf(text, sizeof text, "wait=%d", a->seconds);
    if (a->seconds) bw_reply_header(r, "Preference-Applied", text);
}

/* Sends the job if it has ended or nobody wants to wait any longer, else waits for news of it. */
static void answer(bw_request *r) {
    job_answer *a = r->state;
    bw_job job;
    if (a->status == 200 && r->resume == answer && !bw_http_check_again(r)) return;
    if (!load_job(r, a->id, &job)) return;
    if (has_ended(&job) || bw_mono_ms() >= a->until) {
        send_job(r, a, &job);
        bw_job_clear(&job);
        return;
    }
    bw_job_clear(&job);
    r->resume = answer;
    bw_request_suspend(r);
    bw_watch_add(r->services->watch, &a->watcher, a->id, a->until, on_news, r);
    bool found, ended = bw_queue_get(r->services->queue, a->id, &job, &found) != BW_OK || !found || has_ended(&job);
    bw_job_clear(&job);
    if (ended && bw_watch_remove(r->services->watch, &a->watcher)) bw_request_resume(r);
}

void bw_http_answer_job(bw_request *r, unsigned status, const char *id) {
    job_answer *a = calloc(1, sizeof *a);
    if (!a) {
        bw_reply_json(r, status, NULL);
        return;
    }
    r->state = a;
    r->state_free = free;
    snprintf(a->id, sizeof a->id, "%s", id);
    a->status = status;
    a->seconds = bw_request_wait_preferred(r);
    a->until = a->seconds ? bw_mono_ms() + a->seconds * 1000 : 0;
    answer(r);
}

void bw_http_job_get(bw_request *r) { bw_http_answer_job(r, 200, r->parameters[0]); }

void bw_http_reply_job(bw_request *r, const bw_job *job) { bw_reply_json(r, 200, job_json(r, job)); }
