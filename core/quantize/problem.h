/* One quantization to be found: model, range, size, and the constraints known so far (Q 5.2).
 *
 *     minimize  sum over classes of weight * (value - target)^2,   target = scale * input length
 *
 * Values are integer lengths of classes (model.h). Two of them with the same number are the same quantization.
 */
#ifndef BW_QUANTIZE_PROBLEM_H
#define BW_QUANTIZE_PROBLEM_H

#include "base/kinds.h"
#include "quantize/model.h"

/* Decides validity: appends to `violated` constraints on arcs that `length` breaks; none: valid. */
typedef struct {
    bw_status (*separate)(void *user, const int64_t *length, bw_constraint_list *violated); /* NULL: every length is valid */
    void *user;
    uint64_t calls, rounds; /* rounds: calls that found something */
    double seconds;
} bw_quant_oracle;

typedef struct {
    const bw_quant_model *model; /* borrowed */
    bw_quantize_range range;
    double scale;
    double *target;          /* [class] */
    bw_constraint_list rows; /* on classes */
    int64_t *length;         /* [arc] scratch */
} bw_quant_problem;

/* Starts with the constraints that the range alone asks for. */
bw_status bw_quant_problem_init(bw_context *ctx, const bw_quant_model *model, bw_quantize_range range, bw_quant_problem *p);
void bw_quant_problem_clear(bw_context *ctx, bw_quant_problem *p);
void bw_quant_problem_set_scale(bw_quant_problem *p, double scale);
/* Appends constraints on arcs that are new. *added: how many. */
bw_status bw_quant_problem_add(bw_context *ctx, bw_quant_problem *p, const bw_constraint_list *list, size_t *added);

/* The least value of a class; INT64_MIN if there is none. */
int64_t bw_quant_problem_least(const bw_quant_problem *p, size_t class);
double bw_quant_problem_objective(const bw_quant_problem *p, const int64_t *value);
/* Whether values are in range and satisfy the constraints known so far. */
bool bw_quant_problem_allows(const bw_quant_problem *p, const int64_t *value);
/* Asks the oracle about values and adds what it finds; *valid tells whether it found nothing. */
bw_status bw_quant_problem_separate(bw_context *ctx, bw_quant_problem *p, bw_quant_oracle *oracle, const int64_t *value, bool *valid);

/* A lower bound of the objective without linear programming: each class at its best, and constraints on disjoint classes at what they
 * add at least. */
bw_status bw_quant_problem_bound(bw_context *ctx, const bw_quant_problem *p, double *bound);

#endif
