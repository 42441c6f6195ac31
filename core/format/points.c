#include "format/points.h"

#include <math.h>
#include <string.h>

#include "exact/det.h"

typedef __int128 i128;
typedef unsigned __int128 u128;

/* ---- exact values
 * ------------------------------------------------------------------------------------------------ */

static uint64_t gcd64(uint64_t a, uint64_t b) {
    if (!a || !b) return a | b;
    int shift = __builtin_ctzll(a | b);
    a >>= __builtin_ctzll(a);
    while (b) {
        b >>= __builtin_ctzll(b);
        if (a > b) {
            uint64_t t = a;
            a = b, b = t;
        }
        b -= a;
    }
    return a << shift;
}

static void mpz_set_u128(mpz_t z, u128 x) {
    mpz_set_ui(z, (uint64_t)(x >> 64));
    mpz_mul_2exp(z, z, 64);
    mpz_add_ui(z, z, (uint64_t)x);
}

static u128 mpz_get_u128(const mpz_t z) {
    return (u128)mpz_getlimbn(z, 1) << 64 | mpz_getlimbn(z, 0);
}

/* Fractional part of the one coordinate of a facet vertex that is not an integer. Below 2^96: its denominator
 * divides a component of the facet's normal. */
static bw_status add_fraction(bw_context *ctx, bw_points *points, bw_cvertex vertex, mpq_t q[3]) {
    const bw_cell_vertex *v = &points->cells->vertex[vertex];
    bw_status status = bw_reserve(ctx, &points->fraction, &points->fraction_room, points->fraction_count + 1);
    if (status != BW_OK) return status;
    int axis = v->fraction >> 1; /* bit 0, 1 or 2 is set */
    bw_cells_parameter(points->cells, vertex, points->cells->mesh->facet_tet[v->carrier][0], q);
    mpz_fdiv_r(points->scratch[0], mpq_numref(q[axis]), mpq_denref(q[axis]));
    if (mpz_sizeinbase(mpq_denref(q[axis]), 2) > 100)
        return bw_fail(ctx, BW_E_CHECK, "vertex %d of the cell complex has too large a denominator",
                       (int)vertex);
    u128 *fraction = points->fraction[points->fraction_count];
    fraction[0] = mpz_get_u128(points->scratch[0]);
    fraction[1] = mpz_get_u128(mpq_denref(q[axis]));
    points->fraction_of[vertex] = (int32_t)points->fraction_count++;
    return BW_OK;
}

bw_status bw_points_init(bw_context *ctx, bw_points *points, const bw_cells *cells) {
    *points = (bw_points){.cells = cells, .ready = true};
    mpz_inits(points->scratch[0], points->scratch[1], NULL);
    points->fraction_of = bw_alloc(ctx, cells->vertex_count, sizeof *points->fraction_of);
    if (!points->fraction_of) return ctx->error.status;
    mpq_t q[3];
    mpq_inits(q[0], q[1], q[2], NULL);
    bw_status status = BW_OK;
    for (size_t v = 0; v < cells->vertex_count && status == BW_OK; v++) {
        points->fraction_of[v] = BW_NONE;
        if (cells->vertex[v].kind == BW_IN_FACET && cells->vertex[v].fraction)
            status = add_fraction(ctx, points, (bw_cvertex)v, q);
    }
    mpq_clears(q[0], q[1], q[2], NULL);
    return status;
}

void bw_points_clear(bw_context *ctx, bw_points *points) {
    bw_free(ctx, points->fraction_of), bw_free(ctx, points->fraction), bw_free(ctx, points->added);
    if (points->ready) mpz_clears(points->scratch[0], points->scratch[1], NULL);
    *points = (bw_points){0};
}

bw_status bw_points_add(bw_context *ctx, bw_points *points, const bw_added_point *point, bw_point *out) {
    bw_status status = bw_reserve(ctx, &points->added, &points->added_room, points->added_count + 1);
    if (status != BW_OK) return status;
    if (bw_points_count(points) >= INT32_MAX)
        return bw_fail(ctx, BW_E_LIMIT, "the traced mesh has too many vertices");
    *out = (bw_point)bw_points_count(points);
    points->added[points->added_count++] = *point;
    return BW_OK;
}

static const bw_added_point *added_point(const bw_points *points, bw_point point) {
    size_t vertices = points->cells->vertex_count;
    return (size_t)point < vertices ? NULL : &points->added[(size_t)point - vertices];
}

void bw_points_exact(const bw_points *points, bw_point point, bw_tet tet, mpq_t out[3]) {
    const bw_added_point *a = added_point(points, point);
    if (!a) {
        bw_cells_parameter(points->cells, point, tet, out);
    } else if (a->mean[0] == BW_NONE) {
        for (int k = 0; k < 3; k++) mpq_set_si(out[k], a->value[k], 1);
    } else {
        mpq_t q[3];
        mpq_inits(q[0], q[1], q[2], NULL);
        for (int k = 0; k < 3; k++) mpq_set_si(out[k], 0, 1);
        for (int i = 0; i < 4; i++) {
            bw_cells_parameter(points->cells, a->mean[i], tet, q);
            for (int k = 0; k < 3; k++) mpq_add(out[k], out[k], q[k]);
        }
        for (int k = 0; k < 3; k++) mpq_div_2exp(out[k], out[k], 2);
        mpq_clears(q[0], q[1], q[2], NULL);
    }
}

/* Barycentric coordinates in the parametrization, by Cramer's rule, carried over to space. */
static void grid_point_position(const bw_cells *cells, const bw_added_point *a, double out[3]) {
    const int64_t(*value)[3] = (const int64_t(*)[3])cells->map->value[a->tet];
    const double(*x)[3] = (const double(*)[3])cells->mesh->position;
    const bw_vertex *corner = cells->mesh->tet[a->tet];
    double e[3][3], p[3];
    for (int k = 0; k < 3; k++) {
        p[k] = (double)(a->value[k] - value[0][k]);
        for (int i = 0; i < 3; i++) e[i][k] = (double)(value[i + 1][k] - value[0][k]);
        out[k] = x[corner[0]][k];
    }
    double whole = bw_det3_rounded(e[0], e[1], e[2]);
    double weight[3] = {bw_det3_rounded(p, e[1], e[2]) / whole, bw_det3_rounded(e[0], p, e[2]) / whole,
                        bw_det3_rounded(e[0], e[1], p) / whole};
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) out[k] += weight[i] * (x[corner[i + 1]][k] - x[corner[0]][k]);
}

void bw_points_position(const bw_points *points, bw_point point, double out[3]) {
    const bw_added_point *a = added_point(points, point);
    if (!a) {
        bw_cells_position(points->cells, point, out);
    } else if (a->mean[0] == BW_NONE) {
        grid_point_position(points->cells, a, out);
    } else {
        double x[4][3];
        for (int i = 0; i < 4; i++) bw_cells_position(points->cells, a->mean[i], x[i]);
        for (int k = 0; k < 3; k++) out[k] = (x[0][k] + x[1][k] + x[2][k] + x[3][k]) / 4;
    }
}

bw_status bw_points_positions(bw_context *ctx, const bw_points *points, double (**out)[3]) {
    *out = bw_alloc(ctx, bw_points_count(points), sizeof **out);
    if (!*out) return ctx->error.status;
    for (size_t v = 0; v < bw_points_count(points); v++) bw_points_position(points, (bw_point)v, (*out)[v]);
    return BW_OK;
}

/* ---- text
 * -------------------------------------------------------------------------------------------------------- */

static size_t print_u128(u128 x, char *text) {
    static const uint64_t chunk = 10000000000000000000u; /* 10^19 */
    uint64_t part[3];
    int parts = 0;
    do {
        part[parts++] = (uint64_t)(x % chunk);
        x /= chunk;
    } while (x);
    char *p = text;
    for (int i = parts - 1; i >= 0; i--) {
        char digits[20];
        int n = 0;
        for (uint64_t d = part[i]; d; d /= 10) digits[n++] = (char)('0' + d % 10);
        if (i < parts - 1)
            while (n < 19) digits[n++] = '0';
        if (!n) digits[n++] = '0';
        while (n) *p++ = digits[--n];
    }
    return (size_t)(p - text);
}

/* numerator / (denominator 2^exponent), where numerator / denominator is in lowest terms; the numerator is in
 * scratch[0], the denominator in scratch[1]. For what does not fit the fast form below. */
static size_t print_long(bw_points *points, int32_t exponent, char *text) {
    mpz_ptr n = points->scratch[0], d = points->scratch[1];
    if (mpz_sgn(n) == 0) {
        text[0] = '0';
        return 1;
    }
    mp_bitcnt_t up = exponent > 0 ? (mp_bitcnt_t)exponent : 0,
                down = exponent < 0 ? (mp_bitcnt_t)-exponent : 0;
    mp_bitcnt_t shared = mpz_scan1(n, 0) < up ? mpz_scan1(n, 0) : up;
    mpz_tdiv_q_2exp(n, n, shared);
    mpz_mul_2exp(d, d, up - shared);
    shared = mpz_scan1(d, 0) < down ? mpz_scan1(d, 0) : down;
    mpz_tdiv_q_2exp(d, d, shared);
    mpz_mul_2exp(n, n, down - shared);
    mpz_get_str(text, 10, n);
    size_t length = strlen(text);
    if (mpz_cmp_ui(d, 1)) {
        text[length++] = '/';
        mpz_get_str(text + length, 10, d);
        length += strlen(text + length);
    }
    return length;
}

/* The same with a numerator below 2^127 and a denominator below 2^48. */
static size_t print_ratio(bw_points *points, i128 numerator, uint64_t denominator, int32_t exponent,
                          char *text) {
    u128 n = numerator < 0 ? -(u128)numerator : (u128)numerator;
    if (exponent < 0 || exponent > 79) {
        mpz_set_u128(points->scratch[0], n);
        if (numerator < 0) mpz_neg(points->scratch[0], points->scratch[0]);
        mpz_set_ui(points->scratch[1], denominator);
        return print_long(points, exponent, text);
    }
    if (!n) exponent = 0;
    while (exponent > 0 && !(n & 1)) {
        int zeros = (uint64_t)n ? __builtin_ctzll((uint64_t)n) : 63;
        if (zeros > exponent) zeros = exponent;
        n >>= zeros, exponent -= zeros;
    }
    u128 d = (u128)denominator << exponent;
    size_t length = 0;
    if (numerator < 0) text[length++] = '-';
    length += print_u128(n, text + length);
    if (d != 1) {
        text[length++] = '/';
        length += print_u128(d, text + length);
    }
    return length;
}

static const int64_t *value_at(const bw_cells *cells, bw_tet tet, bw_vertex v) {
    return cells->map->value[tet][bw_tet_corner(cells->mesh, tet, v)];
}

/* Where a point of an edge lies: at p + ratio (q - p), the ratio in lowest terms. */
typedef struct {
    const int64_t *p, *q;
    uint64_t numerator, denominator;
} edge_place;

static edge_place place_on_edge(const bw_cells *cells, const bw_cell_vertex *v, bw_tet tet) {
    const bw_vertex *end = cells->mesh->edge[v->carrier];
    uint64_t n = (uint64_t)v->exact[0], d = (uint64_t)v->exact[1], g = gcd64(n, d);
    return (edge_place){value_at(cells, tet, end[0]), value_at(cells, tet, end[1]), n / g, d / g};
}

static size_t print_on_edge(bw_points *points, const edge_place *at, int axis, char *text) {
    int64_t span = at->q[axis] - at->p[axis];
    uint64_t g = gcd64(span < 0 ? -(uint64_t)span : (uint64_t)span, at->denominator);
    uint64_t denominator = at->denominator / g;
    i128 numerator =
        (i128)at->p[axis] * (int64_t)denominator + (i128)(span / (int64_t)g) * (int64_t)at->numerator;
    return print_ratio(points, numerator, denominator, points->cells->map->exponent, text);
}

/* Coordinate `axis` of a facet vertex in the chart of `tet` as whole + sign * fraction. sign 0: an integer.
 */
static int64_t whole_in_facet(const bw_cells *cells, const bw_cell_vertex *v, bw_tet tet, int axis,
                              int *sign) {
    if (tet == cells->mesh->facet_tet[v->carrier][0]) {
        *sign = v->fraction >> axis & 1;
        return v->exact[axis];
    }
    bw_transition t = bw_grid_map_across(cells->mesh, cells->map, v->carrier, cells->mesh->facet_tet[v->carrier][0]);
    int from = bw_rotation_axis[t.rotation][axis], turn = bw_rotation_sign[t.rotation][axis];
    *sign = v->fraction >> from & 1 ? turn : 0;
    return turn * v->exact[from] + t.shift[axis];
}

static size_t print_in_facet(bw_points *points, bw_point point, bw_tet tet, int axis, char *text) {
    const bw_cell_vertex *v = &points->cells->vertex[point];
    int32_t exponent = points->cells->map->exponent;
    int sign;
    int64_t whole = whole_in_facet(points->cells, v, tet, axis, &sign);
    if (!sign) return print_ratio(points, whole, 1, exponent, text);
    const u128 *fraction = points->fraction[points->fraction_of[point]];
    mpz_set_u128(points->scratch[1], fraction[1]);
    mpz_mul_si(points->scratch[1], points->scratch[1], whole);
    mpz_set_u128(points->scratch[0], fraction[0]);
    if (sign < 0) mpz_neg(points->scratch[0], points->scratch[0]);
    mpz_add(points->scratch[0], points->scratch[0], points->scratch[1]);
    mpz_set_u128(points->scratch[1], fraction[1]);
    return print_long(points, exponent, text);
}

static size_t print_mean(bw_points *points, bw_point point, bw_tet tet, char *text) {
    mpq_t q[3];
    mpq_inits(q[0], q[1], q[2], NULL);
    bw_points_exact(points, point, tet, q);
    size_t length = 0;
    for (int k = 0; k < 3; k++) {
        mpz_set(points->scratch[0], mpq_numref(q[k]));
        mpz_set(points->scratch[1], mpq_denref(q[k]));
        length += print_long(points, points->cells->map->exponent, text + length);
        text[length++] = 0;
    }
    mpq_clears(q[0], q[1], q[2], NULL);
    return length;
}

size_t bw_points_print(bw_points *points, bw_point point, bw_tet tet, char *text) {
    const bw_cells *cells = points->cells;
    const bw_added_point *a = added_point(points, point);
    if (a && a->mean[0] != BW_NONE) return print_mean(points, point, tet, text);
    const bw_cell_vertex *v = a ? NULL : &cells->vertex[point];
    edge_place place = {0};
    if (v && v->kind == BW_IN_EDGE) place = place_on_edge(cells, v, tet);
    size_t length = 0;
    for (int k = 0; k < 3; k++) {
        if (place.p)
            length += print_on_edge(points, &place, k, text + length);
        else if (v && v->kind == BW_IN_FACET)
            length += print_in_facet(points, point, tet, k, text + length);
        else
            length += print_ratio(points,
                                  a                         ? a->value[k]
                                  : v->kind == BW_IN_VERTEX ? value_at(cells, tet, v->carrier)[k]
                                                            : v->exact[k],
                                  1, cells->map->exponent, text + length);
        text[length++] = 0;
    }
    return length;
}

/* ---- charts
 * ------------------------------------------------------------------------------------------------------ */

bw_status bw_chart_open(bw_context *ctx, bw_chart *chart, const bw_points *points, bw_tet tet) {
    chart->points = points;
    chart->tet = tet;
    chart->count = 0;
    chart->size = 0;
    int64_t(*value)[3] = points->cells->map->value[tet];
    for (int k = 0; k < 3; k++) {
        chart->origin[k] = value[0][k];
        for (int i = 1; i < 4; i++)
            chart->size = fmax(chart->size, fabs((double)(value[i][k] - value[0][k])));
    }
    return bw_reserve(ctx, &chart->slot, &chart->slot_room, bw_points_count(points));
}

void bw_chart_clear(bw_context *ctx, bw_chart *chart) {
    bw_free(ctx, chart->point), bw_free(ctx, chart->at), bw_free(ctx, chart->slot);
    *chart = (bw_chart){0};
}

/* A vertex of the complex, relative to the origin. In units of 2^-53 size the errors are: 5 in an edge (two
 * roundings of a term up to twice the size, and the sum's), 4 in a facet, 0 elsewhere. */
static void local_vertex(const bw_chart *chart, bw_cvertex vertex, double out[3]) {
    const bw_cells *cells = chart->points->cells;
    const bw_cell_vertex *v = &cells->vertex[vertex];
    if (v->kind == BW_IN_EDGE) {
        const int64_t *p = value_at(cells, chart->tet, cells->mesh->edge[v->carrier][0]);
        const int64_t *q = value_at(cells, chart->tet, cells->mesh->edge[v->carrier][1]);
        double n = (double)v->exact[0], d = (double)v->exact[1];
        for (int k = 0; k < 3; k++)
            out[k] = (double)(p[k] - chart->origin[k]) + n * (double)(q[k] - p[k]) / d;
    } else if (v->kind == BW_IN_FACET) {
        for (int k = 0; k < 3; k++) {
            int sign;
            out[k] = (double)(whole_in_facet(cells, v, chart->tet, k, &sign) - chart->origin[k]);
            if (!sign) continue;
            const u128 *fraction = chart->points->fraction[chart->points->fraction_of[vertex]];
            out[k] += sign * ((double)fraction[0] / (double)fraction[1]);
        }
    } else {
        const int64_t *x = v->kind == BW_IN_VERTEX ? value_at(cells, chart->tet, v->carrier) : v->exact;
        for (int k = 0; k < 3; k++) out[k] = (double)(x[k] - chart->origin[k]);
    }
}

bw_status bw_chart_add(bw_context *ctx, bw_chart *chart, bw_point point, int32_t *slot) {
    bw_status status =
        bw_reserve(ctx, &chart->slot, &chart->slot_room, (size_t)point + 1); /* added since it was opened? */
    if (status == BW_OK && bw_chart_has(chart, point)) {
        *slot = chart->slot[point];
        return BW_OK;
    }
    if (status == BW_OK) status = bw_reserve(ctx, &chart->point, &chart->point_room, chart->count + 1);
    if (status == BW_OK) status = bw_reserve(ctx, &chart->at, &chart->at_room, chart->count + 1);
    if (status != BW_OK) return status;
    double *at = chart->at[chart->count];
    const bw_added_point *a = added_point(chart->points, point);
    if (!a) {
        local_vertex(chart, point, at);
    } else if (a->mean[0] == BW_NONE) {
        for (int k = 0; k < 3; k++) at[k] = (double)(a->value[k] - chart->origin[k]);
    } else {
        double x[4][3];
        for (int i = 0; i < 4; i++) local_vertex(chart, a->mean[i], x[i]);
        for (int k = 0; k < 3; k++) at[k] = (x[0][k] + x[1][k] + x[2][k] + x[3][k]) / 4;
    }
    *slot = chart->slot[point] = (int32_t)chart->count;
    chart->point[chart->count++] = point;
    return BW_OK;
}

/* Rows: the points but the last, relative to it. Returns the largest entry. */
static double differences(const bw_chart *chart, const int32_t *slot, int count, double e[][3]) {
    const double *origin = chart->at[slot[count - 1]];
    double largest = 0;
    for (int i = 0; i + 1 < count; i++)
        for (int k = 0; k < 3; k++) {
            e[i][k] = chart->at[slot[i]][k] - origin[k];
            largest = fmax(largest, fabs(e[i][k]));
        }
    return largest;
}

double bw_chart_volume(const bw_chart *chart, const int32_t slot[4]) {
    double e[3][3];
    differences(chart, slot, 4, e);
    return -bw_det3_rounded(e[0], e[1], e[2]); /* relative to the last corner the order is reversed */
}

/* With D the largest entry (made larger by 2^-47 size, which covers all errors of it) an entry is off by less
 * than 2^-47.9 size; the determinant's six products are off by 18 D^2 of that, and 42 roundings of D^3 come
 * on top, D being at most twice the size: less than 2^-43 D^2 size together. */
int bw_chart_sign_filtered(const bw_chart *chart, const int32_t slot[4]) {
    double e[3][3], largest = differences(chart, slot, 4, e) + 0x1p-47 * chart->size;
    double volume = -bw_det3_rounded(e[0], e[1], e[2]), bound = 0x1p-43 * largest * largest * chart->size;
    return volume > bound ? 1 : volume < -bound ? -1 : 2;
}

static void exact_differences(const bw_chart *chart, const int32_t *slot, int count, mpq_t e[][3]) {
    for (int i = 0; i < count; i++) {
        for (int k = 0; k < 3; k++) mpq_init(e[i][k]);
        bw_points_exact(chart->points, chart->point[slot[i]], chart->tet, e[i]);
    }
    for (int i = 0; i + 1 < count; i++)
        for (int k = 0; k < 3; k++) mpq_sub(e[i][k], e[i][k], e[count - 1][k]);
}

static void clear_differences(int count, mpq_t e[][3]) {
    for (int i = 0; i < count; i++)
        for (int k = 0; k < 3; k++) mpq_clear(e[i][k]);
}

/* out = a[i] b[j] - a[j] b[i] */
static void minor(mpq_t out, mpq_t a[3], mpq_t b[3], int i, int j) {
    mpq_t t;
    mpq_init(t);
    mpq_mul(out, a[i], b[j]);
    mpq_mul(t, a[j], b[i]);
    mpq_sub(out, out, t);
    mpq_clear(t);
}

int bw_chart_sign(const bw_chart *chart, const int32_t slot[4]) {
    int sign = bw_chart_sign_filtered(chart, slot);
    if (sign != 2) return sign;
    mpq_t e[4][3], sum, term;
    mpq_inits(sum, term, NULL);
    exact_differences(chart, slot, 4, e);
    for (int k = 0; k < 3; k++) {
        minor(term, e[1], e[2], (k + 1) % 3, (k + 2) % 3);
        mpq_mul(term, term, e[0][k]);
        mpq_add(sum, sum, term);
    }
    sign = -mpq_sgn(sum);
    clear_differences(4, e);
    mpq_clears(sum, term, NULL);
    return sign;
}

/* A component of the cross product is off by 4 D times an entry's error and 6 roundings of D^2: less than
 * 2^-45 D size. */
bool bw_chart_collinear(const bw_chart *chart, const int32_t slot[3]) {
    double e[2][3], largest = differences(chart, slot, 3, e) + 0x1p-47 * chart->size;
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        if (fabs(e[0][i] * e[1][j] - e[0][j] * e[1][i]) > 0x1p-45 * largest * chart->size) return false;
    }
    mpq_t x[3][3], component;
    mpq_init(component);
    exact_differences(chart, slot, 3, x);
    bool zero = true;
    for (int k = 0; k < 3 && zero; k++) {
        minor(component, x[0], x[1], (k + 1) % 3, (k + 2) % 3);
        zero = mpq_sgn(component) == 0;
    }
    clear_differences(3, x);
    mpq_clear(component);
    return zero;
}
