/* Streams of events: of a job, and of all that the caller may see. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "server/clock.h"
#include "server/http/access.h"
#include "server/http/operations.h"
#include "server/http/reply.h"
#include "server/http/stream.h"

enum { PAGE = 16, SCAN = 1000, PROGRESS_MS = 200 };

/* ---- an event of the journal ---- */

/* In the journal `stage` is the one that comes next; here it is the one that the event is about. */
static void send_event(bw_stream *s, int64_t seq, const char *job, const char *kind, json_t *data, int64_t at) {
    char text[BW_TIME_TEXT];
    bool ends = strcmp(kind, "done") == 0 || strcmp(kind, "reused") == 0;
    json_int_t done = json_integer_value(json_object_get(data, "stages_done"));
    if (ends && done > 0 && done <= BW_API_STAGE_COUNT) json_object_set_new(data, "stage", json_string(bw_api_stages[done - 1].name));
    json_object_set_new(data, "job", json_string(job));
    json_object_set_new(data, "change", json_string(kind));
    json_object_set_new(data, "at", json_string(bw_time_text(at, text)));
    bw_stream_json(s, ends || strcmp(kind, "started") == 0 ? "stage" : "state", seq, data);
}

/* ---- of a job ---- */

typedef struct {
    bw_services services;
    bw_stream *stream;
    char id[BW_PARAMETER_MOST];
    int64_t seen;           /* number of the last event */
    bool runs;              /* an attempt is under way, as far as has been told */
    int done, count;        /* stages, likewise */
    char stage[16];
    double progress;        /* of the stage; told last, as is the note */
    char note[BW_NOTE_TEXT];
    int64_t progress_at;    /* when more of it may be told; monotonic */
} job_events;

static void on_event(void *user, int64_t seq, const char *job, const char *kind, const char *text, int64_t at) {
    job_events *e = user;
    json_t *data = json_loads(text, 0, NULL);
    const char *stage = json_string_value(json_object_get(data, "stage"));
    e->done = (int)json_integer_value(json_object_get(data, "stages_done"));
    e->count = (int)json_integer_value(json_object_get(data, "stage_count"));
    snprintf(e->stage, sizeof e->stage, "%s", stage ? stage : "");
    if (strcmp(kind, "started") == 0) e->runs = true, e->progress = 0, *e->note = '\0';
    else if (strcmp(kind, "cancelling") != 0 && strcmp(kind, "finishing") != 0) e->runs = false;
    send_event(e->stream, seq, job, kind, data, at);
}

/* Of progress and notes only the last counts, so a client that is slow gets few. */
static void send_progress(job_events *e, double progress, const char note[BW_NOTE_TEXT]) {
    int64_t now = bw_mono_ms();
    if (!e->runs || e->count <= 0 || now < e->progress_at) return;
    if (progress != e->progress) {
        e->progress = progress;
        e->progress_at = now + PROGRESS_MS;
        bw_stream_json(e->stream, "progress", -1, json_pack("{s:s, s:s, s:f}", "job", e->id, "stage", e->stage, "progress",
                                                            (e->done + progress) / e->count));
    }
    if (*note && strcmp(note, e->note) != 0) {
        memcpy(e->note, note, sizeof e->note);
        e->progress_at = now + PROGRESS_MS;
        bw_stream_json(e->stream, "note", -1, json_pack("{s:s, s:s, s:s}", "job", e->id, "stage", e->stage, "note", note));
    }
}

static bool has_ended(bw_job_state state) { return state != BW_JOB_QUEUED && state != BW_JOB_RUNNING; }

/* What is read first is older: if the job had ended then, the journal is whole; and progress is not of a stage that it does not know yet. */
static bw_stream_state more_events(bw_stream *s, void *user) {
    job_events *e = user;
    char note[BW_NOTE_TEXT];
    bw_job_state state;
    bool known;
    double progress = bw_dispatch_progress(e->services.dispatch, e->id, note);
    bw_journal page = {.job = e->id, .after = e->seen, .limit = PAGE};
    e->stream = s;
    if (bw_queue_state(e->services.queue, e->id, &state, &known) != BW_OK || bw_queue_journal(e->services.queue, &page, on_event, e) != BW_OK)
        return BW_STREAM_BROKEN;
    e->seen = page.last;
    if (page.looked) return BW_STREAM_ON;
    if (known && !has_ended(state)) {
        send_progress(e, progress, note);
        return BW_STREAM_ON;
    }
    bw_stream_json(s, "end", -1, json_pack("{s:s, s:s}", "job", e->id, "state", known ? bw_job_state_names[state] : "deleted"));
    return BW_STREAM_END;
}

static void none_seen(void *user, int64_t seq, const char *job, const char *kind, const char *data, int64_t at) {
    (void)user, (void)seq, (void)job, (void)kind, (void)data, (void)at;
}

/* Whoever has seen the last event of a job that has ended gets 204, which tells a browser not to come again. */
static bool all_seen(bw_request *r, const bw_job *job, int64_t seen) {
    bw_journal next = {.job = job->id, .after = seen, .limit = 1};
    if (!has_ended(job->state)) return false;
    if (bw_queue_journal(r->services->queue, &next, none_seen, NULL) != BW_OK) bw_reply_storage(r);
    else if (!next.looked) bw_reply_nothing(r);
    return r->reply != NULL;
}

void bw_http_job_events(bw_request *r) {
    int64_t seen, newest;
    bw_job job;
    if (!bw_stream_position(r, 0, &seen)) return;
    if (bw_queue_journal_end(r->services->queue, &newest) != BW_OK) {
        bw_reply_storage(r);
        return;
    }
    if (seen > newest) seen = 0; /* numbers of another daemon, or of before a restore: all of it again */
    if (!bw_http_load_job(r, &job)) return;
    bool done = all_seen(r, &job, seen);
    job_events *e = done ? NULL : calloc(1, sizeof *e);
    if (e) {
        e->services = *r->services;
        snprintf(e->id, sizeof e->id, "%s", job.id);
        e->seen = seen;
        e->runs = job.open;
        e->done = job.stage;
        e->count = job.stage_count;
        snprintf(e->stage, sizeof e->stage, "%s", bw_api_stages[job.stage < job.stage_count ? job.stage : job.stage_count - 1].name);
        bw_stream_start(r, &(bw_stream_source){more_events, free, e, e->id});
    } else if (!done) {
        bw_reply_json(r, 500, NULL);
    }
    bw_job_clear(&job);
}

/* ---- of all jobs ---- */

typedef struct {
    bw_queue *queue;
    bw_stream *stream;
    bool everybody;
    char owner[BW_OWNER_TEXT];
    int64_t seen;
} all_events;

static void on_any_event(void *user, int64_t seq, const char *job, const char *kind, const char *text, int64_t at) {
    send_event(((all_events *)user)->stream, seq, job, kind, json_loads(text, 0, NULL), at);
}

static bw_stream_state more_of_all(bw_stream *s, void *user) {
    all_events *e = user;
    bw_journal page = {.owner = e->everybody ? NULL : e->owner, .after = e->seen, .limit = e->everybody ? PAGE : SCAN};
    e->stream = s;
    if (bw_queue_journal(e->queue, &page, on_any_event, e) != BW_OK) return BW_STREAM_BROKEN;
    e->seen = page.last;
    if (page.looked == page.limit && bw_stream_is_empty(s)) bw_stream_comment(s); /* there is more, but others have their turn first */
    return BW_STREAM_ON;
}

void bw_http_event_list(bw_request *r) {
    const char *owner;
    int64_t seen, newest;
    if (!bw_http_owner_wanted(r, &owner)) return;
    if (bw_queue_journal_end(r->services->queue, &newest) != BW_OK) {
        bw_reply_storage(r);
        return;
    }
    if (!bw_stream_position(r, newest, &seen)) return;
    if (seen > newest) seen = newest; /* numbers of another daemon, or of before a restore */
    all_events *e = calloc(1, sizeof *e);
    if (!e) {
        bw_reply_json(r, 500, NULL);
        return;
    }
    e->queue = r->services->queue;
    e->everybody = !owner;
    snprintf(e->owner, sizeof e->owner, "%s", owner ? owner : "");
    e->seen = seen;
    bw_stream_start(r, &(bw_stream_source){more_of_all, free, e, ""});
}
