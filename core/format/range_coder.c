#include "format/range_coder.h"

void bw_bit_models_init(bw_bit_model *model, size_t count) {
    for (size_t i = 0; i < count; i++) model[i] = (bw_bit_model){.zero = 1 << 15};
}

/* ---- the range ----------------------------------------------------------------------------------------------------- */

void bw_range_encoder_init(bw_context *ctx, bw_range_encoder *e) {
    *e = (bw_range_encoder){.ctx = ctx, .range = UINT32_MAX, .pending = 1};
    for (uint32_t n = 0; n <= BW_MODEL_MOST; n++) e->rate[n] = 131072 / (2 * n + 3);
}

void bw_range_encoder_clear(bw_range_encoder *e) {
    bw_free(e->ctx, e->byte);
    *e = (bw_range_encoder){0};
}

static void shift_low(bw_range_encoder *e) {
    if (e->low < 0xff000000u || e->low >> 32) {
        uint8_t carry = (uint8_t)(e->low >> 32);
        if (bw_reserve(e->ctx, &e->byte, &e->room, e->count + (size_t)e->pending) != BW_OK) e->count = 0;
        for (; e->pending; e->pending--) {
            if (e->count < e->room) e->byte[e->count++] = (uint8_t)(e->cache + carry);
            e->cache = 0xff;
        }
        e->cache = (uint8_t)(e->low >> 24);
    }
    e->pending++;
    e->low = (e->low & 0x00ffffff) << 8;
}

void bw_range_encoder_finish(bw_range_encoder *e) {
    for (int i = 0; i < 5; i++) shift_low(e);
}

static inline void normalize(bw_range_encoder *e) {
    for (; e->range < 1u << 24; e->range <<= 8) shift_low(e);
}

void bw_range_put(bw_range_encoder *e, bw_bit_model *model, unsigned bit) {
    uint32_t bound = (e->range >> 12) * (uint32_t)(model->zero >> 4), rate = e->rate[model->seen];
    if (bit) {
        e->low += bound, e->range -= bound;
        model->zero = (uint16_t)(model->zero - (model->zero * rate >> 16));
    } else {
        e->range = bound;
        model->zero = (uint16_t)(model->zero + ((65536 - model->zero) * rate >> 16));
    }
    model->seen = (uint16_t)(model->seen + (model->seen < BW_MODEL_MOST));
    normalize(e);
}

void bw_range_put_tree(bw_range_encoder *e, bw_bit_model *model, int depth, unsigned value) {
    unsigned node = 1;
    for (int i = depth; i-- > 0;) {
        bw_range_put(e, &model[node], value >> i & 1);
        node = 2 * node + (value >> i & 1);
    }
}

static void put_even(bw_range_encoder *e, unsigned bit) {
    e->range >>= 1;
    if (bit) e->low += e->range;
    normalize(e);
}

void bw_range_put_number(bw_range_encoder *e, bw_bit_model *model, uint64_t value) {
    int bits = bw_bit_length(value);
    bw_range_put_tree(e, model, 7, (unsigned)bits);
    for (int i = bits - 1; i-- > 0;) put_even(e, value >> i & 1);
}

/* ---- bits as they are ---------------------------------------------------------------------------------------------- */

void bw_bit_writer_init(bw_context *ctx, bw_bit_writer *w) {
    *w = (bw_bit_writer){.ctx = ctx};
}

void bw_bit_writer_clear(bw_bit_writer *w) {
    bw_free(w->ctx, w->byte);
    *w = (bw_bit_writer){0};
}

static void put_byte(bw_bit_writer *w) {
    if (bw_reserve(w->ctx, &w->byte, &w->room, w->count + 1) == BW_OK) w->byte[w->count++] = (uint8_t)w->hold;
    w->hold >>= 8, w->have -= 8;
}

void bw_bit_writer_put(bw_bit_writer *w, uint64_t value, int count) {
    if (count > 32) {
        bw_bit_writer_put(w, value & UINT32_MAX, 32);
        bw_bit_writer_put(w, value >> 32, count - 32);
        return;
    }
    w->hold |= (value & (((uint64_t)1 << count) - 1)) << w->have;
    for (w->have += count; w->have >= 8;) put_byte(w);
}

void bw_bit_writer_finish(bw_bit_writer *w) {
    if (w->have) w->have = 8, put_byte(w);
}
