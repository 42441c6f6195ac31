#include "hex/quality.h"

#include <math.h>
#include <string.h>

#include "exact/det.h"
#include "hex/skin.h"

static double length_of(const double a[3]) { return sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]); }

double bw_hex_corner_jacobian(const double corner[8][3], int c) {
    double e[3][3], lengths = 1;
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 3; i++) e[k][i] = corner[c ^ 1 << k][i] - corner[c][i];
        lengths *= length_of(e[k]);
    }
    double d = bw_det3_rounded(e[0], e[1], e[2]);
    int mirrored = (c ^ c >> 1 ^ c >> 2) & 1; /* edges lead backwards along an odd number of axes */
    return lengths > 0 ? (mirrored ? -d : d) / lengths : 0;
}

double bw_hex_scaled_jacobian(const double corner[8][3]) {
    double least = bw_hex_corner_jacobian(corner, 0);
    for (int c = 1; c < 8; c++) least = fmin(least, bw_hex_corner_jacobian(corner, c));
    return least;
}

void bw_hex_corners(const bw_hex_mesh *mesh, bw_hex hex, double corner[8][3]) {
    for (int c = 0; c < 8; c++) memcpy(corner[c], mesh->position[mesh->hex[hex][c]], sizeof corner[c]);
}

/* Integral of the Jacobian's determinant over the unit cube: exact with two Gauss points along each axis, for it is quadratic in each. */
static double volume_of(const double corner[8][3]) {
    static const double gauss[2] = {0.21132486540518712, 0.78867513459481288};
    double sum = 0;
    for (int g = 0; g < 8; g++) {
        double at[3] = {gauss[g & 1], gauss[g >> 1 & 1], gauss[g >> 2]}, j[3][3] = {{0}};
        for (int c = 0; c < 8; c++)
            for (int k = 0; k < 3; k++) {
                double w = c >> k & 1 ? 1 : -1;
                for (int i = 0; i < 3; i++)
                    if (i != k) w *= c >> i & 1 ? at[i] : 1 - at[i];
                for (int i = 0; i < 3; i++) j[k][i] += w * corner[c][i];
            }
        sum += bw_det3_rounded(j[0], j[1], j[2]) / 8;
    }
    return sum;
}

static void keep_worst(bw_hex_quality *q, bw_hex hex, double value, const double corner[8][3]) {
    if (q->worst_count == BW_HEX_WORST && !(value < q->worst[BW_HEX_WORST - 1].scaled_jacobian)) return;
    size_t at = q->worst_count < BW_HEX_WORST ? q->worst_count++ : BW_HEX_WORST - 1;
    for (; at > 0 && q->worst[at - 1].scaled_jacobian > value; at--) q->worst[at] = q->worst[at - 1];
    q->worst[at] = (bw_hex_worst){.hex = hex, .scaled_jacobian = value};
    for (int c = 0; c < 8; c++)
        for (int k = 0; k < 3; k++) q->worst[at].centre[k] += corner[c][k] / 8;
}

static void add(bw_hex_range *range, double value, bool first) {
    range->min = first ? value : fmin(range->min, value);
    range->max = first ? value : fmax(range->max, value);
    range->mean += value;
}

/* The bin of a scaled Jacobian; the first for what is no number. */
static int bin_of(double value) {
    double bin = (value + 1) * (BW_HEX_BINS / 2);
    return bin >= BW_HEX_BINS ? BW_HEX_BINS - 1 : bin > 0 ? (int)bin : 0;
}

static bw_status measure_hexes(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_quality *q) {
    q->hexes = mesh->hex_count;
    for (size_t h = 0; h < mesh->hex_count; h++) {
        double corner[8][3];
        bw_hex_corners(mesh, (bw_hex)h, corner);
        double value = bw_hex_scaled_jacobian((const double(*)[3])corner);
        if (h % 65536 == 0 && bw_poll(ctx)) return ctx->error.status;
        q->histogram[bin_of(value)]++;
        q->nonpositive += !(value > 0);
        q->volume += volume_of((const double(*)[3])corner);
        add(&q->scaled_jacobian, value, h == 0);
        keep_worst(q, (bw_hex)h, value, (const double(*)[3])corner);
    }
    if (mesh->hex_count) q->scaled_jacobian.mean /= (double)mesh->hex_count;
    return BW_OK;
}

static void measure_edges(const bw_hex_mesh *mesh, const bw_hex_skin *skin, bw_hex_quality *q) {
    for (size_t e = 0; e < skin->edge_count; e++) {
        const bw_hex_edge *edge = &skin->edge[e];
        double d[3];
        for (int k = 0; k < 3; k++) d[k] = mesh->position[edge->vertex[1]][k] - mesh->position[edge->vertex[0]][k];
        add(&q->edge_length, length_of(d), e == 0);
        (edge->boundary ? q->boundary : q->inner)[edge->valence < BW_HEX_VALENCES ? edge->valence : BW_HEX_VALENCES - 1]++;
    }
    if (skin->edge_count) q->edge_length.mean /= (double)skin->edge_count;
}

bw_status bw_hex_measure(bw_context *ctx, const bw_hex_mesh *mesh, bw_hex_quality *quality) {
    bw_hex_skin skin;
    *quality = (bw_hex_quality){0};
    if (bw_hex_skin_init_all(ctx, mesh, &skin) == BW_OK && measure_hexes(ctx, mesh, quality) == BW_OK) measure_edges(mesh, &skin, quality);
    bw_hex_skin_clear(ctx, &skin);
    return ctx->error.status;
}
