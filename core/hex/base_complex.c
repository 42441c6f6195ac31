#include "hex/base_complex.h"

#include <string.h>

/* A hex as seen from one of its faces at one of its edges. */
typedef struct {
    uint32_t hex;
    int face, edge;
} flag;

enum { OFTEN = 65536 }; /* hexes or quads between questions whether to go on */
enum { SEEN = 1, IRREGULAR = 2, CROSSED = 4 /* inside and regular: sheets go on */ };

/* Hexes by what is beyond their faces alone. */
typedef struct {
    uint32_t count;
    uint32_t *mate;      /* [6 * hex + face] the same quad of the hex beyond; BW_HEX_NO_MATE outside */
    bw_rotation *turn;   /* [likewise] from the axes of the hex to those of the one beyond */
    uint8_t (*edge)[12]; /* [hex] of each of its edges */
    uint8_t *wall;       /* [6 * hex + face] */
    uint32_t *stack;     /* quads whose sheets are to go on; then hexes */
    size_t depth;
    bw_hex_base_complex *found;
} search;

/* The face on the other side of an edge: edge 4 * axis + bits is on a low or high face of each of the two other axes. */
static int other_face(int edge, int face) {
    int axis = edge >> 2, a = 2 * ((axis + 1) % 3) + (edge & 1), b = 2 * ((axis + 2) % 3) + (edge >> 1 & 1);
    return face == a ? b : a;
}

static bool has_edge(const flag *f) { return other_face(f->edge, other_face(f->edge, f->face)) == f->face; }

/* To the hex beyond the face; the flag is then that hex's other face at the edge. False on the boundary. */
static bool cross(const search *s, flag *f) {
    uint32_t from = 6 * f->hex + (uint32_t)f->face, to = s->mate[from];
    if (to == BW_HEX_NO_MATE) return false;
    int64_t at[3]; /* the edge, from the centre of the hex; then of the one beyond */
    int axis = f->edge >> 2;
    at[axis] = 0, at[(axis + 1) % 3] = f->edge & 1 ? 1 : -1, at[(axis + 2) % 3] = f->edge & 2 ? 1 : -1;
    at[f->face >> 1] = -at[f->face >> 1];
    bw_rotate(s->turn[from], at, at);
    axis = at[0] ? at[1] ? 2 : 1 : 0;
    int edge = 4 * axis + (at[(axis + 1) % 3] > 0) + 2 * (at[(axis + 2) % 3] > 0);
    *f = (flag){to / 6, other_face(edge, (int)(to % 6)), edge};
    return true;
}

static void set_wall(search *s, uint32_t hex, int face) {
    uint32_t quad = 6 * hex + (uint32_t)face;
    if (s->mate[quad] == BW_HEX_NO_MATE || s->wall[quad]) return;
    s->wall[quad] = s->wall[s->mate[quad]] = 1;
    s->stack[s->depth++] = quad;
    s->found->wall_quads++;
}

/* Hexes around an edge, counted by going around it: two edges may have the same vertices. */
static void look_around(search *s, uint32_t hex, int edge) {
    int axis = edge >> 2, valence = 0;
    bool inside = false;
    flag start = {hex, 2 * ((axis + 1) % 3) + (edge & 1), edge}, f = start;
    for (int turn = 0; turn < 2 && !inside; turn++) { /* one way round, then from the start the other way */
        for (f = start, f.face = turn ? other_face(edge, start.face) : start.face; cross(s, &f);) {
            valence++;
            if (f.hex == hex && f.edge == edge) {
                inside = true;
                break;
            }
        }
    }
    if (!inside) valence++; /* the hex itself */
    uint8_t kind = SEEN | (valence != (inside ? 4 : 2) ? IRREGULAR : inside ? CROSSED : 0);
    s->found->irregular_edges += (kind & IRREGULAR) != 0;
    for (int turn = 0; turn < 2; turn++) {
        f = start, f.face = turn ? other_face(edge, start.face) : start.face;
        do {
            s->edge[f.hex][f.edge] = kind;
            if (kind & IRREGULAR) set_wall(s, f.hex, f.face), set_wall(s, f.hex, other_face(f.edge, f.face));
        } while (cross(s, &f) && !(f.hex == hex && f.edge == edge));
    }
}

/* Around a regular edge inside, the quad across from another is the one that shares no hex with it. */
static void go_on(search *s, uint32_t quad) {
    for (int e = 0; e < 12; e++) {
        flag f = {quad / 6, (int)(quad % 6), e};
        if (!has_edge(&f) || !(s->edge[f.hex][e] & CROSSED)) continue;
        f.face = other_face(e, f.face);
        if (cross(s, &f)) set_wall(s, f.hex, f.face);
    }
}

static bw_status unite(bw_context *ctx, search *s, bw_block *block) {
    for (size_t h = 0; h < s->count; h++) {
        if (h % OFTEN == 0 && bw_poll(ctx)) return ctx->error.status;
        if (block[h] != BW_NONE) continue;
        block[h] = (bw_block)s->found->blocks;
        s->stack[s->depth++] = (uint32_t)h;
        while (s->depth) {
            uint32_t at = s->stack[--s->depth];
            for (uint32_t quad = 6 * at; quad < 6 * at + 6; quad++) {
                uint32_t to = s->mate[quad];
                if (to == BW_HEX_NO_MATE || s->wall[quad] || block[to / 6] != BW_NONE) continue;
                block[to / 6] = block[h];
                s->stack[s->depth++] = to / 6;
            }
        }
        s->found->blocks++;
    }
    return BW_OK;
}

/* Requires mate and turn, which are freed. */
static bw_status find(bw_context *ctx, search *s, bw_block *block) {
    size_t n = s->count;
    bw_block *own = block ? block : bw_alloc(ctx, n, sizeof *own);
    s->edge = bw_alloc(ctx, n, sizeof *s->edge);
    s->wall = bw_alloc(ctx, 6 * n, sizeof *s->wall);
    s->stack = bw_alloc(ctx, 3 * n, sizeof *s->stack); /* a quad inside is in two hexes */
    bw_status status = ctx->error.status;
    if (status != BW_OK) goto out;
    for (uint32_t h = 0; h < n; h++) {
        if (h % OFTEN == 0 && (status = bw_poll(ctx)) != BW_OK) goto out;
        for (int e = 0; e < 12; e++)
            if (!s->edge[h][e]) look_around(s, h, e);
    }
    for (size_t i = 0; s->depth; i++) {
        if (i % OFTEN == 0 && (status = bw_poll(ctx)) != BW_OK) goto out;
        go_on(s, s->stack[--s->depth]);
    }
    for (size_t h = 0; h < n; h++) own[h] = BW_NONE;
    status = unite(ctx, s, own);
out:
    bw_free(ctx, s->mate), bw_free(ctx, s->turn), bw_free(ctx, s->edge), bw_free(ctx, s->wall), bw_free(ctx, s->stack);
    if (own != block) bw_free(ctx, own);
    return status;
}

/* ---- of a mesh ----------------------------------------------------------------------------------------------------- */

static int corner_of(const bw_hvertex *hex, bw_hvertex vertex) {
    int c = 0;
    while (hex[c] != vertex) c++;
    return c;
}

/* The rotation that takes axis k to axis[k], turned over where sense[k] is -1. */
static bw_rotation rotation_to(const int axis[3], const int sense[3]) {
    for (int r = 0; r < BW_ROTATIONS; r++) {
        bool same = true;
        for (int k = 0; k < 3; k++) same = same && bw_rotation_image[r][k] == axis[k] && bw_rotation_sign[r][axis[k]] == sense[k];
        if (same) return (bw_rotation)r;
    }
    return 0; /* not reached: the hexes of a mesh have one orientation */
}

/* From the axes of a hex to those of the one beyond its face: where the corners of the quad are in both. */
static bw_rotation turn_across(const bw_hex_mesh *mesh, uint32_t quad, uint32_t to) {
    const bw_hvertex *from = mesh->hex[quad / 6], *hex = mesh->hex[to / 6];
    int normal = (int)(quad % 6) >> 1, axis[3], sense[3];
    int corner = (int)(quad % 6 & 1) << normal; /* of the quad, on the low ends of both other axes */
    int at = corner_of(hex, from[corner]);
    axis[normal] = (int)(to % 6) >> 1, sense[normal] = (quad % 6 & 1) == (to % 6 & 1) ? -1 : 1;
    for (int i = 1; i < 3; i++) {
        int k = (normal + i) % 3, next = corner_of(hex, from[corner | 1 << k]), bit = at ^ next;
        axis[k] = bit == 1 ? 0 : bit == 2 ? 1 : 2, sense[k] = next & bit ? 1 : -1;
    }
    return rotation_to(axis, sense);
}

bw_status bw_hex_find_base_complex(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_base_complex *found, bw_block *block) {
    search s = {.found = found};
    *found = (bw_hex_base_complex){0};
    bw_status status = bw_hex_mates(ctx, mesh, &s.mate);
    if (status != BW_OK) return status;
    s.count = (uint32_t)mesh->hex_count;
    s.turn = bw_alloc(ctx, 6 * mesh->hex_count, sizeof *s.turn);
    for (uint32_t quad = 0; quad < 6 * s.count && s.turn; quad++)
        if (s.mate[quad] != BW_HEX_NO_MATE) s.turn[quad] = turn_across(mesh, quad, s.mate[quad]);
    return find(ctx, &s, block);
}

/* ---- of a plan ----------------------------------------------------------------------------------------------------- */

/* Number of a cube: blocks one after the other, first axis fastest. */
static uint32_t cube_number(const bw_hex_plan *plan, const uint32_t *begin, const bw_plan_cube *cube) {
    const int64_t *size = plan->size[cube->block], *c = cube->centre;
    return begin[cube->block] + (uint32_t)(c[0] / 2 + size[0] / 2 * (c[1] / 2 + size[1] / 2 * (c[2] / 2)));
}

static bw_status join_cube(bw_context *ctx, const bw_hex_plan *plan, const uint32_t *begin, const bw_plan_cube *cube, search *s) {
    for (int face = 0; face < 6; face++) {
        uint32_t quad = 6 * cube_number(plan, begin, cube) + (uint32_t)face;
        bw_plan_cube to;
        bw_patch patch;
        bw_plan_step step = bw_hex_plan_step(plan, cube, face, &to, &patch);
        s->mate[quad] = BW_HEX_NO_MATE;
        if (step == BW_PLAN_NOTHING) return bw_fail(ctx, BW_E_CHECK, "the plan of the hex mesh has a gap");
        if (step == BW_PLAN_OUTSIDE) continue;
        int axis = bw_rotation_image[to.turn][face >> 1], sense = (face & 1 ? 1 : -1) * bw_rotation_sign[to.turn][axis];
        s->mate[quad] = 6 * cube_number(plan, begin, &to) + (uint32_t)(2 * axis + (sense < 0)); /* it is entered from the other end */
        s->turn[quad] = to.turn;
    }
    return BW_OK;
}

bw_status bw_hex_plan_base_complex(bw_context *ctx, const bw_hex_plan *plan, bw_hex_base_complex *found) {
    size_t blocks = plan->verifier.x->block_count;
    search s = {.found = found, .count = (uint32_t)plan->cubes};
    *found = (bw_hex_base_complex){0};
    if (plan->cubes > UINT32_MAX / 12 - 1) return bw_fail(ctx, BW_E_LIMIT, "more than 350 million hexes");
    uint32_t *begin = bw_alloc(ctx, blocks, sizeof *begin), next = 0;
    s.mate = bw_alloc(ctx, 6 * plan->cubes, sizeof *s.mate);
    s.turn = bw_alloc(ctx, 6 * plan->cubes, sizeof *s.turn);
    bw_status status = ctx->error.status;
    for (size_t b = 0; b < blocks && status == BW_OK; b++) {
        const int64_t *n = plan->size[b];
        begin[b] = next;
        next += (uint32_t)(n[0] / 2 * (n[1] / 2) * (n[2] / 2));
    }
    for (size_t b = 0; b < blocks && status == BW_OK; b++) {
        bw_plan_cube cube = {.block = (bw_block)b};
        const int64_t *n = plan->size[b];
        for (cube.centre[2] = 1; cube.centre[2] < n[2]; cube.centre[2] += 2)
            for (cube.centre[1] = 1; cube.centre[1] < n[1]; cube.centre[1] += 2)
                for (cube.centre[0] = 1; cube.centre[0] < n[0] && status == BW_OK; cube.centre[0] += 2) status = join_cube(ctx, plan, begin, &cube, &s);
        if (status == BW_OK) status = bw_poll(ctx);
    }
    bw_free(ctx, begin);
    if (status == BW_OK) return find(ctx, &s, NULL);
    bw_free(ctx, s.mate), bw_free(ctx, s.turn);
    return status;
}
