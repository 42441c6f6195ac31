/* Writer of hexmesh.bwh, the compact form of a hex mesh: blocks as grids, connectivity from their sizes, coordinates predicted and entropy coded; lossless, or on
 * a lattice of chosen bits. api/bwh.md describes the format for whoever reads it; clients/decode/ has decoders in C and JavaScript.
 *
 *     offset 0    header                     64 bytes, little-endian as everything here
 *            64   lattice                    48 bytes: low[3], step[3]; only if header.kind is BW_BWH_LATTICE
 *            ...  shape                      range coded: parts, what is glued to what, what holds vertices
 *            ...  places                     range coded: coordinates
 *            ...  bits                       low bits of coordinates as they are
 *
 * Hexes and vertices are numbered anew: hexes part by part, i fastest; vertices as the parts first have them. What a block that does not fill its box, or is not
 * known, has is listed one by one, without ijk.
 *
 * Coordinates are coded as integers on a lattice of chosen bits; as decimals, if all of them are such with few digits (files written as text); else as
 * doubles in their order, without the low bits that none of them has (floats).
 *
 * Changing the layout, the order of vertices, the prediction or the models: raise BW_BWH_VERSION here and in clients/decode/bwh.c and bwh.mjs, describe it in api/bwh.md, write
 * tests/fuzz/corpus/bwh anew (test_hex_bwh.c tells how), and raise the version of stage encode (pipeline.c, openapi.yaml). Decoders refuse other versions; one
 * that is to read old files as well keeps the code of both.
 */
#ifndef BW_FORMAT_HEX_BWH_H
#define BW_FORMAT_HEX_BWH_H

#include "format/hex_write.h"

enum { BW_BWH_VERSION = 2, BW_BWH_LEAST_BITS = 1, BW_BWH_MOST_BITS = 24 };

typedef enum {
    BW_BWH_DOUBLES, /* parameter: how many low bits no coordinate has */
    BW_BWH_DECIMAL, /* integers / 10^parameter */
    BW_BWH_LATTICE  /* low + integer * step; parameter: bits */
} bw_bwh_kind;

typedef struct {
    char magic[8]; /* 89 'B' 'W' 'H' 0d 0a 1a 0a */
    uint32_t version;
    uint32_t part_count;
    uint64_t vertex_count, hex_count;
    uint32_t subdivide;
    uint8_t kind, parameter, reserved[2]; /* bw_bwh_kind */
    uint64_t file_size;
    uint32_t shape_size, places_size; /* bytes; bits: the rest of the file */
    uint32_t body_crc;                /* CRC-32 of shape, places and bits */
    uint32_t crc;                     /* CRC-32 of header and lattice, this field taken as 0 */
} bw_bwh_header;

_Static_assert(sizeof(bw_bwh_header) == 64, "the layout has no padding");

/* What of a file is what, in bytes. */
typedef struct {
    uint64_t header, shape, places; /* sum: the file; places with its plain bits */
    double step[3];                 /* of the lattice; 0 if lossless: no coordinate is further away than half of it */
} bw_bwh_sizes;

/* bits: of each coordinate, 0 for lossless, else BW_BWH_LEAST_BITS..BW_BWH_MOST_BITS over the box of the mesh. sizes may be NULL. Errors: those of
 * hex_write.h; BW_E_LIMIT for 2^31 hexes or vertices, or streams of 2^32 bytes. */
bw_status bw_bwh_write(bw_context *ctx, const bw_hex_mesh *mesh, int bits, const char *path, bw_bwh_sizes *sizes);

/* Lossless, as bw_hex_formats has it. */
bw_status bw_hex_write_bwh(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes);

#endif
