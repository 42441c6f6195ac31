#include <errno.h>
#include <stdlib.h>
#include <string.h>

#include "models/models.h"

enum { BUFFER = 1 << 16, ROOM = 512 };

typedef struct {
    FILE *file;
    size_t used;
    bool failed;
    char text[BUFFER];
} sink;

static void flush(sink *s) {
    if (s->used && fwrite(s->text, 1, s->used, s->file) != s->used) s->failed = true;
    s->used = 0;
}

static void put_char(sink *s, char c) {
    if (s->used + ROOM > BUFFER) flush(s);
    s->text[s->used++] = c;
}

static void put_integer(sink *s, int64_t value, char after) {
    if (s->used + ROOM > BUFFER) flush(s);
    s->used += (size_t)snprintf(s->text + s->used, ROOM, "%lld%c", (long long)value, after);
}

/* 16 digits where they read back to the same double, else 17, which always do. */
static void put_double(sink *s, double value, char after) {
    if (s->used + ROOM > BUFFER) flush(s);
    char *at = s->text + s->used;
    int n = snprintf(at, ROOM, "%.16g", value);
    if (strtod(at, NULL) != value) n = snprintf(at, ROOM, "%.17g", value);
    s->used += (size_t)n;
    put_char(s, after);
}

static void put_mesh(sink *s, const bw_model *m) {
    put_integer(s, (int64_t)m->vertex_count, '\n');
    for (size_t v = 0; v < m->vertex_count; v++)
        for (int i = 0; i < 3; i++) put_double(s, m->position[v][i], i < 2 ? ' ' : '\n');
    put_integer(s, (int64_t)m->tet_count, '\n');
    for (size_t t = 0; t < m->tet_count; t++) {
        for (int i = 0; i < 4; i++) put_integer(s, m->tet[t][i], ' ');
        for (int i = 0; i < 12; i++) put_double(s, m->parameter[t][i / 3][i % 3], i < 11 ? ' ' : '\n');
    }
}

static void put_features(sink *s, const bw_model *m) {
    if (!m->feature_vertex_count && !m->feature_edge_count) return;
    put_integer(s, (int64_t)m->feature_vertex_count, ' ');
    put_integer(s, (int64_t)m->feature_edge_count, ' ');
    put_integer(s, 0, '\n');
    for (size_t i = 0; i < m->feature_vertex_count; i++) put_integer(s, m->feature_vertex[i], '\n');
    for (size_t i = 0; i < m->feature_edge_count; i++) {
        put_integer(s, m->feature_edge[i][0], ' ');
        put_integer(s, m->feature_edge[i][1], '\n');
    }
}

bw_status bw_model_write(bw_context *ctx, const bw_model *model, FILE *file) {
    sink *s = bw_alloc(ctx, 1, sizeof *s);
    if (!s) return ctx->error.status;
    s->file = file;
    put_mesh(s, model);
    put_features(s, model);
    flush(s);
    bool failed = s->failed || fflush(file);
    bw_free(ctx, s);
    return failed ? bw_fail(ctx, BW_E_IO, "writing the model failed: %s", strerror(errno)) : BW_OK;
}

bw_status bw_model_save(bw_context *ctx, const bw_model *model, const char *path) {
    FILE *file = fopen(path, "w");
    if (!file) return bw_fail(ctx, BW_E_IO, "%s: %s", path, strerror(errno));
    bw_status status = bw_model_write(ctx, model, file);
    if (fclose(file) && !status) status = bw_fail(ctx, BW_E_IO, "%s: %s", path, strerror(errno));
    return status;
}
