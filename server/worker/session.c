#include "server/worker/session.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "server/clock.h"

enum { LOG_MOST = 4 << 20, READ_MOST = 256 << 10 };

_Static_assert((int)BW_NOTE_TEXT > (int)BW_FRAME_NOTE_MOST, "a note has to fit");

void bw_session_open(bw_session *s, const bw_api_stage *stage, int attempt, pthread_mutex_t *lock, int channel, int errors, int log) {
    memset(s, 0, sizeof *s);
    s->stage = stage;
    s->attempt = attempt;
    s->lock = lock;
    s->channel = channel;
    s->errors = errors;
    s->log = log;
    bw_decoder_init(&s->decoder);
}

static void close_one(int *fd) {
    if (*fd >= 0) close(*fd);
    *fd = -1;
}

void bw_session_close(bw_session *s) {
    close_one(&s->channel);
    close_one(&s->errors);
    close_one(&s->log);
    json_decref(s->result);
    s->result = NULL;
}

/* ---- the job's log ---- */

static void append(bw_session *s, const char *text, size_t size) {
    char line[BW_LOG_LINE_MOST + 100], time[BW_TIME_TEXT];
    if (s->log < 0 || s->logged > LOG_MOST) return;
    if (size > BW_LOG_LINE_MOST) size = BW_LOG_LINE_MOST;
    int n = snprintf(line, 80, "%s %s#%d ", bw_time_text(bw_now_ms(), time), s->stage ? s->stage->name : "trial", s->attempt);
    size_t at = (size_t)n;
    for (size_t i = 0; i < size; i++) line[at++] = (unsigned char)text[i] < 0x20 || text[i] == 0x7f ? ' ' : text[i];
    line[at++] = '\n';
    if (write(s->log, line, at) < 0) s->logged = LOG_MOST; /* the log is not worth the job */
    s->logged += at;
}

/* What the worker says; the daemon's own lines come through bw_session_log and are never cut. */
static void append_said(bw_session *s, const char *text, size_t size) {
    static const char cut[] = "(the worker says more; the log ends here)";
    if (s->logged + size + BW_LOG_LINE_MOST < LOG_MOST) append(s, text, size);
    else if (s->logged < LOG_MOST - BW_LOG_LINE_MOST) append(s, cut, sizeof cut - 1), s->logged = LOG_MOST - BW_LOG_LINE_MOST;
}

void bw_session_log(bw_session *s, const char *text) { append(s, text, strlen(text)); }

static void end_line(bw_session *s) {
    if (s->line_size) append_said(s, s->line, s->line_size);
    s->line_size = 0;
}

/* Reads standard error. False: there is no more for now. */
static bool read_errors(bw_session *s, size_t *left) {
    char bytes[16384];
    ssize_t n = read(s->errors, bytes, sizeof bytes);
    if (n < 0 && errno == EINTR) return true;
    if (n <= 0) {
        if (n < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return false;
        end_line(s);
        close_one(&s->errors);
        return false;
    }
    for (ssize_t i = 0; i < n; i++) {
        if (bytes[i] == '\n' || s->line_size == sizeof s->line) end_line(s);
        if (bytes[i] != '\n') s->line[s->line_size++] = bytes[i];
    }
    s->said += (size_t)n;
    *left -= (size_t)n < *left ? (size_t)n : *left;
    return true;
}

/* ---- frames ---- */

/* What the worker tells of its sandbox. Nothing told is nothing in force. */
static void take_sandbox(bw_session *s, const json_t *told) {
    s->sandbox.no_new_privileges = json_is_true(json_object_get(told, "no_new_privileges"));
    s->sandbox.seccomp = json_is_true(json_object_get(told, "seccomp"));
    s->sandbox.address_space = json_is_true(json_object_get(told, "address_space"));
    s->sandbox.landlock = (int)json_integer_value(json_object_get(told, "landlock"));
    const char *missing = json_string_value(json_object_get(told, "missing"));
    snprintf(s->sandbox.missing, sizeof s->sandbox.missing, "%s", missing ? missing : "the worker does not tell of a sandbox");
}

/* The worker must be of the same build as the daemon: same stage, same version of its algorithm. */
static bool take_hello(bw_session *s, const bw_frame *frame) {
    json_t *hello = json_loadb((const char *)frame->data, frame->size, JSON_REJECT_DUPLICATES, NULL);
    const char *stage = json_string_value(json_object_get(hello, "stage"));
    json_int_t version = json_integer_value(json_object_get(hello, "version"));
    bool fits = stage && strcmp(stage, s->stage ? s->stage->name : BW_WORKER_TRIAL) == 0 && version == (s->stage ? s->stage->version : 0);
    take_sandbox(s, json_object_get(hello, "sandbox"));
    json_decref(hello);
    return fits;
}

static void take_note(bw_session *s, const bw_frame *frame) {
    pthread_mutex_lock(s->lock);
    for (size_t i = 0; i < frame->size; i++) s->note[i] = frame->data[i] >= 0x20 && frame->data[i] < 0x7f ? (char)frame->data[i] : '?';
    s->note[frame->size] = '\0';
    pthread_mutex_unlock(s->lock);
    append_said(s, s->note, frame->size);
}

static bool take_frame(bw_session *s, const bw_frame *frame) {
    switch (frame->type) {
    case BW_FRAME_HELLO:
        return take_hello(s, frame);
    case BW_FRAME_PROGRESS:
        pthread_mutex_lock(s->lock);
        s->progress = bw_frame_progress(frame);
        pthread_mutex_unlock(s->lock);
        return true;
    case BW_FRAME_LOG:
        append_said(s, (const char *)frame->data, frame->size);
        return true;
    case BW_FRAME_NOTE:
        take_note(s, frame);
        return true;
    case BW_FRAME_RESULT:
        s->result = json_loadb((const char *)frame->data, frame->size, JSON_REJECT_DUPLICATES, NULL);
        return json_is_string(json_object_get(s->result, "status"));
    }
    return false;
}

/* Likewise of the channel. */
static bool read_frames(bw_session *s, size_t *left) {
    size_t room;
    bw_frame frame;
    void *space = bw_decoder_space(&s->decoder, &room);
    ssize_t n = recv(s->channel, space, room, MSG_DONTWAIT);
    if (n < 0 && errno == EINTR) return true;
    if (n <= 0) {
        if (n == 0 || (errno != EAGAIN && errno != EWOULDBLOCK)) close_one(&s->channel);
        return false;
    }
    bw_decoder_filled(&s->decoder, (size_t)n);
    s->said += (size_t)n;
    *left -= (size_t)n < *left ? (size_t)n : *left;
    bool good = true;
    while (good && bw_decoder_next(&s->decoder, &frame)) good = take_frame(s, &frame);
    if (good && s->decoder.status == BW_OK) return true;
    s->state = BW_SAY_BROKEN;
    bw_session_log(s, "the worker broke the protocol");
    return false;
}

static void read_some(bw_session *s, size_t most) {
    size_t left = most;
    for (bool more = true; more && left && s->state == BW_SAY_GOOD;) {
        more = s->channel >= 0 && read_frames(s, &left);
        if (left && s->errors >= 0) more |= read_errors(s, &left);
        if (s->said > BW_SAID_MOST && s->state == BW_SAY_GOOD) s->state = BW_SAY_FLOOD;
    }
    if (s->state == BW_SAY_GOOD) return;
    close_one(&s->channel); /* nothing of it counts any more, and a worker that still writes is stopped by that too */
    close_one(&s->errors);
}

void bw_session_read(bw_session *s) { read_some(s, READ_MOST); }
void bw_session_drain(bw_session *s) { read_some(s, BW_SAID_MOST); }
