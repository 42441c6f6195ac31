#include "hex/base_complex.h"

/* A hex as seen from one of its faces at one of its edges. */
typedef struct {
    uint32_t hex;
    int face, edge;
} flag;

enum { SEEN = 1, IRREGULAR = 2, CROSSED = 4 /* inside and regular: sheets go on */ };

typedef struct {
    const bw_hex_mesh *mesh;
    uint32_t *mate;
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
    uint32_t to = s->mate[6 * f->hex + (uint32_t)f->face];
    if (to == BW_HEX_NO_MATE) return false;
    const bw_hvertex *from = s->mesh->hex[f->hex], *hex = s->mesh->hex[to / 6];
    bw_hvertex a = from[bw_hex_edge_corner[f->edge][0]], b = from[bw_hex_edge_corner[f->edge][1]];
    int e = 0;
    for (bw_hvertex c = -1, d = -1; e < 12; e++) {
        c = hex[bw_hex_edge_corner[e][0]], d = hex[bw_hex_edge_corner[e][1]];
        if ((a == c && b == d) || (a == d && b == c)) break;
    }
    *f = (flag){to / 6, other_face(e, (int)(to % 6)), e};
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

static void unite(search *s, bw_block *block) {
    for (size_t h = 0; h < s->mesh->hex_count; h++) {
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
}

bw_status bw_hex_find_base_complex(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_base_complex *found, bw_block *block) {
    search s = {.mesh = mesh, .found = found};
    bw_block *own = NULL;
    *found = (bw_hex_base_complex){0};
    bw_status status = bw_hex_mates(ctx, mesh, &s.mate);
    if (status != BW_OK) return status;
    s.edge = bw_alloc(ctx, mesh->hex_count, sizeof *s.edge);
    s.wall = bw_alloc(ctx, 6 * mesh->hex_count, sizeof *s.wall);
    s.stack = bw_alloc(ctx, 3 * mesh->hex_count, sizeof *s.stack); /* a quad inside is in two hexes */
    own = block ? block : bw_alloc(ctx, mesh->hex_count, sizeof *own);
    status = ctx->error.status;
    if (status != BW_OK) goto out;
    for (uint32_t h = 0; h < mesh->hex_count; h++)
        for (int e = 0; e < 12; e++)
            if (!s.edge[h][e]) look_around(&s, h, e);
    while (s.depth) go_on(&s, s.stack[--s.depth]);
    for (size_t h = 0; h < mesh->hex_count; h++) own[h] = BW_NONE;
    unite(&s, own);
out:
    bw_free(ctx, s.mate), bw_free(ctx, s.edge), bw_free(ctx, s.wall), bw_free(ctx, s.stack);
    if (own != block) bw_free(ctx, own);
    return status;
}
