#include "server/http/stream.h"

#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/queue.h>
#include <unistd.h>

#include "server/clock.h"
#include "server/http/reply.h"
#include "server/metrics.h"

enum { BLOCK = 4096, FULL_SECONDS = 10 };

typedef struct owner {
    char name[BW_OWNER_TEXT];
    int streams;
    LIST_ENTRY(owner) link;
} owner;

struct bw_streams {
    pthread_mutex_t lock;
    LIST_HEAD(, owner) owners; /* those that have streams */
};

struct bw_stream {
    bw_streams *all;
    owner *owner;
    bw_request *request;
    bw_stream_source source;
    bw_stream_state state;
    bool lost; /* out of memory while an event was added */
    char topic[BW_JOB_ID_TEXT];
    int64_t look_at;          /* monotonic: when to look around */
    char *text;               /* NULL while it is idle */
    size_t at, size, room;    /* sent; there; allocated */
    bw_watcher watcher;
    _Atomic int reason;       /* why it was resumed: bw_watch_reason */
};

/* ---- how many there are ---- */

bw_status bw_streams_open(bw_streams **out) {
    bw_streams *all = calloc(1, sizeof *all);
    if (!all) return BW_E_MEMORY;
    pthread_mutex_init(&all->lock, NULL);
    LIST_INIT(&all->owners);
    *out = all;
    return BW_OK;
}

void bw_streams_close(bw_streams *all) {
    if (!all) return;
    pthread_mutex_destroy(&all->lock);
    free(all);
}

static owner *find_owner(bw_streams *all, const char *name) {
    owner *o;
    LIST_FOREACH(o, &all->owners, link)
        if (strcmp(o->name, name) == 0) return o;
    if (!(o = calloc(1, sizeof *o))) return NULL;
    snprintf(o->name, sizeof o->name, "%s", name);
    LIST_INSERT_HEAD(&all->owners, o, link);
    return o;
}

/* One more of the owner's; NULL if it has `most` (0: any number), or without memory. */
static owner *count_in(bw_streams *all, const char *name, int most) {
    pthread_mutex_lock(&all->lock);
    owner *o = find_owner(all, name);
    if (o && most && o->streams >= most) o = NULL;
    if (o) o->streams++;
    pthread_mutex_unlock(&all->lock);
    if (o) bw_gauge_add(BW_METRIC_STREAMS, 0, 1);
    return o;
}

static void count_out(bw_streams *all, owner *o) {
    pthread_mutex_lock(&all->lock);
    if (--o->streams == 0) {
        LIST_REMOVE(o, link);
        free(o);
    }
    pthread_mutex_unlock(&all->lock);
    bw_gauge_add(BW_METRIC_STREAMS, 0, -1);
}

/* ---- what is to be sent ---- */

static void add(bw_stream *s, const char *text, size_t size) {
    if (s->size + size > s->room) {
        size_t room = s->size + size < BLOCK ? BLOCK : 2 * (s->size + size);
        char *more = realloc(s->text, room);
        if (!more) s->lost = true;
        if (!more) return;
        s->text = more;
        s->room = room;
    }
    memcpy(s->text + s->size, text, size);
    s->size += size;
}

/* A carriage return ends a line for the reader of a stream, too. */
void bw_stream_event(bw_stream *s, const char *event, int64_t id, const char *data, size_t size) {
    char head[80];
    int n = id < 0 ? snprintf(head, sizeof head, "event: %s\n", event) : snprintf(head, sizeof head, "id: %lld\nevent: %s\n", (long long)id, event);
    add(s, head, (size_t)n);
    const char *end = data + size;
    do {
        const char *line = data;
        while (data < end && *data != '\n' && *data != '\r') data++;
        add(s, "data: ", 6);
        add(s, line, (size_t)(data - line));
        add(s, "\n", 1);
    } while (data++ < end);
    add(s, "\n", 1);
}

void bw_stream_json(bw_stream *s, const char *event, int64_t id, json_t *data) {
    char *text = data ? json_dumps(data, JSON_COMPACT | JSON_REAL_PRECISION(6)) : NULL;
    json_decref(data);
    if (text) bw_stream_event(s, event, id, text, strlen(text));
    else s->lost = true;
    free(text);
}

void bw_stream_comment(bw_stream *s) { add(s, ":\n\n", 3); }
bool bw_stream_is_empty(const bw_stream *s) { return s->at == s->size; }

/* Room for nothing, until there is something again. */
static void empty(bw_stream *s) {
    free(s->text);
    s->text = NULL;
    s->at = s->size = s->room = 0;
}

static ssize_t take(bw_stream *s, char *out, size_t room) {
    size_t n = s->size - s->at < room ? s->size - s->at : room;
    memcpy(out, s->text + s->at, n);
    s->at += n;
    s->request->sent += n;
    return (ssize_t)n;
}

/* ---- waiting ---- */

static void on_told(void *user, bw_watch_reason reason) {
    bw_stream *s = user;
    atomic_store(&s->reason, (int)reason);
    bw_request_resume(s->request);
}

static void ask(bw_stream *s) {
    if (s->state == BW_STREAM_ON) s->state = s->source.more(s, s->source.state);
    if (s->lost) s->state = BW_STREAM_BROKEN;
}

static bool has_news(const bw_stream *s) { return !bw_stream_is_empty(s) || s->state != BW_STREAM_ON; }

/* Gives back the pages of a buffer whose content does not matter until it is written: libmicrohttpd has cleared them, which is most of what an
 * idle connection takes. It is private anonymous memory, so they come back as zeros. */
static void give_back(char *buffer, size_t size) {
    uintptr_t page = (uintptr_t)sysconf(_SC_PAGESIZE), first = ((uintptr_t)buffer + page - 1) / page * page, end = ((uintptr_t)buffer + size) / page * page;
    if (end > first) madvise((void *)first, end - first, MADV_DONTNEED);
}

/* Suspends until there is something. See watch.h for the order. */
static void sleep_on(bw_stream *s) {
    bw_watch *watch = s->request->services->watch;
    empty(s);
    bw_request_suspend(s->request);
    bw_watch_listen(watch, &s->watcher, s->topic, s->look_at, on_told, s);
    ask(s);
    if (has_news(s) && bw_watch_remove(watch, &s->watcher)) bw_request_resume(s->request);
}

/* May the client hear more? And now and then, however much there is to tell: is he still there? */
static void look_around(bw_stream *s) {
    const bw_request *r = s->request;
    int64_t now = bw_mono_ms();
    if (s->state != BW_STREAM_ON) return;
    if (!bw_access_holds(r->services->access, &r->caller, bw_now_ms())) {
        s->state = BW_STREAM_END;
    } else if (now >= s->look_at) {
        s->look_at = now + r->services->config->stream_comment_ms;
        if (bw_guard_has_gone(r->guarded)) s->state = BW_STREAM_BROKEN;
        else bw_stream_comment(s);
    }
}

static ssize_t read_stream(void *user, uint64_t at, char *out, size_t room) {
    bw_stream *s = user;
    (void)at;
    if (bw_stream_is_empty(s)) {
        empty(s);
        look_around(s);
        ask(s);
    }
    if (s->state == BW_STREAM_BROKEN) return MHD_CONTENT_READER_END_WITH_ERROR;
    if (!bw_stream_is_empty(s)) return take(s, out, room);
    if (s->state == BW_STREAM_END || atomic_load(&s->reason) == BW_WATCH_STOP || bw_watch_stopped(s->request->services->watch))
        return MHD_CONTENT_READER_END_OF_STREAM;
    give_back(out, room);
    sleep_on(s);
    return 0;
}

/* ---- beginning and end ---- */

static void free_stream(void *user) {
    bw_stream *s = user;
    if (s->source.release) s->source.release(s->source.state);
    count_out(s->all, s->owner);
    free(s->text);
    free(s);
}

static void refuse(bw_request *r, const bw_stream_source *source) {
    int most = r->services->config->owner_streams;
    char seconds[12];
    if (source->release) source->release(source->state);
    bw_reply_problem(r, BW_PROBLEM_TOO_MANY_STREAMS, "you may have %d streams of events and logs at the same time", most);
    snprintf(seconds, sizeof seconds, "%d", FULL_SECONDS);
    bw_reply_header(r, "Retry-After", seconds);
}

static bw_stream *new_stream(bw_request *r, const bw_stream_source *source, owner *o) {
    char retry[40];
    bw_stream *s = calloc(1, sizeof *s);
    if (!s) return NULL;
    s->all = r->traffic->streams;
    s->owner = o;
    s->request = r;
    s->source = *source;
    s->look_at = bw_mono_ms() + r->services->config->stream_comment_ms;
    snprintf(s->topic, sizeof s->topic, "%s", source->topic);
    add(s, retry, (size_t)snprintf(retry, sizeof retry, "retry: %d\n\n", BW_STREAM_RETRY_MS));
    return s;
}

void bw_stream_start(bw_request *r, const bw_stream_source *source) {
    owner *o = count_in(r->traffic->streams, r->caller.owner, r->services->config->owner_streams);
    if (!o) {
        refuse(r, source);
        return;
    }
    bw_stream *s = new_stream(r, source, o);
    if (!s) {
        if (source->release) source->release(source->state);
        count_out(r->traffic->streams, o);
        bw_reply_json(r, 500, NULL);
        return;
    }
    struct MHD_Response *response = MHD_create_response_from_callback(MHD_SIZE_UNKNOWN, 1024, read_stream, s, free_stream);
    if (!response) free_stream(s);
    bw_reply_made(r, 200, response, "text/event-stream");
    bw_reply_header(r, "Cache-Control", "no-store");
    bw_reply_header(r, "X-Accel-Buffering", "no"); /* nginx */
}

bool bw_stream_position(bw_request *r, int64_t otherwise, int64_t *position) {
    const char *last = bw_request_header(r, "Last-Event-ID");
    char *end;
    if (!last || !*last) return bw_request_number(r, "after", 0, INT64_MAX, otherwise, position);
    errno = 0;
    *position = strtoll(last, &end, 10);
    if (!errno && *last >= '0' && *last <= '9' && !*end) return true;
    bw_reply_problem(r, BW_PROBLEM_BAD_REQUEST, "Last-Event-ID is no number of an event");
    return false;
}
