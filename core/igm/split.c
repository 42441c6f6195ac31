#include "igm/split.h"

#include <stdlib.h>
#include <string.h>

typedef struct {
    bw_vertex end[2]; /* ascending */
} pair;

typedef struct {
    size_t edge;
    bw_tet tet;
    int local;
} use;

typedef struct {
    bw_context *ctx;
    bw_frame *f;
    pair *edge; /* sorted, each once */
    use *use;   /* sorted by edge, then tet */
    size_t edge_count, use_count, edge_room, use_room;
} splitter;

static pair pair_of(const bw_frame_tet *t, int local) {
    bw_vertex a = t->vertex[bw_tet_edge_corners[local][0]], b = t->vertex[bw_tet_edge_corners[local][1]];
    return a < b ? (pair){{a, b}} : (pair){{b, a}};
}

static int compare_pairs(const void *a, const void *b) {
    const pair *x = a, *y = b;
    int c = (x->end[0] > y->end[0]) - (x->end[0] < y->end[0]);
    return c ? c : (x->end[1] > y->end[1]) - (x->end[1] < y->end[1]);
}

static int compare_uses(const void *a, const void *b) {
    const use *x = a, *y = b;
    if (x->edge != y->edge) return x->edge < y->edge ? -1 : 1;
    return (x->tet > y->tet) - (x->tet < y->tet);
}

/* The facets of a tet that hold a local edge are opposite its two other corners. */
static bool is_opposite(int facet, int local) { return bw_tet_edge_corners[local][0] != facet && bw_tet_edge_corners[local][1] != facet; }

static bool lies_on_surface(const bw_frame_tet *t, int local) {
    bool on = t->line[local] >= 0;
    for (int i = 0; i < 4; i++) on = on || (is_opposite(i, local) && t->plane[i] >= 0);
    return on;
}

/* ---- which edges ---- */

static bw_status add_edge(splitter *s, pair edge) {
    bw_status status = bw_reserve(s->ctx, &s->edge, &s->edge_room, s->edge_count + 1);
    if (status == BW_OK) s->edge[s->edge_count++] = edge;
    return status;
}

static void sort_edges(splitter *s) {
    size_t kept = 0;
    qsort(s->edge, s->edge_count, sizeof *s->edge, compare_pairs);
    for (size_t i = 0; i < s->edge_count; i++)
        if (!kept || compare_pairs(&s->edge[kept - 1], &s->edge[i])) s->edge[kept++] = s->edge[i];
    s->edge_count = kept;
}

static size_t find_edge(const splitter *s, pair edge) {
    const pair *found = bsearch(&edge, s->edge, s->edge_count, sizeof edge, compare_pairs);
    return found ? (size_t)(found - s->edge) : s->edge_count;
}

/* Edges on the surface look like chords from tets that touch it there with the edge alone: those are taken out again. */
static void drop_surface(splitter *s, uint8_t *on) {
    size_t kept = 0;
    for (size_t t = 0; t < s->f->tet_count; t++)
        for (int j = 0; j < 6; j++) {
            size_t e = lies_on_surface(&s->f->tet[t], j) ? find_edge(s, pair_of(&s->f->tet[t], j)) : s->edge_count;
            if (e < s->edge_count) on[e] = 1;
        }
    for (size_t e = 0; e < s->edge_count; e++)
        if (!on[e]) s->edge[kept++] = s->edge[e];
    s->edge_count = kept;
}

static bw_status choose(splitter *s, const uint8_t *marked) {
    bw_frame *f = s->f;
    bw_status status = BW_OK;
    for (size_t t = 0; t < f->tet_count && status == BW_OK; t++) {
        bool near = marked[t];
        for (int i = 0; i < 4; i++) near = near || (f->tet[t].next[i] != BW_NONE && marked[f->tet[t].next[i]]);
        for (int j = 0; j < 6 && near && status == BW_OK; j++)
            if (f->tet[t].mask[bw_tet_edge_corners[j][0]] && f->tet[t].mask[bw_tet_edge_corners[j][1]])
                status = add_edge(s, pair_of(&f->tet[t], j));
    }
    if (status != BW_OK) return status;
    sort_edges(s);
    uint8_t *on = bw_alloc(s->ctx, s->edge_count, 1);
    if (!on) return s->ctx->error.status;
    drop_surface(s, on);
    bw_free(s->ctx, on);
    if (s->edge_count) return BW_OK;
    for (size_t t = 0; t < f->tet_count && status == BW_OK; t++)
        for (int j = 0; j < 6 && marked[t] && status == BW_OK; j++) status = add_edge(s, pair_of(&f->tet[t], j));
    if (status == BW_OK) sort_edges(s);
    return status;
}

/* ---- splitting ---- */

static bw_status list_uses(splitter *s) {
    s->use_count = 0;
    for (size_t t = 0; t < s->f->tet_count; t++)
        for (int j = 0; j < 6; j++) {
            size_t e = find_edge(s, pair_of(&s->f->tet[t], j));
            if (e == s->edge_count) continue;
            if (bw_reserve(s->ctx, &s->use, &s->use_room, s->use_count + 1)) return s->ctx->error.status;
            s->use[s->use_count++] = (use){e, (bw_tet)t, j};
        }
    qsort(s->use, s->use_count, sizeof *s->use, compare_uses);
    return BW_OK;
}

/* Corner `moved` of a half becomes the middle of the edge from it to `kept`. */
static void halve(bw_frame_tet *t, int kept, int moved, int local, bw_vertex middle) {
    t->vertex[moved] = middle;
    for (int k = 0; k < 3; k++) {
        t->p[moved][k] = 0.5 * (t->p[kept][k] + t->p[moved][k]);
        t->u[moved][k] = 0.5 * (t->u[kept][k] + t->u[moved][k]);
    }
    t->mask[moved] = 0;
    for (int8_t k = 0; k < 3; k++) {
        bool held = t->line[local] >= 0 && t->line[local] != k;
        for (int i = 0; i < 4; i++) held = held || (is_opposite(i, local) && t->plane[i] == k);
        if (!held) continue;
        t->mask[moved] |= (uint8_t)(1 << k);
        t->hold[moved][k] = t->hold[kept][k];
    }
    for (int i = 0; i < 4; i++)
        if (i != kept && i != moved) {
            t->quarters[bw_tet_edge_of[moved][i]] = t->next[6 - kept - moved - i] == BW_NONE ? 2 : 4; /* inside the facet of both and i */
            t->line[bw_tet_edge_of[moved][i]] = -1;
            t->feature_edges &= (uint8_t) ~(1 << bw_tet_edge_of[moved][i]);
        }
    t->plane[kept] = -1; /* the facet between the halves */
    t->feature_facets &= (uint8_t) ~(1 << kept);
    t->across[kept] = (bw_transition){.rotation = 0};
}

static void split_tet(splitter *s, bw_tet tet, int local, bw_vertex middle) {
    int a = bw_tet_edge_corners[local][0], b = bw_tet_edge_corners[local][1];
    bw_frame_tet *half = &s->f->tet[s->f->tet_count++];
    *half = s->f->tet[tet];
    halve(&s->f->tet[tet], a, b, local, middle);
    halve(half, b, a, local, middle);
}

static bw_status split_edge(splitter *s, size_t begin, size_t end) {
    bw_frame *f = s->f;
    pair edge = s->edge[s->use[begin].edge];
    if (f->vertex_count + 1 > INT32_MAX || 4 * (f->tet_count + end - begin) > INT32_MAX) return bw_fail(s->ctx, BW_E_RANGE, "the refined mesh is too large");
    if (bw_reserve(s->ctx, &f->position, &f->vertex_room, f->vertex_count + 1)) return s->ctx->error.status;
    if (bw_reserve(s->ctx, &f->tet, &f->tet_room, f->tet_count + end - begin)) return s->ctx->error.status;
    for (int k = 0; k < 3; k++) f->position[f->vertex_count][k] = 0.5 * (f->position[edge.end[0]][k] + f->position[edge.end[1]][k]);
    for (size_t i = begin; i < end; i++) split_tet(s, s->use[i].tet, s->use[i].local, (bw_vertex)f->vertex_count);
    f->vertex_count++;
    return BW_OK;
}

/* Splits edges of which no two are in one tet; the others stay listed for the next round. */
static bw_status split_round(splitter *s, size_t *count) {
    uint8_t *taken = bw_alloc(s->ctx, s->f->tet_count, 1);
    bw_status status = taken ? BW_OK : s->ctx->error.status;
    size_t left = 0;
    for (size_t i = 0, end; i < s->use_count && status == BW_OK; i = end) {
        bool free = true;
        for (end = i; end < s->use_count && s->use[end].edge == s->use[i].edge; end++) free = free && !taken[s->use[end].tet];
        if (!free) {
            s->edge[left++] = s->edge[s->use[i].edge];
            continue;
        }
        for (size_t k = i; k < end; k++) taken[s->use[k].tet] = 1;
        status = split_edge(s, i, end);
        ++*count;
    }
    s->edge_count = left;
    bw_free(s->ctx, taken);
    return status;
}

bw_status bw_frame_split(bw_context *ctx, bw_frame *frame, const uint8_t *marked, size_t *count) {
    splitter s = {.ctx = ctx, .f = frame};
    *count = 0;
    bw_status status = choose(&s, marked);
    while (s.edge_count && status == BW_OK) {
        if ((status = list_uses(&s)) == BW_OK) status = split_round(&s, count);
    }
    bw_free(ctx, s.edge);
    bw_free(ctx, s.use);
    if (status == BW_OK) status = bw_frame_connect(ctx, frame);
    return status == BW_OK ? bw_frame_resolve(ctx, frame) : status;
}
