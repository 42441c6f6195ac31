/* Whether a T-mesh is as its header says: from cells, faces and T-joints alone, against ribs and patches of the atlas. */
#include <gmp.h>
#include <stdlib.h>
#include <string.h>

#include "tspline/parts.h"

typedef struct {
    bw_context *ctx;
    const bw_tmesh *mesh;
    size_t *face_begin;  /* [6 * cell + side + 1] */
    size_t *face;        /* faces of the side */
    int64_t *at;         /* where the cells at a rib begin and end; scratch */
    size_t at_room;
    uint8_t (*axes)[3];  /* [cell][axis]: by bits, which of its four edges along the axis are extraordinary (bits as in complex.h) */
    int32_t *cells_at;   /* [arc] cells at its first part, over all ribs */
    size_t *point_begin; /* [vertex + 1] */
    size_t *point;
} checker;

static bw_status fault(const checker *c, const char *kind, size_t id, const char *what) { return bw_fail(c->ctx, BW_E_CHECK, "T-mesh: %s %zu: %s", kind, id, what); }

/* ---- 1: boxes are filled ------------------------------------------------------------------------------------------- */

static void add_box(mpz_t sum, const int64_t extent[3]) {
    mpz_t box;
    mpz_init_set_si(box, extent[0]);
    mpz_mul_si(box, box, extent[1]), mpz_mul_si(box, box, extent[2]);
    mpz_add(sum, sum, box);
    mpz_clear(box);
}

static bool overlap(const bw_tcell *a, const bw_tcell *b) {
    for (int k = 0; k < 3; k++)
        if (a->high[k] <= b->low[k] || b->high[k] <= a->low[k]) return false;
    return true;
}

static bw_status check_cells(checker *c, bw_block block, mpz_t volume) {
    const bw_tmesh *m = c->mesh;
    for (size_t i = m->cell_begin[block]; i < m->cell_begin[block + 1]; i++) {
        const bw_tcell *cell = &m->cell[i];
        int64_t extent[3];
        if (i % 256 == 0 && bw_poll(c->ctx)) return c->ctx->error.status;
        if (cell->block != block) return fault(c, "cell", i, "it is listed with another block");
        for (int k = 0; k < 3; k++) {
            extent[k] = cell->high[k] - cell->low[k];
            if (extent[k] <= 0) return fault(c, "cell", i, "an extent is not positive");
            if (cell->low[k] < 0 || cell->high[k] > BW_TMESH_UNIT * m->atlas->extent[block][k]) return fault(c, "cell", i, "it leaves its block");
        }
        for (size_t j = m->cell_begin[block]; j < i; j++)
            if (overlap(cell, &m->cell[j])) return fault(c, "cell", i, "it overlaps another one");
        add_box(volume, extent);
    }
    return BW_OK;
}

static bw_status check_block(checker *c, bw_block block) {
    mpz_t volume, box;
    int64_t extent[3];
    mpz_inits(volume, box, NULL);
    for (int k = 0; k < 3; k++) extent[k] = BW_TMESH_UNIT * c->mesh->atlas->extent[block][k];
    add_box(box, extent);
    bw_status status = check_cells(c, block, volume);
    if (status == BW_OK && mpz_cmp(volume, box)) status = fault(c, "block", (size_t)block, "its cells do not fill it");
    mpz_clears(volume, box, NULL);
    return status;
}

/* ---- 2: sides are tiled -------------------------------------------------------------------------------------------- */

/* The rectangle of a face as the cell on one side of it sees it. */
static void face_box(const bw_tmesh *m, const bw_tface *f, int which, int64_t out[2][3]) {
    memcpy(out[0], f->low, sizeof f->low), memcpy(out[1], f->high, sizeof f->high);
    if (!which || f->patch == BW_NONE) return;
    bw_transition t = bw_tmesh_out(m->atlas, f->patch, 0);
    for (int e = 0; e < 2; e++) bw_transition_apply(&t, out[e], out[e]);
    for (int k = 0; k < 3; k++)
        if (out[0][k] > out[1][k]) {
            int64_t x = out[0][k];
            out[0][k] = out[1][k], out[1][k] = x;
        }
}

static bool is_on_side(const bw_tcell *cell, int side, const int64_t box[2][3]) {
    for (int k = 0; k < 3; k++) {
        int64_t low = k == side >> 1 && side & 1 ? cell->high[k] : cell->low[k], high = k == side >> 1 && !(side & 1) ? cell->low[k] : cell->high[k];
        if (box[0][k] < low || box[1][k] > high || (k != side >> 1 && box[0][k] >= box[1][k])) return false;
    }
    return true;
}

static bool is_whole(const bw_tcell *cell, int side, const int64_t box[2][3]) {
    for (int k = 0; k < 3; k++)
        if (k != side >> 1 && (box[0][k] != cell->low[k] || box[1][k] != cell->high[k])) return false;
    return true;
}

static bw_status check_face(checker *c, size_t i) {
    const bw_tmesh *m = c->mesh;
    const bw_complex *x = m->atlas->complex;
    const bw_tface *f = &m->face[i];
    if (f->patch == BW_NONE && (f->cell[1] == BW_NONE || m->cell[f->cell[0]].block != m->cell[f->cell[1]].block))
        return fault(c, "face", i, "it is in no patch although it is between blocks");
    if (f->patch != BW_NONE && (x->patch_block[f->patch][0] != m->cell[f->cell[0]].block || (x->patch_block[f->patch][1] == BW_NONE) != (f->cell[1] == BW_NONE) ||
                                (f->cell[1] != BW_NONE && x->patch_block[f->patch][1] != m->cell[f->cell[1]].block)))
        return fault(c, "face", i, "its patch is between other blocks");
    if (f->patch != BW_NONE && (!bw_tpatch_has(m->atlas, f->patch, 0, f->low) || !bw_tpatch_has(m->atlas, f->patch, 0, f->high)))
        return fault(c, "face", i, "it leaves its patch");
    for (int which = 0; which < 2 && f->cell[which] != BW_NONE; which++) {
        int64_t box[2][3];
        face_box(m, f, which, box);
        if (!is_on_side(&m->cell[f->cell[which]], f->side[which], (const int64_t(*)[3])box)) return fault(c, "face", i, "it is not on the side of its cell");
    }
    return BW_OK;
}

static bw_status list_faces(checker *c) {
    const bw_tmesh *m = c->mesh;
    size_t sides = 6 * m->cell_count;
    c->face_begin = bw_alloc(c->ctx, sides + 2, sizeof *c->face_begin);
    c->face = bw_alloc(c->ctx, 2 * m->face_count, sizeof *c->face);
    if (!c->face_begin || !c->face) return c->ctx->error.status;
    for (int pass = 0; pass < 2; pass++) {
        for (size_t i = 0; i < m->face_count; i++)
            for (int which = 0; which < 2 && m->face[i].cell[which] != BW_NONE; which++) {
                size_t key = 6 * (size_t)m->face[i].cell[which] + m->face[i].side[which];
                if (pass) c->face[c->face_begin[key + 1]++] = i;
                else c->face_begin[key + 2]++;
            }
        for (size_t k = 2; k < sides + 2 && !pass; k++) c->face_begin[k] += c->face_begin[k - 1];
    }
    return BW_OK;
}

static unsigned __int128 area_of(const int64_t low[3], const int64_t high[3], int normal) {
    int u = (normal + 1) % 3, v = (normal + 2) % 3;
    return (unsigned __int128)(high[u] - low[u]) * (unsigned __int128)(high[v] - low[v]);
}

static bool faces_overlap(const int64_t a[2][3], const int64_t b[2][3], int normal) {
    for (int k = 0; k < 3; k++)
        if (k != normal && (a[1][k] <= b[0][k] || b[1][k] <= a[0][k])) return false;
    return true;
}

static bw_status check_side(checker *c, size_t cell, int side) {
    const bw_tmesh *m = c->mesh;
    unsigned __int128 sum = 0;
    size_t key = 6 * cell + (size_t)side;
    for (size_t i = c->face_begin[key]; i < c->face_begin[key + 1]; i++) {
        const bw_tface *f = &m->face[c->face[i]];
        int64_t a[2][3], b[2][3];
        face_box(m, f, !(f->cell[0] == (int32_t)cell && f->side[0] == side), a);
        sum += area_of(a[0], a[1], side >> 1);
        for (size_t j = c->face_begin[key]; j < i; j++) {
            const bw_tface *g = &m->face[c->face[j]];
            face_box(m, g, !(g->cell[0] == (int32_t)cell && g->side[0] == side), b);
            if (faces_overlap((const int64_t(*)[3])a, (const int64_t(*)[3])b, side >> 1)) return fault(c, "cell", cell, "faces of one side overlap");
        }
    }
    return sum == area_of(m->cell[cell].low, m->cell[cell].high, side >> 1) ? BW_OK : fault(c, "cell", cell, "a side is not covered by faces");
}

/* ---- 3: tubes ------------------------------------------------------------------------------------------------------ */

/* Bit of the edge of a cell along `axis` that lies on a line, or -1. */
static int edge_on(const bw_tcell *cell, int axis, const int64_t line[3]) {
    int bits = 0;
    for (int i = 1; i < 3; i++) {
        int k = (axis + i) % 3;
        if (line[k] == cell->high[k]) bits |= 1 << (i - 1);
        else if (line[k] != cell->low[k]) return -1;
    }
    return bits;
}

static int compare_numbers(const void *a, const void *b) {
    int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

/* Cells at a rib: as many as it has quarter turns, all beginning and ending where the arc is cut. */
static bw_status check_rib(checker *c, bw_block block, const bw_rib *rib) {
    const bw_tmesh *m = c->mesh;
    int64_t low[3], high[3];
    const int axis = rib->axis;
    size_t count = 0, quarters = rib->side[0] == rib->side[1] ? 2 : 1, cuts = m->cut_begin[rib->arc + 1] - m->cut_begin[rib->arc];
    bw_trib_ends(m->atlas, rib, low, high);
    for (size_t i = m->cell_begin[block]; i < m->cell_begin[block + 1]; i++) {
        const bw_tcell *cell = &m->cell[i];
        int bits = edge_on(cell, axis, low);
        if (bits < 0 || cell->high[axis] <= low[axis] || cell->low[axis] >= high[axis]) continue;
        if (cell->low[axis] < low[axis] || cell->high[axis] > high[axis]) return fault(c, "cell", i, "it goes on beyond the end of an extraordinary arc");
        c->axes[i][axis] |= (uint8_t)(1 << bits);
        bw_status status = bw_reserve(c->ctx, &c->at, &c->at_room, count + 1);
        if (status != BW_OK) return status;
        c->at[count++] = rib->reversed ? high[axis] - cell->high[axis] : cell->low[axis] - low[axis];
    }
    if (count != quarters * (cuts + 1)) return fault(c, "arc", (size_t)rib->arc, "there is not one cell per quarter turn and part of it");
    if (count) qsort(c->at, count, sizeof *c->at, compare_numbers);
    for (size_t i = 0; i < count; i++) {
        size_t part = i / quarters;
        if (c->at[i] != (part ? m->cut[m->cut_begin[rib->arc] + part - 1] : 0)) return fault(c, "arc", (size_t)rib->arc, "the cells around it are not cut alike");
    }
    c->cells_at[rib->arc] += (int32_t)quarters;
    return bw_poll(c->ctx);
}

static bw_status check_tubes(checker *c) {
    const bw_atlas *atlas = c->mesh->atlas;
    const bw_complex *x = atlas->complex;
    bw_status status = BW_OK;
    for (bw_block b = 0; b < (bw_block)x->block_count && status == BW_OK; b++)
        for (size_t r = atlas->rib_begin[b]; r < atlas->rib_begin[b + 1] && status == BW_OK; r++)
            if (bw_tmesh_is_extraordinary(x, atlas->rib[r].arc)) status = check_rib(c, b, &atlas->rib[r]);
    for (bw_arc a = 0; a < (bw_arc)x->arc_count && status == BW_OK; a++)
        if (bw_tmesh_is_extraordinary(x, a) && c->cells_at[a] != x->arc_quarters[a]) status = fault(c, "arc", (size_t)a, "it has not one cell per quarter turn");
    return status;
}

/* ---- 5: one node per cell ------------------------------------------------------------------------------------------ */

static bw_status check_cell(checker *c, size_t i) {
    const bw_tmesh *m = c->mesh;
    const bw_tcell *cell = &m->cell[i];
    int low[3] = {0, 0, 0}, high[3] = {0, 0, 0}; /* edges on the low and on the high end of each axis */
    for (int axis = 0; axis < 3; axis++)
        for (int bits = 0; bits < 4; bits++) {
            if (!(c->axes[i][axis] >> bits & 1)) continue;
            for (int k = 0; k < 2; k++) {
                int across = (axis + 1 + k) % 3;
                ++(bits >> k & 1 ? high : low)[across];
                if (2 * (cell->high[across] - cell->low[across]) > BW_TMESH_UNIT * m->atlas->extent[cell->block][across])
                    return fault(c, "cell", i, "it is thicker than half of its block beside an extraordinary arc");
            }
        }
    for (int k = 0; k < 3; k++)
        if (low[k] && high[k]) return fault(c, "cell", i, "its extraordinary arcs do not meet in one corner");
    return BW_OK;
}

/* ---- 4: no T-joints in tubes --------------------------------------------------------------------------------------- */

/* Whether a rectangle on a side of a cell touches one of the cell's extraordinary edges. */
static bool touches_arc(const checker *c, size_t cell, const int64_t box[2][3]) {
    const bw_tcell *t = &c->mesh->cell[cell];
    for (int axis = 0; axis < 3; axis++)
        for (int bits = 0; bits < 4; bits++) {
            bool on = c->axes[cell][axis] >> bits & 1;
            for (int k = 0; k < 2 && on; k++) {
                int across = (axis + 1 + k) % 3;
                int64_t at = bits >> k & 1 ? t->high[across] : t->low[across];
                on = box[0][across] <= at && at <= box[1][across];
            }
            if (on) return true;
        }
    return false;
}

static bw_status check_joined(checker *c, size_t i) {
    const bw_tmesh *m = c->mesh;
    const bw_tface *f = &m->face[i];
    bool touches = false, whole = true;
    for (int which = 0; which < 2; which++) {
        size_t cell = (size_t)f->cell[which];
        int64_t box[2][3];
        if (f->cell[which] == BW_NONE || !(c->axes[cell][0] | c->axes[cell][1] | c->axes[cell][2])) return BW_OK;
        face_box(m, f, which, box);
        touches |= touches_arc(c, cell, (const int64_t(*)[3])box);
        whole &= is_whole(&m->cell[cell], f->side[which], (const int64_t(*)[3])box);
    }
    return whole || !touches ? BW_OK : fault(c, "face", i, "cells at an extraordinary arc share less than a whole side");
}

/* ---- 6: vertices --------------------------------------------------------------------------------------------------- */

static void corner_at(const bw_tcell *cell, int corner, int64_t out[3]) {
    for (int k = 0; k < 3; k++) out[k] = corner >> k & 1 ? cell->high[k] : cell->low[k];
}

/* Corners of both cells of a face that are one point of it. */
static bw_status check_corners(checker *c, size_t i) {
    const bw_tmesh *m = c->mesh;
    const bw_tface *f = &m->face[i];
    const bw_tcell *a = &m->cell[f->cell[0]], *b = f->cell[1] == BW_NONE ? NULL : &m->cell[f->cell[1]];
    bw_transition t = {.rotation = 0};
    if (b && f->patch != BW_NONE) t = bw_tmesh_out(m->atlas, f->patch, 0);
    for (int n = 0; n < 64 && b; n++) {
        int64_t p[3], q[3];
        corner_at(a, n & 7, p), corner_at(b, n >> 3, q);
        if (p[f->side[0] >> 1] != f->low[f->side[0] >> 1]) continue; /* not on the side of the face: there the transition says nothing */
        bw_transition_apply(&t, p, p);
        if (!memcmp(p, q, sizeof p) && a->corner[n & 7] != b->corner[n >> 3]) return fault(c, "face", i, "its cells have different vertices at one point");
    }
    return BW_OK;
}

/* Places of each vertex, as faces are listed. */
static bw_status list_points(checker *c) {
    const bw_tmesh *m = c->mesh;
    c->point_begin = bw_alloc(c->ctx, m->vertex_count + 2, sizeof *c->point_begin);
    c->point = bw_alloc(c->ctx, m->point_count, sizeof *c->point);
    if (!c->point_begin || !c->point) return c->ctx->error.status;
    for (size_t i = 0; i < m->point_count; i++) c->point_begin[m->point[i].vertex + 2]++;
    for (size_t v = 2; v < m->vertex_count + 2; v++) c->point_begin[v] += c->point_begin[v - 1];
    for (size_t i = 0; i < m->point_count; i++) c->point[c->point_begin[m->point[i].vertex + 1]++] = i;
    return BW_OK;
}

static bw_status check_joint(checker *c, size_t i) {
    const bw_tmesh *m = c->mesh;
    const bw_tjoint *j = &m->joint[i];
    const bw_tcell *cell = &m->cell[j->cell];
    bool found = false;
    for (size_t n = c->point_begin[j->vertex]; n < c->point_begin[j->vertex + 1]; n++) {
        const bw_tpoint *p = &m->point[c->point[n]];
        int inside = 0, on = 0;
        for (int k = 0; k < 3; k++) {
            inside |= (cell->low[k] < p->at[k] && p->at[k] < cell->high[k]) << k;
            on += p->at[k] == cell->low[k] || p->at[k] == cell->high[k];
        }
        if (p->block != cell->block || inside != j->inside || !on || on == 3) continue;
        if (on == 1 + !(inside & (inside - 1))) found = true;
        for (int axis = 0; axis < 3; axis++)
            if (inside == 1 << axis && edge_on(cell, axis, p->at) >= 0 && c->axes[j->cell][axis] >> edge_on(cell, axis, p->at) & 1)
                return fault(c, "T-joint", i, "it is on an extraordinary arc");
    }
    return found ? BW_OK : fault(c, "T-joint", i, "it is not on its cell");
}

bw_status bw_tmesh_check(bw_context *ctx, const bw_tmesh *mesh) {
    const bw_complex *x = mesh->atlas->complex;
    checker c = {.ctx = ctx, .mesh = mesh};
    c.axes = bw_alloc(ctx, mesh->cell_count, sizeof *c.axes);
    c.cells_at = bw_alloc(ctx, x->arc_count, sizeof *c.cells_at);
    bw_status status = ctx->error.status;
    for (bw_block b = 0; b < (bw_block)x->block_count && status == BW_OK; b++) status = check_block(&c, b);
    for (size_t i = 0; i < mesh->face_count && status == BW_OK; i++) status = check_face(&c, i);
    if (status == BW_OK) status = list_faces(&c);
    for (size_t i = 0; i < 6 * mesh->cell_count && status == BW_OK; i++) status = check_side(&c, i / 6, (int)(i % 6));
    if (status == BW_OK) status = check_tubes(&c);
    for (size_t i = 0; i < mesh->cell_count && status == BW_OK; i++) status = check_cell(&c, i);
    for (size_t i = 0; i < mesh->face_count && status == BW_OK; i++) status = check_joined(&c, i);
    for (size_t i = 0; i < mesh->face_count && status == BW_OK; i++) status = check_corners(&c, i);
    if (status == BW_OK) status = list_points(&c);
    for (size_t i = 0; i < mesh->joint_count && status == BW_OK; i++) status = check_joint(&c, i);
    bw_free(ctx, c.axes), bw_free(ctx, c.cells_at), bw_free(ctx, c.point_begin), bw_free(ctx, c.point);
    bw_free(ctx, c.face_begin), bw_free(ctx, c.face), bw_free(ctx, c.at);
    return status;
}
