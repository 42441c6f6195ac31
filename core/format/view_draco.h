/* The one door to the Draco library (C++): integer geometry to and from Draco's bit streams. No exception
 * passes through it.
 *
 * Coordinates and ids are int32 attributes, so Draco codes them without loss; quantizing is the caller's
 * business. Unique attribute id 0 holds the positions, 1 the ids (metadata "name": "ids").
 */
#ifndef BW_FORMAT_VIEW_DRACO_H
#define BW_FORMAT_VIEW_DRACO_H

#ifdef __cplusplus
extern "C" {
#endif

#include "base/context.h"

enum { BW_DRACO_IDS = 4 };

/* A triangle mesh, or a sequence of points if it has no faces. A point pairs a position with an id tuple;
 * points that share a position entry are connected. */
typedef struct {
    size_t position_count, id_count, point_count, face_count;
    int ids; /* numbers in an id tuple, 1..BW_DRACO_IDS */
    int32_t (*position)[3];
    int32_t (*id)[BW_DRACO_IDS]; /* the first `ids` of each are used */
    int32_t (*point)[2];         /* position entry, id entry */
    int32_t (*face)[3];          /* points */
} bw_draco_geometry;

void bw_draco_geometry_clear(bw_context *ctx, bw_draco_geometry *geometry);

/* Encodes; *bytes is bw_free'd by the caller. Meshes: Edgebreaker, which reorders faces and points and drops
 * faces that use a position entry twice. Point sequences keep their order. Same input, same bytes.
 * BW_E_MEMORY, BW_E_ALGORITHM. */
bw_status bw_draco_encode(bw_context *ctx, const bw_draco_geometry *geometry, uint8_t **bytes,
                          size_t *length);
/* Decodes what bw_draco_encode wrote (for checks; never given a client's bytes). Every point comes with a
 * position entry and an id entry of its own. BW_E_VERSION if the bytes are something else. */
bw_status bw_draco_decode(bw_context *ctx, const uint8_t *bytes, size_t length, bw_draco_geometry *geometry);

#ifdef __cplusplus
}
#endif

#endif
