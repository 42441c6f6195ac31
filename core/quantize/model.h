/* What a quantization may be: integer lengths of arcs under the rectangularity of patches (Q 7, MC 7.1), with the equalities solved.
 *
 * Arcs that must be equally long in every quantization form a class. A class is either free or implied by one short row: its length
 * is an integer combination of other classes. All solutions of the equalities in integers are reached by integers of the free ones, and only they.
 *
 *     arc  --arc_class-->  class  --form-->  sum of factor * free unknown
 *
 * Invariants
 *  1. Rows are triangular: following rows from any class ends at free classes. form = the row followed to the end.
 *  2. Input lengths (grid units) satisfy every row: class_length is that of all arcs of the class, and is positive where it has arcs.
 *  3. Classes without arcs (weight 0) occur only where an equality had no factor of 1.
 *  4. Classes ascend by their first arc; those without arcs come last.
 */
#ifndef BW_QUANTIZE_MODEL_H
#define BW_QUANTIZE_MODEL_H

#include "complex/complex.h"
#include "quantize/constraint.h"

typedef struct {
    int32_t index; /* of a class, or of a free unknown */
    int32_t factor;
} bw_quant_term;

typedef struct {
    size_t arc_count, class_count, free_count, block_count;
    int32_t *arc_class;       /* [arc] */
    int32_t *class_weight;    /* [class] number of its arcs */
    int64_t *class_length;    /* [class] grid units */
    int32_t *free_class;      /* [free] the class that is this unknown */
    int32_t *class_free;      /* [class] its number among the free ones, or BW_NONE */
    size_t *row_begin;        /* [class + 1] empty for free ones */
    bw_quant_term *row;       /* class = sum of factor * class index */
    size_t *form_begin;       /* [class + 1] */
    bw_quant_term *form;      /* class = sum of factor * free index */
    size_t *extent_begin;     /* [3 * block + axis]: the extent of a block */
    bw_quant_term *extent;    /* = sum of factor * class index */
    double unit;              /* grid units per parameter unit */
} bw_quant_model;

/* Reads the model off a complex. BW_E_RANGE if a factor exceeds 2^20; BW_E_MEMORY. Linear in the complex but for fill-in. */
bw_status bw_quant_model_init(bw_context *ctx, const bw_complex *complex, int32_t grid_exponent, bw_quant_model *model);
void bw_quant_model_clear(bw_context *ctx, bw_quant_model *model);
/* Verifies the invariants, and every rectangularity of the complex for each free unknown alone (so for all solutions). BW_E_CHECK. */
bw_status bw_quant_model_check(bw_context *ctx, const bw_complex *complex, const bw_quant_model *model);

/* class_value[class] from unknown[free]. */
void bw_quant_model_expand(const bw_quant_model *model, const int64_t *unknown, int64_t *class_value);
/* length[arc] from class_value[class]. */
void bw_quant_model_lengths(const bw_quant_model *model, const int64_t *class_value, int64_t *length);
int64_t bw_quant_model_extent(const bw_quant_model *model, size_t block, int axis, const int64_t *class_value);
/* Number of hexes: the sum of the volumes of the blocks; INT64_MAX where it, or a block's, is larger than that. */
int64_t bw_quant_model_hexes(const bw_quant_model *model, const int64_t *class_value);

/* Appends constraint c of `list`, which is on arcs, to `out`, which is on classes (its term[].arc is a class). */
bw_status bw_quant_model_constraint(bw_context *ctx, const bw_quant_model *model, const bw_constraint_list *list, size_t c,
                              bw_constraint_list *out);
/* number[3 * block + axis]: extents that are equal in every quantization share a number below *count. */
bw_status bw_quant_model_number_extents(bw_context *ctx, const bw_quant_model *model, int32_t *number, size_t *count);
/* Appends the non-negative extents of all blocks (Q 8) on classes, equal ones once, those with a single class too. */
bw_status bw_quant_model_extents(bw_context *ctx, const bw_quant_model *model, bw_constraint_list *out);

#endif
