/* What the legacy and the XML form of VTK have in common: typed arrays, and the unstructured grid made of
 * them.
 *
 * What a grid has to have
 *   cells        tets (type 10), or hexes (12, or 11: voxels); besides them vertices (1), lines (3) and
 *                triangles (5), or quads (9), which may be features
 *   parameters   of tets: a cell array of 12 components: u0 v0 w0 u1 v1 w1 u2 v2 w2 u3 v3 w3, corner by corner in the
 *                order of the tet's points. Named "parametrization", "uvw" or "param" (looked for in this
 *                order, letters of either case are the same), or of any name if it is the only array of 12
 *                components. Rows of other cells are read and not used.
 *   features     the cell array "feature" of one component: the vertices, lines, triangles and quads where it is not
 *                zero (values at tets and hexes are not used). Without such an array all vertices, lines and triangles
 *                are features.
 * Tets, hexes, features: in the order of the cells. Point, vertex and cell numbers count from 0.
 */
#ifndef BW_FORMAT_VTK_GRID_H
#define BW_FORMAT_VTK_GRID_H

#include "format/input_scan.h"
#include "mesh/tetmesh.h"

typedef enum {
    BW_VTK_INT8,
    BW_VTK_UINT8,
    BW_VTK_INT16,
    BW_VTK_UINT16,
    BW_VTK_INT32,
    BW_VTK_UINT32,
    BW_VTK_INT64,
    BW_VTK_UINT64,
    BW_VTK_FLOAT32,
    BW_VTK_FLOAT64,
    BW_VTK_TYPES
} bw_vtk_type;

typedef enum { BW_VTK_TEXT, BW_VTK_LITTLE, BW_VTK_BIG } bw_vtk_coding;

/* Values one after the other at the cursor of a scan. */
typedef struct {
    bw_vtk_type type;
    bw_vtk_coding coding;
} bw_vtk_format;

typedef struct {
    char name[80];
    bw_vtk_format format;
    int64_t components;
    bw_scan scan; /* legacy: at the first value. XML: the element's text, or its bytes in the appended data */
    uint8_t encoding; /* XML: how the values are to be got out of `scan` (vtu.c) */
} bw_vtk_array;

typedef struct bw_vtk_grid bw_vtk_grid;
struct bw_vtk_grid {
    bw_context *ctx;
    bw_tet_mesh *mesh;
    size_t cell_count;
    uint64_t *begin; /* [cell + 1] into corner */
    bw_vertex *corner;
    size_t corner_count;
    uint8_t *type;       /* [cell] */
    bw_vtk_array *array; /* of the cells */
    size_t array_count, array_room;
    /* Opens an array of `count` values for reading: *scan stands at the first. The caller frees *owned. */
    bw_status (*open)(bw_vtk_grid *grid, const bw_vtk_array *array, uint64_t count, bw_scan *scan,
                      void **owned);
    bool bounded; /* an opened scan ends with the array */
};

size_t bw_vtk_size(bw_vtk_type type); /* bytes of a value */

/* BW_OK if `count` values of this format may be in what is left of the scan. `plural` names them. */
bw_status bw_vtk_check_count(bw_scan *s, bw_vtk_format format, const char *plural, int64_t count);
/* Reads `count` finite numbers. `kind`, `per_record`: errors name the value's record of that kind. */
bw_status bw_vtk_reals(bw_scan *s, bw_vtk_format format, uint64_t count, const char *kind,
                       uint64_t per_record, double *out);
/* Reads whole numbers; a value above INT64_MAX is given as INT64_MAX. Floating types are BW_E_SYNTAX. */
bw_status bw_vtk_wholes(bw_scan *s, bw_vtk_format format, size_t count, int64_t *out);
/* Where scans are bounded: BW_E_COUNT if there is more in it. */
bw_status bw_vtk_end(const bw_vtk_grid *grid, bw_scan *s);
/* Passes `count` values of any kind. */
bw_status bw_vtk_pass(bw_scan *s, bw_vtk_format format, uint64_t count);

/* Sections of a grid, each read from a scan that stands at its first value; counts have not been checked. */
bw_status bw_vtk_read_points(bw_vtk_grid *grid, bw_scan *s, bw_vtk_format format, int64_t count);
/* Corners of all cells in one list, after the points and the ends. */
bw_status bw_vtk_read_corners(bw_vtk_grid *grid, bw_scan *s, bw_vtk_format format, int64_t count);
/* Where each cell's corners end in that list; with_zero: a 0 comes first (legacy). */
bw_status bw_vtk_read_ends(bw_vtk_grid *grid, bw_scan *s, bw_vtk_format format, int64_t cells,
                           bool with_zero);
bw_status bw_vtk_read_types(bw_vtk_grid *grid, bw_scan *s, bw_vtk_format format);

/* Makes tets and parameters, or hexes, and features of *grid->mesh out of the sections. `place`: what errors that concern
 * no array tell. */
bw_status bw_vtk_finish(bw_vtk_grid *grid, bw_scan *place);
void bw_vtk_clear(bw_vtk_grid *grid);

#endif
