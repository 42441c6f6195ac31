/* Adaptive binary arithmetic coding: the writing half. Readers are in clients/decode/; api/bwh.md tells the arithmetic, which is of integers throughout.
 *
 * A bit is coded with a model: the probability of 0 as seen so far, in 1/65536, and how many bits that rests on. The n-th bit moves it by 2 / (2 n + 3) of the way
 * (the estimator of Krichevsky and Trofimov, a little faster), from the BW_MODEL_MOST-th on always by the same part. The coder is that of LZMA: a range of 32
 * bits, whole bytes leave, a carry goes through the bytes held back.
 *
 * Out of memory is recorded in the context; what is written after that is thrown away.
 */
#ifndef BW_FORMAT_RANGE_CODER_H
#define BW_FORMAT_RANGE_CODER_H

#include "base/context.h"

enum { BW_MODEL_MOST = 127 };

typedef struct {
    uint16_t zero; /* probability of 0, in 1/65536 */
    uint16_t seen;
} bw_bit_model;

typedef struct {
    bw_context *ctx;
    uint8_t *byte;
    size_t count, room;
    uint64_t low;
    uint32_t range;
    uint8_t cache;
    uint64_t pending; /* bytes held back: cache, then 0xff */
    uint32_t rate[BW_MODEL_MOST + 1];
} bw_range_encoder;

/* Bits without a model, the lowest of each first. */
typedef struct {
    bw_context *ctx;
    uint8_t *byte;
    size_t count, room;
    uint64_t hold;
    int have; /* bits held, fewer than 8 */
} bw_bit_writer;

void bw_bit_models_init(bw_bit_model *model, size_t count);

void bw_range_encoder_init(bw_context *ctx, bw_range_encoder *e);
/* byte[count] is all there is then. */
void bw_range_encoder_finish(bw_range_encoder *e);
void bw_range_encoder_clear(bw_range_encoder *e);
void bw_range_put(bw_range_encoder *e, bw_bit_model *model, unsigned bit);
/* A number of `depth` bits, the highest first, with the models of a binary tree: model[1 .. 2^depth - 1]. */
void bw_range_put_tree(bw_range_encoder *e, bw_bit_model *model, int depth, unsigned value);
/* Any number: how many bits it has as a tree of 7 (model[128]), those below the highest as they are. */
void bw_range_put_number(bw_range_encoder *e, bw_bit_model *model, uint64_t value);

void bw_bit_writer_init(bw_context *ctx, bw_bit_writer *w);
void bw_bit_writer_put(bw_bit_writer *w, uint64_t value, int count); /* 0..64 bits */
void bw_bit_writer_finish(bw_bit_writer *w);                         /* zeros up to a whole byte */
void bw_bit_writer_clear(bw_bit_writer *w);

static inline int bw_bit_length(uint64_t value) {
    return value ? 64 - __builtin_clzll(value) : 0;
}

#endif
