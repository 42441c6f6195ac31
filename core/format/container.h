/* Container of the state files between stages: named sections of fixed-size elements, read in place from a mapping.
 *
 *     offset 0    bw_container_header                       64 bytes
 *            64   bw_container_entry * section_count        64 bytes each, in ascending order of offset
 *            ...  payloads, each at a multiple of 64 bytes, zero bytes between them and up to the end
 *
 * Numbers are in the machine's byte order, which the header tells: a state file is read by the kind of machine that wrote
 * it, and anything else is refused. Doubles and integers therefore come back bit for bit.
 *
 * Invariants after bw_container_open, however the bytes came about
 *  1. Magic, format version, byte order, stage name and stage version are the expected ones.
 *  2. Every payload lies inside the file, starts at a multiple of 64, and count * elem_size did not overflow; payloads are
 *     in order and do not overlap; tags are distinct.
 *  3. The checksum (XXH64 of the whole file, taken with the checksum field zero) is right.
 * What the elements mean (index ranges and the like) is for the reader of the state to check.
 *
 * Changing the layout: raise BW_CONTAINER_VERSION with any change of the header, the entry or the rules above; old files
 * are then refused with BW_E_VERSION and their stage is run again, so no code for old versions is kept. A change of
 * what one stage writes (a section more, another element type) raises that stage's version (bw_stage_version) instead.
 */
#ifndef BW_FORMAT_CONTAINER_H
#define BW_FORMAT_CONTAINER_H

#include "base/context.h"

enum {
    BW_CONTAINER_VERSION = 1,
    BW_CONTAINER_ALIGN = 64,
    BW_CONTAINER_SECTIONS_MAX = 1024,
    BW_CONTAINER_NAME = 16 /* bytes of a tag or a stage name; NUL-padded, not necessarily terminated */
};

typedef struct {
    char magic[8];          /* "bwstate\n" */
    uint32_t version;       /* BW_CONTAINER_VERSION */
    uint32_t byte_order;    /* 0x01020304 */
    char stage[BW_CONTAINER_NAME];
    uint32_t stage_version;
    uint32_t section_count;
    uint64_t file_size;
    uint64_t checksum;
    uint64_t reserved; /* 0 */
} bw_container_header;

typedef struct {
    char tag[BW_CONTAINER_NAME]; /* not empty */
    uint64_t elem_size;          /* at least 1 */
    uint64_t count;
    uint64_t offset;
    uint64_t reserved[3]; /* 0 */
} bw_container_entry;

_Static_assert(sizeof(bw_container_header) == 64 && sizeof(bw_container_entry) == 64, "the layout has no padding");

typedef struct bw_container bw_container;

/* A section to be written: data (borrowed) may be NULL if count is 0. */
typedef struct {
    const char *tag; /* 1..16 bytes */
    size_t elem_size, count;
    const void *data;
} bw_section;

/* Writes `path` whole or not at all: into a file beside it ("<path>.part"), which is then renamed; with `sync` the bytes and the
 * name are on the disk before it returns. Two tags alike or a bad one: BW_E_INTERNAL. Failed writes: BW_E_IO. */
bw_status bw_container_write(bw_context *ctx, const char *path, const char *stage, uint32_t stage_version,
                             const bw_section *section, size_t section_count, bool sync);

/* Maps and validates a file. Errors: BW_E_IO unreadable or damaged; BW_E_VERSION another format version, byte order, stage
 * or stage version. The file must not be changed while it is open. *c is owned: bw_container_close. O(bytes). */
bw_status bw_container_open(bw_context *ctx, const char *path, const char *stage, uint32_t stage_version,
                            bw_container **c);
/* The same over `size` bytes of memory (borrowed until close), which must start at a multiple of 64. */
bw_status bw_container_open_memory(bw_context *ctx, const void *data, size_t size, const char *stage,
                                   uint32_t stage_version, bw_container **c);
void bw_container_close(bw_container *c); /* NULL is fine */

bool bw_container_has(const bw_container *c, const char *tag);
/* The elements of a section, at a multiple of 64 bytes, borrowed from the container; never NULL if the section is there, even
 * if it is empty. NULL, with BW_E_VERSION recorded in the context the container was opened with, if there is none of this tag
 * with elements of this size. */
const void *bw_container_section(const bw_container *c, const char *tag, size_t elem_size, size_t *count);
/* The same, and the section must have exactly `count` elements. */
const void *bw_container_section_of(const bw_container *c, const char *tag, size_t elem_size, size_t count);

/* XXH64 with seed 0, as published. For a container: of its bytes with the checksum field zero. */
uint64_t bw_checksum(const void *data, size_t size);
uint64_t bw_container_checksum(const void *data, size_t size); /* size >= 64 */

#endif
