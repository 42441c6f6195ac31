#include "format/vtm_file.h"

#include <string.h>

static const struct {
    const char *name;
    uint64_t size;
} types[] = {{"UInt8", 1}, {"Int32", 4}, {"Int64", 8}, {"Float64", 8}};

static uint64_t size_of(const bw_vtm_array_info *a) {
    return a->count * types[a->type].size;
}

static void put_attribute(bw_output *out, const char *name, uint64_t value) {
    bw_put_text(out, " ");
    bw_put_text(out, name);
    bw_put_text(out, "=\"");
    bw_put_integer(out, (int64_t)value);
    bw_put_text(out, "\"");
}

static void put_array_tag(bw_output *out, const bw_vtm_array_info *a, uint64_t offset) {
    bw_put_text(out, "        <DataArray type=\"");
    bw_put_text(out, types[a->type].name);
    bw_put_text(out, "\" Name=\"");
    bw_put_text(out, a->name);
    bw_put_text(out, "\"");
    put_attribute(out, "NumberOfComponents", (uint64_t)a->components);
    bw_put_text(out, " format=\"appended\"");
    put_attribute(out, "offset", offset);
    bw_put_text(out, "/>\n");
}

bw_status bw_vtm_begin(bw_context *ctx, bw_vtm_file *file, const char *path, uint64_t points, uint64_t cells,
                       const bw_vtm_array_info *array, size_t array_count) {
    static const char *const place[] = {"Points", "Cells", "CellData", "PointData"};
    *file = (bw_vtm_file){.array = array, .array_count = array_count};
    bw_output *out = &file->out;
    bw_status status = bw_output_open(ctx, out, path);
    bw_put_text(out, "<?xml version=\"1.0\"?>\n"
                     "<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" byte_order=\"LittleEndian\" "
                     "header_type=\"UInt64\">\n"
                     "  <UnstructuredGrid>\n    <Piece");
    put_attribute(out, "NumberOfPoints", points);
    put_attribute(out, "NumberOfCells", cells);
    bw_put_text(out, ">\n");
    uint64_t offset = 0;
    for (size_t i = 0; i < array_count; i++) {
        bool first = i == 0 || array[i - 1].place != array[i].place,
             last = i + 1 == array_count || array[i + 1].place != array[i].place;
        if (first)
            bw_put_text(out, "      <"), bw_put_text(out, place[array[i].place]), bw_put_text(out, ">\n");
        put_array_tag(out, &array[i], offset);
        if (last)
            bw_put_text(out, "      </"), bw_put_text(out, place[array[i].place]), bw_put_text(out, ">\n");
        offset += 8 + size_of(&array[i]);
    }
    bw_put_text(out, "    </Piece>\n  </UnstructuredGrid>\n  <AppendedData encoding=\"raw\">\n_");
    return status;
}

static void fail_length(bw_vtm_file *file) {
    if (file->out.status == BW_OK)
        file->out.status =
            bw_fail(file->out.ctx, BW_E_INTERNAL, "an array of a VTU file is not as long as announced");
}

static void put_little(bw_vtm_file *file, uint64_t bits, size_t size) {
    char bytes[8];
    for (size_t i = 0; i < size; i++) bytes[i] = (char)(bits >> 8 * i);
    bw_put_bytes(&file->out, bytes, size);
}

void bw_vtm_array(bw_vtm_file *file) {
    if (file->left || file->next == file->array_count) {
        fail_length(file);
        return;
    }
    file->left = size_of(&file->array[file->next++]);
    put_little(file, file->left, 8);
}

static void put_value(bw_vtm_file *file, bw_vtm_type type, uint64_t bits) {
    uint64_t size = types[type].size;
    if (file->left < size || file->array[file->next - 1].type != type) {
        fail_length(file);
        return;
    }
    file->left -= size;
    put_little(file, bits, (size_t)size);
}

void bw_vtm_uint8(bw_vtm_file *file, uint8_t value) {
    put_value(file, BW_VTM_UINT8, value);
}
void bw_vtm_int32(bw_vtm_file *file, int32_t value) {
    put_value(file, BW_VTM_INT32, (uint32_t)value);
}
void bw_vtm_int64(bw_vtm_file *file, int64_t value) {
    put_value(file, BW_VTM_INT64, (uint64_t)value);
}

void bw_vtm_float64(bw_vtm_file *file, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    put_value(file, BW_VTM_FLOAT64, bits);
}

bw_status bw_vtm_end(bw_vtm_file *file, uint64_t *bytes) {
    if (file->left || file->next != file->array_count) fail_length(file);
    bw_put_text(&file->out, "\n  </AppendedData>\n</VTKFile>\n");
    return bw_output_close(&file->out, bytes);
}
