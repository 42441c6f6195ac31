/* The log of a job: whole, its end, or as it grows. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "server/http/content.h"
#include "server/http/operations.h"
#include "server/http/reply.h"
#include "server/http/stream.h"

enum { PIECE = 4096, BLOCK = 16384, LINES_MOST = 10000 };

/* Where the last `lines` lines of a file begin. */
static uint64_t find_tail(int fd, uint64_t bytes, int64_t lines) {
    char block[BLOCK];
    uint64_t end = bytes;
    while (end > 0) {
        size_t size = end < BLOCK ? (size_t)end : BLOCK;
        if (pread(fd, block, size, (off_t)(end - size)) != (ssize_t)size) return 0;
        for (size_t i = size; i-- > 0;) {
            uint64_t place = end - size + i;
            if (block[i] == '\n' && place + 1 < bytes && --lines == 0) return place + 1;
        }
        end -= size;
    }
    return 0;
}

/* ---- as it grows ---- */

typedef struct {
    bw_services services;
    char id[BW_PARAMETER_MOST];
    int64_t sent;  /* bytes; the number of an event is how far the log was with it */
    int64_t lines; /* to begin with, of the end of the log; 0: from `sent` on */
} log_stream;

/* Whole lines, as many as fit; the last of a log that has ended may lack its end. */
static ssize_t read_lines(log_stream *l, char piece[PIECE], bool ended) {
    uint64_t bytes;
    int fd = bw_store_open_log(l->services.store, l->id, &bytes);
    if (fd < 0) return 0;
    if (l->lines) l->sent = (int64_t)find_tail(fd, bytes, l->lines);
    l->lines = 0;
    ssize_t n = pread(fd, piece, PIECE, (off_t)l->sent);
    close(fd);
    ssize_t whole = n > 0 ? n : 0;
    while (whole > 0 && piece[whole - 1] != '\n') whole--;
    return whole == 0 && (ended || n == PIECE) ? n : whole;
}

static bw_stream_state more_log(bw_stream *s, void *user) {
    log_stream *l = user;
    char piece[PIECE];
    bw_job_state state;
    bool known;
    if (bw_queue_state(l->services.queue, l->id, &state, &known) != BW_OK) return BW_STREAM_BROKEN;
    bool ended = !known || (state != BW_JOB_QUEUED && state != BW_JOB_RUNNING);
    ssize_t n = read_lines(l, piece, ended);
    if (n < 0) return BW_STREAM_BROKEN;
    if (n > 0) {
        l->sent += n;
        bw_stream_event(s, "log", l->sent, piece, (size_t)n - (piece[n - 1] == '\n'));
        return BW_STREAM_ON;
    }
    if (!ended) return BW_STREAM_ON;
    bw_stream_json(s, "end", -1, json_pack("{s:s, s:s}", "job", l->id, "state", known ? bw_job_state_names[state] : "deleted"));
    return BW_STREAM_END;
}

static void follow(bw_request *r, const bw_job *job, int64_t seen, int64_t lines) {
    uint64_t bytes = 0;
    int fd = bw_store_open_log(r->services->store, job->id, &bytes);
    if (fd >= 0) close(fd);
    if (seen > 0 && (uint64_t)seen >= bytes && job->state != BW_JOB_QUEUED && job->state != BW_JOB_RUNNING) {
        bw_reply_nothing(r); /* a browser does not come again */
        return;
    }
    log_stream *l = calloc(1, sizeof *l);
    if (!l) {
        bw_reply_json(r, 500, NULL);
        return;
    }
    l->services = *r->services;
    snprintf(l->id, sizeof l->id, "%s", job->id);
    l->sent = seen > 0 ? seen : 0;
    l->lines = seen < 0 ? lines : 0;
    bw_stream_start(r, &(bw_stream_source){more_log, free, l, l->id});
}

/* ---- as it is ---- */

static void send_log(bw_request *r, const bw_job *job, int64_t lines) {
    static const char text_plain[] = "text/plain; charset=utf-8";
    uint64_t bytes;
    int fd = bw_store_open_log(r->services->store, job->id, &bytes);
    if (fd < 0) {
        bw_reply_text(r, text_plain, "", 0);
        return;
    }
    uint64_t from = lines ? find_tail(fd, bytes, lines) : 0;
    bw_reply_content(r, 200, &(bw_content){.fd = fd, .offset = from, .bytes = bytes - from, .media_type = text_plain});
}

static bool read_follow(bw_request *r, bool *follows) {
    const char *text = bw_request_query(r, "follow");
    *follows = text && strcmp(text, "true") == 0;
    if (!text || *follows || strcmp(text, "false") == 0) return true;
    bw_reply_problem(r, BW_PROBLEM_INVALID_PARAMETER, "follow is true or false, not '%.40s'", text);
    return false;
}

void bw_http_job_log(bw_request *r) {
    int64_t lines, seen = -1;
    bool follows;
    bw_job job;
    if (!bw_request_number(r, "tail", 1, LINES_MOST, 0, &lines) || !read_follow(r, &follows)) return;
    if (!follows && bw_request_query(r, "after")) {
        bw_reply_problem(r, BW_PROBLEM_INVALID_PARAMETER, "after is for follow=true; Range asks for a part of the log");
        return;
    }
    if ((follows && !bw_stream_position(r, -1, &seen)) || !bw_http_load_job(r, &job)) return;
    if (follows) follow(r, &job, seen, lines);
    else send_log(r, &job, lines);
    bw_job_clear(&job);
}
