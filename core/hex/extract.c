#include "hex/extract.h"

#include <string.h>

#include "base/parallel.h"
#include "hex/vertices.h"

enum { LEAST_HEXES = 1024, ROOM_OF_THREAD = 512, FRAMES = 128, TO_DO = -3 };

void bw_hex_origin_clear(bw_context *ctx, bw_hex_origin *origin) {
    bw_free(ctx, origin->tet);
    bw_free(ctx, origin->low);
    memset(origin, 0, sizeof *origin);
}

/* ---- searching the tets around a hex ---- */

typedef struct {
    bw_tet tet;
    bw_transition to; /* from the chart of the hex's tet, in steps */
} stop;

/* Tets visited for one hex; the same tet may be met in two ways where the mesh closes up within a hex. Slots are a hash table of twice as many entries. */
typedef struct {
    stop *stop;
    size_t count, room; /* room is a power of two */
    uint32_t *slot;     /* [2 * room] index of a stop */
    uint32_t *stamp;    /* [2 * room] the search that filled the slot */
    uint32_t search;
    bw_lattice_tet *frame; /* [FRAMES] tets used lately */
    bw_tet *frame_tet;
} search;

static void search_clear(bw_context *ctx, search *s) {
    bw_free(ctx, s->stop);
    bw_free(ctx, s->slot);
    bw_free(ctx, s->stamp);
    bw_free(ctx, s->frame);
    bw_free(ctx, s->frame_tet);
    memset(s, 0, sizeof *s);
}

static bw_status search_init(bw_context *ctx, search *s, size_t room) {
    *s = (search){.room = room};
    s->stop = bw_alloc(ctx, room, sizeof *s->stop);
    s->slot = bw_alloc(ctx, 2 * room, sizeof *s->slot);
    s->stamp = bw_alloc(ctx, 2 * room, sizeof *s->stamp);
    s->frame = bw_alloc(ctx, FRAMES, sizeof *s->frame);
    s->frame_tet = bw_alloc(ctx, FRAMES, sizeof *s->frame_tet);
    for (int i = 0; i < FRAMES && s->frame_tet; i++) s->frame_tet[i] = BW_NONE;
    return ctx->error.status;
}

/* False if there is no room left. */
static bool search_add(search *s, bw_tet tet, const bw_transition *to) {
    size_t mask = 2 * s->room - 1, i = (uint32_t)tet * 2654435769u & mask;
    for (; s->stamp[i] == s->search; i = (i + 1) & mask) {
        const stop *old = &s->stop[s->slot[i]];
        if (old->tet == tet && bw_transition_equal(&old->to, to)) return true;
    }
    if (s->count == s->room) return false;
    s->stamp[i] = s->search, s->slot[i] = (uint32_t)s->count;
    s->stop[s->count++] = (stop){tet, *to};
    return true;
}

static const bw_lattice_tet *frame_of(bw_context *ctx, const bw_hex_vertices *p, search *s, bw_tet tet) {
    int i = (int)((uint32_t)tet % FRAMES);
    if (s->frame_tet[i] == tet) return &s->frame[i];
    s->frame_tet[i] = BW_NONE;
    if (bw_lattice_tet_init(ctx, &p->lattice, tet, &s->frame[i])) return NULL;
    s->frame_tet[i] = tet;
    return &s->frame[i];
}

/* Goes on across facet i of a stop, if one of the missing corners is beyond it and the hex reaches it. */
static bw_status go_across(bw_context *ctx, const bw_hex_vertices *p, search *s, size_t from, const bw_lattice_tet *frame, int i, const int64_t centre[3],
                           int64_t (*corner)[3], unsigned missing, bool *room) {
    const bw_tet_mesh *mesh = &p->lattice.igm->mesh;
    const stop at = s->stop[from];
    bw_facet facet = mesh->tet_facet[at.tet][i];
    bw_tet next = bw_tet_across(mesh, facet, at.tet);
    bool beyond = false;
    for (int c = 0; c < 8 && next != BW_NONE && !beyond; c++) beyond = missing >> c & 1 && bw_lattice_side(frame, i, corner[c]) < 0;
    if (!beyond || !bw_lattice_facet_in_cube(&p->lattice, frame, i, centre)) return BW_OK;
    bw_transition to = at.to;
    if (!bw_grid_map_same_chart(&p->lattice.igm->map, facet)) {
        bw_transition across;
        if (bw_lattice_across(ctx, &p->lattice, facet, at.tet, &across)) return ctx->error.status;
        to = bw_transition_compose(&across, &at.to);
    }
    *room = search_add(s, next, &to);
    return BW_OK;
}

/* Looks for the missing corners of a hex in one tet. */
static unsigned look_up(const bw_hex_vertices *p, bw_tet tet, int64_t (*corner)[3], unsigned missing, bw_hvertex *hex) {
    for (int c = 0; c < 8; c++) {
        if (!(missing >> c & 1)) continue;
        const int64_t k[3] = {corner[c][0] >> 1, corner[c][1] >> 1, corner[c][2] >> 1};
        bw_hvertex v = bw_hex_vertices_find(p, tet, k);
        if (v >= 0) hex[c] = v, missing &= ~(1u << c);
    }
    return missing;
}

/* Finds the corners that are missing of hex h. *room is set to false if the search was given up for lack of it. */
static bw_status complete(bw_context *ctx, const bw_hex_vertices *p, search *s, size_t h, const bw_hex_origin *origin, unsigned missing, bw_hvertex *hex, bool *room) {
    const int64_t *low = origin->low[h];
    s->search++, s->count = 0;
    search_add(s, origin->tet[h], &(bw_transition){{0, 0, 0}, 0});
    for (size_t i = 0; i < s->count && missing && *room; i++) {
        int64_t centre[3] = {2 * low[0] + 1, 2 * low[1] + 1, 2 * low[2] + 1}, corner[8][3];
        const stop at = s->stop[i];
        for (int c = 0; c < 8; c++) {
            for (int k = 0; k < 3; k++) corner[c][k] = centre[k] + (c >> k & 1 ? 1 : -1);
            if (missing >> c & 1) bw_transition_apply(&at.to, corner[c], corner[c]);
        }
        bw_transition_apply(&at.to, centre, centre);
        if (i) missing = look_up(p, at.tet, corner, missing, hex);
        if (!missing) break;
        const bw_lattice_tet *frame = frame_of(ctx, p, s, at.tet);
        if (!frame) return ctx->error.status;
        for (int f = 0; f < 4 && *room; f++)
            if (go_across(ctx, p, s, i, frame, f, centre, corner, missing, room)) return ctx->error.status;
    }
    if (!missing || !*room) return BW_OK;
    bw_fail_element(ctx, "tet", p->lattice.igm->mesh.tet_id[origin->tet[h]], NULL);
    return bw_fail(ctx, BW_E_CHECK, "hex %zu is not complete: the map is not regular around its centre", h);
}

/* Those in the tet of the centre. */
static unsigned look_near(const bw_hex_vertices *p, const bw_hex_origin *origin, size_t h, bw_hvertex *hex) {
    unsigned missing = 0;
    for (int c = 0; c < 8; c++) {
        const int64_t *low = origin->low[h], k[3] = {low[0] + (c & 1), low[1] + (c >> 1 & 1), low[2] + (c >> 2)};
        hex[c] = bw_hex_vertices_find(p, origin->tet[h], k);
        if (hex[c] < 0) missing |= 1u << c;
    }
    return missing;
}

/* ---- all hexes ---- */

typedef struct {
    const bw_hex_vertices *points;
    const bw_hex_origin *origin;
    bw_hex_mesh *mesh;
    search *search; /* [range] */
} joining;

static bw_status join_range(bw_context *ctx, size_t begin, size_t end, int range, void *user) {
    const joining *j = user;
    for (size_t h = begin; h < end; h++) {
        if (h % 4096 == 0 && bw_poll(ctx)) return ctx->error.status;
        bw_hvertex *hex = j->mesh->hex[h];
        unsigned missing = look_near(j->points, j->origin, h, hex);
        bool room = true;
        if (missing && complete(ctx, j->points, &j->search[range], h, j->origin, missing, hex, &room)) return ctx->error.status;
        if (!room) hex[0] = TO_DO;
    }
    return BW_OK;
}

/* Hexes that meet more tets than a thread has room for: one after another, with as much as they need. */
static bw_status join_large(bw_context *ctx, const joining *j) {
    search s = {0};
    bw_status status = BW_OK;
    for (size_t h = 0; h < j->mesh->hex_count && status == BW_OK; h++) {
        bw_hvertex *hex = j->mesh->hex[h];
        size_t room = s.room ? s.room : 2 * ROOM_OF_THREAD;
        for (bool enough = false; hex[0] == TO_DO && status == BW_OK && !enough;) {
            enough = s.room > 0;
            if (enough) status = complete(ctx, j->points, &s, h, j->origin, look_near(j->points, j->origin, h, hex), hex, &enough);
            if (enough || status != BW_OK) continue;
            hex[0] = TO_DO;
            search_clear(ctx, &s);
            status = search_init(ctx, &s, room *= 2);
            if (status == BW_OK) status = bw_poll(ctx);
        }
    }
    search_clear(ctx, &s);
    return status;
}

static bw_status join_hexes(bw_context *ctx, const bw_hex_vertices *points, const bw_hex_origin *origin, bw_hex_mesh *mesh) {
    search all[BW_PARALLEL_MOST] = {0};
    int ranges = bw_parallel_ranges(ctx, mesh->hex_count, LEAST_HEXES);
    joining j = {points, origin, mesh, all};
    bw_status status = BW_OK;
    for (int i = 0; i < ranges && status == BW_OK; i++) status = search_init(ctx, &all[i], ROOM_OF_THREAD);
    if (status == BW_OK) status = bw_parallel(ctx, mesh->hex_count, ranges, join_range, &j);
    for (int i = 0; i < ranges; i++) search_clear(ctx, &all[i]);
    if (status == BW_OK) status = join_large(ctx, &j);
    return status;
}

bw_status bw_hex_extract(bw_context *ctx, const bw_igm *igm, int32_t subdivide, uint64_t max_hexes, bw_hex_mesh *mesh, bw_hex_origin *origin) {
    bw_hex_vertices points;
    memset(mesh, 0, sizeof *mesh);
    memset(origin, 0, sizeof *origin);
    bw_status status = bw_hex_vertices_init(ctx, igm, subdivide, max_hexes, &points, mesh, origin);
    if (status == BW_OK) status = join_hexes(ctx, &points, origin, mesh);
    bw_hex_vertices_clear(ctx, &points);
    if (status != BW_OK) {
        bw_hex_mesh_clear(ctx, mesh);
        bw_hex_origin_clear(ctx, origin);
    }
    return status;
}
