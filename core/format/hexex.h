/* Reader of .hexex: a tet mesh with twelve parameters per tet, and the optional lists after it.
 *
 *     N                       vertices, then N lines   x y z
 *     M                       tets, then M lines       v0 v1 v2 v3  u0 v0 w0  u1 v1 w1  u2 v2 w2  u3 v3 w3
 *     [W                      one number on its line: walls follow, W lines   a b c distance ]
 *     [FV FE FF               three numbers on a line: feature vertices (1 index a line), edges (2), facets (3), in this order ]
 *
 * Indices count from 0. Numbers are decimals or rationals p/q of any length (format/number.h). One record a line; blank
 * lines and blanks at either end of a line are passed over. Either list may stand alone.
 *
 * The input is hostile until read:
 *  1. Nothing is allocated for a declared count before the bytes that are left can hold it (2 bytes per number at
 *     least); from a pipe, whose length is unknown, memory grows with what has arrived.
 *  2. Beyond the mesh itself, memory is one line buffer of constant size; lines over 1 MiB and numbers over 64 KiB are refused.
 *  3. Every index is in range and every number finite when BW_OK is returned.
 * Tets that repeat a vertex or occur twice are found by bw_tet_mesh_connect.
 *
 * Errors, each with its line (elements of kind "line" count from 1, as editors do) and the element ("vertex", "tet", "wall",
 * ... from 0): BW_E_EMPTY nothing, or no tets; BW_E_SYNTAX; BW_E_TRUNCATED; BW_E_COUNT negative or more than the input can
 * hold; BW_E_INDEX; BW_E_NUMBER nan, inf, overflow, p/0; BW_E_LINE; BW_E_MEMORY; BW_E_IO; BW_E_CANCELLED.
 */
#ifndef BW_FORMAT_HEXEX_H
#define BW_FORMAT_HEXEX_H

#include "base/context.h"
#include "mesh/tetmesh.h"

/* Largest counts: every vertex, and every facet and edge derived from the tets, has an index that fits its type. */
#define BW_HEXEX_VERTICES_MAX ((int64_t)INT32_MAX)
#define BW_HEXEX_TETS_MAX ((int64_t)1 << 28)

/* Each fills vertex_count, position, tet_count, tet, parameter and the lists of *mesh, which is overwritten; clear it with
 * bw_tet_mesh_clear. On failure it is left empty. O(bytes). Progress is the fraction of the bytes read. */
bw_status bw_hexex_read(bw_context *ctx, const char *path, bw_tet_mesh *mesh);
/* From a descriptor's position to its end: a file, a pipe or a socket. fd is borrowed. */
bw_status bw_hexex_read_fd(bw_context *ctx, int fd, bw_tet_mesh *mesh);
bw_status bw_hexex_read_memory(bw_context *ctx, const void *data, size_t size, bw_tet_mesh *mesh);

#endif
