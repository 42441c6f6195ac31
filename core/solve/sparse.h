/* Sparse symmetric positive definite systems: one interface in front of CHOLMOD.
 *
 *     new (pattern, analysed once) -> factor (values) -> solve, solve, ...  -> factor ... -> free
 *
 * The factorization is simplicial: no BLAS, whose results depend on the library that is installed and on its threads. So the same values give the same bits.
 */
#ifndef BW_SOLVE_SPARSE_H
#define BW_SOLVE_SPARSE_H

#include "base/context.h"

typedef struct bw_sparse bw_sparse;

/* A matrix of order n that is a sum of `count` terms, term i at (row[i], column[i]) and, unless on the diagonal, at (column[i], row[i]). Positions may repeat.
 * row and column are not kept. Errors: BW_E_MEMORY. O(count log count + fill-in). */
bw_status bw_sparse_new(bw_context *ctx, size_t n, size_t count, const int32_t *row, const int32_t *column, bw_sparse **out);
void bw_sparse_free(bw_context *ctx, bw_sparse *sparse); /* NULL is fine */
/* Factors the matrix with these terms, value[count], and `shift` added to its diagonal. *definite is false if it is not positive definite: then it cannot solve. */
bw_status bw_sparse_factor(bw_context *ctx, bw_sparse *sparse, const double *value, double shift, bool *definite);
/* x = A^-1 b; may be the same array. */
bw_status bw_sparse_solve(bw_context *ctx, bw_sparse *sparse, const double *b, double *x);

#endif
