/* Text input line by line, from a descriptor or from memory, in constant memory.
 *
 * Invariants
 *  1. A line handed out is whole: [text, end), without its line break, and *end may be read (it is a blank).
 *  2. The buffer never exceeds BW_LINE_MAX: a longer line is refused (BW_E_LINE) after reading that much of it.
 *  3. Lines count from 1; blank lines are passed over but counted.
 */
#ifndef BW_FORMAT_HEXEX_LINES_H
#define BW_FORMAT_HEXEX_LINES_H

#include "base/context.h"

enum { BW_LINE_MAX = 1 << 20 }; /* bytes, with the line break */

typedef struct {
    bw_context *ctx;
    int fd; /* borrowed; -1 when reading from memory */
    const char *memory;
    size_t memory_left;

    char *buffer;
    size_t room; /* bytes of the buffer: grows up to BW_LINE_MAX with the longest line */
    size_t begin, searched, filled; /* [begin, filled) is not handed out yet; no line break in [begin, searched) */
    bool at_end;                    /* the source has no more bytes */

    bool sized;    /* is the number of bytes known beforehand? */
    uint64_t size; /* that number */
    uint64_t read; /* bytes taken from the source */
    uint64_t reported;

    uint64_t number;       /* of the current line */
    const char *text, *end; /* the current line; text is NULL after the last one */
    bool broken_off;       /* the current line is the last one and has no line break */
} bw_lines;

/* Start reading at a descriptor's position (regular file, pipe, socket, ...), or at the first of `size` bytes. */
bw_status bw_lines_open_fd(bw_context *ctx, bw_lines *lines, int fd);
bw_status bw_lines_open_memory(bw_context *ctx, bw_lines *lines, const void *data, size_t size);
void bw_lines_close(bw_lines *lines);

/* Goes on to the next line that is not blank. Errors: BW_E_LINE, BW_E_IO, BW_E_CANCELLED. Reports progress every 4 MiB. */
bw_status bw_lines_next(bw_lines *lines);

/* Bytes after the current line; UINT64_MAX if unknown. */
uint64_t bw_lines_left(const bw_lines *lines);

#endif
