#include "igm/overlay.h"

#include <math.h>
#include <string.h>

#include "exact/det.h"
#include "igm/overlay_points.h"
#include "igm/pieces.h"

enum { COARSEST = 24 /* bits of the first grid that is tried: files write its decimals out */ };

/* A part of a block on which the map is affine: image = (matrix x + offset) / whole. */
typedef struct {
    bw_cutter plane[4];
    int planes;
    mpz_t matrix[3][3], offset[3], whole;
} region;

/* A point of the closed box of a block, not yet glued to those of other blocks. */
typedef struct {
    int64_t image[3];
    double position[3];
    int32_t parent; /* union-find: the same vertex; the lowest is the root */
} place;

typedef struct {
    bw_context *ctx;
    const bw_blockwise *map;
    const bw_complex *x;
    const bw_cells *cells;
    uint64_t max_tets;
    int bits; /* images are multiples of 2^-bits */
    bw_patch *polygon_patch;
    size_t *block_begin; /* [block + 1]: its cells */
    bw_cell *block_cell;

    bw_block block; /* in hand, with its regions and points */
    region *region;
    size_t region_count, region_room;
    bw_exact_points inside, walls; /* by coordinates in the block; by patch and coordinates in its frame */

    bw_piece whole, work[2];
    int32_t *corner_of; /* [vertex of the complex]: in `whole` */
    int32_t *key, *ring, *at_place; /* of the loop in hand: what orders its corners; [corner of the piece] its place */
    uint8_t *straight;
    size_t key_room, ring_room, straight_room, at_room;
    int32_t (*triangle)[3]; /* of the faces of the piece in hand */
    size_t triangle_count, triangle_room;

    place *place;
    size_t place_count, place_room;
    int32_t (*tet)[4]; /* places */
    size_t tet_count, tet_room;
    int32_t *place_of_vertex; /* [vertex of the complex]: one of its places */
    int32_t (*feature)[3];
    size_t feature_count, feature_room;
    bw_overlay_report *report;
} overlay;

/* ---- regions ------------------------------------------------------------------------------------------------------- */

static void region_clear(region *r) {
    for (int i = 0; i < r->planes; i++) bw_cutter_clear(&r->plane[i]);
    for (int i = 0; i < 9; i++) mpz_clear(r->matrix[i / 3][i % 3]);
    mpz_clears(r->offset[0], r->offset[1], r->offset[2], r->whole, NULL);
}

static void clear_regions(overlay *o) {
    for (size_t i = 0; i < o->region_count; i++) region_clear(&o->region[i]);
    o->region_count = 0;
}

/* The affine map of a meta-tet: matrix = sum over its edges of image edge times dual of real edge. */
static void solve_affine(region *r, const bw_block_point c[4]) {
    int64_t e[3][3], image[3][3];
    mpz_t dual, t;
    mpz_inits(dual, t, r->offset[0], r->offset[1], r->offset[2], r->whole, NULL);
    for (int i = 0; i < 9; i++) mpz_init(r->matrix[i / 3][i % 3]);
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) e[i][k] = c[i + 1].real[k] - c[0].real[k], image[i][k] = c[i + 1].image[k] - c[0].image[k];
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) {
            const int64_t *p = e[(i + 1) % 3], *q = e[(i + 2) % 3];
            mpz_set_si(dual, p[(k + 1) % 3]), mpz_mul_si(dual, dual, q[(k + 2) % 3]);
            mpz_set_si(t, p[(k + 2) % 3]), mpz_mul_si(t, t, q[(k + 1) % 3]);
            mpz_sub(dual, dual, t);
            for (int a = 0; a < 3; a++) mpz_mul_si(t, dual, image[i][a]), mpz_add(r->matrix[a][k], r->matrix[a][k], t);
            if (i == 0) mpz_mul_si(t, dual, e[0][k]), mpz_add(r->whole, r->whole, t);
        }
    for (int a = 0; a < 3; a++) {
        mpz_mul_si(r->offset[a], r->whole, c[0].image[a]);
        for (int k = 0; k < 3; k++) mpz_mul_si(t, r->matrix[a][k], c[0].real[k]), mpz_sub(r->offset[a], r->offset[a], t);
    }
    mpz_clears(dual, t, NULL);
}

static size_t rim_size(const bw_blockwise *map, bw_patch p) { return map->rim_begin[p + 1] - map->rim_begin[p]; }

static bw_status new_region(overlay *o, const bw_block_point c[4], region **out) {
    bw_status status = bw_reserve(o->ctx, &o->region, &o->region_room, o->region_count + 1);
    if (status != BW_OK) return status;
    *out = &o->region[o->region_count++];
    (*out)->planes = 0;
    solve_affine(*out, c);
    return BW_OK;
}

static void bound(region *r, const bw_block_point *a, const bw_block_point *b, const bw_block_point *c, const bw_block_point *inside) {
    bw_cutter_init(&r->plane[r->planes++], a->real, b->real, c->real, inside->real);
}

/* On a patch without T-nodes the map is affine: one pyramid. */
static bw_status add_patch(overlay *o, bw_patch p, int slot) {
    bw_block_point c[4];
    bool turned, plain = rim_size(o->map, p) == 4;
    region *r = NULL;
    bw_status status = BW_OK;
    for (size_t k = 0; k < rim_size(o->map, p) && status == BW_OK; k++) {
        bw_blockwise_tet(o->map, p, slot, k, c, &turned);
        if (k == 0 || !plain) status = new_region(o, c, &r);
        if (status != BW_OK) break;
        bound(r, &c[0], &c[2], &c[3], &c[1]);
        if (plain) continue;
        bound(r, &c[0], &c[1], &c[2], &c[3]);
        bound(r, &c[0], &c[1], &c[3], &c[2]);
    }
    return status;
}

static bool is_plain(const overlay *o, bw_block b) {
    for (size_t s = 6 * (size_t)b; s < 6 * (size_t)b + 6; s++) {
        size_t begin = o->x->block_side_begin[s];
        if (o->x->block_side_begin[s + 1] != begin + 1 || rim_size(o->map, o->x->block_side[begin]) != 4) return false;
    }
    return true;
}

static bw_status list_regions(overlay *o) {
    clear_regions(o);
    bw_status status = BW_OK;
    if (is_plain(o, o->block)) {
        bw_patch p = o->x->block_side[o->x->block_side_begin[6 * (size_t)o->block]];
        bw_block_point c[4];
        bool turned;
        region *r;
        bw_blockwise_tet(o->map, p, o->x->patch_block[p][0] != o->block, 0, c, &turned);
        return new_region(o, c, &r);
    }
    for (size_t i = 0; i < 2 * o->x->patch_count && status == BW_OK; i++)
        if (o->x->patch_block[i / 2][i % 2] == o->block) status = add_patch(o, (bw_patch)(i / 2), (int)(i % 2));
    return status;
}

/* ---- places -------------------------------------------------------------------------------------------------------- */

/* To the nearest multiple of 2^-bits, halves to even: so that integral shifts and reversals of axes commute with it. */
static int64_t rounded(const overlay *o, mpq_t q) {
    mpz_t whole, rest;
    mpz_inits(whole, rest, NULL);
    mpq_mul_2exp(q, q, (mp_bitcnt_t)(o->bits - BW_IMAGE_BITS + 1));
    mpz_add(mpq_numref(q), mpq_numref(q), mpq_denref(q));
    mpz_mul_2exp(mpq_denref(q), mpq_denref(q), 1);
    mpz_fdiv_qr(whole, rest, mpq_numref(q), mpq_denref(q));
    int64_t out = mpz_get_si(whole);
    if (mpz_sgn(rest) == 0 && out % 2) out--;
    mpz_clears(whole, rest, NULL);
    return out;
}

static void map_corner(const overlay *o, const region *r, const bw_corner *c, int64_t image[3]) {
    mpq_t sum, t;
    mpq_inits(sum, t, NULL);
    for (int a = 0; a < 3; a++) {
        mpq_set_z(sum, r->offset[a]);
        for (int k = 0; k < 3; k++) mpq_set_z(t, r->matrix[a][k]), mpq_mul(t, t, c->x[k]), mpq_add(sum, sum, t);
        mpq_set_z(t, r->whole);
        mpq_div(sum, sum, t);
        image[a] = rounded(o, sum);
    }
    mpq_clears(sum, t, NULL);
}

/* Position of a point of a cell, by its weights in the cell's tet. */
static void position_of(const overlay *o, bw_cell cell, const double at[3], double out[3]) {
    bw_tet tet = bw_cells_tet(o->cells, cell);
    double c[4][3], w[4], sum = 0;
    for (int i = 0; i < 4; i++) {
        int64_t x[3];
        bw_transition_apply(bw_complex_chart(o->x, cell), o->cells->map->value[tet][i], x);
        for (int k = 0; k < 3; k++) c[i][k] = 2 * (double)x[k] - at[k];
    }
    w[0] = bw_det3_rounded(c[1], c[2], c[3]), w[1] = -bw_det3_rounded(c[0], c[2], c[3]), w[2] = bw_det3_rounded(c[0], c[1], c[3]), w[3] = -bw_det3_rounded(c[0], c[1], c[2]);
    for (int i = 0; i < 4; i++) sum += w[i] = fmax(w[i], 0);
    for (int k = 0; k < 3; k++) {
        out[k] = 0;
        for (int i = 0; i < 4; i++) out[k] += w[i] / sum * o->cells->mesh->position[o->cells->mesh->tet[tet][i]][k];
    }
}

static bw_status new_place(overlay *o, const region *r, bw_cell cell, const bw_corner *c, int32_t *out) {
    bw_status status = bw_reserve(o->ctx, &o->place, &o->place_room, o->place_count + 1);
    if (status != BW_OK) return status;
    if (o->place_count >= INT32_MAX - 1) return bw_fail(o->ctx, BW_E_LIMIT, "the refined mesh has too many vertices");
    place *p = &o->place[o->place_count];
    map_corner(o, r, c, p->image);
    if (c->vertex != BW_NONE) {
        bw_cells_position(o->cells, c->vertex, p->position);
        o->place_of_vertex[c->vertex] = (int32_t)o->place_count;
    } else {
        position_of(o, cell, c->at, p->position);
    }
    p->parent = *out = (int32_t)o->place_count++;
    return BW_OK;
}

static int32_t root_of(overlay *o, int32_t p) {
    while (o->place[p].parent != p) p = o->place[p].parent = o->place[o->place[p].parent].parent;
    return p;
}

static void glue(overlay *o, int32_t a, int32_t b) {
    a = root_of(o, a), b = root_of(o, b);
    if (a < b) o->place[b].parent = a;
    else o->place[a].parent = b;
}

static bw_status find_places(overlay *o, const region *r, bw_cell cell, const bw_piece *piece) {
    bw_status status = bw_reserve(o->ctx, &o->at_place, &o->at_room, piece->corner_count + 1);
    for (size_t i = 0; i < piece->corner_count && status == BW_OK; i++) {
        int32_t point;
        status = bw_exact_points_find(o->ctx, &o->inside, o->block, (const mpq_t *)piece->corner[i].x, &point);
        if (status != BW_OK) break;
        int32_t *item = &o->inside.point[point].item;
        if (*item == BW_NONE) status = new_place(o, r, cell, &piece->corner[i], item);
        o->at_place[i] = *item;
    }
    return status;
}

/* ---- faces --------------------------------------------------------------------------------------------------------- */

/* Coordinates of a corner in the frame of a patch; false if it is not on the patch. */
static bool to_frame(const overlay *o, bw_patch p, int slot, const bw_corner *c, mpq_t uv[3]) {
    const bw_transition *frame = &o->map->real[p][slot];
    for (int k = 0; k < 3; k++) {
        int8_t i = bw_rotation_image[frame->rotation][k];
        mpq_set_si(uv[k], -2 * frame->shift[i], 1);
        mpq_add(uv[k], uv[k], c->x[i]);
        if (bw_rotation_sign[frame->rotation][i] < 0) mpq_neg(uv[k], uv[k]);
        int64_t extent = k == 2 ? 0 : 2 * o->x->patch_extent[p][k];
        if (mpq_sgn(uv[k]) < 0 || mpq_cmp_si(uv[k], extent, 1) > 0) return false;
    }
    return true;
}

/* Keys of a face on a wall: points of its patch, which both sides share. They glue the places of the two sides. */
static bw_status wall_keys(overlay *o, const bw_piece *piece, const bw_piece_face *face) {
    bw_patch p = o->polygon_patch[face->tag];
    mpq_t uv[3];
    mpq_inits(uv[0], uv[1], uv[2], NULL);
    int slot = 0;
    for (; slot < 2; slot++) {
        bool on = o->x->patch_block[p][slot] == o->block;
        for (size_t i = 0; i < face->count && on; i++) on = to_frame(o, p, slot, &piece->corner[piece->loop[face->begin + i]], uv);
        if (on) break;
    }
    bw_status status = slot < 2 ? BW_OK : bw_fail(o->ctx, BW_E_CHECK, "a piece of a wall is not on patch %d", p);
    for (size_t i = 0; i < face->count && status == BW_OK; i++) {
        int32_t corner = piece->loop[face->begin + i];
        to_frame(o, p, slot, &piece->corner[corner], uv);
        status = bw_exact_points_find(o->ctx, &o->walls, p, (const mpq_t *)uv, &o->key[i]);
        if (status != BW_OK) break;
        int32_t *item = &o->walls.point[o->key[i]].item;
        if (*item == BW_NONE) *item = o->at_place[corner];
        glue(o, *item, o->at_place[corner]);
    }
    mpq_clears(uv[0], uv[1], uv[2], NULL);
    return status;
}

static bw_status add_triangle(overlay *o, int32_t a, int32_t b, int32_t c) {
    bw_status status = bw_reserve(o->ctx, &o->triangle, &o->triangle_room, o->triangle_count + 1);
    if (status != BW_OK) return status;
    int32_t *t = o->triangle[o->triangle_count++];
    t[0] = a, t[1] = b, t[2] = c;
    return BW_OK;
}

/* The place in the ring of the corner of lowest key that is not straight (whose neighbours are not, for a fan); -1. */
static int choose(const overlay *o, int n, bool fan) {
    int best = -1;
    for (int i = 0; i < n; i++) {
        bool good = fan ? !o->straight[(i + 1) % n] && !o->straight[(i + n - 1) % n] : !o->straight[i];
        if (good && (best < 0 || o->key[i] < o->key[best])) best = i;
    }
    return best;
}

/* Triangles of a face without flat ones, the same seen from both sides: a fan, after ears have been clipped until there is a corner for one. */
static bw_status triangulate(overlay *o, const bw_piece *piece, int n) {
    bw_status status = BW_OK;
    int fan, ear;
    for (int i = 0; i < n; i++)
        o->straight[i] = n > 3 && bw_corner_collinear(&piece->corner[o->ring[(i + n - 1) % n]], &piece->corner[o->ring[i]], &piece->corner[o->ring[(i + 1) % n]]);
    while ((fan = choose(o, n, true)) < 0 && status == BW_OK) {
        if ((ear = choose(o, n, false)) < 0 || n <= 3) return bw_fail(o->ctx, BW_E_CHECK, "a face of a piece is flat");
        status = add_triangle(o, o->ring[(ear + n - 1) % n], o->ring[ear], o->ring[(ear + 1) % n]);
        o->straight[(ear + 1) % n] = o->straight[(ear + n - 1) % n] = 0;
        size_t rest = (size_t)(n - 1 - ear);
        memmove(o->ring + ear, o->ring + ear + 1, rest * sizeof *o->ring);
        memmove(o->key + ear, o->key + ear + 1, rest * sizeof *o->key);
        memmove(o->straight + ear, o->straight + ear + 1, rest);
        n--;
    }
    for (int i = 1; i + 1 < n && status == BW_OK; i++) status = add_triangle(o, o->ring[fan], o->ring[(fan + i) % n], o->ring[(fan + i + 1) % n]);
    return status;
}

static bw_status add_face(overlay *o, bw_cell cell, const bw_piece *piece, const bw_piece_face *face) {
    bw_status status = bw_reserve(o->ctx, &o->key, &o->key_room, face->count);
    if (status == BW_OK) status = bw_reserve(o->ctx, &o->ring, &o->ring_room, face->count);
    if (status == BW_OK) status = bw_reserve(o->ctx, &o->straight, &o->straight_room, face->count);
    if (status != BW_OK) return status;
    const bw_cell_polygon *polygon = face->tag == BW_NONE ? NULL : &o->cells->polygon[face->tag];
    for (size_t i = 0; i < face->count; i++) {
        o->ring[i] = piece->loop[face->begin + i];
        o->key[i] = o->at_place[o->ring[i]];
    }
    if (polygon && polygon->flags & BW_WALL) status = wall_keys(o, piece, face);
    size_t first = o->triangle_count;
    if (status == BW_OK) status = triangulate(o, piece, (int)face->count);
    for (size_t i = first; polygon && polygon->flags & BW_FEATURE && polygon->cell[0] == cell && i < o->triangle_count && status == BW_OK; i++) {
        status = bw_reserve(o->ctx, &o->feature, &o->feature_room, o->feature_count + 1);
        for (int k = 0; k < 3 && status == BW_OK; k++) o->feature[o->feature_count][k] = o->at_place[o->triangle[i][k]];
        o->feature_count += status == BW_OK;
    }
    return status;
}

/* ---- pieces -------------------------------------------------------------------------------------------------------- */

static bw_status add_tet(overlay *o, const bw_piece *piece, int32_t apex, const int32_t triangle[3]) {
    const bw_corner *c = piece->corner;
    int sign = bw_corner_sign(&c[apex], &c[triangle[0]], &c[triangle[1]], &c[triangle[2]]);
    if (sign == 0) return bw_fail(o->ctx, BW_E_CHECK, "a piece of a cell has a flat tet");
    if (o->tet_count >= o->max_tets)
        return bw_fail(o->ctx, BW_E_LIMIT, "the block-wise map needs more than %llu tets", (unsigned long long)o->max_tets);
    bw_status status = bw_reserve(o->ctx, &o->tet, &o->tet_room, o->tet_count + 1);
    if (status != BW_OK) return status;
    int32_t *t = o->tet[o->tet_count++];
    t[0] = o->at_place[apex], t[1] = o->at_place[triangle[0]];
    t[2] = o->at_place[triangle[sign > 0 ? 1 : 2]], t[3] = o->at_place[triangle[sign > 0 ? 2 : 1]];
    return BW_OK;
}

/* A corner off the plane of a triangle: the farthest as doubles tell, unless that is in it. */
static int32_t off_plane(const bw_piece *piece, size_t corners, const int32_t t[3]) {
    double most = -1, e[3][3];
    int32_t best = 0;
    const bw_corner *c = piece->corner;
    for (size_t i = 0; i < corners; i++) {
        for (int k = 0; k < 3; k++)
            e[0][k] = c[t[1]].at[k] - c[t[0]].at[k], e[1][k] = c[t[2]].at[k] - c[t[0]].at[k], e[2][k] = c[i].at[k] - c[t[0]].at[k];
        double volume = fabs(bw_det3_rounded(e[0], e[1], e[2]));
        if (volume > most) most = volume, best = (int32_t)i;
    }
    for (size_t i = 0; bw_corner_sign(&c[t[0]], &c[t[1]], &c[t[2]], &c[best]) == 0 && i < corners; i++) best = (int32_t)i;
    return best;
}

static bool sees_all(const overlay *o, const bw_piece *piece, size_t corners, int32_t apex) {
    const bw_corner *c = piece->corner;
    for (size_t i = 0; i < o->triangle_count; i++) {
        const int32_t *t = o->triangle[i];
        int32_t off = off_plane(piece, corners, t);
        if (bw_corner_sign(&c[t[0]], &c[t[1]], &c[t[2]], &c[off]) != bw_corner_sign(&c[t[0]], &c[t[1]], &c[t[2]], &c[apex])) return false;
    }
    return true;
}

/* A point strictly inside: the mean of the corners on the grid, or else the exact mean of four that span the space. */
static bw_status add_apex(overlay *o, bw_piece *piece, int32_t *apex) {
    size_t corners = piece->corner_count;
    bw_status status = bw_piece_corner(o->ctx, piece, apex);
    if (status != BW_OK) return status;
    bw_corner *a = &piece->corner[*apex];
    for (int k = 0; k < 3; k++) {
        double mean = 0;
        for (size_t i = 0; i < corners; i++) mean += piece->corner[i].at[k] / (double)corners;
        mpq_set_si(a->x[k], (long)rint(mean), 1);
    }
    bw_corner_round(a);
    if (sees_all(o, piece, corners, *apex)) return BW_OK;
    int32_t span[4] = {o->triangle[0][0], o->triangle[0][1], o->triangle[0][2], off_plane(piece, corners, o->triangle[0])};
    mpq_t quarter;
    mpq_init(quarter);
    mpq_set_ui(quarter, 1, 4);
    for (int k = 0; k < 3; k++) {
        mpq_set_si(a->x[k], 0, 1);
        for (int i = 0; i < 4; i++) mpq_add(a->x[k], a->x[k], piece->corner[span[i]].x[k]);
        mpq_mul(a->x[k], a->x[k], quarter);
    }
    mpq_clear(quarter);
    bw_corner_round(a);
    return BW_OK;
}

static bw_status add_piece(overlay *o, const region *r, bw_cell cell, bw_piece *piece) {
    bw_status status = find_places(o, r, cell, piece);
    o->triangle_count = 0;
    for (size_t f = 0; f < piece->face_count && status == BW_OK; f++) status = add_face(o, cell, piece, &piece->face[f]);
    if (status != BW_OK) return status;
    if (o->triangle_count == 4) {
        int32_t apex = off_plane(piece, piece->corner_count, o->triangle[0]);
        return add_tet(o, piece, apex, o->triangle[0]);
    }
    int32_t apex;
    status = add_apex(o, piece, &apex);
    if (status == BW_OK) status = bw_reserve(o->ctx, &o->at_place, &o->at_room, piece->corner_count);
    if (status == BW_OK) status = new_place(o, r, cell, &piece->corner[apex], &o->at_place[apex]);
    for (size_t i = 0; i < o->triangle_count && status == BW_OK; i++) status = add_tet(o, piece, apex, o->triangle[i]);
    return status;
}

/* The cell as a piece, in the chart of its block. */
static bw_status take_cell(overlay *o, bw_cell cell, mpq_t at[3]) {
    const bw_cells *c = o->cells;
    const bw_transition *chart = bw_complex_chart(o->x, cell);
    bw_status status = BW_OK;
    bw_piece_empty(&o->whole);
    for (bw_polygon p = bw_cells_first_in_cell(c, cell); p != BW_NONE && status == BW_OK; p = bw_cells_next_in_cell(c, p, cell)) {
        bw_half head = c->polygon[p].half, h = head;
        do {
            bw_cvertex v = c->half[h].origin;
            int32_t corner = o->corner_of[v];
            h = c->half[h].next;
            if ((size_t)corner >= o->whole.corner_count || o->whole.corner[corner].vertex != v) {
                if ((status = bw_piece_corner(o->ctx, &o->whole, &corner)) != BW_OK) break;
                bw_corner *to = &o->whole.corner[corner];
                o->corner_of[v] = corner, to->vertex = v;
                bw_cells_parameter(c, v, bw_cells_tet(c, cell), at);
                for (int i = 0; i < 3; i++) {
                    mpq_set_si(to->x[i], chart->shift[i], 1);
                    if (bw_rotation_sign[chart->rotation][i] > 0) mpq_add(to->x[i], to->x[i], at[bw_rotation_axis[chart->rotation][i]]);
                    else mpq_sub(to->x[i], to->x[i], at[bw_rotation_axis[chart->rotation][i]]);
                    mpq_mul_2exp(to->x[i], to->x[i], 1);
                }
                bw_corner_round(to);
            }
            status = bw_piece_put(o->ctx, &o->whole, corner);
        } while (h != head && status == BW_OK);
        if (status == BW_OK) status = bw_piece_close(o->ctx, &o->whole, p);
    }
    return status;
}

/* Whether a plane has all corners on its outer side, or on it. */
static bool is_outside(const bw_piece *piece, const bw_cutter *plane) {
    for (size_t i = 0; i < piece->corner_count; i++)
        if (bw_cutter_side(plane, &piece->corner[i]) > 0) return false;
    return true;
}

static bw_status cut_cell(overlay *o, bw_cell cell) {
    size_t pieces = 0;
    bw_status status = BW_OK;
    for (size_t i = 0; i < o->region_count && status == BW_OK; i++) {
        const region *r = &o->region[i];
        bw_piece *piece = &o->whole;
        bool met = true;
        for (int k = 0; k < r->planes && met; k++) met = !is_outside(&o->whole, &r->plane[k]);
        for (int k = 0; k < r->planes && met && status == BW_OK; k++) {
            bw_piece *next = &o->work[piece == &o->work[0]];
            status = bw_piece_cut(o->ctx, piece, &r->plane[k], next);
            piece = next;
            met = piece->face_count > 0;
        }
        if (!met || status != BW_OK) continue;
        size_t corners = piece->corner_count;
        status = add_piece(o, r, cell, piece);
        piece->corner_count = corners; /* the whole cell may be needed again */
        pieces++;
    }
    if (status == BW_OK && pieces == 0) return bw_fail(o->ctx, BW_E_CHECK, "cell %d is in no meta-tet of its block", cell);
    o->report->cut_cells += pieces > 1;
    return status;
}

/* ---- blocks -------------------------------------------------------------------------------------------------------- */

static bw_status sort_cells(overlay *o) {
    size_t cells = o->cells->cell_count, blocks = o->x->block_count;
    o->block_begin = bw_alloc(o->ctx, blocks + 2, sizeof *o->block_begin);
    o->block_cell = bw_alloc(o->ctx, cells, sizeof *o->block_cell);
    o->polygon_patch = bw_alloc(o->ctx, o->cells->polygon_count, sizeof *o->polygon_patch);
    o->corner_of = bw_alloc(o->ctx, o->cells->vertex_count, sizeof *o->corner_of);
    o->place_of_vertex = bw_alloc(o->ctx, o->cells->vertex_count, sizeof *o->place_of_vertex);
    if (o->ctx->error.status != BW_OK) return o->ctx->error.status;
    for (size_t c = 0; c < cells; c++) o->block_begin[o->x->cell_block[c] + 2]++;
    for (size_t b = 2; b < blocks + 2; b++) o->block_begin[b] += o->block_begin[b - 1];
    for (size_t c = 0; c < cells; c++) o->block_cell[o->block_begin[o->x->cell_block[c] + 1]++] = (bw_cell)c;
    for (size_t p = 0; p < o->x->patch_count; p++)
        for (size_t i = o->x->patch_polygon_begin[p]; i < o->x->patch_polygon_begin[p + 1]; i++) o->polygon_patch[o->x->patch_polygon[i]] = (bw_patch)p;
    for (size_t v = 0; v < o->cells->vertex_count; v++) o->place_of_vertex[v] = BW_NONE;
    return BW_OK;
}

static bw_status cut_blocks(overlay *o) {
    mpq_t at[3];
    mpq_inits(at[0], at[1], at[2], NULL);
    bw_status status = sort_cells(o);
    for (o->block = 0; (size_t)o->block < o->x->block_count && status == BW_OK; o->block++) {
        bw_exact_points_empty(&o->inside);
        status = list_regions(o);
        for (size_t i = o->block_begin[o->block]; i < o->block_begin[o->block + 1] && status == BW_OK; i++) {
            status = take_cell(o, o->block_cell[i], at);
            if (status == BW_OK) status = cut_cell(o, o->block_cell[i]);
            if (status == BW_OK && i % 64 == 0) status = bw_poll(o->ctx);
        }
    }
    mpq_clears(at[0], at[1], at[2], NULL);
    clear_regions(o);
    return status;
}

/* ---- the map ------------------------------------------------------------------------------------------------------- */

static bw_status number_vertices(overlay *o, int32_t *number, bw_tet_mesh *mesh) {
    for (size_t i = 0; i < o->place_count; i++) {
        int32_t root = root_of(o, (int32_t)i);
        number[i] = root == (int32_t)i ? (int32_t)mesh->vertex_count++ : number[root];
    }
    mesh->position = bw_alloc(o->ctx, mesh->vertex_count, sizeof *mesh->position);
    mesh->tet = bw_alloc(o->ctx, o->tet_count, sizeof *mesh->tet);
    if (o->ctx->error.status != BW_OK) return o->ctx->error.status;
    for (size_t i = 0; i < o->place_count; i++)
        if (o->place[i].parent == (int32_t)i) memcpy(mesh->position[number[i]], o->place[i].position, sizeof *mesh->position);
    mesh->tet_count = o->tet_count;
    for (size_t t = 0; t < o->tet_count; t++)
        for (int k = 0; k < 4; k++) mesh->tet[t][k] = number[o->tet[t][k]];
    return BW_OK;
}

/* Features: vertices and edges are those of the complex, for no meta-facet cuts an arc; facets are triangles of pieces. */
static bw_status carry_features(overlay *o, const int32_t *number, bw_tet_mesh *mesh) {
    const bw_tet_mesh *from = o->cells->mesh;
    const bw_cells *c = o->cells;
    size_t edges = 0;
    for (size_t e = 0; e < c->edge_count; e++) edges += bw_cells_edge_is_leaf(c, (bw_cedge)e) && bw_cells_edge_is_feature(c, (bw_cedge)e);
    mesh->feature_vertex = bw_alloc(o->ctx, from->feature_vertex_count, sizeof *mesh->feature_vertex);
    mesh->feature_edge = bw_alloc(o->ctx, edges, sizeof *mesh->feature_edge);
    mesh->feature_facet = bw_alloc(o->ctx, o->feature_count, sizeof *mesh->feature_facet);
    if (o->ctx->error.status != BW_OK) return o->ctx->error.status;
    for (size_t i = 0; i < from->feature_vertex_count; i++) {
        int32_t p = o->place_of_vertex[from->feature_vertex[i]];
        if (p != BW_NONE) mesh->feature_vertex[mesh->feature_vertex_count++] = number[p];
    }
    for (size_t e = 0; e < c->edge_count; e++) {
        if (!bw_cells_edge_is_leaf(c, (bw_cedge)e) || !bw_cells_edge_is_feature(c, (bw_cedge)e)) continue;
        for (int i = 0; i < 2; i++) mesh->feature_edge[mesh->feature_edge_count][i] = number[o->place_of_vertex[c->edge[e].vertex[i]]];
        mesh->feature_edge_count++;
    }
    for (size_t i = 0; i < o->feature_count; i++)
        for (int k = 0; k < 3; k++) mesh->feature_facet[i][k] = number[o->feature[i][k]];
    mesh->feature_facet_count = o->feature_count;
    return BW_OK;
}

/* x / 2^shift to the nearest integer, halves to even. */
static int64_t shifted(int64_t x, int shift) {
    int64_t whole = x >> shift, twice = shift ? (x & (((int64_t)1 << shift) - 1)) << 1 : 0, one = (int64_t)1 << shift;
    return whole + (shift && (twice > one || (twice == one && whole & 1)));
}

/* Values on a grid of 2^-bits; counts the tets that this leaves flat. */
static void round_values(overlay *o, int bits, bw_igm *out) {
    const bw_tet_mesh *mesh = &out->mesh;
    o->report->flat = 0;
    out->map.exponent = bits;
    for (size_t t = 0; t < mesh->tet_count; t++) {
        for (int i = 0; i < 4; i++)
            for (int k = 0; k < 3; k++) out->map.value[t][i][k] = shifted(o->place[o->tet[mesh->tet_id[t]][i]].image[k], o->bits - bits);
        o->report->flat += bw_grid_tet_sign((const int64_t(*)[3])out->map.value[t]) <= 0;
    }
}

static bw_status make_map(overlay *o, bw_igm *out) {
    bw_tet_mesh *mesh = &out->mesh;
    int32_t *number = bw_alloc(o->ctx, o->place_count, sizeof *number);
    bw_status status = number ? number_vertices(o, number, mesh) : o->ctx->error.status;
    if (status == BW_OK) status = carry_features(o, number, mesh);
    bw_free(o->ctx, number);
    mesh->mirrored = o->cells->mesh->mirrored;
    if (status == BW_OK) status = bw_tet_mesh_connect(o->ctx, mesh);
    if (status != BW_OK) return status;
    out->map.value = bw_alloc(o->ctx, mesh->tet_count, sizeof *out->map.value);
    if (!out->map.value) return o->ctx->error.status;
    for (int bits = o->bits < COARSEST ? o->bits : COARSEST;; bits = bits + 8 < o->bits ? bits + 8 : o->bits) {
        round_values(o, bits, out);
        if (o->report->flat == 0 || bits == o->bits) break;
    }
    if (o->report->flat)
        return bw_fail(o->ctx, BW_E_RANGE, "%llu of %zu tets of the refined block-wise map are thinner than the grid", (unsigned long long)o->report->flat,
                       mesh->tet_count);
    return bw_grid_map_derive(o->ctx, mesh, &out->map);
}

/* The finest grid on which the coordinates of every block, and differences to those beside it, are in range. */
static int finest(const bw_atlas *atlas) {
    int64_t most = 1;
    int bits = 40;
    for (size_t i = 0; i < 3 * atlas->complex->block_count; i++)
        if (atlas->extent[i / 3][i % 3] > most) most = atlas->extent[i / 3][i % 3];
    while (bits > BW_IMAGE_BITS && most > BW_GRID_MAX >> bits) bits--;
    return bits;
}

bw_status bw_overlay(bw_context *ctx, const bw_blockwise *map, bw_cells *cells, uint64_t max_tets, bw_igm *out, bw_overlay_report *report) {
    overlay o = {.ctx = ctx, .map = map, .x = map->atlas->complex, .cells = cells, .report = report, .bits = finest(map->atlas), .max_tets = max_tets};
    *report = (bw_overlay_report){0};
    memset(out, 0, sizeof *out);
    bw_status status = cells == map->atlas->cells ? bw_cells_open_all(ctx, cells) : bw_fail(ctx, BW_E_INTERNAL, "the map belongs to other cells");
    if (status == BW_OK) status = cut_blocks(&o);
    report->tets = o.tet_count;
    bw_exact_points_clear(ctx, &o.inside), bw_exact_points_clear(ctx, &o.walls);
    if (status == BW_OK) status = make_map(&o, out);
    bw_piece_clear(ctx, &o.whole), bw_piece_clear(ctx, &o.work[0]), bw_piece_clear(ctx, &o.work[1]);
    void *scratch[] = {o.polygon_patch, o.block_begin, o.block_cell, o.region, o.corner_of, o.key, o.ring, o.at_place, o.straight, o.triangle,
                       o.place, o.tet, o.place_of_vertex, o.feature};
    for (size_t i = 0; i < sizeof scratch / sizeof *scratch; i++) bw_free(ctx, scratch[i]);
    if (status != BW_OK) bw_igm_clear(ctx, out);
    return status;
}
