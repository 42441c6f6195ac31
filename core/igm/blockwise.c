#include "igm/blockwise.h"

#include <gmp.h>
#include <math.h>
#include <string.h>

#include "exact/det.h"

#define UNIT ((int64_t)1 << BW_IMAGE_BITS)
#define LONGEST ((int64_t)1 << 30) /* an extent, so that coordinates of images stay below 2^46 */

void bw_blockwise_clear(bw_context *ctx, bw_blockwise *map) {
    void *blocks[] = {map->real, map->image, map->rim_begin, map->rim, map->patch_centre, map->block_centre, map->tile_begin, map->tile};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
    memset(map, 0, sizeof *map);
}

static size_t rim_size(const bw_blockwise *map, bw_patch p) { return map->rim_begin[p + 1] - map->rim_begin[p]; }

/* ---- frames of patches --------------------------------------------------------------------------------------------- */

/* The rotation that takes axes 0, 1 of a patch's frame to the axes after the normal. */
static bw_rotation frame_rotation(int normal) {
    for (int r = 0; r < BW_ROTATIONS; r++) {
        const int8_t *axis = bw_rotation_axis[r], *sign = bw_rotation_sign[r];
        if (axis[(normal + 1) % 3] == 0 && axis[(normal + 2) % 3] == 1 && axis[normal] == 2 && sign[0] + sign[1] + sign[2] == 3) return (bw_rotation)r;
    }
    return 0; /* not reached: they are the even permutations */
}

static bw_status place_frames(bw_context *ctx, bw_blockwise *map) {
    const bw_atlas *atlas = map->atlas;
    const bw_complex *x = atlas->complex;
    for (bw_patch p = 0; p < (bw_patch)x->patch_count; p++) {
        bw_transition *real = map->real[p], *image = map->image[p];
        int32_t low = bw_atlas_find(atlas, x->patch_block[p][0], x->patch_low[p]);
        if (low == BW_NONE) return bw_fail(ctx, BW_E_CHECK, "the low corner of patch %d has no place", p);
        real[0].rotation = image[0].rotation = frame_rotation(x->patch_side[p][0] >> 1);
        for (int k = 0; k < 3; k++) real[0].shift[k] = x->patch_low[p][k], image[0].shift[k] = atlas->place[low].at[k].q;
        if (x->patch_block[p][1] == BW_NONE) continue;
        real[1] = bw_transition_compose(&atlas->across[p], &real[0]);
        image[1] = bw_transition_compose(&atlas->integer[p], &image[0]);
    }
    return BW_OK;
}

/* A point of a patch in the charts of one of its blocks. */
static bw_block_point in_block(const bw_blockwise *map, bw_patch p, int slot, const bw_patch_point *at) {
    bw_transition real = map->real[p][slot], image = map->image[p][slot];
    bw_block_point out = {{at->real[0], at->real[1], 0}, {at->image[0], at->image[1], 0}};
    for (int k = 0; k < 3; k++) real.shift[k] *= 2, image.shift[k] *= UNIT;
    bw_transition_apply(&real, out.real, out.real);
    bw_transition_apply(&image, out.image, out.image);
    return out;
}

/* ---- rims and centres of patches ----------------------------------------------------------------------------------- */

static void list_rim(bw_blockwise *map, bw_patch p, size_t *at) {
    const bw_complex *x = map->atlas->complex;
    bw_patch_point here = {{0, 0}, {0, 0}};
    for (size_t side = 0; side < 4; side++) {
        int axis = (int)(side & 1), sign = side < 2 ? 1 : -1;
        for (size_t i = x->patch_chain_begin[4 * (size_t)p + side]; i < x->patch_chain_begin[4 * (size_t)p + side + 1]; i++) {
            bw_arc a = x->patch_chain[i] >> 1;
            map->rim[(*at)++] = here;
            here.real[axis] += 2 * sign * x->arc_length[a];
            here.image[axis] += sign * UNIT * map->atlas->length[a];
        }
    }
}

/* The largest coordinates: where the rim turns around. */
static bw_patch_point far_corner(const bw_blockwise *map, bw_patch p) {
    bw_patch_point far = {{0, 0}, {0, 0}};
    for (size_t i = map->rim_begin[p]; i < map->rim_begin[p + 1]; i++)
        for (int k = 0; k < 2; k++)
            if (map->rim[i].real[k] > far.real[k]) far.real[k] = map->rim[i].real[k], far.image[k] = map->rim[i].image[k];
    return far;
}

/* Image along `axis` of the middle of the side on which the other coordinate is `across`. */
static double middle_of_side(const bw_blockwise *map, bw_patch p, int axis, int64_t middle, int64_t across) {
    size_t n = rim_size(map, p);
    const bw_patch_point *rim = &map->rim[map->rim_begin[p]];
    for (size_t i = 0; i < n; i++) {
        const bw_patch_point *a = &rim[i], *b = &rim[(i + 1) % n];
        if (a->real[!axis] != across || b->real[!axis] != across) continue;
        if (a->real[axis] > b->real[axis]) a = b, b = &rim[i];
        if (middle < a->real[axis] || middle > b->real[axis]) continue;
        double s = (double)(middle - a->real[axis]) / (double)(b->real[axis] - a->real[axis]);
        return (double)a->image[axis] + s * (double)(b->image[axis] - a->image[axis]);
    }
    return 0; /* not reached: sides are covered by the rim */
}

static int64_t strictly_between(double x, int64_t high) {
    int64_t whole = (int64_t)rint(x);
    return whole < 1 ? 1 : whole > high - 1 ? high - 1 : whole;
}

static void place_patch_centre(bw_blockwise *map, bw_patch p) {
    bw_patch_point far = far_corner(map, p), *c = &map->patch_centre[p];
    for (int k = 0; k < 2; k++) c->real[k] = far.real[k] / 2;
    for (int k = 0; k < 2; k++) {
        double low = middle_of_side(map, p, k, c->real[k], 0), high = middle_of_side(map, p, k, c->real[k], far.real[!k]);
        c->image[k] = strictly_between(0.5 * (low + high), far.image[k]);
    }
}

/* ---- the star of a patch ------------------------------------------------------------------------------------------- */

static double cross(const double a[2], const double b[2], const double c[2]) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

static void as_doubles(const int64_t *x, int n, double *out) {
    for (int k = 0; k < n; k++) out[k] = (double)x[k];
}

/* Carries a point of a patch along its star, from images to the map or the other way. The triangle that holds it, or nearly does, decides. */
static void along_star(const bw_blockwise *map, bw_patch p, bool back, const double x[2], double out[2]) {
    size_t n = rim_size(map, p);
    const bw_patch_point *rim = &map->rim[map->rim_begin[p]], *centre = &map->patch_centre[p];
    double best = -INFINITY, a[2], b[2], c[2], at[2] = {x[0], x[1]};
    as_doubles(back ? centre->image : centre->real, 2, c);
    for (size_t i = 0; i < n && best < 0; i++) {
        const bw_patch_point *from = &rim[i], *to = &rim[(i + 1) % n];
        as_doubles(back ? from->image : from->real, 2, a), as_doubles(back ? to->image : to->real, 2, b);
        double whole = cross(c, a, b), wa = cross(c, at, b) / whole, wb = cross(c, a, at) / whole;
        double least = fmin(fmin(wa, wb), 1 - wa - wb);
        if (least <= best) continue;
        best = least;
        as_doubles(back ? from->real : from->image, 2, a), as_doubles(back ? to->real : to->image, 2, b);
        for (int k = 0; k < 2; k++) {
            double m = (double)(back ? centre->real[k] : centre->image[k]);
            out[k] = m + wa * (a[k] - m) + wb * (b[k] - m);
        }
    }
}

void bw_blockwise_back_on_patch(const bw_blockwise *map, bw_patch patch, const double q[2], double p[2]) {
    along_star(map, patch, true, (double[2]){q[0] * (double)UNIT, q[1] * (double)UNIT}, p);
    p[0] *= 0.5, p[1] *= 0.5;
}

/* ---- centres of blocks --------------------------------------------------------------------------------------------- */

/* Point x of a chart in the frame of a patch, both in a unit that is 1 / scale of the frame's. */
static void to_frame(const bw_transition *frame, double scale, const double x[3], double out[2]) {
    for (int k = 0; k < 2; k++) {
        int8_t i = bw_rotation_image[frame->rotation][k];
        out[k] = bw_rotation_sign[frame->rotation][i] * (x[i] - scale * (double)frame->shift[i]);
    }
}

static void from_frame(const bw_transition *frame, double scale, const double x[2], double out[3]) {
    for (int i = 0; i < 3; i++) {
        int8_t k = bw_rotation_axis[frame->rotation][i];
        out[i] = scale * (double)frame->shift[i] + (k < 2 ? bw_rotation_sign[frame->rotation][i] * x[k] : 0);
    }
}

/* Image of the middle of a side. */
static bw_status middle_of_block_side(bw_context *ctx, const bw_blockwise *map, bw_block b, int side, double out[3]) {
    const bw_complex *x = map->atlas->complex;
    int64_t middle[3];
    for (int k = 0; k < 3; k++) middle[k] = x->block_extent[b][k];
    middle[side >> 1] *= side & 1 ? 2 : 0;
    for (size_t i = x->block_side_begin[6 * (size_t)b + (size_t)side]; i < x->block_side_begin[6 * (size_t)b + (size_t)side + 1]; i++) {
        bw_patch p = x->block_side[i];
        for (int slot = 0; slot < 2; slot++) {
            if (x->patch_block[p][slot] != b || x->patch_side[p][slot] != side) continue;
            const bw_transition *frame = &map->real[p][slot];
            double at[3] = {(double)middle[0], (double)middle[1], (double)middle[2]}, uv[2];
            bw_patch_point far = far_corner(map, p);
            to_frame(frame, 2, at, uv);
            if (uv[0] < 0 || uv[1] < 0 || uv[0] > (double)far.real[0] || uv[1] > (double)far.real[1]) continue;
            along_star(map, p, false, uv, uv);
            from_frame(&map->image[p][slot], (double)UNIT, uv, out);
            return BW_OK;
        }
    }
    return bw_fail(ctx, BW_E_CHECK, "the middle of side %d of block %d is in no patch", side, b);
}

/* Along each axis the mean of the images of the middles of the four sides around it. */
static bw_status place_block_centre(bw_context *ctx, bw_blockwise *map, bw_block b) {
    double sum[3] = {0, 0, 0}, at[3];
    for (int side = 0; side < 6; side++) {
        bw_status status = middle_of_block_side(ctx, map, b, side, at);
        if (status != BW_OK) return status;
        for (int k = 0; k < 3; k++) sum[k] += k == side >> 1 ? 0 : at[k];
    }
    bw_block_point *c = &map->block_centre[b];
    for (int k = 0; k < 3; k++) {
        c->real[k] = map->atlas->complex->block_extent[b][k];
        c->image[k] = strictly_between(0.25 * sum[k], UNIT * map->atlas->extent[b][k]);
    }
    return BW_OK;
}

void bw_blockwise_back(const bw_blockwise *map, bw_block block, const double q[3], double p[3]) {
    const bw_block_point *centre = &map->block_centre[block];
    double c[3], d[3], at[3], uv[2], s = 0;
    int side = 0;
    for (int k = 0; k < 3; k++) {
        c[k] = (double)centre->image[k] / (double)UNIT;
        d[k] = q[k] - c[k];
        double reach = d[k] > 0 ? d[k] / ((double)map->atlas->extent[block][k] - c[k]) : -d[k] / c[k];
        if (reach > s) s = reach, side = 2 * k + (d[k] > 0);
    }
    for (int k = 0; k < 3; k++) p[k] = 0.5 * (double)centre->real[k];
    if (s == 0) return; /* the centre itself */
    const int64_t *n = map->atlas->extent[block];
    for (int k = 0; k < 3; k++) at[k] = fmin(fmax(c[k] + d[k] / s, 0), (double)n[k]); /* where the ray from the centre leaves the box */
    at[side >> 1] = side & 1 ? (double)n[side >> 1] : 0;
    int u = (side / 2 + 1) % 3, v = (side / 2 + 2) % 3;
    int64_t square[2] = {(int64_t)fmin(at[u], (double)n[u] - 1), (int64_t)fmin(at[v], (double)n[v] - 1)};
    int32_t use = map->tile[map->tile_begin[6 * (size_t)block + (size_t)side] + (size_t)(square[0] + n[u] * square[1])];
    to_frame(&map->image[use >> 1][use & 1], 1, at, uv);
    bw_blockwise_back_on_patch(map, use >> 1, uv, uv);
    from_frame(&map->real[use >> 1][use & 1], 1, uv, at);
    for (int k = 0; k < 3; k++) p[k] += s * (at[k] - p[k]);
}

/* ---- tiles --------------------------------------------------------------------------------------------------------- */

static bw_status lay_tiles(bw_context *ctx, bw_blockwise *map, bw_patch p, int slot) {
    const bw_complex *x = map->atlas->complex;
    bw_block b = x->patch_block[p][slot];
    int side = x->patch_side[p][slot], axis[2] = {(side / 2 + 1) % 3, (side / 2 + 2) % 3};
    const int64_t *n = map->atlas->extent[b];
    bw_patch_point far = far_corner(map, p);
    bw_block_point corner[2] = {in_block(map, p, slot, &(bw_patch_point){{0, 0}, {0, 0}}), in_block(map, p, slot, &far)};
    int64_t low[2], high[2], normal = corner[0].image[side >> 1];
    if (normal != corner[1].image[side >> 1] || normal != (side & 1 ? UNIT * n[side >> 1] : 0))
        return bw_fail(ctx, BW_E_CHECK, "patch %d does not lie in a side of block %d", p, b);
    for (int i = 0; i < 2; i++) {
        int64_t a = corner[0].image[axis[i]] / UNIT, c = corner[1].image[axis[i]] / UNIT;
        low[i] = a < c ? a : c, high[i] = a < c ? c : a;
        if (low[i] < 0 || high[i] > n[axis[i]]) return bw_fail(ctx, BW_E_CHECK, "patch %d leaves a side of block %d", p, b);
    }
    int32_t *tile = &map->tile[map->tile_begin[6 * (size_t)b + (size_t)side]];
    for (int64_t j = low[1]; j < high[1]; j++)
        for (int64_t i = low[0]; i < high[0]; i++) {
            int32_t *t = &tile[i + n[axis[0]] * j];
            if (*t != BW_NONE) return bw_fail(ctx, BW_E_CHECK, "patches %d and %d overlap in a side of block %d", *t >> 1, p, b);
            *t = 2 * p + slot;
        }
    return bw_poll(ctx);
}

static bw_status tile_sides(bw_context *ctx, bw_blockwise *map) {
    const bw_complex *x = map->atlas->complex;
    size_t total = 0;
    for (size_t k = 0; k < 6 * x->block_count; k++) {
        const int64_t *n = map->atlas->extent[k / 6];
        map->tile_begin[k] = total;
        if (__builtin_add_overflow(total, (size_t)n[(k % 6 / 2 + 1) % 3] * (size_t)n[(k % 6 / 2 + 2) % 3], &total))
            return bw_fail(ctx, BW_E_LIMIT, "the sides of the integer boxes are too large");
    }
    map->tile_begin[6 * x->block_count] = total;
    if (!(map->tile = bw_alloc(ctx, total, sizeof *map->tile))) return ctx->error.status;
    for (size_t i = 0; i < total; i++) map->tile[i] = BW_NONE;
    bw_status status = BW_OK;
    for (size_t i = 0; i < 2 * x->patch_count && status == BW_OK; i++)
        if (x->patch_block[i / 2][i % 2] != BW_NONE) status = lay_tiles(ctx, map, (bw_patch)(i / 2), (int)(i % 2));
    for (size_t i = 0; i < total && status == BW_OK; i++)
        if (map->tile[i] == BW_NONE) status = bw_fail(ctx, BW_E_CHECK, "a side of an integer box is not covered by patches");
    return status;
}

/* ---- everything ---------------------------------------------------------------------------------------------------- */

static bw_status check_lengths(bw_context *ctx, const bw_atlas *atlas) {
    for (size_t a = 0; a < atlas->complex->arc_count; a++)
        if (atlas->length[a] < 1) return bw_fail(ctx, BW_E_USAGE, "arc %zu has the length %lld: the block-wise map needs positive ones", a,
                                                 (long long)atlas->length[a]);
    for (size_t i = 0; i < 3 * atlas->complex->block_count; i++)
        if (atlas->extent[i / 3][i % 3] > LONGEST) return bw_fail(ctx, BW_E_RANGE, "block %zu is more than 2^30 hexes long", i / 3);
    return BW_OK;
}

bw_status bw_blockwise_init(bw_context *ctx, const bw_atlas *atlas, bw_blockwise *map) {
    const bw_complex *x = atlas->complex;
    *map = (bw_blockwise){.atlas = atlas};
    bw_status status = check_lengths(ctx, atlas);
    if (status != BW_OK) return status;
    size_t rims = x->patch_chain_begin[4 * x->patch_count], at = 0;
    map->real = bw_alloc(ctx, x->patch_count, sizeof *map->real);
    map->image = bw_alloc(ctx, x->patch_count, sizeof *map->image);
    map->rim_begin = bw_alloc(ctx, x->patch_count + 1, sizeof *map->rim_begin);
    map->rim = bw_alloc(ctx, rims, sizeof *map->rim);
    map->patch_centre = bw_alloc(ctx, x->patch_count, sizeof *map->patch_centre);
    map->block_centre = bw_alloc(ctx, x->block_count, sizeof *map->block_centre);
    map->tile_begin = bw_alloc(ctx, 6 * x->block_count + 1, sizeof *map->tile_begin);
    status = ctx->error.status;
    if (status == BW_OK) status = place_frames(ctx, map);
    for (bw_patch p = 0; p < (bw_patch)x->patch_count && status == BW_OK; p++) {
        list_rim(map, p, &at);
        map->rim_begin[p + 1] = at;
        place_patch_centre(map, p);
    }
    for (bw_block b = 0; b < (bw_block)x->block_count && status == BW_OK; b++) status = place_block_centre(ctx, map, b);
    if (status == BW_OK) status = tile_sides(ctx, map);
    if (status != BW_OK) bw_blockwise_clear(ctx, map);
    return status;
}

/* ---- meta-tets and their check ------------------------------------------------------------------------------------- */

void bw_blockwise_tet(const bw_blockwise *map, bw_patch patch, int slot, size_t k, bw_block_point corner[4], bool *turned) {
    const bw_complex *x = map->atlas->complex;
    const bw_patch_point *rim = &map->rim[map->rim_begin[patch]];
    corner[0] = map->block_centre[x->patch_block[patch][slot]];
    corner[1] = in_block(map, patch, slot, &map->patch_centre[patch]);
    corner[2] = in_block(map, patch, slot, &rim[k]);
    corner[3] = in_block(map, patch, slot, &rim[(k + 1) % rim_size(map, patch)]);
    int side = x->patch_side[patch][slot], sign = bw_rotation_sign[map->real[patch][slot].rotation][side >> 1];
    *turned = (sign > 0) != (side & 1); /* the frame's normal points into the block */
}

/* Adds six times the volume of a tet; its sign is returned. */
static int add_volume(mpz_t sum, const int64_t p[3], const int64_t q[3], const int64_t r[3], const int64_t s[3], bool turned) {
    int64_t e[3][3];
    mpz_t term, factor;
    mpz_inits(term, factor, NULL);
    for (int k = 0; k < 3; k++) e[0][k] = q[k] - p[k], e[1][k] = r[k] - p[k], e[2][k] = s[k] - p[k];
    for (int k = 0; k < 6; k++) {
        int i = k % 3, j = k < 3 ? (i + 1) % 3 : (i + 2) % 3, l = 3 - i - j;
        mpz_set_si(term, e[0][i]);
        mpz_set_si(factor, e[1][j]), mpz_mul(term, term, factor);
        mpz_set_si(factor, e[2][l]), mpz_mul(term, term, factor);
        if ((k < 3) != turned) mpz_add(sum, sum, term);
        else mpz_sub(sum, sum, term);
    }
    mpz_clears(term, factor, NULL);
    int sign = bw_det3_sign(e[0], e[1], e[2]);
    return turned ? -sign : sign;
}

/* Whether a rim's node is where the atlas has it, so that neighbouring patches agree on it. */
static bool is_in_atlas(const bw_atlas *atlas, bw_block b, const bw_block_point *at) {
    int64_t p[3];
    for (int k = 0; k < 3; k++) p[k] = at->real[k] / 2;
    int32_t place = bw_atlas_find(atlas, b, p);
    for (int k = 0; k < 3 && place != BW_NONE; k++)
        if (at->real[k] != 2 * p[k] || at->image[k] != UNIT * atlas->place[place].at[k].q) return false;
    return place != BW_NONE;
}

static bool is_in_side(const bw_block_point *at, int side, const int64_t real[3], const int64_t image[3]) {
    int k = side >> 1;
    return at->real[k] == (side & 1 ? 2 * real[k] : 0) && at->image[k] == (side & 1 ? UNIT * image[k] : 0);
}

static bw_status check_patch(bw_context *ctx, const bw_blockwise *map, bw_patch p, int slot, mpz_t (*volume)[2]) {
    const bw_complex *x = map->atlas->complex;
    bw_block b = x->patch_block[p][slot];
    for (size_t k = 0; k < rim_size(map, p); k++) {
        bw_block_point c[4];
        bool turned;
        bw_blockwise_tet(map, p, slot, k, c, &turned);
        for (int i = 1; i < 4; i++)
            if (!is_in_side(&c[i], x->patch_side[p][slot], x->block_extent[b], map->atlas->extent[b]))
                return bw_fail(ctx, BW_E_CHECK, "block-wise map: a point of patch %d is not in the side of block %d", p, b);
        if (!is_in_atlas(map->atlas, b, &c[2])) return bw_fail(ctx, BW_E_CHECK, "block-wise map: node %zu of patch %d is misplaced in block %d", k, p, b);
        if (add_volume(volume[b][0], c[0].real, c[1].real, c[2].real, c[3].real, turned) <= 0 ||
            add_volume(volume[b][1], c[0].image, c[1].image, c[2].image, c[3].image, turned) <= 0)
            return bw_fail(ctx, BW_E_CHECK, "block-wise map: meta-tet %zu of patch %d in block %d is not positive", k, p, b);
    }
    return BW_OK;
}

static bool equals_box(const mpz_t volume, const int64_t extent[3], uint64_t unit) {
    mpz_t box;
    mpz_init_set_ui(box, 6);
    for (int k = 0; k < 3; k++) mpz_mul_ui(box, box, (uint64_t)extent[k]), mpz_mul_ui(box, box, unit);
    bool same = mpz_cmp(box, volume) == 0;
    mpz_clear(box);
    return same;
}

bw_status bw_blockwise_check(bw_context *ctx, const bw_blockwise *map) {
    const bw_complex *x = map->atlas->complex;
    mpz_t(*volume)[2] = bw_alloc(ctx, x->block_count, sizeof *volume);
    if (!volume) return ctx->error.status;
    for (size_t b = 0; b < x->block_count; b++) mpz_inits(volume[b][0], volume[b][1], NULL);
    bw_status status = BW_OK;
    for (size_t i = 0; i < 2 * x->patch_count && status == BW_OK; i++)
        if (x->patch_block[i / 2][i % 2] != BW_NONE) status = check_patch(ctx, map, (bw_patch)(i / 2), (int)(i % 2), volume);
    for (size_t b = 0; b < x->block_count && status == BW_OK; b++)
        if (!equals_box(volume[b][0], x->block_extent[b], 2) || !equals_box(volume[b][1], map->atlas->extent[b], (uint64_t)UNIT))
            status = bw_fail(ctx, BW_E_CHECK, "block-wise map: the meta-tets of block %zu do not fill its box", b);
    for (size_t b = 0; b < x->block_count; b++) mpz_clears(volume[b][0], volume[b][1], NULL);
    bw_free(ctx, volume);
    return status;
}
