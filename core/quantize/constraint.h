/* Linear constraints on the integer lengths of arcs, in one pool.
 *
 * Constraint c reads: sum of factor * length[arc] over term[begin[c]] .. term[begin[c + 1] - 1], related to bound[c].
 *
 * Invariants
 *  1. begin has count + 1 entries once anything was added (or none at all).
 *  2. The arcs of a constraint ascend and are distinct, no factor is 0: so equal constraints are equal arrays. A constraint
 *     may have no term at all (0 >= bound), which no quantization can help.
 */
#ifndef BW_QUANTIZE_CONSTRAINT_H
#define BW_QUANTIZE_CONSTRAINT_H

#include <stdbool.h>

#include "base/context.h"
#include "base/index.h"

typedef struct {
    bw_arc arc;
    int32_t factor;
} bw_term;

typedef enum { BW_AT_LEAST, BW_EQUAL } bw_relation;

/* Why a constraint is there. */
typedef enum {
    BW_RULE_RECTANGLE,  /* opposite sides of a patch are equally long (Q 7) */
    BW_RULE_EXTENT,     /* no block has a negative extent (Q 8) */
    BW_RULE_LINK,       /* (i) a singular link does not collapse (Q 10) */
    BW_RULE_SEPARATION, /* (ii) critical entities do not coincide (Q 11) */
    BW_RULE_REGION,     /* (iii) a cycle in a boundary region does not collapse (Q 12) */
    BW_RULE_VOLUME,     /* (iv) a cycle in the volume does not collapse (Q 12) */
    BW_RULE_COUNT
} bw_rule;

const char *bw_rule_name(bw_rule rule); /* "rectangle", ... */

typedef struct {
    size_t count;
    size_t *begin; /* [count + 1] */
    size_t begin_room;
    bw_term *term;
    size_t term_room;
    int64_t *bound;    /* [count] */
    size_t bound_room;
    uint8_t *relation; /* [count] bw_relation */
    size_t relation_room;
    uint8_t *rule;     /* [count] bw_rule */
    size_t rule_room;
} bw_constraint_list;

void bw_constraint_clear(bw_context *ctx, bw_constraint_list *list);

/* Appends a constraint. The terms may come in any order and repeat arcs; they are sorted and summed up, so `terms` is changed. On failure the
 * list is as it was. O(n log n). */
bw_status bw_constraint_add(bw_context *ctx, bw_constraint_list *list, bw_rule rule, bw_relation relation, bw_term *terms,
                            size_t n, int64_t bound);
/* Appends a copy of constraint c of another list. */
bw_status bw_constraint_copy(bw_context *ctx, bw_constraint_list *list, const bw_constraint_list *from, size_t c);

/* The value of the left side. */
int64_t bw_constraint_value(const bw_constraint_list *list, size_t c, const int64_t *length);
bool bw_constraint_holds(const bw_constraint_list *list, size_t c, const int64_t *length);
/* The first constraint that does not hold; list->count if all do. */
size_t bw_constraint_first_broken(const bw_constraint_list *list, const int64_t *length);

#endif
