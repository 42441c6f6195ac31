#include "format/hexex.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "format/hexex_lines.h"
#include "format/number.h"

/* What a list of records is made of, and where they go. */
typedef struct {
    const char *kind;        /* "vertex" */
    const char *plural;      /* "vertices" */
    const char *element;     /* kind of the elements that errors list; NULL: only the line is listed */
    int indices, numbers;    /* on a line, in this order */
    bw_vertex **index;       /* [record][indices] */
    double **number;         /* [record][numbers] */
    size_t *count;
    int64_t count_max;
} list;

typedef struct {
    bw_context *ctx;
    bw_lines lines;
    bw_tet_mesh *mesh;
    const char *at;  /* in the current line */
    const list *list; /* of the record being read; NULL on a line of counts */
    int64_t record;
} reader;

/* ---- errors ------------------------------------------------------------------------------------------------- */

/* "line 7 (tet 3)" */
static void place(const reader *r, char *text, size_t size) {
    if (r->list)
        snprintf(text, size, "line %llu (%s %lld)", (unsigned long long)r->lines.number, r->list->kind, (long long)r->record);
    else snprintf(text, size, "line %llu", (unsigned long long)r->lines.number);
}

static void name_elements(reader *r) {
    if (r->list && r->list->element) bw_fail_element(r->ctx, r->list->element, r->record, NULL);
    bw_fail_element(r->ctx, "line", (int64_t)r->lines.number, NULL);
}

static bw_status fail_here(reader *r, bw_status status, const char *what) {
    char where[80];
    place(r, where, sizeof where);
    name_elements(r);
    return bw_fail(r->ctx, status, "%s: %s", where, what);
}

/* The word at `at`, fit to be shown: printable ASCII, not too long. */
static const char *word_at(const reader *r, const char *at, char text[40]) {
    int n = 0;
    for (; at < r->lines.end && !bw_is_blank(*at) && n < 32; at++) text[n++] = *at >= ' ' && *at <= '~' ? *at : '?';
    snprintf(text + n, 8, "%s", n == 32 ? "..." : "");
    return text;
}

static bw_status fail_number(reader *r, bw_number_status why, const char *word, const char *stop) {
    char text[40], what[160];
    word_at(r, word, text);
    if (why == BW_NUMBER_SYNTAX && r->lines.broken_off && stop == r->lines.end)
        return fail_here(r, BW_E_TRUNCATED, word == stop ? "the input ends in the middle of the line"
                                                         : "the input ends in the middle of a number");
    if (why == BW_NUMBER_SYNTAX && word == r->lines.end) return fail_here(r, BW_E_SYNTAX, "too few numbers");
    static const char *const reason[] = {[BW_NUMBER_SYNTAX] = "is not a number",
                                         [BW_NUMBER_NOT_FINITE] = "is not a finite number",
                                         [BW_NUMBER_ZERO_DIVISOR] = "divides by zero",
                                         [BW_NUMBER_LENGTHY] = "is too long a number"};
    snprintf(what, sizeof what, "'%s' %s", text, reason[why]);
    return fail_here(r, why == BW_NUMBER_SYNTAX ? BW_E_SYNTAX : why == BW_NUMBER_LENGTHY ? BW_E_LINE : BW_E_NUMBER, what);
}

/* ---- one line ----------------------------------------------------------------------------------------------- */

static void pass_blanks(reader *r) {
    while (r->at < r->lines.end && bw_is_blank(*r->at)) r->at++;
}

static bw_status next_line(reader *r) {
    bw_status status = bw_lines_next(&r->lines);
    r->at = r->lines.text;
    return status;
}

static bw_status read_whole(reader *r, int64_t *value) {
    pass_blanks(r);
    const char *word = r->at;
    bw_number_status status = bw_integer_read(&r->at, r->lines.end, value);
    if (status == BW_NUMBER_OK) return BW_OK;
    char text[40], what[100];
    if (status == BW_NUMBER_SYNTAX && word < r->lines.end && !(r->lines.broken_off && r->at == r->lines.end)) {
        snprintf(what, sizeof what, "'%s' is not a whole number", word_at(r, word, text));
        return fail_here(r, BW_E_SYNTAX, what);
    }
    return fail_number(r, status, word, r->at);
}

static bw_status read_index(reader *r, size_t bound, bw_vertex *index) {
    int64_t value;
    bw_status status = read_whole(r, &value);
    if (status != BW_OK) return status;
    if (value < 0 || (uint64_t)value >= bound) {
        char what[120];
        snprintf(what, sizeof what, "vertex index %lld is outside 0..%lld", (long long)value, (long long)bound - 1);
        return fail_here(r, BW_E_INDEX, what);
    }
    *index = (bw_vertex)value;
    return BW_OK;
}

static bw_status read_number(reader *r, double *value) {
    pass_blanks(r);
    const char *word = r->at;
    bw_number_status status = bw_number_read(&r->at, r->lines.end, value);
    return status == BW_NUMBER_OK ? BW_OK : fail_number(r, status, word, r->at);
}

static bw_status end_line(reader *r) {
    pass_blanks(r);
    if (r->at == r->lines.end) return BW_OK;
    char text[40], what[100];
    snprintf(what, sizeof what, "'%s' is more than belongs on the line", word_at(r, r->at, text));
    return fail_here(r, BW_E_SYNTAX, what);
}

/* ---- lists -------------------------------------------------------------------------------------------------- */

static bw_status check_count(reader *r, const list *l, int64_t count, uint64_t bytes_left) {
    char what[160];
    uint64_t record = 2 * (uint64_t)(l->indices + l->numbers); /* a digit and a blank each */
    if (count < 0) {
        snprintf(what, sizeof what, "the number of %s is negative: %lld", l->plural, (long long)count);
        return fail_here(r, BW_E_COUNT, what);
    }
    if (count > l->count_max) {
        snprintf(what, sizeof what, "%lld %s are more than the %lld supported", (long long)count, l->plural, (long long)l->count_max);
        return fail_here(r, BW_E_COUNT, what);
    }
    if (bytes_left != UINT64_MAX && (uint64_t)count > (bytes_left + 1) / record) { /* the last line may lack its break */
        snprintf(what, sizeof what, "%lld %s cannot be in the %llu bytes that are left", (long long)count, l->plural,
                 (unsigned long long)bytes_left);
        return fail_here(r, BW_E_COUNT, what);
    }
    return BW_OK;
}

/* Makes room for records up to `room`. */
static bw_status resize_list(reader *r, const list *l, size_t room) {
    if (l->indices) {
        void *block = bw_resize(r->ctx, *l->index, room, (size_t)l->indices * sizeof **l->index);
        if (!block) return r->ctx->error.status;
        *l->index = block;
    }
    if (l->numbers) {
        void *block = bw_resize(r->ctx, *l->number, room, (size_t)l->numbers * sizeof **l->number);
        if (!block) return r->ctx->error.status;
        *l->number = block;
    }
    return BW_OK;
}

static bw_status read_record(reader *r, const list *l, size_t i) {
    bw_status status = next_line(r);
    if (status == BW_OK && !r->lines.text) return fail_here(r, BW_E_TRUNCATED, "the input ends before it");
    bw_vertex *index = l->indices ? *l->index + i * (size_t)l->indices : NULL;
    double *number = l->numbers ? *l->number + i * (size_t)l->numbers : NULL;
    for (int k = 0; status == BW_OK && k < l->indices; k++) status = read_index(r, r->mesh->vertex_count, &index[k]);
    for (int k = 0; status == BW_OK && k < l->numbers; k++) status = read_number(r, &number[k]);
    return status == BW_OK ? end_line(r) : status;
}

/* Reads `count` records. The room is all of them if the size of the input vouches for the count, else it grows. */
static bw_status read_list(reader *r, const list *l, int64_t count) {
    size_t room = r->lines.sized || count < 1024 ? (size_t)count : 1024;
    bw_status status = resize_list(r, l, room);
    r->list = l;
    for (size_t i = 0; status == BW_OK && i < (size_t)count; i++) {
        r->record = (int64_t)i;
        if (i == room) {
            room = (size_t)count / 2 < room ? (size_t)count : 2 * room;
            status = resize_list(r, l, room);
        }
        if (status == BW_OK) status = read_record(r, l, i);
    }
    r->list = NULL;
    if (status == BW_OK) *l->count = (size_t)count;
    return status;
}

/* ---- the file ----------------------------------------------------------------------------------------------- */

static bw_status read_counted(reader *r, const list *l, bw_status if_absent) {
    int64_t count;
    bw_status status = next_line(r);
    if (status != BW_OK) return status;
    if (!r->lines.text) {
        char what[100];
        snprintf(what, sizeof what, "the input ends before the number of %s", l->plural);
        return if_absent == BW_E_EMPTY ? bw_fail(r->ctx, BW_E_EMPTY, "the input is empty") : fail_here(r, if_absent, what);
    }
    if ((status = read_whole(r, &count)) != BW_OK) return status;
    if ((status = end_line(r)) != BW_OK) return status;
    if ((status = check_count(r, l, count, bw_lines_left(&r->lines))) != BW_OK) return status;
    return read_list(r, l, count);
}

static bw_status read_mesh(reader *r) {
    bw_tet_mesh *m = r->mesh;
    const list vertices = {"vertex", "vertices", "vertex", 0, 3, NULL, (double **)&m->position, &m->vertex_count, BW_HEXEX_VERTICES_MAX};
    const list tets = {"tet", "tets", "tet", 4, 12, (bw_vertex **)&m->tet, (double **)&m->parameter, &m->tet_count, BW_HEXEX_TETS_MAX};
    bw_status status = read_counted(r, &vertices, BW_E_EMPTY);
    if (status == BW_OK) status = read_counted(r, &tets, BW_E_TRUNCATED);
    if (status == BW_OK && !m->tet_count) status = bw_fail(r->ctx, BW_E_EMPTY, "the input has no tets");
    return status;
}

static bw_status read_features(reader *r, const int64_t count[3]) {
    bw_tet_mesh *m = r->mesh;
    const list feature[3] = {
        {"feature vertex", "feature vertices", NULL, 1, 0, &m->feature_vertex, NULL, &m->feature_vertex_count, INT32_MAX},
        {"feature edge", "feature edges", NULL, 2, 0, (bw_vertex **)&m->feature_edge, NULL, &m->feature_edge_count, INT32_MAX},
        {"feature facet", "feature facets", NULL, 3, 0, (bw_vertex **)&m->feature_facet, NULL, &m->feature_facet_count, INT32_MAX}};
    uint64_t left = bw_lines_left(&r->lines);
    bw_status status = BW_OK;
    for (int i = 0; i < 3 && status == BW_OK; i++) { /* all three before the first is read */
        status = check_count(r, &feature[i], count[i], left);
        if (left != UINT64_MAX && status == BW_OK) {
            uint64_t need = 2 * (uint64_t)feature[i].indices * (uint64_t)count[i];
            left -= need < left ? need : left;
        }
    }
    for (int i = 0; i < 3 && status == BW_OK; i++) status = read_list(r, &feature[i], count[i]);
    return status;
}

/* A line of counts: one for walls, three for features. */
static bw_status read_counts(reader *r, bool after_walls, int64_t count[3], int *n) {
    bw_status status = BW_OK;
    for (*n = 0; *n < 3 && status == BW_OK; ++*n) {
        pass_blanks(r);
        if (r->at == r->lines.end) break;
        status = read_whole(r, &count[*n]);
    }
    if (status == BW_OK) status = end_line(r);
    if (status != BW_OK || *n == 3 || (*n == 1 && !after_walls)) return status;
    if (r->lines.broken_off) return fail_here(r, BW_E_TRUNCATED, "the input ends in the middle of the feature counts");
    return fail_here(r, BW_E_SYNTAX, after_walls ? "only feature counts (three numbers) may follow the walls"
                                                 : "two counts: one number announces walls, three announce features");
}

static bw_status read_lists(reader *r) {
    bw_tet_mesh *m = r->mesh;
    const list walls = {"wall", "walls", "wall", 3, 1, (bw_vertex **)&m->wall, &m->wall_distance, &m->wall_count, INT32_MAX};
    int64_t count[3];
    int n;
    bw_status status = next_line(r);
    if (status != BW_OK || !r->lines.text) return status;
    if ((status = read_counts(r, false, count, &n)) != BW_OK) return status;
    if (n == 1) {
        if ((status = check_count(r, &walls, count[0], bw_lines_left(&r->lines))) != BW_OK) return status;
        if ((status = read_list(r, &walls, count[0])) != BW_OK) return status;
        if ((status = next_line(r)) != BW_OK || !r->lines.text) return status;
        if ((status = read_counts(r, true, count, &n)) != BW_OK) return status;
    }
    if ((status = read_features(r, count)) != BW_OK) return status;
    if ((status = next_line(r)) != BW_OK || !r->lines.text) return status;
    return fail_here(r, BW_E_SYNTAX, "there is more text after the last list");
}

static bw_status read_all(reader *r, bw_status opened) {
    bw_status status = opened;
    if (status == BW_OK) status = read_mesh(r);
    if (status == BW_OK) status = read_lists(r);
    if (status == BW_OK) bw_progress(r->ctx, 1);
    bw_lines_close(&r->lines);
    if (status != BW_OK) bw_tet_mesh_clear(r->ctx, r->mesh);
    return status;
}

static reader reader_of(bw_context *ctx, bw_tet_mesh *mesh) {
    memset(mesh, 0, sizeof *mesh);
    return (reader){.ctx = ctx, .mesh = mesh};
}

bw_status bw_hexex_read_memory(bw_context *ctx, const void *data, size_t size, bw_tet_mesh *mesh) {
    reader r = reader_of(ctx, mesh);
    return read_all(&r, bw_lines_open_memory(ctx, &r.lines, data, size));
}

bw_status bw_hexex_read_fd(bw_context *ctx, int fd, bw_tet_mesh *mesh) {
    reader r = reader_of(ctx, mesh);
    return read_all(&r, bw_lines_open_fd(ctx, &r.lines, fd));
}

bw_status bw_hexex_read(bw_context *ctx, const char *path, bw_tet_mesh *mesh) {
    memset(mesh, 0, sizeof *mesh);
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NOCTTY);
    if (fd < 0) return bw_fail(ctx, BW_E_IO, "cannot open %.200s: %s", path, strerror(errno));
    bw_status status = bw_hexex_read_fd(ctx, fd, mesh);
    close(fd);
    return status;
}
