#include "complex/reduction.h"

#include <string.h>

typedef struct {
    bw_block parent;
    int32_t first_side; /* ring of patch sides (2 * patch + slot) of the union */
    bw_transition chart;
    int64_t low[3], high[3];
} block_set;

typedef struct {
    bw_patch parent, next; /* next: ring of the patches of the union */
    uint8_t flags;         /* BW_PATCH_*, and GONE, QUEUED */
    int64_t distance;
    int64_t low[3], high[3]; /* rectangle, in the chart of patch_block[0] of the root */
} patch_set;

enum { GONE = 64, QUEUED = 128 };
enum { STAYS = 1 << 30 }; /* walls around an arc that stays however few are left: singular or a feature */

struct queued {
    int64_t key;
    bw_patch patch;
};

struct bw_reduction {
    const bw_complex *x;
    block_set *block, *block_start;
    patch_set *patch, *patch_start;
    int32_t *next_side;      /* [2 * patch + slot] ring of a block */
    int32_t *next_side_start;
    bw_transition *across;   /* [patch]: chart of patch_block[1] to that of patch_block[0] */
    int32_t *walls, *walls_start; /* [arc]: those left, or about STAYS; 0 or less once the arc has vanished */
    bool has_features;            /* some arc is one */
    size_t *rim_begin;       /* [arc + 1]: the patches around it, once per appearance */
    bw_patch *rim;
    struct queued *heap;
    size_t heap_count;
    bw_patch *first;         /* the patches that are removable at the start, under rules like `first_rules` */
    size_t first_count;
    bw_reduction_rules first_rules;
    const bw_reduction_rules *rules;
    uint8_t stays;           /* patches with one of these flags are not removable under the rules */
    size_t blocks;
};

/* ---- setting up ---------------------------------------------------------------------------------------------------- */

void bw_reduction_free(bw_context *ctx, bw_reduction *r) {
    if (!r) return;
    void *blocks[] = {r->block, r->block_start, r->patch, r->patch_start, r->next_side, r->next_side_start, r->across,
                      r->walls, r->walls_start, r->rim_begin, r->rim, r->heap, r->first, r};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(ctx, blocks[i]);
}

static bw_status allocate(bw_context *ctx, bw_reduction *r) {
    const bw_complex *x = r->x;
    size_t uses = x->patch_chain_begin[4 * x->patch_count];
    r->block = bw_alloc(ctx, x->block_count, sizeof *r->block);
    r->block_start = bw_alloc(ctx, x->block_count, sizeof *r->block);
    r->patch = bw_alloc(ctx, x->patch_count, sizeof *r->patch);
    r->patch_start = bw_alloc(ctx, x->patch_count, sizeof *r->patch);
    r->next_side = bw_alloc(ctx, 2 * x->patch_count, sizeof *r->next_side);
    r->next_side_start = bw_alloc(ctx, 2 * x->patch_count, sizeof *r->next_side);
    r->across = bw_alloc(ctx, x->patch_count, sizeof *r->across);
    r->walls = bw_alloc(ctx, x->arc_count, sizeof *r->walls);
    r->walls_start = bw_alloc(ctx, x->arc_count, sizeof *r->walls);
    r->rim_begin = bw_alloc(ctx, x->arc_count + 2, sizeof *r->rim_begin);
    r->rim = bw_alloc(ctx, uses, sizeof *r->rim);
    r->heap = bw_alloc(ctx, 2 * x->patch_count + 1, sizeof *r->heap);
    r->first = bw_alloc(ctx, x->patch_count, sizeof *r->first);
    return ctx->error.status;
}

static void list_rims(bw_reduction *r) {
    const bw_complex *x = r->x;
    size_t uses = x->patch_chain_begin[4 * x->patch_count];
    for (size_t i = 0; i < uses; i++) r->rim_begin[(x->patch_chain[i] >> 1) + 2]++;
    for (size_t a = 0; a < x->arc_count; a++) {
        bool stays = x->arc_flags[a] & (BW_ARC_SINGULAR | BW_ARC_FEATURE);
        r->walls_start[a] = stays ? STAYS : (int32_t)r->rim_begin[a + 2];
        r->has_features = r->has_features || x->arc_flags[a] & BW_ARC_FEATURE;
    }
    for (size_t a = 2; a < x->arc_count + 2; a++) r->rim_begin[a] += r->rim_begin[a - 1];
    for (size_t p = 0; p < x->patch_count; p++)
        for (size_t i = x->patch_chain_begin[4 * p]; i < x->patch_chain_begin[4 * p + 4]; i++)
            r->rim[r->rim_begin[(x->patch_chain[i] >> 1) + 1]++] = (bw_patch)p;
}

/* The rectangle of a patch in the chart of its first block: its first side starts at the low corner of its plane (chains.c). */
static void set_rectangle(bw_reduction *r, bw_patch p) {
    const bw_complex *x = r->x;
    int axis = x->patch_side[p][0] >> 1;
    patch_set *s = &r->patch_start[p];
    for (int k = 0; k < 3; k++) s->low[k] = s->high[k] = x->patch_low[p][k];
    s->high[(axis + 1) % 3] += x->patch_extent[p][0];
    s->high[(axis + 2) % 3] += x->patch_extent[p][1];
}

static void set_start(bw_reduction *r, const bw_cells *cells) {
    const bw_complex *x = r->x;
    for (size_t b = 0; b < x->block_count; b++) {
        block_set *s = &r->block_start[b];
        s->parent = (bw_block)b;
        s->first_side = BW_NONE;
        memcpy(s->high, x->block_extent[b], sizeof s->high);
    }
    for (size_t p = 0; p < x->patch_count; p++) {
        r->patch_start[p] = (patch_set){.parent = (bw_patch)p, .next = (bw_patch)p, .flags = x->patch_flags[p],
                                        .distance = x->patch_distance[p]};
        set_rectangle(r, (bw_patch)p);
        if (x->patch_block[p][1] != BW_NONE) r->across[p] = bw_complex_across(cells, x, (bw_patch)p);
        for (int32_t slot = 0; slot < 2 && x->patch_block[p][slot] != BW_NONE; slot++) {
            int32_t side = 2 * (int32_t)p + slot, *first = &r->block_start[x->patch_block[p][slot]].first_side;
            r->next_side_start[side] = *first == BW_NONE ? side : r->next_side_start[*first];
            if (*first == BW_NONE) *first = side;
            else r->next_side_start[*first] = side;
        }
    }
}

bw_status bw_reduction_new(bw_context *ctx, const bw_cells *cells, const bw_complex *complex, bw_reduction **out) {
    bw_reduction *r = *out = bw_alloc(ctx, 1, sizeof *r);
    if (!r) return ctx->error.status;
    r->x = complex;
    bw_status status = allocate(ctx, r);
    if (status == BW_OK) {
        list_rims(r);
        set_start(r, cells);
        return BW_OK;
    }
    bw_reduction_free(ctx, r);
    *out = NULL;
    return status;
}

/* ---- sets ---------------------------------------------------------------------------------------------------------- */

static bw_block compress_block(bw_reduction *r, bw_block b) {
    bw_block parent = r->block[b].parent;
    if (r->block[parent].parent == parent) return parent;
    bw_block root = compress_block(r, parent);
    r->block[b].chart = bw_transition_compose(&r->block[parent].chart, &r->block[b].chart);
    return r->block[b].parent = root;
}

/* Root of a block; afterwards block[b].chart leads straight to the root's chart (of a root: the identity). */
static inline bw_block find_block(bw_reduction *r, bw_block b) {
    return r->block[b].parent == b ? b : compress_block(r, b);
}

static inline bw_patch find_patch(bw_reduction *r, bw_patch p) {
    for (bw_patch parent; (parent = r->patch[p].parent) != p; p = parent) r->patch[p].parent = r->patch[parent].parent;
    return p;
}

/* The block behind one side of a patch, and the side of its box in which the patch lies. */
typedef struct {
    bw_block block;
    int side;
} touch;

static touch touching(bw_reduction *r, bw_patch p, int slot) {
    const bw_complex *x = r->x;
    bw_block base = x->patch_block[p][slot];
    int side = x->patch_side[p][slot];
    if (base == BW_NONE) return (touch){BW_NONE, 0};
    bw_block root = find_block(r, base);
    if (root == base) return (touch){root, side};
    const bw_transition *chart = &r->block[base].chart;
    bw_plane plane = bw_transition_plane(chart, (bw_plane){0, (int8_t)(side >> 1)});
    bool high = (side & 1) ^ (bw_rotation_sign[chart->rotation][plane.axis] < 0);
    return (touch){root, 2 * plane.axis + high};
}

static __int128 area_of(const int64_t low[3], const int64_t high[3], int axis) {
    int u = (axis + 1) % 3, v = (axis + 2) % 3;
    return (__int128)(high[u] - low[u]) * (high[v] - low[v]);
}

static __int128 patch_area(const bw_reduction *r, bw_patch p) {
    return area_of(r->patch[p].low, r->patch[p].high, r->x->patch_side[p][0] >> 1);
}

static __int128 side_area(const bw_reduction *r, touch t) {
    return area_of(r->block[t.block].low, r->block[t.block].high, t.side >> 1);
}

/* Whether two blocks touch in a patch other than p. */
static bool touch_elsewhere(bw_reduction *r, bw_patch p, bw_block a, bw_block b) {
    int32_t first = r->block[a].first_side, s = first;
    do {
        bw_patch q = s >> 1;
        if (!(r->patch[find_patch(r, q)].flags & GONE) && find_patch(r, q) != p) {
            bw_block other = r->x->patch_block[q][!(s & 1)];
            if (other != BW_NONE && find_block(r, other) == b) return true;
        }
        s = r->next_side[s];
    } while (s != first);
    return false;
}

static bool removable(bw_reduction *r, bw_patch p) {
    const patch_set *s = &r->patch[p];
    if (s->flags & r->stays) return false;
    touch t[2] = {touching(r, p, 0), touching(r, p, 1)};
    if (t[0].block == t[1].block) return false;
    __int128 area = patch_area(r, p);
    if (area != side_area(r, t[0]) || area != side_area(r, t[1])) return false;
    return !r->rules->split_self_adjacent || !touch_elsewhere(r, p, t[0].block, t[1].block);
}

/* ---- the queue ----------------------------------------------------------------------------------------------------- */

static int64_t key_of(const bw_reduction *r, bw_patch p) { return r->rules->key ? r->rules->key[p] : r->patch[p].distance; }

static bool before(struct queued a, struct queued b) { return a.key != b.key ? a.key > b.key : a.patch < b.patch; }

static void enqueue(bw_reduction *r, bw_patch p) {
    r->patch[p].flags |= QUEUED;
    struct queued x = {key_of(r, p), p};
    size_t i = r->heap_count++;
    for (; i > 0 && before(x, r->heap[(i - 1) / 2]); i = (i - 1) / 2) r->heap[i] = r->heap[(i - 1) / 2];
    r->heap[i] = x;
}

static void push(bw_reduction *r, bw_patch p) {
    if (!(r->patch[p].flags & (QUEUED | r->stays)) && removable(r, p)) enqueue(r, p);
}

static struct queued pop(bw_reduction *r) {
    struct queued top = r->heap[0], last = r->heap[--r->heap_count];
    size_t i = 0;
    for (;;) {
        size_t c = 2 * i + 1;
        if (c >= r->heap_count) break;
        if (c + 1 < r->heap_count && before(r->heap[c + 1], r->heap[c])) c++;
        if (!before(r->heap[c], last)) break;
        r->heap[i] = r->heap[c];
        i = c;
    }
    r->heap[i] = last;
    r->patch[top.patch].flags &= (uint8_t)~QUEUED;
    return top;
}

/* ---- merging ------------------------------------------------------------------------------------------------------- */

static void splice(int32_t *next, int32_t a, int32_t b) {
    int32_t swap = next[a];
    next[a] = next[b], next[b] = swap;
}

/* Joins the blocks on both sides of a patch: that of slot 1 becomes part of that of slot 0. */
static void merge_blocks(bw_reduction *r, bw_patch p) {
    bw_block base[2] = {r->x->patch_block[p][0], r->x->patch_block[p][1]};
    bw_block root[2] = {find_block(r, base[0]), find_block(r, base[1])};
    bw_transition in = {{0, 0, 0}, 0}, out = in;
    if (root[1] != base[1]) in = bw_transition_inverse(&r->block[base[1]].chart);
    if (root[0] != base[0]) out = r->block[base[0]].chart;
    in = bw_transition_compose(&r->across[p], &in);
    bw_transition chart = bw_transition_compose(&out, &in);
    block_set *a = &r->block[root[0]], *b = &r->block[root[1]];
    for (int end = 0; end < 2; end++) {
        int64_t corner[3];
        bw_transition_apply(&chart, end ? b->high : b->low, corner);
        for (int k = 0; k < 3; k++) {
            if (corner[k] < a->low[k]) a->low[k] = corner[k];
            if (corner[k] > a->high[k]) a->high[k] = corner[k];
        }
    }
    b->parent = root[0];
    b->chart = chart;
    splice(r->next_side, a->first_side, b->first_side);
    r->blocks--;
}

/* A box carried along a transition. */
static void carry(const bw_transition *t, int64_t low[3], int64_t high[3]) {
    int64_t a[3], b[3];
    bw_transition_apply(t, low, a);
    bw_transition_apply(t, high, b);
    for (int k = 0; k < 3; k++) low[k] = a[k] < b[k] ? a[k] : b[k], high[k] = a[k] < b[k] ? b[k] : a[k];
}

/* The rectangle of a patch in the chart of patch_block[slot] of patch p, another patch's chart of the same united block. */
static void rectangle_beside(bw_reduction *r, bw_patch q, int q_slot, bw_patch p, int p_slot, int64_t low[3], int64_t high[3]) {
    memcpy(low, r->patch[q].low, 3 * sizeof *low);
    memcpy(high, r->patch[q].high, 3 * sizeof *high);
    if (q_slot) {
        bw_transition out = bw_transition_inverse(&r->across[q]);
        carry(&out, low, high);
    }
    bw_block from = r->x->patch_block[q][q_slot], to = r->x->patch_block[p][p_slot];
    if (find_block(r, from) != from) carry(&r->block[from].chart, low, high);
    if (find_block(r, to) != to) {
        bw_transition in = bw_transition_inverse(&r->block[to].chart);
        carry(&in, low, high);
    }
}

/* Whether a feature arc lies between two patches: it has to stay between them. */
static bool feature_between(bw_reduction *r, bw_patch a, bw_patch b) {
    bw_patch p = b;
    do {
        for (size_t i = r->x->patch_chain_begin[4 * p]; i < r->x->patch_chain_begin[4 * p + 4]; i++) {
            bw_arc arc = r->x->patch_chain[i] >> 1;
            if (!(r->x->arc_flags[arc] & BW_ARC_FEATURE)) continue;
            for (size_t j = r->rim_begin[arc]; j < r->rim_begin[arc + 1]; j++)
                if (find_patch(r, r->rim[j]) == a) return true;
        }
        p = r->patch[p].next;
    } while (p != b);
    return false;
}

/* Joins two patches beside an arc that two walls pass flat, if their union is a rectangle: always, inside; on the boundary it may be
 * L-shaped, and the arc stays. */
static bool merge_patches(bw_reduction *r, bw_patch p, bw_patch q) {
    bw_patch a = find_patch(r, p), b = find_patch(r, q);
    if (a == b) return false;
    if (b < a) a ^= b, b ^= a, a ^= b;
    patch_set *x = &r->patch[a], *y = &r->patch[b];
    touch t = touching(r, a, 0), same[2] = {touching(r, b, 0), touching(r, b, 1)};
    int slot = same[0].block == t.block && same[0].side == t.side ? 0 : 1, axis = r->x->patch_side[a][0] >> 1;
    if (same[slot].block != t.block || same[slot].side != t.side || (r->has_features && feature_between(r, a, b))) return false;
    int64_t low[3], high[3];
    rectangle_beside(r, b, slot, a, 0, low, high);
    for (int k = 0; k < 3; k++) {
        if (x->low[k] < low[k]) low[k] = x->low[k];
        if (x->high[k] > high[k]) high[k] = x->high[k];
    }
    if (low[axis] != high[axis] || area_of(low, high, axis) != patch_area(r, a) + patch_area(r, b)) return false;
    memcpy(x->low, low, sizeof low);
    memcpy(x->high, high, sizeof high);
    x->flags |= y->flags & (uint8_t)~QUEUED;
    if (y->distance < x->distance) x->distance = y->distance;
    y->parent = a;
    bw_patch swap = x->next;
    x->next = y->next, y->next = swap;
    return true;
}

/* The two patches beside an arc that two walls pass flat. */
static void beside_arc(bw_reduction *r, bw_arc a, bw_patch left[2]) {
    int n = 0;
    for (size_t i = r->rim_begin[a]; n < 2; i++) {
        left[n] = find_patch(r, r->rim[i]);
        n += !(r->patch[left[n]].flags & GONE);
    }
}

/* Makes an arc that two walls pass flat vanish, if the patches beside it have become one or can. The root of both if that was
 * just done, else BW_NONE. */
static bw_patch dissolve_arc(bw_reduction *r, bw_arc a) {
    bw_patch left[2];
    beside_arc(r, a, left);
    bool merged = left[0] != left[1] && merge_patches(r, left[0], left[1]);
    if (merged || left[0] == left[1]) r->walls[a] = 0;
    return merged ? find_patch(r, left[0]) : BW_NONE;
}

/* An arc that lost a wall. A patch that grew may now match its neighbours across arcs that had to stay before. */
static void retest_arc(bw_reduction *r, bw_arc a) {
    const bw_complex *x = r->x;
    if (r->walls[a] != 2) return;
    for (bw_patch root = dissolve_arc(r, a), grown; root != BW_NONE; root = grown) {
        bw_patch p = root;
        grown = BW_NONE;
        do {
            for (size_t i = x->patch_chain_begin[4 * p]; i < x->patch_chain_begin[4 * p + 4] && grown == BW_NONE; i++)
                if (r->walls[x->patch_chain[i] >> 1] == 2) grown = dissolve_arc(r, x->patch_chain[i] >> 1);
            p = r->patch[p].next;
        } while (p != root && grown == BW_NONE);
    }
}

static void remove_patch(bw_reduction *r, bw_patch root) {
    const bw_complex *x = r->x;
    merge_blocks(r, root);
    r->patch[root].flags |= GONE;
    bw_patch p = root;
    do {
        for (size_t i = x->patch_chain_begin[4 * p]; i < x->patch_chain_begin[4 * p + 4]; i++) r->walls[x->patch_chain[i] >> 1]--;
        p = r->patch[p].next;
    } while (p != root);
    do {
        for (size_t i = x->patch_chain_begin[4 * p]; i < x->patch_chain_begin[4 * p + 4]; i++) retest_arc(r, x->patch_chain[i] >> 1);
        p = r->patch[p].next;
    } while (p != root);
    int32_t first = r->block[find_block(r, x->patch_block[root][0])].first_side, s = first;
    do { /* the union's patches; of those that became one its root, which lies in the same side of the same blocks */
        if (r->patch[s >> 1].parent == s >> 1) push(r, s >> 1);
        s = r->next_side[s];
    } while (s != first);
}

static void list_first(bw_reduction *r) {
    r->first_count = 0;
    for (bw_patch p = 0; p < (bw_patch)r->x->patch_count; p++)
        if (removable(r, p)) r->first[r->first_count++] = p;
    r->first_rules = *r->rules;
}

bw_status bw_reduction_run(bw_context *ctx, bw_reduction *r, const bw_reduction_rules *rules, uint8_t *removed, uint8_t *kept,
                           size_t *blocks) {
    const bw_complex *x = r->x;
    memcpy(r->block, r->block_start, x->block_count * sizeof *r->block);
    memcpy(r->patch, r->patch_start, x->patch_count * sizeof *r->patch);
    memcpy(r->next_side, r->next_side_start, 2 * x->patch_count * sizeof *r->next_side);
    memcpy(r->walls, r->walls_start, x->arc_count * sizeof *r->walls);
    r->rules = rules;
    r->stays = GONE | BW_PATCH_BOUNDARY | BW_PATCH_FEATURE | (rules->mode == BW_REDUCE_KEEP_SINGULAR ? BW_PATCH_SINGULAR : 0);
    r->heap_count = 0;
    r->blocks = x->block_count;
    if (rules->mode != r->first_rules.mode || rules->split_self_adjacent != r->first_rules.split_self_adjacent) list_first(r);
    for (size_t i = 0; i < r->first_count && rules->mode != BW_REDUCE_NONE; i++) enqueue(r, r->first[i]);
    while (r->heap_count) {
        struct queued top = pop(r);
        if (r->patch[top.patch].parent != top.patch) continue;
        if (top.key != key_of(r, top.patch)) push(r, top.patch); /* came nearer to its origin when it was merged */
        else if (removable(r, top.patch)) remove_patch(r, top.patch);
    }
    for (size_t p = 0; p < x->patch_count; p++) removed[p] = (r->patch[find_patch(r, (bw_patch)p)].flags & GONE) != 0;
    for (size_t a = 0; a < x->arc_count && kept; a++) {
        bw_patch left[2] = {BW_NONE, BW_NONE};
        if (r->walls[a] == 2) beside_arc(r, (bw_arc)a, left);
        kept[a] = left[0] != left[1];
    }
    *blocks = r->blocks;
    return bw_poll(ctx);
}

/* ---- the independent test ------------------------------------------------------------------------------------------ */

static bool is_whole_side(const bw_complex *x, bw_patch p, int slot) {
    size_t side = 6 * (size_t)x->patch_block[p][slot] + x->patch_side[p][slot];
    return x->block_side_begin[side + 1] - x->block_side_begin[side] == 1;
}

bw_patch bw_complex_removable_patch(const bw_complex *x, const bw_reduction_rules *rules) {
    for (size_t p = 0; p < x->patch_count && rules->mode != BW_REDUCE_NONE; p++) {
        const bw_block *b = x->patch_block[p];
        if (x->patch_flags[p] & (BW_PATCH_BOUNDARY | BW_PATCH_FEATURE) || b[0] == b[1]) continue;
        if (rules->mode == BW_REDUCE_KEEP_SINGULAR && x->patch_flags[p] & BW_PATCH_SINGULAR) continue;
        if (!is_whole_side(x, (bw_patch)p, 0) || !is_whole_side(x, (bw_patch)p, 1)) continue;
        bool elsewhere = false;
        for (size_t q = 0; q < x->patch_count && rules->split_self_adjacent; q++) {
            const bw_block *c = x->patch_block[q];
            elsewhere = elsewhere || (q != p && ((c[0] == b[0] && c[1] == b[1]) || (c[0] == b[1] && c[1] == b[0])));
        }
        if (!elsewhere) return (bw_patch)p;
    }
    return BW_NONE;
}
