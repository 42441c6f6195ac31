#include "hex/lattice.h"

#include <math.h>

/* Corners of facet i, in the order in which its normal points to corner i. */
static const uint8_t facet_corner[4][3] = {{1, 3, 2}, {0, 2, 3}, {0, 3, 1}, {0, 1, 2}};

enum { BITS_OF_DIFFERENCE = 54, BITS_OF_SUM = 126 };

bw_status bw_lattice_init(bw_context *ctx, const bw_igm *igm, int32_t subdivide, bw_lattice *lattice) {
    int32_t e = igm->map.exponent;
    *lattice = (bw_lattice){.igm = igm, .shift = e > 0 ? e : 0};
    bool fits = subdivide > 0 && e <= 60 && e >= -40;
    if (fits) {
        lattice->unit = (int64_t)1 << lattice->shift;
        lattice->factor = 2 * (int64_t)subdivide * ((int64_t)1 << (e < 0 ? -e : 0));
        fits = lattice->factor <= ((int64_t)1 << 62) / BW_GRID_MAX;
    }
    return fits ? BW_OK : bw_fail(ctx, BW_E_RANGE, "hexes of 1/%d of a unit are finer than the exact grid can tell", subdivide);
}

static int64_t floor_shift(int64_t x, int shift) { return x >> shift; } /* arithmetic: rounds down */

static int bits_of(uint64_t x) { return x ? 64 - __builtin_clzll(x) : 0; }
static uint64_t magnitude(int64_t x) { return x < 0 ? 0 - (uint64_t)x : (uint64_t)x; }

/* Whether everything that bw_lattice_side and the cube test add up stays below 2^126. */
static bool fits(const bw_lattice *lattice, const bw_lattice_tet *tet) {
    uint64_t widest = 0;
    for (int i = 1; i < 4; i++)
        for (int k = 0; k < 3; k++) {
            uint64_t d = magnitude(tet->value[i][k] - tet->value[0][k]);
            if (d > widest) widest = d;
        }
    int bits = bits_of(widest), steps = bits_of((widest >> lattice->shift) + 8);
    return bits + 1 <= BITS_OF_DIFFERENCE && 2 * (bits + 1) + 1 + steps + 3 <= BITS_OF_SUM;
}

/* offset = floor(n . (base * unit - a) / unit), and whether something is left over. */
static void set_offset(const bw_lattice *lattice, bw_lattice_tet *tet, int i) {
    const int64_t *a = tet->value[facet_corner[i][0]];
    const bw_wide low_bits = (bw_wide)lattice->unit - 1;
    bw_wide whole = 0, rest = 0;
    for (int k = 0; k < 3; k++) {
        int64_t v = tet->base[k] * lattice->unit - a[k];
        int64_t v_high = floor_shift(v, lattice->shift), v_low = v - v_high * lattice->unit;
        bw_wide n = tet->normal[i][k];
        whole += n * v_high + (n >> lattice->shift) * v_low;
        rest += (n & low_bits) * v_low;
    }
    tet->offset[i] = whole + (rest >> lattice->shift);
    tet->fraction[i] = (rest & low_bits) != 0;
}

bw_status bw_lattice_tet_init(bw_context *ctx, const bw_lattice *lattice, bw_tet t, bw_lattice_tet *tet) {
    const bw_igm *igm = lattice->igm;
    for (int i = 0; i < 12; i++) tet->value[i / 3][i % 3] = lattice->factor * igm->map.value[t][i / 3][i % 3];
    if (!fits(lattice, tet)) return bw_fail(ctx, BW_E_RANGE, "tet %d spans too many hexes", igm->mesh.tet_id[t]);
    for (int k = 0; k < 3; k++) {
        tet->base[k] = floor_shift(tet->value[0][k], lattice->shift);
        for (int i = 0; i < 4; i++) tet->local[i][k] = (double)(tet->value[i][k] - tet->base[k] * lattice->unit) / (double)lattice->unit;
    }
    for (int i = 0; i < 4; i++) {
        const int64_t *a = tet->value[facet_corner[i][0]], *b = tet->value[facet_corner[i][1]], *c = tet->value[facet_corner[i][2]];
        for (int k = 0; k < 3; k++) {
            int p = (k + 1) % 3, q = (k + 2) % 3;
            tet->normal[i][k] = (bw_wide)(b[p] - a[p]) * (c[q] - a[q]) - (bw_wide)(b[q] - a[q]) * (c[p] - a[p]);
        }
        set_offset(lattice, tet, i);
    }
    return BW_OK;
}

static int64_t half_up(int64_t x) { return (x >> 1) + (x & 1); }

void bw_lattice_columns(const bw_lattice_tet *tet, int parity, int64_t range[2]) {
    double low = tet->local[0][0], high = low;
    for (int i = 1; i < 4; i++) low = fmin(low, tet->local[i][0]), high = fmax(high, tet->local[i][0]);
    /* Rounding is far below 2^-20 steps; rows that it lets in are found empty. */
    range[0] = half_up(tet->base[0] + (int64_t)ceil(low - 0x1p-20) - parity);
    range[1] = (tet->base[0] + (int64_t)floor(high + 0x1p-20) - parity) >> 1;
}

void bw_lattice_rows(const bw_lattice_tet *tet, int parity, int64_t x, int64_t range[2]) {
    const double at = (double)(2 * x + parity - tet->base[0]), near = 0x1p-20;
    double low = INFINITY, high = -INFINITY;
    for (int i = 0; i < 4; i++) {
        const double *p = tet->local[i];
        for (int j = i + 1; j < 4; j++) {
            const double *q = tet->local[j];
            double from = fmin(p[0], q[0]), to = fmax(p[0], q[0]), y[2] = {p[1], q[1]};
            if (at < from - near || at > to + near) continue;
            if (to - from > 0x1p-10) y[0] = y[1] = p[1] + (q[1] - p[1]) * fmin(1, fmax(0, (at - p[0]) / (q[0] - p[0])));
            low = fmin(low, fmin(y[0], y[1])), high = fmax(high, fmax(y[0], y[1]));
        }
    }
    range[0] = 0, range[1] = -1;
    if (low > high) return;
    /* Where an edge is longer than 2^-10 steps in x, an error of 2^-20 there is one of at most 2^-10 times its extent in y. */
    double slack = 0x1p-9 * (1 + (high - low));
    range[0] = half_up(tet->base[1] + (int64_t)ceil(low - slack) - parity);
    range[1] = (tet->base[1] + (int64_t)floor(high + slack) - parity) >> 1;
}

/* floor(a / b), b > 0: the quotient of doubles is off by less than one, for it is below 2^40. */
static int64_t floor_divide(bw_wide a, bw_wide b) {
    int64_t q = (int64_t)floor((double)a / (double)b);
    while ((bw_wide)q * b > a) q--;
    while ((bw_wide)(q + 1) * b <= a) q++;
    return q;
}

void bw_lattice_row_init(const bw_lattice_tet *tet, int parity, int64_t x, int64_t y, bw_lattice_row *row) {
    const int64_t dx = 2 * x + parity - tet->base[0], dy = 2 * y + parity - tet->base[1];
    int64_t low = INT64_MIN, high = INT64_MAX;
    *row = (bw_lattice_row){.low = 0, .high = -1};
    for (int i = 0; i < 4; i++) {
        bw_wide c = row->start[i] = tet->offset[i] + tet->normal[i][0] * dx + tet->normal[i][1] * dy, n = tet->normal[i][2];
        if (n > 0) {
            int64_t z = -floor_divide(c, n);
            if (z > low) low = z;
        } else if (n < 0) {
            int64_t z = floor_divide(c, -n);
            if (z < high) high = z;
        } else if (c < 0) {
            return;
        } else if (c == 0 && !tet->fraction[i]) {
            row->flat |= (uint8_t)(1 << i);
        }
    }
    row->low = half_up(low + tet->base[2] - parity);
    row->high = (high + tet->base[2] - parity) >> 1;
    if (row->low > row->high) return;
    row->base_low = 2 * row->low + parity - tet->base[2];
    for (int i = 0; i < 4; i++) {
        bw_wide n = tet->normal[i][2];
        row->start[i] += n * row->base_low;
        if (tet->fraction[i]) continue;
        if (n > 0 && row->start[i] == 0) row->at_low |= (uint8_t)(1 << i);
        if (n < 0 && row->start[i] + n * (2 * (row->high - row->low)) == 0) row->at_high |= (uint8_t)(1 << i);
    }
}

static bw_wide absolute(bw_wide x) { return x < 0 ? -x : x; }

/* Separating axes of a triangle and an open cube with half edges of one step: the normals of the cube and of the facet, and the cross products of their edges. The
 * cube is open, so intervals that only touch are apart. */
bool bw_lattice_facet_in_cube(const bw_lattice *lattice, const bw_lattice_tet *tet, int facet, const int64_t centre[3]) {
    int64_t v[3][3];
    const int64_t unit = lattice->unit;
    for (int i = 0; i < 3; i++)
        for (int k = 0; k < 3; k++) v[i][k] = tet->value[facet_corner[facet][i]][k] - centre[k] * unit;
    for (int k = 0; k < 3; k++) {
        if (v[0][k] >= unit && v[1][k] >= unit && v[2][k] >= unit) return false;
        if (v[0][k] <= -unit && v[1][k] <= -unit && v[2][k] <= -unit) return false;
    }
    bw_wide at = bw_lattice_side(tet, facet, centre), reach = 0;
    for (int k = 0; k < 3; k++) reach += absolute(tet->normal[facet][k]);
    if (at >= reach || at + tet->fraction[facet] <= -reach) return false;
    for (int i = 0; i < 3; i++) {
        const int64_t *a = v[i], *b = v[(i + 1) % 3], *c = v[(i + 2) % 3];
        for (int k = 0; k < 3; k++) {
            int p = (k + 1) % 3, q = (k + 2) % 3;
            int64_t dp = b[p] - a[p], dq = b[q] - a[q];
            bw_wide edge = (bw_wide)dq * a[p] - (bw_wide)dp * a[q], corner = (bw_wide)dq * c[p] - (bw_wide)dp * c[q];
            bw_wide r = (bw_wide)unit * ((dp < 0 ? -dp : dp) + (dq < 0 ? -dq : dq));
            if (r && ((edge >= r && corner >= r) || (edge <= -r && corner <= -r))) return false;
        }
    }
    return true;
}

bw_status bw_lattice_across(bw_context *ctx, const bw_lattice *lattice, bw_facet facet, bw_tet from, bw_transition *out) {
    const bw_igm *igm = lattice->igm;
    *out = bw_grid_map_across(&igm->mesh, &igm->map, facet, from);
    for (int k = 0; k < 3; k++) {
        bw_wide s = (bw_wide)out->shift[k] * lattice->factor;
        if (s & (lattice->unit - 1)) return bw_fail(ctx, BW_E_CHECK, "the shift across facet %d is not whole", facet);
        out->shift[k] = (int64_t)(s >> lattice->shift);
    }
    return BW_OK;
}
