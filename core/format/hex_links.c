#include "format/hex_links.h"

#include <stdlib.h>
#include <string.h>

typedef struct {
    bw_context *ctx;
    const bw_hex_mesh *mesh;
    const bw_hex_skin *skin;
    const bw_hex_groups *blocks;
    uint32_t *mate;
    uint8_t *done;   /* [hex] bit per face */
    bw_hex *at;      /* [blocks->begin[g] + cell of its grid] */
    bw_hex_links *links;
} finder;

static size_t group_of(const bw_hex_groups *blocks, bw_block block) {
    size_t low = 0, high = blocks->count;
    while (high - low > 1) {
        size_t middle = (low + high) / 2;
        if (blocks->key[middle] <= block) low = middle;
        else high = middle;
    }
    return low;
}

static int32_t surface_of(const bw_hex_skin *skin, uint32_t x) {
    size_t low = 0, high = skin->quad_count;
    while (high - low > 1) {
        size_t middle = (low + high) / 2;
        const bw_hex_quad *q = &skin->quad[middle];
        if (6 * (uint32_t)q->hex + q->face <= x) low = middle;
        else high = middle;
    }
    return skin->quad[low].surface;
}

static unsigned corner_of(const bw_hvertex hex[8], bw_hvertex v) {
    unsigned c = 0;
    while (c < 7 && hex[c] != v) c++;
    return c;
}

/* How the face x = 6 * hex + face is linked: from, other_from are those of its low corner; to and other_to are left. */
static bw_hex_link link_of(const finder *f, uint32_t x) {
    const bw_hex_mesh *m = f->mesh;
    uint32_t h = x / 6, face = x % 6, axis = face / 2, y = f->mate[x];
    unsigned low = (face & 1) << axis;
    bw_hex_link l = {.surface = -1};
    for (int k = 0; k < 3; k++) l.from[k] = m->ijk[h][k] + (int32_t)(low >> k & 1);
    if (y == BW_HEX_NO_MATE) {
        l.surface = surface_of(f->skin, x);
        return l;
    }
    const bw_hvertex *here = m->hex[h], *there = m->hex[y / 6];
    unsigned start = corner_of(there, here[low]);
    l.other = group_of(f->blocks, m->block[y / 6]);
    for (int k = 0; k < 3; k++) l.other_from[k] = m->ijk[y / 6][k] + (int32_t)(start >> k & 1);
    l.turn[axis] = (int)(y % 6 / 2 + 1) * ((face & 1) != (y % 6 & 1) ? 1 : -1);
    for (unsigned i = 1; i < 3; i++) {
        unsigned t = (axis + i) % 3, step = start ^ corner_of(there, here[low ^ 1u << t]);
        int to = step == 1 ? 0 : step == 2 ? 1 : 2;
        l.turn[t] = (start >> to & 1) ? -1 - to : 1 + to;
    }
    return l;
}

/* other(from + step of axis k) */
static void move(const bw_hex_link *l, int32_t other[3], int k, int32_t by) {
    int to = abs(l->turn[k]) - 1;
    other[to] += l->turn[k] < 0 ? -by : by;
}

/* Does the quad of the cell that is u, v from that of `l` along axes a, b go on with it? */
static bool goes_on(const finder *f, const bw_hex_link *l, uint32_t x, int a, int32_t u, int b, int32_t v) {
    if (f->done[x / 6] >> x % 6 & 1) return false;
    bw_hex_link next = link_of(f, x);
    if (next.surface != l->surface) return false;
    if (l->surface >= 0) return true;
    int32_t expected[3];
    memcpy(expected, l->other_from, sizeof expected);
    move(l, expected, a, u), move(l, expected, b, v);
    return next.other == l->other && !memcmp(next.turn, l->turn, sizeof l->turn) && !memcmp(next.other_from, expected, sizeof expected);
}

static void mark(finder *f, uint32_t x) {
    f->done[x / 6] |= (uint8_t)(1u << x % 6);
    if (f->mate[x] != BW_HEX_NO_MATE) f->done[f->mate[x] / 6] |= (uint8_t)(1u << f->mate[x] % 6);
}

/* A side of a block: quad (u, v) along axes a, b. */
typedef struct {
    size_t group;
    const uint32_t *n;
    uint32_t face;
    int a, b;
} side;

static uint32_t quad_at(const finder *f, const side *s, uint32_t u, uint32_t v) {
    uint32_t x[3], axis = s->face / 2;
    x[axis] = s->face & 1 ? s->n[axis] - 1 : 0;
    x[s->a] = u, x[s->b] = v;
    return 6 * (uint32_t)f->at[f->blocks->begin[s->group] + x[0] + (size_t)s->n[0] * (x[1] + (size_t)s->n[1] * x[2])] + s->face;
}

/* The rectangle that starts at (u, v). A quad that is marked on the way, because it is the mate of one before, ends it. */
static bw_status take_rectangle(finder *f, const side *s, uint32_t u, uint32_t v) {
    uint32_t width = 1, height = 1, x = quad_at(f, s, u, v);
    bw_hex_link l = link_of(f, x);
    l.group = s->group;
    mark(f, x);
    for (; u + width < s->n[s->a] && goes_on(f, &l, x = quad_at(f, s, u + width, v), s->a, (int32_t)width, s->b, 0); width++) mark(f, x);
    for (bool whole = true; v + height < s->n[s->b]; height++) {
        for (uint32_t i = 0; i < width && whole; i++) whole = goes_on(f, &l, quad_at(f, s, u + i, v + height), s->a, (int32_t)i, s->b, (int32_t)height);
        if (!whole) break;
        for (uint32_t i = 0; i < width; i++) mark(f, quad_at(f, s, u + i, v + height));
    }
    memcpy(l.to, l.from, sizeof l.to), memcpy(l.other_to, l.other_from, sizeof l.other_to);
    l.to[s->a] += (int32_t)width, l.to[s->b] += (int32_t)height;
    if (l.surface < 0) move(&l, l.other_to, s->a, (int32_t)width), move(&l, l.other_to, s->b, (int32_t)height);
    bw_status status = bw_reserve(f->ctx, &f->links->link, &f->links->room, f->links->count + 1);
    if (status == BW_OK) f->links->link[f->links->count++] = l;
    return status;
}

static bw_status take_block(finder *f, size_t g) {
    uint32_t n[3];
    bw_hex_grid_measure(f->mesh, f->blocks, g, n);
    bw_status status = BW_OK;
    for (uint32_t face = 0; face < 6; face++) {
        side s = {.group = g, .n = n, .face = face, .a = ((int)face / 2 + 1) % 3, .b = ((int)face / 2 + 2) % 3};
        for (uint32_t v = 0; v < n[s.b]; v++)
            for (uint32_t u = 0; u < n[s.a] && status == BW_OK; u++) {
                uint32_t x = quad_at(f, &s, u, v);
                if (!(f->done[x / 6] >> face & 1)) status = take_rectangle(f, &s, u, v);
            }
    }
    return status;
}

static void place_hexes(finder *f) {
    for (size_t g = 0; g < f->blocks->count; g++) {
        uint32_t n[3];
        bw_hex_grid_measure(f->mesh, f->blocks, g, n);
        for (size_t i = f->blocks->begin[g]; i < f->blocks->begin[g + 1]; i++) {
            size_t h = f->blocks->item[i], x = (size_t)f->mesh->ijk[h][0], y = (size_t)f->mesh->ijk[h][1], z = (size_t)f->mesh->ijk[h][2];
            f->at[f->blocks->begin[g] + x + n[0] * (y + n[1] * z)] = (bw_hex)h;
        }
    }
}

bw_status bw_hex_links_init(bw_context *ctx, const bw_hex_mesh *mesh, const bw_hex_skin *skin, const bw_hex_groups *blocks, bw_hex_links *links) {
    *links = (bw_hex_links){0};
    finder f = {.ctx = ctx, .mesh = mesh, .skin = skin, .blocks = blocks, .links = links};
    bw_status status = bw_hex_mates(ctx, mesh, &f.mate);
    f.done = status == BW_OK ? bw_alloc(ctx, mesh->hex_count, 1) : NULL;
    f.at = f.done ? bw_alloc(ctx, mesh->hex_count, sizeof *f.at) : NULL;
    if (status == BW_OK && !f.at) status = ctx->error.status;
    if (status == BW_OK) place_hexes(&f);
    for (size_t g = 0; g < blocks->count && status == BW_OK; g++) status = take_block(&f, g);
    bw_free(ctx, f.mate), bw_free(ctx, f.done), bw_free(ctx, f.at);
    return status;
}

void bw_hex_links_clear(bw_context *ctx, bw_hex_links *links) {
    bw_free(ctx, links->link);
    *links = (bw_hex_links){0};
}

bw_hex_link bw_hex_link_turned(const bw_hex_link *link) {
    bw_hex_link l = {.group = link->other, .other = link->group, .surface = -1};
    for (int i = 0; i < 3; i++) {
        int k = abs(link->turn[i]) - 1;
        bool back = link->turn[i] < 0;
        l.turn[k] = back ? -1 - i : 1 + i;
        /* ranges of a group ascend */
        bool swap = link->other_from[k] > link->other_to[k];
        l.from[k] = swap ? link->other_to[k] : link->other_from[k], l.to[k] = swap ? link->other_from[k] : link->other_to[k];
        l.other_from[i] = swap ? link->to[i] : link->from[i], l.other_to[i] = swap ? link->from[i] : link->to[i];
    }
    return l;
}
