#include "format/hexex_lines.h"

#include <errno.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "format/number.h"

enum { CHUNK = 128 << 10, PROGRESS = 4 << 20 };

static bw_status open_lines(bw_context *ctx, bw_lines *lines) {
    lines->ctx = ctx;
    lines->room = CHUNK;
    lines->buffer = bw_alloc(ctx, lines->room + 1, 1); /* one more for the break of the last line */
    return lines->buffer ? BW_OK : ctx->error.status;
}

bw_status bw_lines_open_fd(bw_context *ctx, bw_lines *lines, int fd) {
    memset(lines, 0, sizeof *lines);
    lines->fd = fd;
    struct stat info;
    off_t here = lseek(fd, 0, SEEK_CUR);
    if (here >= 0 && fstat(fd, &info) == 0 && S_ISREG(info.st_mode)) {
        lines->sized = true;
        lines->size = info.st_size > here ? (uint64_t)(info.st_size - here) : 0;
    }
    return open_lines(ctx, lines);
}

bw_status bw_lines_open_memory(bw_context *ctx, bw_lines *lines, const void *data, size_t size) {
    memset(lines, 0, sizeof *lines);
    lines->fd = -1;
    lines->memory = data;
    lines->memory_left = size;
    lines->sized = true;
    lines->size = size;
    return open_lines(ctx, lines);
}

void bw_lines_close(bw_lines *lines) {
    if (lines->ctx) bw_free(lines->ctx, lines->buffer);
    memset(lines, 0, sizeof *lines);
}

static bw_status take(bw_lines *lines, char *to, size_t room, size_t *got) {
    if (lines->fd < 0) {
        *got = room < lines->memory_left ? room : lines->memory_left;
        if (*got) memcpy(to, lines->memory, *got);
        lines->memory += *got;
        lines->memory_left -= *got;
        return BW_OK;
    }
    for (;;) {
        ssize_t n = read(lines->fd, to, room);
        if (n < 0 && errno == EINTR) {
            bw_status status = bw_poll(lines->ctx);
            if (status != BW_OK) return status;
            continue;
        }
        if (n < 0) return bw_fail(lines->ctx, BW_E_IO, "cannot read the input: %s", strerror(errno));
        *got = (size_t)n;
        return BW_OK;
    }
}

/* Moves what is left, the start of a line, to the front of the buffer, and makes the buffer larger if it is full of it. */
static bw_status make_room(bw_lines *lines) {
    size_t kept = lines->filled - lines->begin;
    memmove(lines->buffer, lines->buffer + lines->begin, kept);
    lines->searched -= lines->begin;
    lines->begin = 0;
    lines->filled = kept;
    if (kept < lines->room) return BW_OK;
    if (lines->room >= BW_LINE_MAX) {
        bw_fail_element(lines->ctx, "line", (int64_t)lines->number, NULL);
        return bw_fail(lines->ctx, BW_E_LINE, "line %llu is longer than %d bytes", (unsigned long long)lines->number, BW_LINE_MAX);
    }
    char *buffer = bw_resize(lines->ctx, lines->buffer, 2 * lines->room + 1, 1);
    if (!buffer) return lines->ctx->error.status;
    lines->buffer = buffer;
    lines->room *= 2;
    return BW_OK;
}

static bw_status refill(bw_lines *lines) {
    size_t got = 0;
    bw_status status = bw_poll(lines->ctx);
    if (status == BW_OK) status = make_room(lines);
    if (status == BW_OK) status = take(lines, lines->buffer + lines->filled, lines->room - lines->filled, &got);
    if (status != BW_OK) return status;
    lines->filled += got;
    lines->read += got;
    lines->at_end = got == 0;
    if (lines->read - lines->reported >= PROGRESS && lines->size) {
        bw_progress(lines->ctx, (double)lines->read / (double)lines->size);
        lines->reported = lines->read;
    }
    return BW_OK;
}

/* The next line, blank or not. */
static bw_status step(bw_lines *lines) {
    lines->number++;
    for (;;) {
        char *from = lines->buffer + lines->searched, *to = lines->buffer + lines->filled;
        char *mark = from < to ? memchr(from, '\n', (size_t)(to - from)) : NULL;
        lines->searched = lines->filled;
        if (!mark && lines->at_end && lines->begin < lines->filled) {
            mark = to; /* the last line lacks its break: there is room for one */
            lines->broken_off = true;
        }
        if (mark) {
            *mark = '\n';
            lines->text = lines->buffer + lines->begin;
            lines->end = mark;
            lines->begin = (size_t)(mark - lines->buffer) + (mark < to);
            lines->searched = lines->begin;
            return BW_OK;
        }
        if (lines->at_end) {
            lines->text = lines->end = NULL;
            return BW_OK;
        }
        bw_status status = refill(lines);
        if (status != BW_OK) return status;
    }
}

bw_status bw_lines_next(bw_lines *lines) {
    for (;;) {
        bw_status status = step(lines);
        if (status != BW_OK || !lines->text) return status;
        while (lines->text < lines->end && bw_is_blank(*lines->text)) lines->text++;
        if (lines->text < lines->end) return BW_OK;
    }
}

uint64_t bw_lines_left(const bw_lines *lines) {
    if (!lines->sized) return UINT64_MAX;
    uint64_t taken = lines->read - (lines->filled - lines->begin);
    return lines->size > taken ? lines->size - taken : 0;
}
