#include "format/bwh_places.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "hex/predict.h"

_Static_assert(FLT_EVAL_METHOD == 0, "predictions are sums of doubles, rounded after each step");

static const int step_of[3] = {1, 3, 9}; /* in bw_bwh_near */

static uint64_t bits_of(double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return bits;
}

/* ---- as what coordinates are coded --------------------------------------------------------------------------------- */

enum { MOST_DIGITS = 15 };
static const double most_decimal = (double)((int64_t)1 << 44);

/* Is this what value / scale gives back? */
static bool is_decimal(double x, double scale) {
    double value = rint(x * scale);
    return fabs(value) <= most_decimal && bits_of((double)(int64_t)value / scale) == bits_of(x);
}

static bool find_decimal(const bw_hex_mesh *mesh, bw_bwh_places *p) {
    p->kind = BW_BWH_DECIMAL, p->parameter = 0, p->scale = 1;
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++)
        while (!is_decimal(mesh->position[i / 3][i % 3], p->scale)) {
            if (p->parameter++ == MOST_DIGITS) return false;
            p->scale *= 10;
        }
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++)
        if (!is_decimal(mesh->position[i / 3][i % 3], p->scale)) return false; /* too large */
    return true;
}

static void find_low_bits(const bw_hex_mesh *mesh, bw_bwh_places *p) {
    uint64_t used = (uint64_t)1 << 63;
    for (size_t i = 0; i < 3 * mesh->vertex_count; i++) used |= bits_of(mesh->position[i / 3][i % 3]);
    p->kind = BW_BWH_DOUBLES, p->parameter = __builtin_ctzll(used);
}

/* A step of at most 29 bits, so that its products with whole numbers of 24 are exact; not below extent / most. */
static double step_for(double extent, double most) {
    int exponent;
    double part = frexp(extent / most, &exponent);
    double step = ldexp(ceil(ldexp(part, 29)), exponent - 29);
    if (step * most < extent) step = ldexp(ceil(ldexp(part, 29)) + 1, exponent - 29);
    return fmax(step, DBL_MIN);
}

static bw_status find_lattice(bw_context *ctx, const bw_hex_mesh *mesh, int bits, bw_bwh_places *p) {
    p->kind = BW_BWH_LATTICE, p->parameter = bits;
    double high[3];
    bw_predict_box((const double(*)[3])mesh->position, mesh->vertex_count, p->low, high);
    for (int k = 0; k < 3; k++) {
        p->step[k] = step_for(high[k] > p->low[k] ? high[k] - p->low[k] : 1, (double)(((int64_t)1 << bits) - 1));
        if (!isfinite(p->low[k] + p->step[k] * (double)((int64_t)1 << bits))) return bw_fail(ctx, BW_E_LIMIT, "coordinates are too large for a lattice");
    }
    return BW_OK;
}

/* ---- init, clear --------------------------------------------------------------------------------------------------- */

bw_status bw_bwh_places_init(bw_context *ctx, const bw_hex_mesh *mesh, int bits, bw_bwh_places *p) {
    *p = (bw_bwh_places){.ctx = ctx};
    bw_range_encoder_init(ctx, &p->coder);
    bw_bit_writer_init(ctx, &p->plain);
    if (bits) {
        bw_status status = find_lattice(ctx, mesh, bits, p);
        if (status != BW_OK) return status;
    } else if (!find_decimal(mesh, p)) {
        find_low_bits(mesh, p);
    }
    p->value = bw_alloc(ctx, mesh->vertex_count, sizeof *p->value);
    p->bits = bw_alloc(ctx, mesh->vertex_count, sizeof *p->bits);
    p->sign = bw_alloc(ctx, mesh->vertex_count, sizeof *p->sign);
    p->model = bw_alloc(ctx, BW_BWH_PLACE_MODELS, sizeof *p->model);
    if (!p->value || !p->bits || !p->sign || !p->model) return ctx->error.status;
    bw_bit_models_init(p->model, BW_BWH_PLACE_MODELS);
    return BW_OK;
}

void bw_bwh_places_clear(bw_bwh_places *p) {
    bw_free(p->ctx, p->value), bw_free(p->ctx, p->bits), bw_free(p->ctx, p->sign), bw_free(p->ctx, p->model);
    bw_range_encoder_clear(&p->coder);
    bw_bit_writer_clear(&p->plain);
    *p = (bw_bwh_places){0};
}

/* ---- prediction ---------------------------------------------------------------------------------------------------- */

/* near[i]: coordinate k of near->at[i]. */
#define NEAR(i) (p->value[near->at[i]][k])

static double from_line(const bw_bwh_places *p, const bw_bwh_near *near, int s, int k) {
    return near->at[2 * s] < 0 ? NEAR(s) : NEAR(s) + NEAR(s) - NEAR(2 * s);
}

static double from_parallelogram(const bw_bwh_places *p, const bw_bwh_near *near, int s, int t, int k) {
    double corner = NEAR(s) + NEAR(t) - NEAR(s + t), error = 0;
    bool far_s = near->at[2 * s] >= 0, far_t = near->at[2 * t] >= 0;
    if (far_s) {
        double e = NEAR(s) - NEAR(2 * s) - NEAR(s + t) + NEAR(2 * s + t);
        error = e + e;
    }
    if (far_t) {
        double e = NEAR(t) - NEAR(s + t) - NEAR(2 * t) + NEAR(s + 2 * t);
        error = error + e + e;
    }
    if (far_s && far_t) error = error - (NEAR(s + t) - NEAR(2 * s + t) - NEAR(s + 2 * t) + NEAR(2 * s + 2 * t));
    return fabs(error) < 1e-300 ? corner : corner + 0.25 * error; /* a quarter of that is exact */
}

static double foresee(const bw_bwh_places *p, const bw_bwh_near *near, int k) {
    double x;
    switch (near->axes) {
    case 0: x = p->count ? p->value[p->count - 1][k] : 0; break;
    case 1: x = from_line(p, near, 1, k); break;
    case 2: x = from_line(p, near, 3, k); break;
    case 4: x = from_line(p, near, 9, k); break;
    case 3: x = from_parallelogram(p, near, 1, 3, k); break;
    case 5: x = from_parallelogram(p, near, 1, 9, k); break;
    case 6: x = from_parallelogram(p, near, 3, 9, k); break;
    default: x = NEAR(1) + NEAR(3) + NEAR(9) - NEAR(4) - NEAR(10) - NEAR(12) + NEAR(13); break;
    }
    return isfinite(x) ? x : 0;
}

#undef NEAR

/* ---- what is left -------------------------------------------------------------------------------------------------- */

/* Doubles in their order as unsigned integers, without low bits. */
static uint64_t ordered(double value, int drop) {
    uint64_t bits = bits_of(value);
    return (bits >> 63 ? ~bits : bits | (uint64_t)1 << 63) >> drop;
}

static double value_of(const bw_bwh_places *p, double x, int k) {
    if (p->kind == BW_BWH_DOUBLES) return x;
    if (p->kind == BW_BWH_DECIMAL) return rint(x * p->scale);
    double most = (double)(((int64_t)1 << p->parameter) - 1);
    return fmin(fmax(rint((x - p->low[k]) / p->step[k]), 0), most);
}

/* Value minus what was foreseen. */
static int64_t rest_of(const bw_bwh_places *p, double value, double foreseen) {
    if (p->kind == BW_BWH_DOUBLES) return (int64_t)(ordered(value, p->parameter) - ordered(foreseen, p->parameter));
    return (int64_t)(value - floor(foreseen + 0.5));
}

static void put_rest(bw_bwh_places *p, int64_t rest, int class, int expected, int signs, int k) {
    uint64_t size = rest < 0 ? 0 - (uint64_t)rest : (uint64_t)rest;
    int bits = bw_bit_length(size), sign = rest < 0 ? 2 : rest > 0;
    p->bits[p->count][k] = (uint8_t)bits, p->sign[p->count][k] = (uint8_t)sign;
    bw_range_put_tree(&p->coder, &p->model[BW_BWH_HIGH + (class * 17 + expected / 4) * 8], 3, (unsigned)bits / 16);
    bw_range_put_tree(&p->coder, &p->model[BW_BWH_LOW + ((class * 65 + expected) * 5 + bits / 16) * 16], 4, (unsigned)bits % 16);
    if (sign) bw_range_put(&p->coder, &p->model[BW_BWH_SIGN + class * 27 + signs], sign == 2);
    if (bits > 1) bw_range_put(&p->coder, &p->model[BW_BWH_NEXT + bits], size >> (bits - 2) & 1);
    if (bits > 2) bw_bit_writer_put(&p->plain, size & (((uint64_t)1 << (bits - 2)) - 1), bits - 2);
}

void bw_bwh_places_put(bw_bwh_places *p, const double position[3], const bw_bwh_near *near) {
    for (int k = 0; k < 3; k++) {
        int class = 0, bits = 0, signs = 0;
        for (int a = 0; a < 3; a++)
            if (near->axes >> a & 1) {
                int32_t u = near->at[step_of[a]];
                class++, bits += p->bits[u][k], signs = 3 * signs + p->sign[u][k];
            }
        double value = value_of(p, position[k], k), foreseen = foresee(p, near, k);
        put_rest(p, rest_of(p, value, foreseen), class, class ? bits / class : 0, signs, k);
        p->value[p->count][k] = value;
    }
    p->count++;
}
