#include "format/input.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

#include "format/hexex.h"
#include "format/input_scan.h"
#include "format/medit.h"
#include "format/msh.h"
#include "format/number.h"
#include "format/ovm.h"
#include "format/vtk.h"
#include "format/vtu.h"

enum { HEAD = 4096, READ_AT_ONCE = 1 << 20 };

/* ---- which format -------------------------------------------------------------------------------------- */

static bool begins(const bw_scan *s, const char *with) {
    return bw_word_starts((bw_word){s->at, bw_scan_left(s)}, with);
}

bw_input_format bw_input_detect(const void *data, size_t size) {
    bw_context none; /* the scan below cannot fail */
    bw_context_init(&none);
    bw_scan s = bw_scan_open(&none, data, size);
    if (size >= 4 && (!memcmp(data, "\1\0\0\0", 4) || !memcmp(data, "\0\0\0\1", 4))) return BW_INPUT_MEDIT;
    if (begins(&s, "\xef\xbb\xbf<")) return BW_INPUT_VTU;
    if (!bw_scan_blanks(&s)) return BW_INPUT_EMPTY;
    if (begins(&s, "# vtk DataFile")) return BW_INPUT_VTK;
    if (*s.at == '<') return BW_INPUT_VTU;
    if (*s.at == '$') return BW_INPUT_MSH;
    if ((*s.at >= '0' && *s.at <= '9') || *s.at == '+' || *s.at == '-') return BW_INPUT_HEXEX;
    s.comment = '#';
    if (!bw_scan_blanks(&s)) return BW_INPUT_UNKNOWN;
    if (begins(&s, "MeshVersionFormatted")) return BW_INPUT_MEDIT;
    return begins(&s, "OVM") ? BW_INPUT_OVM : BW_INPUT_UNKNOWN;
}

const char *bw_input_format_name(bw_input_format format) {
    static const char *const names[] = {"", "", "hexex", "vtk", "vtu", "msh", "medit", "ovm"};
    return names[format];
}

static bw_status fail_unread(bw_context *ctx, bw_input_format format) {
    if (format == BW_INPUT_EMPTY) return bw_fail(ctx, BW_E_EMPTY, "the input is empty");
    bw_fail_element(ctx, "line", 1, NULL);
    return bw_fail(
        ctx, BW_E_SYNTAX,
        "line 1: not the beginning of a format that is read: .hexex, VTK, VTU, Gmsh, Medit, OpenVolumeMesh");
}

/* Volumes are products of three positions and have to stay finite, as does what is drawn in single precision. */
static bw_status check_positions(bw_context *ctx, bw_tet_mesh *mesh) {
    for (size_t v = 0; v < mesh->vertex_count; v++)
        for (int k = 0; k < 3; k++) {
            if (fabs(mesh->position[v][k]) <= BW_INPUT_POSITION_MAX) continue;
            bw_fail_element(ctx, "vertex", (int64_t)v, mesh->position[v]);
            bw_fail(ctx, BW_E_NUMBER, "vertex %zu is at %g, farther out than %g", v, mesh->position[v][k], BW_INPUT_POSITION_MAX);
            bw_tet_mesh_clear(ctx, mesh);
            return BW_E_NUMBER;
        }
    return BW_OK;
}

static bw_status read_as(bw_context *ctx, bw_input_format format, const void *data, size_t size, const void *parameters,
                         size_t parameters_size, bw_tet_mesh *mesh) {
    if (parameters && format > BW_INPUT_EMPTY && format != BW_INPUT_MEDIT)
        return bw_fail(ctx, BW_E_PARAMETERS, "a file of parameters belongs to a Medit mesh only; the input is %s",
                       bw_input_format_name(format));
    switch (format) {
    case BW_INPUT_HEXEX:
        return bw_hexex_read_memory(ctx, data, size, mesh);
    case BW_INPUT_VTK:
        return bw_vtk_read_memory(ctx, data, size, mesh);
    case BW_INPUT_VTU:
        return bw_vtu_read_memory(ctx, data, size, mesh);
    case BW_INPUT_MSH:
        return bw_msh_read_memory(ctx, data, size, mesh);
    case BW_INPUT_MEDIT:
        return bw_medit_read_memory(ctx, data, size, parameters, parameters_size, mesh);
    case BW_INPUT_OVM:
        return bw_ovm_read_memory(ctx, data, size, mesh);
    default:
        return fail_unread(ctx, format);
    }
}

bw_status bw_input_read_memory(bw_context *ctx, const void *data, size_t size, const void *parameters,
                               size_t parameters_size, bw_tet_mesh *mesh) {
    memset(mesh, 0, sizeof *mesh);
    bw_status status = read_as(ctx, bw_input_detect(data, size), data, size, parameters, parameters_size, mesh);
    return status == BW_OK ? check_positions(ctx, mesh) : status;
}

/* ---- files --------------------------------------------------------------------------------------------- */

typedef struct {
    int fd;
    const char *data;
    size_t size;
    void *map, *block; /* what holds the data */
} file;

static bw_status open_file(bw_context *ctx, const char *path, file *f) {
    *f = (file){.fd = open(path, O_RDONLY | O_CLOEXEC | O_NOCTTY)};
    return f->fd >= 0 ? BW_OK : bw_fail(ctx, BW_E_IO, "cannot open %.200s: %s", path, strerror(errno));
}

static void close_file(bw_context *ctx, file *f) {
    if (f->map) munmap(f->map, f->size);
    bw_free(ctx, f->block);
    if (f->fd >= 0) close(f->fd);
}

static bw_status read_whole(bw_context *ctx, file *f) {
    size_t room = 0;
    char *block = NULL;
    for (;;) {
        bw_status status = bw_poll(ctx);
        if (status == BW_OK && room - f->size < READ_AT_ONCE) {
            status = bw_reserve(ctx, &block, &room, f->size + READ_AT_ONCE);
            f->block = block;
        }
        if (status != BW_OK) return status;
        ssize_t n = read(f->fd, block + f->size, room - f->size);
        if (n < 0 && errno != EINTR)
            return bw_fail(ctx, BW_E_IO, "cannot read the input: %s", strerror(errno));
        if (n == 0) break;
        if (n > 0) f->size += (size_t)n;
    }
    f->data = block;
    return BW_OK;
}

static bw_status load_file(bw_context *ctx, file *f) {
    struct stat info;
    if (fstat(f->fd, &info)) return bw_fail(ctx, BW_E_IO, "cannot read the input: %s", strerror(errno));
    if (S_ISREG(info.st_mode) && info.st_size > 0) {
        void *map = mmap(NULL, (size_t)info.st_size, PROT_READ, MAP_PRIVATE, f->fd, 0);
        if (map != MAP_FAILED) {
            madvise(map, (size_t)info.st_size, MADV_SEQUENTIAL);
            f->map = map;
            f->data = map;
            f->size = (size_t)info.st_size;
            return BW_OK;
        }
    }
    return read_whole(ctx, f);
}

/* Whether the file is .hexex that can be streamed. A pipe cannot be looked at beforehand. */
static bool is_hexex_file(const file *f) {
    char head[HEAD];
    ssize_t n = pread(f->fd, head, sizeof head, 0);
    return n > 0 && bw_input_detect(head, (size_t)n) == BW_INPUT_HEXEX;
}

bw_status bw_input_read(bw_context *ctx, const char *path, const char *parameters_path, bw_tet_mesh *mesh) {
    memset(mesh, 0, sizeof *mesh);
    file input, parameters = {.fd = -1};
    bw_status status = open_file(ctx, path, &input);
    if (status == BW_OK && !parameters_path && is_hexex_file(&input)) {
        status = bw_hexex_read_fd(ctx, input.fd, mesh);
        if (status == BW_OK) status = check_positions(ctx, mesh);
    } else {
        if (status == BW_OK) status = load_file(ctx, &input);
        if (status == BW_OK && parameters_path) status = open_file(ctx, parameters_path, &parameters);
        if (status == BW_OK && parameters_path) status = load_file(ctx, &parameters);
        if (status == BW_OK) {
            const char *side = parameters_path ? parameters.data : NULL;
            status = bw_input_read_memory(ctx, input.data, input.size, side, parameters.size, mesh);
        }
    }
    close_file(ctx, &parameters);
    close_file(ctx, &input);
    return status;
}
