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

enum { BW_OUTPUT_ROOM = 1 << 18 };

typedef struct {
    bw_context *ctx;
    const char *path; /* borrowed */
    char *buffer;
    size_t used;
    uint64_t bytes; /* written or still in the buffer */
    int descriptor;
    bw_status status;
} bw_output;

/* Creates or empties the file. A failure, this one or a later one (disk full), makes every bw_put_* that
 * follows do nothing and is returned by bw_output_close, which must follow in any case. */
bw_status bw_output_open(bw_context *ctx, bw_output *out, const char *path);
/* Writes what is buffered, closes, frees. bytes (may be NULL): size of the file. */
bw_status bw_output_close(bw_output *out, uint64_t *bytes);

void bw_put_bytes(bw_output *out, const void *bytes, size_t length);
static inline void bw_put_text(bw_output *out, const char *text) {
    bw_put_bytes(out, text, strlen(text));
}
void bw_put_integer(bw_output *out, int64_t value);
void bw_put_number(bw_output *out, double value); /* shortest decimal that reads back as the same double */

#endif
