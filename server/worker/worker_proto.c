#include "server/worker/worker_proto.h"

#include <errno.h>
#include <string.h>
#include <sys/socket.h>

void bw_decoder_init(bw_decoder *d) {
    d->start = d->end = 0;
    d->hello = d->result = false;
    d->status = BW_OK;
}

void *bw_decoder_space(bw_decoder *d, size_t *room) {
    if (d->start > 0) {
        memmove(d->buffer, d->buffer + d->start, d->end - d->start);
        d->end -= d->start;
        d->start = 0;
    }
    *room = sizeof d->buffer - d->end;
    return d->buffer + d->end;
}

void bw_decoder_filled(bw_decoder *d, size_t size) { d->end += size; }

static uint32_t read_u32(const unsigned char *p) {
    return (uint32_t)p[0] | (uint32_t)p[1] << 8 | (uint32_t)p[2] << 16 | (uint32_t)p[3] << 24;
}

/* The double by its bits, so that the wire does not depend on the machine. */
double bw_frame_progress(const bw_frame *frame) {
    uint64_t bits = read_u32(frame->data) | (uint64_t)read_u32(frame->data + 4) << 32;
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static size_t most_of(bw_frame_type type) { return type == BW_FRAME_NOTE ? BW_FRAME_NOTE_MOST : BW_FRAME_MOST; }

static bw_status check_header(const unsigned char *h, size_t size) {
    if (h[0] != 'B' || h[1] != 'W') return BW_E_SYNTAX;
    if (h[2] != BW_WORKER_PROTOCOL) return BW_E_VERSION;
    if (h[3] < BW_FRAME_HELLO || h[3] > BW_FRAME_NOTE) return BW_E_SYNTAX;
    if (size > most_of((bw_frame_type)h[3]) || (h[3] == BW_FRAME_PROGRESS && size != 8)) return BW_E_COUNT;
    return BW_OK;
}

/* HELLO comes first and once; nothing comes after RESULT. */
static bw_status check_order(bw_decoder *d, const bw_frame *frame) {
    if (d->result || d->hello == (frame->type == BW_FRAME_HELLO)) return BW_E_SYNTAX;
    d->hello = true;
    d->result = frame->type == BW_FRAME_RESULT;
    if (frame->type == BW_FRAME_PROGRESS) {
        double value = bw_frame_progress(frame);
        if (!(value >= 0 && value <= 1)) return BW_E_NUMBER;
    }
    return BW_OK;
}

bool bw_decoder_next(bw_decoder *d, bw_frame *frame) {
    size_t here = d->end - d->start;
    const unsigned char *h = d->buffer + d->start;
    if (d->status != BW_OK || here < BW_FRAME_HEADER) return false;
    size_t size = read_u32(h + 4);
    d->status = check_header(h, size);
    if (d->status != BW_OK || here - BW_FRAME_HEADER < size) return false;
    frame->type = (bw_frame_type)h[3];
    frame->size = size;
    frame->data = h + BW_FRAME_HEADER;
    d->status = check_order(d, frame);
    if (d->status != BW_OK) return false;
    d->start += BW_FRAME_HEADER + size;
    return true;
}

static bool send_all(int channel, const void *data, size_t size) {
    for (const char *at = data; size;) {
        ssize_t n = send(channel, at, size, MSG_NOSIGNAL);
        if (n < 0 && errno == EINTR) continue;
        if (n <= 0) return false;
        at += n;
        size -= (size_t)n;
    }
    return true;
}

bool bw_send_frame(int channel, bw_frame_type type, const void *data, size_t size) {
    if (size > most_of(type)) {
        if (type != BW_FRAME_LOG && type != BW_FRAME_NOTE) return false;
        size = most_of(type);
    }
    unsigned char h[BW_FRAME_HEADER] = {'B', 'W', BW_WORKER_PROTOCOL, (unsigned char)type};
    for (int i = 0; i < 4; i++) h[4 + i] = (unsigned char)(size >> 8 * i);
    return send_all(channel, h, sizeof h) && send_all(channel, data, size);
}

bool bw_send_progress(int channel, double fraction) {
    uint64_t bits;
    unsigned char data[8];
    memcpy(&bits, &fraction, sizeof bits);
    for (int i = 0; i < 8; i++) data[i] = (unsigned char)(bits >> 8 * i);
    return bw_send_frame(channel, BW_FRAME_PROGRESS, data, sizeof data);
}
