#include "igm/pieces.h"

#include <math.h>
#include <string.h>

#include "base/index.h"
#include "exact/det.h"

/* ---- planes -------------------------------------------------------------------------------------------------------- */

void bw_cutter_init(bw_cutter *p, const int64_t a[3], const int64_t b[3], const int64_t c[3], const int64_t inside[3]) {
    mpz_t t, side;
    mpz_inits(p->normal[0], p->normal[1], p->normal[2], p->offset, t, side, NULL);
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        mpz_set_si(p->normal[k], b[i] - a[i]), mpz_mul_si(p->normal[k], p->normal[k], c[j] - a[j]);
        mpz_set_si(t, b[j] - a[j]), mpz_mul_si(t, t, c[i] - a[i]);
        mpz_sub(p->normal[k], p->normal[k], t);
        mpz_mul_si(t, p->normal[k], a[k]), mpz_add(p->offset, p->offset, t);
        mpz_mul_si(t, p->normal[k], inside[k] - a[k]), mpz_add(side, side, t);
        p->through[k] = a[k];
    }
    for (int k = 0; k < 3; k++) {
        if (mpz_sgn(side) < 0) mpz_neg(p->normal[k], p->normal[k]);
        p->n[k] = mpz_get_d(p->normal[k]);
    }
    if (mpz_sgn(side) < 0) mpz_neg(p->offset, p->offset);
    p->d = mpz_get_d(p->offset);
    mpz_clears(t, side, NULL);
}

void bw_cutter_clear(bw_cutter *p) { mpz_clears(p->normal[0], p->normal[1], p->normal[2], p->offset, NULL); }

static void distance(const bw_cutter *p, const bw_corner *c, mpq_t out) {
    mpq_t t;
    mpq_init(t);
    mpq_set_z(out, p->offset), mpq_neg(out, out);
    for (int k = 0; k < 3; k++) {
        mpq_set_z(t, p->normal[k]);
        mpq_mul(t, t, c->x[k]);
        mpq_add(out, out, t);
    }
    mpq_clear(t);
}

/* A coordinate is off by 2^-52 of itself (GMP truncates), so is the normal, sums by 2^-53: 2^-48 of all magnitudes bounds the error. */
int bw_cutter_side(const bw_cutter *p, const bw_corner *c) {
    double sum = 0, size = 0;
    for (int k = 0; k < 3; k++) {
        double e = c->at[k] - (double)p->through[k];
        sum += p->n[k] * e;
        size += fabs(p->n[k]) * (fabs(c->at[k]) + fabs((double)p->through[k]));
    }
    if (fabs(sum) > 0x1p-48 * size) return sum > 0 ? 1 : -1;
    mpq_t s;
    mpq_init(s);
    distance(p, c, s);
    int sign = mpq_sgn(s);
    mpq_clear(s);
    return sign;
}

/* ---- pieces -------------------------------------------------------------------------------------------------------- */

void bw_piece_clear(bw_context *ctx, bw_piece *piece) {
    for (size_t i = 0; i < piece->corner_ready; i++) mpq_clears(piece->corner[i].x[0], piece->corner[i].x[1], piece->corner[i].x[2], NULL);
    bw_free(ctx, piece->corner), bw_free(ctx, piece->face), bw_free(ctx, piece->loop);
    bw_free(ctx, piece->cut.side), bw_free(ctx, piece->cut.copy), bw_free(ctx, piece->cut.crossed), bw_free(ctx, piece->cut.rim);
    bw_free(ctx, piece->cut.flat);
    memset(piece, 0, sizeof *piece);
}

void bw_piece_empty(bw_piece *piece) { piece->corner_count = piece->face_count = piece->loop_count = 0; }

bw_status bw_piece_corner(bw_context *ctx, bw_piece *piece, int32_t *corner) {
    bw_status status = bw_reserve(ctx, &piece->corner, &piece->corner_room, piece->corner_count + 1);
    if (status != BW_OK) return status;
    *corner = (int32_t)piece->corner_count++;
    piece->corner[*corner].vertex = BW_NONE;
    for (; piece->corner_ready < piece->corner_count; piece->corner_ready++)
        mpq_inits(piece->corner[piece->corner_ready].x[0], piece->corner[piece->corner_ready].x[1], piece->corner[piece->corner_ready].x[2], NULL);
    return BW_OK;
}

static size_t open_begin(const bw_piece *piece) {
    return piece->face_count ? piece->face[piece->face_count - 1].begin + piece->face[piece->face_count - 1].count : 0;
}

bw_status bw_piece_put(bw_context *ctx, bw_piece *piece, int32_t corner) {
    bw_status status = bw_reserve(ctx, &piece->loop, &piece->loop_room, piece->loop_count + 1);
    if (status == BW_OK) piece->loop[piece->loop_count++] = corner;
    return status;
}

bw_status bw_piece_close(bw_context *ctx, bw_piece *piece, int32_t tag) {
    size_t begin = open_begin(piece), count = piece->loop_count - begin;
    if (count < 3) {
        piece->loop_count = begin;
        return BW_OK;
    }
    bw_status status = bw_reserve(ctx, &piece->face, &piece->face_room, piece->face_count + 1);
    if (status == BW_OK) piece->face[piece->face_count++] = (bw_piece_face){begin, count, tag};
    return status;
}

void bw_corner_round(bw_corner *c) {
    for (int k = 0; k < 3; k++) c->at[k] = mpq_get_d(c->x[k]);
}

/* ---- cutting ------------------------------------------------------------------------------------------------------- */

typedef struct {
    bw_context *ctx;
    const bw_piece *from;
    bw_piece *to; /* has the scratch */
    const bw_cutter *plane;
} cut;

static bw_status add_corner(cut *c, bool flat, int32_t *out) {
    bw_status status = bw_piece_corner(c->ctx, c->to, out);
    if (status == BW_OK) status = bw_reserve(c->ctx, &c->to->cut.flat, &c->to->cut.flat_room, c->to->corner_count);
    if (status == BW_OK) c->to->cut.flat[*out] = flat;
    return status;
}

static bw_status copy_corner(cut *c, int32_t corner, int32_t *out) {
    bw_status status = BW_OK;
    if (c->to->cut.copy[corner] == BW_NONE && (status = add_corner(c, c->to->cut.side[corner] == 0, &c->to->cut.copy[corner])) == BW_OK) {
        bw_corner *to = &c->to->corner[c->to->cut.copy[corner]];
        for (int k = 0; k < 3; k++) mpq_set(to->x[k], c->from->corner[corner].x[k]), to->at[k] = c->from->corner[corner].at[k];
        to->vertex = c->from->corner[corner].vertex;
    }
    *out = c->to->cut.copy[corner];
    return status;
}

/* a + (b - a) s_a / (s_a - s_b) */
static void cross(const cut *c, const bw_corner *a, const bw_corner *b, bw_corner *out) {
    mpq_t s, t;
    mpq_inits(s, t, NULL);
    distance(c->plane, a, s), distance(c->plane, b, t);
    mpq_sub(t, s, t);
    mpq_div(s, s, t);
    for (int k = 0; k < 3; k++) {
        mpq_sub(t, b->x[k], a->x[k]);
        mpq_mul(t, t, s);
        mpq_add(out->x[k], a->x[k], t);
    }
    mpq_clears(s, t, NULL);
    bw_corner_round(out);
}

static bw_status cross_edge(cut *c, int32_t a, int32_t b, int32_t *out) {
    if (a > b) {
        int32_t swap = a;
        a = b, b = swap;
    }
    for (size_t i = 0; i < c->to->cut.crossings; i++)
        if (c->to->cut.crossed[i][0] == a && c->to->cut.crossed[i][1] == b) {
            *out = c->to->cut.crossed[i][2];
            return BW_OK;
        }
    bw_status status = add_corner(c, true, out);
    if (status == BW_OK) status = bw_reserve(c->ctx, &c->to->cut.crossed, &c->to->cut.crossing_room, c->to->cut.crossings + 1);
    if (status != BW_OK) return status;
    cross(c, &c->from->corner[a], &c->from->corner[b], &c->to->corner[*out]);
    c->to->cut.crossed[c->to->cut.crossings][0] = a, c->to->cut.crossed[c->to->cut.crossings][1] = b, c->to->cut.crossed[c->to->cut.crossings++][2] = *out;
    return BW_OK;
}

static bw_status cut_face(cut *c, const bw_piece_face *face) {
    const int32_t *loop = &c->from->loop[face->begin];
    bool inside = false;
    bw_status status = BW_OK;
    for (size_t i = 0; i < face->count; i++) inside |= c->to->cut.side[loop[i]] > 0;
    if (!inside) return BW_OK; /* also a face in the plane, outside of which the polyhedron then is */
    for (size_t i = 0; i < face->count && status == BW_OK; i++) {
        int32_t a = loop[i], b = loop[(i + 1) % face->count], corner;
        if (c->to->cut.side[a] >= 0) {
            status = copy_corner(c, a, &corner);
            if (status == BW_OK) status = bw_piece_put(c->ctx, c->to, corner);
        }
        if (status == BW_OK && c->to->cut.side[a] * c->to->cut.side[b] < 0) {
            status = cross_edge(c, a, b, &corner);
            if (status == BW_OK) status = bw_piece_put(c->ctx, c->to, corner);
        }
    }
    return status == BW_OK ? bw_piece_close(c->ctx, c->to, face->tag) : status;
}

/* The edges of the cut faces that lie in the plane. */
static bw_status find_rim(cut *c) {
    for (size_t f = 0; f < c->to->face_count; f++) {
        const bw_piece_face *face = &c->to->face[f];
        for (size_t i = 0; i < face->count; i++) {
            int32_t a = c->to->loop[face->begin + i], b = c->to->loop[face->begin + (i + 1) % face->count];
            if (!c->to->cut.flat[a] || !c->to->cut.flat[b]) continue;
            bw_status status = bw_reserve(c->ctx, &c->to->cut.rim, &c->to->cut.rim_room, c->to->cut.rims + 1);
            if (status != BW_OK) return status;
            c->to->cut.rim[c->to->cut.rims][0] = a, c->to->cut.rim[c->to->cut.rims++][1] = b;
        }
    }
    return BW_OK;
}

/* Links them to the face that closes the piece. */
static bw_status close_rim(cut *c) {
    bw_status status = find_rim(c);
    if (status != BW_OK || c->to->cut.rims == 0) return status;
    int32_t first = c->to->cut.rim[0][0], at = c->to->cut.rim[0][1];
    status = bw_piece_put(c->ctx, c->to, first);
    c->to->cut.rim[0][0] = BW_NONE;
    for (size_t used = 1; used < c->to->cut.rims && status == BW_OK; used++) {
        size_t i = 1;
        while (i < c->to->cut.rims && (c->to->cut.rim[i][0] == BW_NONE || (c->to->cut.rim[i][0] != at && c->to->cut.rim[i][1] != at))) i++;
        if (i == c->to->cut.rims) return bw_fail(c->ctx, BW_E_CHECK, "a piece of a cell is not closed after a cut");
        status = bw_piece_put(c->ctx, c->to, at);
        at = c->to->cut.rim[i][c->to->cut.rim[i][0] == at];
        c->to->cut.rim[i][0] = BW_NONE;
    }
    if (status == BW_OK && at != first) return bw_fail(c->ctx, BW_E_CHECK, "a piece of a cell is not closed after a cut");
    return status == BW_OK ? bw_piece_close(c->ctx, c->to, BW_NONE) : status;
}

/* All of it: faces in the plane too. */
static bw_status copy_all(cut *c) {
    bw_status status = BW_OK;
    for (size_t f = 0; f < c->from->face_count && status == BW_OK; f++) {
        const bw_piece_face *face = &c->from->face[f];
        for (size_t i = 0; i < face->count && status == BW_OK; i++) {
            int32_t corner;
            status = copy_corner(c, c->from->loop[face->begin + i], &corner);
            if (status == BW_OK) status = bw_piece_put(c->ctx, c->to, corner);
        }
        if (status == BW_OK) status = bw_piece_close(c->ctx, c->to, face->tag);
    }
    return status;
}

bw_status bw_piece_cut(bw_context *ctx, const bw_piece *from, const bw_cutter *plane, bw_piece *to) {
    cut c = {.ctx = ctx, .from = from, .to = to, .plane = plane};
    bool inside = false, outside = false;
    bw_piece_empty(to);
    to->cut.crossings = to->cut.rims = 0;
    bw_status status = bw_reserve(ctx, &to->cut.side, &to->cut.side_room, from->corner_count);
    if (status == BW_OK) status = bw_reserve(ctx, &to->cut.copy, &to->cut.copy_room, from->corner_count);
    if (status != BW_OK) return status;
    for (size_t i = 0; i < from->corner_count; i++) {
        int side = bw_cutter_side(plane, &from->corner[i]);
        to->cut.side[i] = (int8_t)side, to->cut.copy[i] = BW_NONE;
        inside |= side > 0, outside |= side < 0;
    }
    if (!inside) return BW_OK;
    if (!outside) return copy_all(&c);
    for (size_t f = 0; f < from->face_count && status == BW_OK; f++) status = cut_face(&c, &from->face[f]);
    return status == BW_OK ? close_rim(&c) : status;
}

/* ---- signs --------------------------------------------------------------------------------------------------------- */

static void minor(mpq_t out, const mpq_t a[3], const mpq_t b[3], int i, int j, mpq_t scratch) {
    mpq_mul(out, a[i], b[j]);
    mpq_mul(scratch, a[j], b[i]);
    mpq_sub(out, out, scratch);
}

int bw_corner_sign(const bw_corner *a, const bw_corner *b, const bw_corner *c, const bw_corner *d) {
    const bw_corner *p[4] = {a, b, c, d};
    double e[3][3], size = 0, span = 0;
    for (int i = 0; i < 4; i++)
        for (int k = 0; k < 3; k++) size = fmax(size, fabs(p[i]->at[k]));
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) e[i][k] = p[i + 1]->at[k] - a->at[k], span = fmax(span, fabs(e[i][k]));
    double sum = bw_det3_rounded(e[0], e[1], e[2]);
    if (fabs(sum) > 0x1p-45 * (span + 0x1p-50 * size) * (span + 0x1p-50 * size) * size) return sum > 0 ? 1 : -1; /* entries are off by 2^-51 size */
    mpq_t x[3][3], m, t, total;
    mpq_inits(m, t, total, NULL);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) mpq_init(x[i][k]), mpq_sub(x[i][k], p[i + 1]->x[k], a->x[k]);
    for (int k = 0; k < 3; k++) {
        minor(m, (const mpq_t *)x[1], (const mpq_t *)x[2], (k + 1) % 3, (k + 2) % 3, t);
        mpq_mul(m, m, x[0][k]);
        mpq_add(total, total, m);
    }
    int sign = mpq_sgn(total);
    for (int i = 0; i < 9; i++) mpq_clear(x[i / 3][i % 3]);
    mpq_clears(m, t, total, NULL);
    return sign;
}

bool bw_corner_collinear(const bw_corner *a, const bw_corner *b, const bw_corner *c) {
    double size = 0, span = 0, u[3], v[3];
    for (int k = 0; k < 3; k++) {
        u[k] = b->at[k] - a->at[k], v[k] = c->at[k] - a->at[k];
        size = fmax(size, fmax(fabs(a->at[k]), fmax(fabs(b->at[k]), fabs(c->at[k]))));
        span = fmax(span, fmax(fabs(u[k]), fabs(v[k])));
    }
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        if (fabs(u[i] * v[j] - u[j] * v[i]) > 0x1p-46 * (span + 0x1p-50 * size) * size) return false;
    }
    mpq_t x[2][3], m, t;
    mpq_inits(m, t, NULL);
    for (int k = 0; k < 3; k++) {
        mpq_inits(x[0][k], x[1][k], NULL);
        mpq_sub(x[0][k], b->x[k], a->x[k]), mpq_sub(x[1][k], c->x[k], a->x[k]);
    }
    bool zero = true;
    for (int k = 0; k < 3 && zero; k++) {
        minor(m, (const mpq_t *)x[0], (const mpq_t *)x[1], (k + 1) % 3, (k + 2) % 3, t);
        zero = mpq_sgn(m) == 0;
    }
    for (int k = 0; k < 3; k++) mpq_clears(x[0][k], x[1][k], NULL);
    mpq_clears(m, t, NULL);
    return zero;
}
