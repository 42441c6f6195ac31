#include "format/output.h"

#include <errno.h>
#include <fcntl.h>
#include <unistd.h>

#include "format/number.h"

bw_status bw_output_open(bw_context *ctx, bw_output *out, const char *path) {
    *out = (bw_output){.ctx = ctx, .path = path, .descriptor = -1};
    out->buffer = bw_alloc(ctx, BW_OUTPUT_ROOM, 1);
    if (!out->buffer) return out->status = ctx->error.status;
    out->descriptor = open(path, O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666);
    if (out->descriptor < 0)
        out->status = bw_fail(ctx, BW_E_IO, "cannot create %s: %s", path, strerror(errno));
    return out->status;
}

static void flush(bw_output *out) {
    for (size_t done = 0; done < out->used && out->status == BW_OK;) {
        ssize_t n = write(out->descriptor, out->buffer + done, out->used - done);
        if (n >= 0)
            done += (size_t)n;
        else if (errno != EINTR)
            out->status = bw_fail(out->ctx, BW_E_IO, "cannot write %s: %s", out->path, strerror(errno));
    }
    out->used = 0;
}

bw_status bw_output_close(bw_output *out, uint64_t *bytes) {
    if (out->buffer) flush(out);
    if (out->descriptor >= 0 && close(out->descriptor) && out->status == BW_OK)
        out->status = bw_fail(out->ctx, BW_E_IO, "cannot close %s: %s", out->path, strerror(errno));
    bw_free(out->ctx, out->buffer);
    out->buffer = NULL;
    out->descriptor = -1;
    if (bytes) *bytes = out->bytes;
    return out->status;
}

void bw_put_bytes(bw_output *out, const void *bytes, size_t length) {
    const char *from = bytes;
    while (length && out->status == BW_OK) {
        if (out->used == BW_OUTPUT_ROOM) flush(out);
        size_t room = BW_OUTPUT_ROOM - out->used, part = length < room ? length : room;
        memcpy(out->buffer + out->used, from, part);
        out->used += part, out->bytes += part;
        from += part, length -= part;
    }
}

void bw_put_integer(bw_output *out, int64_t value) {
    char text[BW_NUMBER_TEXT];
    bw_put_bytes(out, text, bw_integer_print(value, text));
}

void bw_put_number(bw_output *out, double value) {
    char text[BW_NUMBER_TEXT];
    bw_put_bytes(out, text, bw_number_print(value, text));
}
