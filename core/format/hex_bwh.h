/* Writer of hexmesh.bwh, the compact form of a hex mesh: sizes of blocks, implicit connectivity, predicted coordinates, lossless. api/bwh.md describes
 * the format for whoever reads it; clients/decode/ has decoders in C and JavaScript.
 *
 *     offset 0    header                     64 bytes, little-endian as everything here
 *            64   parts                      16 bytes each: a block, or hexes listed one by one
 *            ...  directory                  24 bytes for each of BW_BWH_STREAMS streams
 *            ...  streams                    one after another, each raw or as a zlib stream
 *
 * Hexes and vertices are numbered anew: hexes part by part, i fastest; vertices as the parts first have them. What a block that does not fill its box, or is not
 * known, has is listed one by one, without ijk.
 *
 * Changing the layout, the order of vertices, or the prediction: raise BW_BWH_VERSION here and in clients/decode/bwh.c and bwh.mjs, describe it in api/bwh.md, write tests/fuzz/corpus/bwh
 * anew (test_hex_bwh.c tells how), and raise the version of stage encode (pipeline.c, openapi.yaml). Decoders refuse other versions; one that is to read old files
 * as well keeps the code of both.
 */
#ifndef BW_FORMAT_HEX_BWH_H
#define BW_FORMAT_HEX_BWH_H

#include "format/hex_write.h"

enum {
    BW_BWH_VERSION = 1,
    BW_BWH_GLUE = 0,    /* a number for each grid point on the outside of a block */
    BW_BWH_CORNERS,     /* a number for each corner of hexes listed one by one */
    BW_BWH_HELD,        /* a byte per vertex */
    BW_BWH_COORDINATES, /* 3 * 8 streams: [axis][byte, the highest first], a byte per vertex */
    BW_BWH_STREAMS = BW_BWH_COORDINATES + 24
};

typedef struct {
    char magic[8]; /* 89 'B' 'W' 'H' 0d 0a 1a 0a */
    uint32_t version;
    uint32_t part_count;
    uint64_t vertex_count, hex_count;
    uint32_t subdivide;
    uint32_t stream_count; /* BW_BWH_STREAMS */
    uint64_t file_size;
    uint32_t crc;          /* CRC-32 of header, parts and directory, this field taken as 0 */
    uint32_t reserved[3];  /* 0 */
} bw_bwh_header;

typedef struct {
    int32_t block;  /* index in blocks.json, or BW_NONE */
    uint32_t n[3];  /* hexes along its axes; n[1] = n[2] = 0: n[0] hexes listed one by one */
} bw_bwh_part;

typedef struct {
    uint32_t method; /* 0 raw, 1 zlib */
    uint32_t crc;    /* CRC-32 of the bytes as stored */
    uint64_t size, stored;
} bw_bwh_stream;

_Static_assert(sizeof(bw_bwh_header) == 64 && sizeof(bw_bwh_part) == 16 && sizeof(bw_bwh_stream) == 24, "the layout has no padding");

bw_status bw_hex_write_bwh(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const char *path, uint64_t *bytes);

#endif
