#include "mesh/sectors.h"

#include <stdlib.h>
#include <string.h>

#include "mesh/gridmap.h"

typedef __int128 wide;

/* A linear form in the core system's unknowns: `count` terms at `at` in the pool, ascending columns, no
 * zeros. */
typedef struct {
    size_t at, count;
} form;

typedef struct {
    int32_t column;
    int64_t factor;
} term;

/* c . u + rest = 0 */
typedef struct {
    int64_t c[3];
    form rest;
} equation;

typedef struct {
    bw_rotation rotation; /* value = rotation(u) + offset */
    form offset[3];
} sector;

typedef struct {
    bw_tet tet;
    int32_t corner, sector, fan; /* sector BW_NONE: not reached yet */
} star_item;

enum { KEY_CROSS, KEY_ALIGN };
typedef struct {
    int32_t kind, sheet, from, to;
} seen_key;

typedef struct {
    bw_context *ctx;
    const bw_sector_input *in;
    size_t align_column, line_column, free_column; /* first columns of A, L and what follows */
    /* tets and explicitly aligned hinges of every vertex */
    int32_t *first, *item; /* item: 4 * tet + corner */
    int32_t *line_first, *line_item;
    bw_hinge *line_hinge;
    size_t line_count;
    /* the running vertex */
    int32_t *slot; /* [tet] into star */
    star_item *star;
    int32_t *order, *stack; /* into star: the running fan */
    size_t star_count, star_room, order_count, order_room, stack_room;
    int32_t fan;
    sector *sector;
    size_t sector_count, sector_room;
    seen_key *seen;
    size_t seen_count, seen_room;
    term *pool;
    size_t pool_count, pool_room;
    equation row[3];
    int pivot[3], rank;
    /* pass 1 */
    bw_core_system *system;
    int32_t *hash; /* row + 1, or 0 */
    size_t hash_size, entry_count;
    /* pass 2 */
    const int64_t *x;
    int64_t (*value)[4][3];
} walker;

static int64_t gcd(int64_t a, int64_t b) {
    while (b) {
        int64_t r = a % b;
        a = b, b = r;
    }
    return llabs(a);
}

static bw_status too_large(walker *w) {
    return bw_fail(w->ctx, BW_E_ALGORITHM, "coefficients of the equations at a vertex exceed 64 bits");
}

/* ---- linear forms ---- */

/* a F + b G as a new form. */
static bw_status combine(walker *w, int64_t a, form f, int64_t b, form g, form *out) {
    if (bw_reserve(w->ctx, &w->pool, &w->pool_room, w->pool_count + f.count + g.count))
        return w->ctx->error.status;
    const term *x = w->pool + f.at, *xe = x + f.count, *y = w->pool + g.at, *ye = y + g.count;
    term *to = w->pool + w->pool_count;
    while (x < xe || y < ye) {
        int64_t p = 0, q = 0, sum;
        int32_t column = x == xe || (y < ye && y->column < x->column) ? y->column : x->column;
        bool bad = false;
        if (x < xe && x->column == column) bad = __builtin_mul_overflow(a, (x++)->factor, &p);
        if (y < ye && y->column == column) bad = __builtin_mul_overflow(b, (y++)->factor, &q) || bad;
        if (__builtin_add_overflow(p, q, &sum) || bad) return too_large(w);
        if (sum) *to++ = (term){column, sum};
    }
    out->at = w->pool_count;
    out->count = (size_t)(to - w->pool) - w->pool_count;
    w->pool_count += out->count;
    return BW_OK;
}

static bw_status single(walker *w, int32_t column, form *out) {
    if (bw_reserve(w->ctx, &w->pool, &w->pool_room, w->pool_count + 1)) return w->ctx->error.status;
    w->pool[w->pool_count] = (term){column, 1};
    *out = (form){w->pool_count++, 1};
    return BW_OK;
}

/* out = rotation(in) */
static bw_status turn_forms(walker *w, bw_rotation r, const form in[3], form out[3]) {
    for (int i = 0; i < 3; i++)
        if (combine(w, bw_rotation_sign[r][i], in[bw_rotation_axis[r][i]], 0, (form){0, 0}, &out[i]))
            return w->ctx->error.status;
    return BW_OK;
}

/* The sector across a sheet: forward u -> R u + T, back u -> R^-1 (u - T). */
static bw_status cross(walker *w, const sector *from, int32_t sheet, bool forward, sector *to) {
    bw_rotation r = w->in->cut->rotation[sheet];
    form moved[3], shift;
    if (forward && turn_forms(w, r, from->offset, moved)) return w->ctx->error.status;
    for (int i = 0; i < 3; i++)
        if (single(w, 3 * sheet + i, &shift) ||
            combine(w, 1, forward ? moved[i] : from->offset[i], forward ? 1 : -1, shift, &moved[i]))
            return w->ctx->error.status;
    if (forward) {
        to->rotation = bw_rotation_compose(r, from->rotation);
        memcpy(to->offset, moved, sizeof moved);
        return BW_OK;
    }
    to->rotation = bw_rotation_compose(bw_rotation_inverse(r), from->rotation);
    return turn_forms(w, bw_rotation_inverse(r), moved, to->offset);
}

/* ---- the core system's rows ---- */

static uint64_t hash_terms(const term *t, size_t count) {
    uint64_t h = 14695981039346656037u;
    for (size_t i = 0; i < count; i++) {
        h = (h ^ (uint64_t)(uint32_t)t[i].column) * 1099511628211u;
        h = (h ^ (uint64_t)t[i].factor) * 1099511628211u;
    }
    return h ^ h >> 29;
}

static bool row_equals(const bw_core_system *s, size_t row, const term *t, size_t count) {
    if (s->start[row + 1] - s->start[row] != count) return false;
    for (size_t i = 0; i < count; i++)
        if (s->column[s->start[row] + i] != t[i].column || s->coefficient[s->start[row] + i] != t[i].factor)
            return false;
    return true;
}

static bw_status rehash(walker *w) {
    size_t size = w->hash_size ? 2 * w->hash_size : 1024;
    int32_t *hash = bw_alloc(w->ctx, size, sizeof *hash);
    if (!hash) return w->ctx->error.status;
    for (size_t i = 0; i < w->hash_size; i++) {
        if (!w->hash[i]) continue;
        const bw_core_system *s = w->system;
        size_t row = (size_t)w->hash[i] - 1, begin = s->start[row], n = s->start[row + 1] - begin;
        uint64_t h = 14695981039346656037u;
        for (size_t k = begin; k < begin + n; k++) {
            h = (h ^ (uint64_t)(uint32_t)s->column[k]) * 1099511628211u;
            h = (h ^ (uint64_t)s->coefficient[k]) * 1099511628211u;
        }
        h ^= h >> 29;
        while (hash[h & (size - 1)]) h++;
        hash[h & (size - 1)] = w->hash[i];
    }
    bw_free(w->ctx, w->hash);
    w->hash = hash;
    w->hash_size = size;
    return BW_OK;
}

static bw_status append_row(walker *w, const term *t, size_t count) {
    bw_core_system *s = w->system;
    if (bw_reserve(w->ctx, &s->start, &s->start_room, s->row_count + 2) ||
        bw_reserve(w->ctx, &s->column, &s->column_room, w->entry_count + count) ||
        bw_reserve(w->ctx, &s->coefficient, &s->coefficient_room, w->entry_count + count))
        return w->ctx->error.status;
    for (size_t i = 0; i < count; i++) {
        s->column[w->entry_count] = t[i].column;
        s->coefficient[w->entry_count++] = t[i].factor;
    }
    s->start[++s->row_count] = w->entry_count;
    return BW_OK;
}

/* Adds a row unless it is there. Terms are primitive with a positive first factor; *added tells what
 * happened. */
static bw_status emit(walker *w, const term *t, size_t count, bool *added) {
    *added = false;
    if (2 * (w->system->row_count + 1) > w->hash_size && rehash(w)) return w->ctx->error.status;
    uint64_t h = hash_terms(t, count);
    for (; w->hash[h & (w->hash_size - 1)]; h++)
        if (row_equals(w->system, (size_t)w->hash[h & (w->hash_size - 1)] - 1, t, count)) return BW_OK;
    if (append_row(w, t, count)) return w->ctx->error.status;
    w->hash[h & (w->hash_size - 1)] = (int32_t)w->system->row_count;
    *added = true;
    return BW_OK;
}

/* ---- elimination of u at one vertex ---- */

/* Divides by the common factor and makes the first factor of the row positive. Forms of equations are never
 * shared. */
static void normalise(walker *w, equation *e) {
    int64_t g = 0, first = 0;
    term *t = w->pool + e->rest.at;
    for (int k = 0; k < 3; k++) {
        g = gcd(g, e->c[k]);
        if (!first) first = e->c[k];
    }
    for (size_t i = 0; i < e->rest.count && g != 1; i++) g = gcd(g, t[i].factor);
    if (!first && e->rest.count) first = t[0].factor;
    if (first < 0) g = -g;
    if (g == 0 || g == 1) return;
    for (int k = 0; k < 3; k++) e->c[k] /= g;
    for (size_t i = 0; i < e->rest.count; i++) t[i].factor /= g;
}

/* target := (p target - c row) / common factor, so that column k of target becomes zero; p = row.c[k]. */
static bw_status eliminate(walker *w, equation *target, const equation *row, int k) {
    int64_t p = row->c[k], c = target->c[k], g = gcd(p, c);
    if (!c) return BW_OK;
    p /= g, c /= g;
    for (int i = 0; i < 3; i++) target->c[i] = p * target->c[i] - c * row->c[i];
    if (combine(w, p, target->rest, -c, row->rest, &target->rest)) return w->ctx->error.status;
    normalise(w, target);
    return BW_OK;
}

/* Takes an equation into the vertex's reduced echelon form; what has no u left goes to the core system (first
 * pass). */
static bw_status add_equation(walker *w, equation e) {
    bool added;
    for (int i = 0; i < w->rank; i++)
        if (eliminate(w, &e, &w->row[i], w->pivot[i])) return w->ctx->error.status;
    normalise(w, &e);
    int pivot = -1;
    for (int k = 0; k < 3; k++)
        if (e.c[k] && (pivot < 0 || llabs(e.c[k]) < llabs(e.c[pivot]))) pivot = k;
    if (pivot < 0)
        return e.rest.count && w->system ? emit(w, w->pool + e.rest.at, e.rest.count, &added) : BW_OK;
    for (int i = 0; i < w->rank; i++)
        if (eliminate(w, &w->row[i], &e, pivot)) return w->ctx->error.status;
    w->row[w->rank] = e;
    w->pivot[w->rank++] = pivot;
    return BW_OK;
}

/* Component i of a sector's value, minus an unknown, is zero. */
static bw_status add_alignment(walker *w, const sector *s, int i, size_t column) {
    equation e = {{0, 0, 0}, {0, 0}};
    form constant;
    e.c[bw_rotation_axis[s->rotation][i]] = bw_rotation_sign[s->rotation][i];
    if (single(w, (int32_t)column, &constant) || combine(w, 1, s->offset[i], -1, constant, &e.rest))
        return w->ctx->error.status;
    return add_equation(w, e);
}

/* Two expressions of one sector's value are equal. */
static bw_status add_equality(walker *w, const sector *a, const sector *b) {
    for (int i = 0; i < 3; i++) {
        equation e = {{0, 0, 0}, {0, 0}};
        e.c[bw_rotation_axis[a->rotation][i]] += bw_rotation_sign[a->rotation][i];
        e.c[bw_rotation_axis[b->rotation][i]] -= bw_rotation_sign[b->rotation][i];
        if (combine(w, 1, a->offset[i], -1, b->offset[i], &e.rest) || add_equation(w, e))
            return w->ctx->error.status;
    }
    return BW_OK;
}

/* ---- fans and sectors of one vertex ---- */

/* Whether the key is new; it is remembered. */
static bw_status remember(walker *w, seen_key key, bool *fresh) {
    *fresh = false;
    for (size_t i = 0; i < w->seen_count; i++)
        if (!memcmp(&w->seen[i], &key, sizeof key)) return BW_OK;
    if (bw_reserve(w->ctx, &w->seen, &w->seen_room, w->seen_count + 1)) return w->ctx->error.status;
    w->seen[w->seen_count++] = key;
    *fresh = true;
    return BW_OK;
}

/* A crossing as seen from facet_tet[0]; forward and back crossings of one sheet get different keys. */
static seen_key crossing_key(const walker *w, bw_facet f, int32_t from, int32_t to) {
    bool forward = w->in->cut->side[f] > 0;
    return (seen_key){KEY_CROSS, w->in->cut->cut_sheet[f], forward ? from : to, forward ? to : from};
}

static void flood(walker *w, int32_t start, int32_t label) {
    size_t top = 0;
    w->stack[top++] = start;
    w->star[start].sector = label;
    while (top) {
        int32_t at = w->stack[--top];
        w->order[w->order_count++] = at;
        w->star[at].fan = w->fan;
        for (int i = 0; i < 4; i++) {
            bw_facet f = w->in->mesh->tet_facet[w->star[at].tet][i];
            if (i == w->star[at].corner || w->in->cut->side[f]) continue;
            bw_tet next = bw_tet_across(w->in->mesh, f, w->star[at].tet);
            if (next == BW_NONE || w->star[w->slot[next]].sector != BW_NONE) continue;
            w->star[w->slot[next]].sector = label;
            w->stack[top++] = w->slot[next];
        }
    }
}

static bw_status add_sector(walker *w, sector s, int32_t start) {
    if (bw_reserve(w->ctx, &w->sector, &w->sector_room, w->sector_count + 1)) return w->ctx->error.status;
    w->sector[w->sector_count] = s;
    flood(w, start, (int32_t)w->sector_count++);
    return BW_OK;
}

/* Finds all sectors of the fan of star item `start`: afterwards order lists the fan's items. */
static bw_status find_sectors(walker *w, int32_t start) {
    const bw_cutset *cut = w->in->cut;
    bool fresh;
    w->order_count = w->sector_count = w->seen_count = w->pool_count = 0;
    w->rank = 0;
    if (add_sector(w, (sector){0}, start)) return w->ctx->error.status;
    for (size_t i = 0; i < w->order_count; i++) {
        star_item it = w->star[w->order[i]];
        for (int j = 0; j < 4; j++) {
            bw_facet f = w->in->mesh->tet_facet[it.tet][j];
            if (j == it.corner || !cut->side[f]) continue;
            int32_t other = w->slot[bw_tet_across(w->in->mesh, f, it.tet)];
            if (w->star[other].sector != BW_NONE) continue;
            bool first = w->in->mesh->facet_tet[f][0] == it.tet;
            sector s, from = w->sector[it.sector];
            int32_t label = (int32_t)w->sector_count;
            if (cross(w, &from, cut->cut_sheet[f], first == (cut->side[f] > 0), &s) ||
                add_sector(w, s, other) ||
                remember(w,
                         first ? crossing_key(w, f, it.sector, label) : crossing_key(w, f, label, it.sector),
                         &fresh))
                return w->ctx->error.status;
        }
    }
    return BW_OK;
}

/* Equations that facet j of a star item gives, unless the same ones were had. Facets are seen from
 * facet_tet[0] only. */
static bw_status facet_equations(walker *w, star_item it, bw_facet f) {
    const bw_cutset *cut = w->in->cut;
    bool fresh = false;
    if (w->in->mesh->facet_tet[f][0] != it.tet) return BW_OK;
    if (cut->side[f]) {
        int32_t to = w->star[w->slot[w->in->mesh->facet_tet[f][1]]].sector;
        if (remember(w, crossing_key(w, f, it.sector, to), &fresh)) return w->ctx->error.status;
        sector s, from = w->sector[it.sector];
        if (fresh &&
            (cross(w, &from, cut->cut_sheet[f], cut->side[f] > 0, &s) || add_equality(w, &s, &w->sector[to])))
            return w->ctx->error.status;
    }
    if (cut->align_sheet[f] != BW_NONE) {
        seen_key key = {KEY_ALIGN, cut->align_sheet[f], it.sector, 0};
        if (remember(w, key, &fresh)) return w->ctx->error.status;
        if (fresh) {
            sector s = w->sector[it.sector];
            return add_alignment(w, &s, cut->align_axis[f], w->align_column + (size_t)cut->align_sheet[f]);
        }
    }
    return BW_OK;
}

/* The axis of an explicitly aligned hinge in combed charts. */
static int line_axis(const walker *w, bw_hinge h, bw_tet t) {
    bw_rotation r = w->in->cut->comb[t];
    int k = 0;
    while (bw_rotation_axis[r][k] != w->in->seams->line[h]) k++;
    return k;
}

static bw_status line_equations(walker *w, bw_vertex v) {
    for (int32_t i = w->line_first[v]; i < w->line_first[v + 1]; i++) {
        bw_hinge h = w->line_hinge[w->line_item[i]];
        bw_tet t = w->in->hinges->tet[w->in->hinges->ring[h].begin];
        int axis = line_axis(w, h, t);
        if (w->star[w->slot[t]].fan != w->fan) continue;
        for (int k = 0; k < 2; k++) {
            sector s = w->sector[w->star[w->slot[t]].sector];
            if (add_alignment(w, &s, (axis + 1 + k) % 3,
                              w->line_column + 2 * (size_t)w->line_item[i] + (size_t)k))
                return w->ctx->error.status;
        }
    }
    return BW_OK;
}

/* The reduced equations of the running fan. */
static bw_status fan_equations(walker *w, bw_vertex v) {
    for (size_t i = 0; i < w->order_count; i++) {
        star_item it = w->star[w->order[i]];
        for (int j = 0; j < 4; j++)
            if (j != it.corner && facet_equations(w, it, w->in->mesh->tet_facet[it.tet][j]))
                return w->ctx->error.status;
    }
    return line_equations(w, v);
}

/* Mean of the input's values of u, rounded towards zero. */
static void estimate_u(const walker *w, int64_t out[3]) {
    wide sum[3] = {0, 0, 0};
    int64_t count = 0, u[3];
    for (size_t i = 0; i < w->order_count && w->star[w->order[i]].sector == 0; i++, count++) {
        star_item it = w->star[w->order[i]];
        bw_cutset_combed(w->in->cut, it.tet, w->in->value[it.tet][it.corner], u);
        for (int k = 0; k < 3; k++) sum[k] += u[k];
    }
    for (int k = 0; k < 3; k++) out[k] = (int64_t)(sum[k] / count);
}

/* First pass: components of u that are implied with a divisor become unknowns. Their column is not known
 * until all are, so it is -1 in the row, first, for now. */
static bw_status keep_divided(walker *w) {
    int64_t u[3];
    estimate_u(w, u);
    for (int i = 0; i < w->rank; i++) {
        const equation *e = &w->row[i];
        if (llabs(e->c[w->pivot[i]]) == 1) continue;
        for (int k = 0; k < 3; k++)
            if (k != w->pivot[i] && e->c[k])
                return bw_fail(w->ctx, BW_E_ALGORITHM,
                               "a vertex is bound to a line that is no lattice direction");
        if (bw_reserve(w->ctx, &w->pool, &w->pool_room, w->pool_count + e->rest.count + 1))
            return w->ctx->error.status;
        term *t = w->pool + w->pool_count;
        t[0] = (term){-1, e->c[w->pivot[i]]};
        memcpy(t + 1, w->pool + e->rest.at, e->rest.count * sizeof *t);
        bool added;
        if (emit(w, t, e->rest.count + 1, &added)) return w->ctx->error.status;
        if (!added) continue;
        bw_core_system *s = w->system;
        if (bw_reserve(w->ctx, &s->estimate, &s->estimate_room, s->column_count + 1))
            return w->ctx->error.status;
        s->estimate[s->column_count++] = u[w->pivot[i]];
    }
    return BW_OK;
}

/* ---- second pass: values ---- */

static wide evaluate(const walker *w, form f) {
    wide sum = 0;
    for (size_t i = 0; i < f.count; i++)
        sum += (wide)w->pool[f.at + i].factor * w->x[w->pool[f.at + i].column];
    return sum;
}

static bool fits(wide x, int64_t limit) {
    return x <= limit && x >= -limit;
}

/* u: free components from the input, implied ones from their rows. */
static bw_status solve_u(walker *w, bw_vertex v, int64_t u[3]) {
    estimate_u(w, u);
    for (int i = 0; i < w->rank; i++) {
        const equation *e = &w->row[i];
        wide sum = evaluate(w, e->rest);
        for (int k = 0; k < 3; k++)
            if (k != w->pivot[i]) sum += (wide)e->c[k] * u[k];
        if (sum % e->c[w->pivot[i]])
            return bw_fail(w->ctx, BW_E_INTERNAL, "the solution gives vertex %d no integer value", (int)v);
        sum /= -e->c[w->pivot[i]];
        if (!fits(sum, 4 * BW_COMBED_MAX))
            return bw_fail(w->ctx, BW_E_RANGE, "vertex %d leaves the exact grid", (int)v);
        u[w->pivot[i]] = (int64_t)sum;
    }
    return BW_OK;
}

static bw_status place_sector(walker *w, const sector *s, const int64_t u[3], int64_t out[3]) {
    bw_rotate(s->rotation, u, out);
    for (int k = 0; k < 3; k++) {
        wide sum = out[k] + evaluate(w, s->offset[k]);
        if (!fits(sum, 4 * BW_COMBED_MAX))
            return bw_fail(w->ctx, BW_E_RANGE, "the solution leaves the exact grid");
        out[k] = (int64_t)sum;
    }
    return BW_OK;
}

/* Gives all corners of the running fan their values. Items are ordered by sector. */
static bw_status place_fan(walker *w, bw_vertex v) {
    int64_t u[3], combed[3], own[3];
    int32_t last = BW_NONE;
    if (solve_u(w, v, u)) return w->ctx->error.status;
    for (size_t i = 0; i < w->order_count; i++) {
        star_item it = w->star[w->order[i]];
        if (it.sector != last && place_sector(w, &w->sector[last = it.sector], u, combed))
            return w->ctx->error.status;
        for (int k = 0; k < 3; k++) own[k] = combed[k] - w->in->cut->shift[it.tet][k];
        bw_rotate(bw_rotation_inverse(w->in->cut->comb[it.tet]), own, own);
        for (int k = 0; k < 3; k++) {
            w->value[it.tet][it.corner][k] = own[k];
            if (llabs(own[k]) <= BW_GRID_MAX) continue;
            bw_fail_element(w->ctx, "tet", w->in->mesh->tet_id[it.tet], w->in->mesh->position[v]);
            return bw_fail(w->ctx, BW_E_RANGE, "a parameter of tet %d would leave the exact grid",
                           w->in->mesh->tet_id[it.tet]);
        }
    }
    return BW_OK;
}

/* ---- over all vertices ---- */

static bw_status visit_vertex(walker *w, bw_vertex v) {
    w->star_count = (size_t)(w->first[v + 1] - w->first[v]);
    if (bw_reserve(w->ctx, &w->star, &w->star_room, w->star_count) ||
        bw_reserve(w->ctx, &w->order, &w->order_room, w->star_count) ||
        bw_reserve(w->ctx, &w->stack, &w->stack_room, w->star_count))
        return w->ctx->error.status;
    for (size_t i = 0; i < w->star_count; i++) {
        int32_t it = w->item[w->first[v] + (int32_t)i];
        w->star[i] = (star_item){it / 4, it % 4, BW_NONE, BW_NONE};
        w->slot[it / 4] = (int32_t)i;
    }
    w->fan = 0;
    for (size_t i = 0; i < w->star_count; i++, w->fan++) {
        if (w->star[i].sector != BW_NONE) continue;
        if (find_sectors(w, (int32_t)i) || fan_equations(w, v)) return w->ctx->error.status;
        if (w->system ? keep_divided(w) : place_fan(w, v)) return w->ctx->error.status;
    }
    return BW_OK;
}

static bw_status visit_all(walker *w) {
    for (size_t v = 0; v < w->in->mesh->vertex_count; v++) {
        if (v % 4096 == 0 && bw_poll(w->ctx)) break;
        if (visit_vertex(w, (bw_vertex)v)) break;
    }
    return w->ctx->error.status;
}

static void walker_clear(walker *w) {
    void *blocks[] = {w->first, w->item,  w->line_first, w->line_item, w->line_hinge, w->slot, w->star,
                      w->order, w->stack, w->sector,     w->seen,      w->pool,       w->hash};
    for (size_t i = 0; i < sizeof blocks / sizeof *blocks; i++) bw_free(w->ctx, blocks[i]);
}

/* Lists of tets per vertex and of explicitly aligned hinges per vertex: counting sorts. */
static bw_status list_lines(walker *w) {
    const bw_hinges *hinges = w->in->hinges;
    for (size_t h = 0; h < hinges->count; h++) w->line_count += w->in->seams->line[h] >= 0;
    w->line_first = bw_alloc(w->ctx, w->in->mesh->vertex_count + 2, sizeof *w->line_first);
    w->line_item = bw_alloc(w->ctx, 2 * w->line_count, sizeof *w->line_item);
    w->line_hinge = bw_alloc(w->ctx, w->line_count, sizeof *w->line_hinge);
    if (w->ctx->error.status) return w->ctx->error.status;
    for (size_t h = 0, n = 0; h < hinges->count; h++)
        if (w->in->seams->line[h] >= 0) w->line_hinge[n++] = (bw_hinge)h;
    for (size_t i = 0; i < 2 * w->line_count; i++)
        w->line_first[w->in->mesh->edge[hinges->ring[w->line_hinge[i / 2]].edge][i % 2] + 2]++;
    for (size_t v = 0; v < w->in->mesh->vertex_count; v++) w->line_first[v + 2] += w->line_first[v + 1];
    for (size_t i = 0; i < 2 * w->line_count; i++)
        w->line_item[w->line_first[w->in->mesh->edge[hinges->ring[w->line_hinge[i / 2]].edge][i % 2] + 1]++] =
            (int32_t)(i / 2);
    return BW_OK;
}

static bw_status walker_init(walker *w, bw_context *ctx, const bw_sector_input *in) {
    const bw_tet_mesh *mesh = in->mesh;
    *w = (walker){.ctx = ctx, .in = in};
    w->slot = bw_alloc(ctx, mesh->tet_count, sizeof *w->slot);
    w->first = bw_alloc(ctx, mesh->vertex_count + 2, sizeof *w->first);
    w->item = bw_alloc(ctx, 4 * mesh->tet_count, sizeof *w->item);
    if (ctx->error.status) return ctx->error.status;
    for (size_t i = 0; i < 4 * mesh->tet_count; i++) w->first[mesh->tet[i / 4][i % 4] + 2]++;
    for (size_t v = 0; v < mesh->vertex_count; v++) w->first[v + 2] += w->first[v + 1];
    for (size_t i = 0; i < 4 * mesh->tet_count; i++)
        w->item[w->first[mesh->tet[i / 4][i % 4] + 1]++] = (int32_t)i;
    w->align_column = 3 * in->cut->cut_sheets;
    w->line_column = w->align_column + in->cut->align_sheets;
    if (list_lines(w)) return ctx->error.status;
    w->free_column = w->line_column + 2 * w->line_count;
    if (w->free_column > INT32_MAX / 2)
        return bw_fail(ctx, BW_E_LIMIT, "the core system has too many unknowns");
    return BW_OK;
}

/* What the input has for the sheets' unknowns: means over their facets' corners. */
static bw_status estimate_sheets(walker *w) {
    const bw_tet_mesh *mesh = w->in->mesh;
    const bw_cutset *cut = w->in->cut;
    wide *sum = bw_alloc(w->ctx, w->free_column, sizeof *sum);
    int64_t *count = bw_alloc(w->ctx, w->free_column, sizeof *count);
    w->system->column_count = w->free_column;
    if (!sum || !count || bw_reserve(w->ctx, &w->system->estimate, &w->system->estimate_room, w->free_column))
        goto out;
    for (size_t i = 0; i < 3 * mesh->facet_count; i++) {
        size_t f = i / 3;
        int64_t u[2][3];
        bool forward = cut->side[f] > 0;
        for (int j = 0; j < 2 && mesh->facet_tet[f][j] != BW_NONE; j++) {
            bw_tet t = mesh->facet_tet[f][j];
            bw_cutset_combed(cut, t, w->in->value[t][bw_tet_corner(mesh, t, mesh->facet[f][i % 3])], u[j]);
        }
        if (cut->align_sheet[f] != BW_NONE) {
            sum[w->align_column + (size_t)cut->align_sheet[f]] += u[0][cut->align_axis[f]];
            count[w->align_column + (size_t)cut->align_sheet[f]]++;
        }
        if (!cut->side[f]) continue;
        bw_rotate(cut->rotation[cut->cut_sheet[f]], u[!forward], u[!forward]);
        for (int k = 0; k < 3; k++) {
            sum[3 * cut->cut_sheet[f] + k] += (wide)u[forward][k] - u[!forward][k];
            count[3 * cut->cut_sheet[f] + k]++;
        }
    }
    for (size_t i = 0; i < w->line_count; i++) {
        bw_tet t = w->in->hinges->tet[w->in->hinges->ring[w->line_hinge[i]].begin];
        int axis = line_axis(w, w->line_hinge[i], t);
        int64_t u[3];
        bw_vertex v = mesh->edge[w->in->hinges->ring[w->line_hinge[i]].edge][0];
        bw_cutset_combed(cut, t, w->in->value[t][bw_tet_corner(mesh, t, v)], u);
        for (size_t k = 0; k < 2; k++) {
            sum[w->line_column + 2 * i + k] = u[((size_t)axis + 1 + k) % 3];
            count[w->line_column + 2 * i + k] = 1;
        }
    }
    for (size_t c = 0; c < w->free_column; c++) w->system->estimate[c] = (int64_t)(sum[c] / count[c]);
out:
    bw_free(w->ctx, sum);
    bw_free(w->ctx, count);
    return w->ctx->error.status;
}

void bw_core_system_clear(bw_context *ctx, bw_core_system *system) {
    bw_free(ctx, system->start);
    bw_free(ctx, system->column);
    bw_free(ctx, system->coefficient);
    bw_free(ctx, system->estimate);
    memset(system, 0, sizeof *system);
}

/* Unknowns that keep_divided left without a number get theirs; being the last columns they move to the end of
 * their rows. */
static void number_divided(bw_core_system *system, size_t next) {
    for (size_t r = 0; r < system->row_count; r++) {
        size_t first = system->start[r], last = system->start[r + 1] - 1;
        if (system->column[first] >= 0) continue;
        int64_t factor = system->coefficient[first];
        memmove(system->column + first, system->column + first + 1, (last - first) * sizeof *system->column);
        memmove(system->coefficient + first, system->coefficient + first + 1,
                (last - first) * sizeof *system->coefficient);
        system->column[last] = (int32_t)next++;
        system->coefficient[last] = factor;
    }
}

bw_status bw_sectors_system(bw_context *ctx, const bw_sector_input *input, bw_core_system *system) {
    walker w;
    *system = (bw_core_system){0};
    if (walker_init(&w, ctx, input)) goto out;
    w.system = system;
    if (bw_reserve(ctx, &system->start, &system->start_room, 1) || estimate_sheets(&w) || visit_all(&w))
        goto out;
    number_divided(system, w.free_column);
out:
    walker_clear(&w);
    return ctx->error.status;
}

bw_status bw_sectors_place(bw_context *ctx, const bw_sector_input *input, const int64_t *x,
                           int64_t (*value)[4][3]) {
    walker w;
    if (walker_init(&w, ctx, input)) goto out;
    w.x = x;
    w.value = value;
    visit_all(&w);
out:
    walker_clear(&w);
    return ctx->error.status;
}
