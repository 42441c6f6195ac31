/* Decoder of hexmesh.bwh, Blockwright's compact form of a hex mesh (api/bwh.md). Two files, nothing else of the project:
 *
 *     cc -O2 -c bwh.c && cc program.c bwh.o -lm
 *
 *     bwh_mesh mesh;
 *     bwh_status status = bwh_decode(data, size, 0, &mesh);
 *     if (status != BWH_OK) fprintf(stderr, "%s\n", bwh_text(status));
 *     ...
 *     bwh_clear(&mesh);
 *
 * Corners of a hex are numbered by bits: bit k set is the high end of axis k; a positive hex has axes 0, 1, 2 right-handed. VTK, Gmsh and others want the order
 * bwh_ring instead.
 */
#ifndef BWH_H
#define BWH_H

#include <stddef.h>
#include <stdint.h>

typedef enum {
    BWH_OK,
    BWH_NOT_BWH,     /* the file begins otherwise */
    BWH_VERSION,     /* another version of the format */
    BWH_TRUNCATED,   /* shorter or longer than it says */
    BWH_CHECKSUM,    /* bytes are not those that were written */
    BWH_DAMAGED,     /* checksums are right, and still it contradicts itself */
    BWH_LIMIT,       /* the mesh would take more than max_bytes */
    BWH_MEMORY,
    BWH_STATUS_COUNT
} bwh_status;

/* A block, or hexes listed one by one: then n[1] = n[2] = 0. Its hexes are first .. first + count - 1, i fastest. */
typedef struct {
    int32_t block; /* index in blocks.json; -1: none */
    uint32_t n[3];
    size_t first, count;
} bwh_part;

typedef struct {
    size_t vertex_count, hex_count, part_count;
    uint32_t subdivide;     /* hexes along an edge of a unit cube of the integer-grid map */
    double step;            /* positions are on a lattice: its largest step; 0: they are those of the mesh, every bit */
    double (*position)[3];  /* [vertex] */
    uint8_t *held;          /* [vertex] on 0 a point, 1 a curve, 2 the surface, 3 nothing */
    int32_t (*hex)[8];      /* [hex][corner] */
    int32_t *block;         /* [hex]; -1: not known */
    int32_t (*ijk)[3];      /* [hex] place in its block; -1 for those listed one by one */
    bwh_part *part;
} bwh_mesh;

extern const uint8_t bwh_ring[8]; /* around the low face, then around the high one */

/* *mesh is overwritten; give it to bwh_clear, also after a failure (then it is empty). max_bytes: for all arrays of the mesh together, 0 for no limit;
 * decoding takes about as much again meanwhile. Some
 * files unfold to thousands of times their size, so decode what strangers send with a limit. Any bytes are safe to decode. O(size of the mesh). */
bwh_status bwh_decode(const void *data, size_t size, size_t max_bytes, bwh_mesh *mesh);
void bwh_clear(bwh_mesh *mesh);
const char *bwh_text(bwh_status status); /* a sentence */

#endif
