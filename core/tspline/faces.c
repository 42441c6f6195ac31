/* Faces of the T-mesh: what cells share within a block, across patches, and with the outside. */
#include <string.h>

#include "tspline/parts.h"

typedef struct {
    bw_context *ctx;
    bw_tmesh *mesh;
    size_t room;
} face_list;

/* The rectangle that two boxes have in common. False if it has no area. */
static bool meet(const int64_t a[2][3], const int64_t b[2][3], int64_t out[2][3]) {
    int wide = 0;
    for (int k = 0; k < 3; k++) {
        out[0][k] = a[0][k] > b[0][k] ? a[0][k] : b[0][k];
        out[1][k] = a[1][k] < b[1][k] ? a[1][k] : b[1][k];
        if (out[0][k] > out[1][k]) return false;
        wide += out[0][k] < out[1][k];
    }
    return wide == 2;
}

static void side_of(const bw_tcell *cell, int side, int64_t out[2][3]) {
    memcpy(out[0], cell->low, sizeof cell->low), memcpy(out[1], cell->high, sizeof cell->high);
    out[!(side & 1)][side >> 1] = out[side & 1][side >> 1];
}

static bw_status add_face(face_list *f, const int64_t box[2][3], size_t a, int side_a, int32_t b, int side_b, bw_patch patch) {
    bw_tmesh *mesh = f->mesh;
    bw_status status = bw_reserve(f->ctx, &mesh->face, &f->room, mesh->face_count + 1);
    if (status != BW_OK) return status;
    bw_tface *face = &mesh->face[mesh->face_count++];
    *face = (bw_tface){.cell = {(int32_t)a, b}, .side = {(uint8_t)side_a, (uint8_t)side_b}, .patch = patch};
    memcpy(face->low, box[0], sizeof face->low), memcpy(face->high, box[1], sizeof face->high);
    return BW_OK;
}

static bw_status join_in_block(face_list *f, bw_block block) {
    const bw_tmesh *mesh = f->mesh;
    bw_status status = BW_OK;
    for (size_t a = mesh->cell_begin[block]; a < mesh->cell_begin[block + 1]; a++)
        for (size_t b = a + 1; b < mesh->cell_begin[block + 1] && mesh->cell[b].low[0] <= mesh->cell[a].high[0] && status == BW_OK; b++)
            for (int side = 0; side < 6 && status == BW_OK; side++) {
                int64_t box[3][2][3];
                side_of(&mesh->cell[a], side, box[0]), side_of(&mesh->cell[b], side ^ 1, box[1]);
                if (meet((const int64_t(*)[3])box[0], (const int64_t(*)[3])box[1], box[2]))
                    status = add_face(f, (const int64_t(*)[3])box[2], a, side, (int32_t)b, side ^ 1, BW_NONE);
            }
    return status == BW_OK ? bw_poll(f->ctx) : status;
}

/* A box carried along a transition. */
static void carry(const bw_transition *t, const int64_t from[2][3], int64_t out[2][3]) {
    int64_t end[2][3];
    for (int e = 0; e < 2; e++) bw_transition_apply(t, from[e], end[e]);
    for (int k = 0; k < 3; k++) {
        bool turned = end[0][k] > end[1][k];
        out[0][k] = end[turned][k], out[1][k] = end[!turned][k];
    }
}

/* The cells beyond a patch that share something of a rectangle in the chart of its first block. */
static bw_status join_beyond(face_list *f, bw_patch patch, size_t a, const int64_t box[2][3]) {
    const bw_tmesh *mesh = f->mesh;
    const bw_complex *x = mesh->atlas->complex;
    bw_block block = x->patch_block[patch][1];
    int side[2] = {x->patch_side[patch][0], x->patch_side[patch][1]};
    bw_transition out = bw_tmesh_out(mesh->atlas, patch, 0), back = bw_transition_inverse(&out);
    int64_t beyond[2][3], there[2][3], common[2][3];
    bw_status status = BW_OK;
    carry(&out, box, beyond);
    for (size_t b = mesh->cell_begin[block]; b < mesh->cell_begin[block + 1] && status == BW_OK; b++) {
        side_of(&mesh->cell[b], side[1], there);
        if (!meet((const int64_t(*)[3])beyond, (const int64_t(*)[3])there, common)) continue;
        carry(&back, (const int64_t(*)[3])common, common);
        status = add_face(f, (const int64_t(*)[3])common, a, side[0], (int32_t)b, side[1], patch);
    }
    return status;
}

static bw_status join_at_patch(face_list *f, bw_patch patch) {
    const bw_tmesh *mesh = f->mesh;
    const bw_complex *x = mesh->atlas->complex;
    const bw_box *rectangle = &mesh->atlas->box[patch][0];
    bw_block block = x->patch_block[patch][0];
    int side = x->patch_side[patch][0];
    int64_t whole[2][3], own[2][3], box[2][3];
    bw_status status = BW_OK;
    for (int k = 0; k < 3; k++) whole[0][k] = BW_TMESH_UNIT * rectangle->low[k].q, whole[1][k] = BW_TMESH_UNIT * rectangle->high[k].q;
    for (size_t a = mesh->cell_begin[block]; a < mesh->cell_begin[block + 1] && status == BW_OK; a++) {
        side_of(&mesh->cell[a], side, own);
        if (!meet((const int64_t(*)[3])own, (const int64_t(*)[3])whole, box)) continue;
        status = x->patch_block[patch][1] == BW_NONE ? add_face(f, (const int64_t(*)[3])box, a, side, BW_NONE, 0, patch)
                                                     : join_beyond(f, patch, a, (const int64_t(*)[3])box);
    }
    return status == BW_OK ? bw_poll(f->ctx) : status;
}

bw_status bw_tmesh_join(bw_context *ctx, bw_tmesh *mesh) {
    const bw_complex *x = mesh->atlas->complex;
    face_list f = {.ctx = ctx, .mesh = mesh};
    bw_status status = BW_OK;
    for (bw_block b = 0; b < (bw_block)x->block_count && status == BW_OK; b++) status = join_in_block(&f, b);
    for (bw_patch p = 0; p < (bw_patch)x->patch_count && status == BW_OK; p++) status = join_at_patch(&f, p);
    return status;
}
