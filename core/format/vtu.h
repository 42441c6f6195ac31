/* Reader of VTU files: VTK's XML form of an UnstructuredGrid of tets with twelve parameters per tet.
 *
 *     <VTKFile type="UnstructuredGrid" byte_order=... header_type=... compressor=...>
 *       <UnstructuredGrid><Piece NumberOfPoints=... NumberOfCells=...>
 *         <Points><DataArray NumberOfComponents="3"/></Points>
 *         <Cells><DataArray Name="connectivity"/><DataArray Name="offsets"/><DataArray Name="types"/></Cells>
 *         <CellData><DataArray Name="parametrization" NumberOfComponents="12"/></CellData>
 *       </Piece></UnstructuredGrid>
 *       <AppendedData encoding="raw|base64">_...</AppendedData>
 *     </VTKFile>
 *
 * DataArrays: format ascii, binary (base64) or appended (raw or base64); byte_order of either kind;
 * header_type UInt32 (the default) or UInt64; uncompressed or vtkZLibDataCompressor. One Piece. vtk_grid.h
 * tells which arrays are used, and how features are marked. Nothing after the start of AppendedData is read
 * as XML.
 *
 * The input is hostile until read (input_scan.h); besides:
 *  1. A document type declaration is refused, so there are no entities to expand. Elements nest at most 32
 *     deep and are at most 100 000, a tag is at most 1 MiB long. What the XML parser and zlib allocate is
 *     counted in the job's budget.
 *  2. Deflated data is refused if it claims to be larger than deflate can make it (1032 : 1).
 * Errors as of bw_vtk_read_memory; places are lines in the XML and bytes in encoded data. O(bytes).
 */
#ifndef BW_FORMAT_VTU_H
#define BW_FORMAT_VTU_H

#include "base/context.h"
#include "mesh/tetmesh.h"

/* *mesh is overwritten; on failure it is left empty. */
bw_status bw_vtu_read_memory(bw_context *ctx, const void *data, size_t size, bw_tet_mesh *mesh);

#endif
