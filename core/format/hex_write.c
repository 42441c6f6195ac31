#include "format/hex_write.h"

#include <string.h>

#include "format/hex_bwh.h"

const uint8_t bw_hex_ring[8] = {0, 1, 3, 2, 4, 5, 7, 6};

const bw_hex_format_info bw_hex_formats[BW_HEX_FORMAT_COUNT] = {
    [BW_HEX_FORMAT_MESH] = {"mesh", bw_hex_write_medit}, [BW_HEX_FORMAT_VTK] = {"vtk", bw_hex_write_vtk},
    [BW_HEX_FORMAT_VTU] = {"vtu", bw_hex_write_vtu},     [BW_HEX_FORMAT_MSH] = {"msh", bw_hex_write_msh},
    [BW_HEX_FORMAT_OVM] = {"ovm", bw_hex_write_ovm},     [BW_HEX_FORMAT_INP] = {"inp", bw_hex_write_inp},
    [BW_HEX_FORMAT_CGNS] = {"cgns", bw_hex_write_cgns},  [BW_HEX_FORMAT_BWH] = {"bwh", bw_hex_write_bwh},
};

bw_status bw_hex_format_from_name(const char *name, bw_hex_format *format) {
    for (int f = 0; f < BW_HEX_FORMAT_COUNT; f++)
        if (!strcmp(bw_hex_formats[f].name, name)) {
            *format = (bw_hex_format)f;
            return BW_OK;
        }
    return BW_E_USAGE;
}
