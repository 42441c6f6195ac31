/* Buffered output of a result file. The first failure is recorded in the context; what follows is dropped.
 *
 *     bw_output out;
 *     bw_output_open(ctx, &out, path);
 *     bw_put_text(&out, ...), bw_put_integer(&out, ...);
 *     status = bw_output_close(&out, &bytes);
 */
#ifndef BW_FORMAT_OUTPUT_H
#define BW_FORMAT_OUTPUT_H

#include <string.h>

#include "base/context.h"

enum { BW_OUTPUT_ROOM = 1 << 18, BW_OUTPUT_SLACK = 1 << 12 /* bytes that bw_output_room guarantees */ };

typedef struct {
    bw_context *ctx;
    const char *path; /* borrowed */
    char *buffer;
    size_t used;
    uint64_t bytes; /* written or still in the buffer */
    int descriptor;
    bw_status status;
} bw_output;

/* Creates or empties the file. After a failure call nothing but bw_output_close. A later failure (disk full) shows in
 * bw_output_close; until then every bw_put_* is harmless. */
bw_status bw_output_open(bw_context *ctx, bw_output *out, const char *path);
/* Writes what is buffered, closes, frees. bytes (may be NULL): size of the file. */
bw_status bw_output_close(bw_output *out, uint64_t *bytes);

/* Where at least BW_OUTPUT_SLACK bytes may be written; the writer then says how many it wrote. */
char *bw_output_room(bw_output *out);
static inline void bw_output_advance(bw_output *out, size_t written) {
    out->used += written;
    out->bytes += written;
}
void bw_put_bytes(bw_output *out, const void *bytes, size_t length);
static inline void bw_put_text(bw_output *out, const char *text) { bw_put_bytes(out, text, strlen(text)); }
void bw_put_integer(bw_output *out, int64_t value);
void bw_put_number(bw_output *out, double value); /* shortest decimal that reads back as the same double */

#endif
