/* Writer of one VTU file: XML in front, all arrays behind it as raw appended data (little-endian, counts of
 * 64 bits).
 *
 *     bw_vtm_begin(ctx, &file, path, points, cells, arrays, count);    the header, which tells where each
 *                                                                      array will be
 *     bw_vtm_array(&file);                                             starts the next array, in the order
 *                                                                      given
 *     bw_vtm_int32(&file, value), bw_vtm_float64(&file, value), ...    its values, as many as announced
 *     status = bw_vtm_end(&file, &bytes);
 *
 * Nothing is compressed: offsets are known before the first value is written, so memory is constant, and the
 * bytes do not depend on the version of a library. The first failure is kept and what follows is dropped; an
 * array that is not as long as announced is BW_E_INTERNAL.
 */
#ifndef BW_FORMAT_VTM_FILE_H
#define BW_FORMAT_VTM_FILE_H

#include "format/output.h"

typedef enum { BW_VTM_POINTS, BW_VTM_CELLS, BW_VTM_CELL_DATA, BW_VTM_POINT_DATA } bw_vtm_place;
typedef enum { BW_VTM_UINT8, BW_VTM_INT32, BW_VTM_INT64, BW_VTM_FLOAT64 } bw_vtm_type;

typedef struct {
    bw_vtm_place place; /* ascending in the list */
    const char *name;
    bw_vtm_type type;
    int components;
    uint64_t count; /* values: tuples * components */
} bw_vtm_array_info;

typedef struct {
    bw_output out;
    const bw_vtm_array_info *array; /* borrowed */
    size_t array_count, next;
    uint64_t left; /* bytes of the current array that are not written yet */
} bw_vtm_file;

/* Creates or empties the file. bw_vtm_end must follow, also after a failure. */
bw_status bw_vtm_begin(bw_context *ctx, bw_vtm_file *file, const char *path, uint64_t points, uint64_t cells,
                       const bw_vtm_array_info *array, size_t array_count);
void bw_vtm_array(bw_vtm_file *file);
void bw_vtm_uint8(bw_vtm_file *file, uint8_t value);
void bw_vtm_int32(bw_vtm_file *file, int32_t value);
void bw_vtm_int64(bw_vtm_file *file, int64_t value);
void bw_vtm_float64(bw_vtm_file *file, double value);
bw_status bw_vtm_end(bw_vtm_file *file, uint64_t *bytes);

#endif
