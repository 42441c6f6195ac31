/* The foldover-free energy (foldover.h) of one tet, with its gradient and a positive semidefinite Hessian.
 *
 * J is the Jacobian from the wanted shape of a tet to the present one. The energy f(J) is 5 at least, for a rotation. It depends on the singular values alone, so the eigenvectors of its Hessian are known up to a matrix of order 3 (Smith, de Goes, Kim:
 * Analytic eigensystems for isotropic distortion energies, 2019); negative eigenvalues are left out.
 */
#ifndef BW_SOLVE_DISTORTION_H
#define BW_SOLVE_DISTORTION_H

/* A 3 by 3 matrix as U diag(s) V^T with rotations U and V, whose columns are u[c] and v[c]; |s[0]| >= |s[1]| >= |s[2]|, only s[2] may be negative. */
void bw_svd3(const double matrix[3][3], double u[3][3], double s[3], double v[3][3]);

double bw_det3(const double m[3][3]);
/* out = m^-1; returns the determinant, and leaves out alone if it is 0. */
double bw_inverse3(const double m[3][3], double out[3][3]);

/* f; infinite where D is not positive and epsilon 0. */
double bw_distortion(const double jacobian[3][3], double epsilon);
/* The same with derivatives by the corners, when the Jacobian is linear in them: dJ[a][b] / d corner[i][a] = slope[i][b]. Index 3 * corner + axis; of the Hessian
 * only the lower triangle is set. */
double bw_distortion_expand(const double jacobian[3][3], const double slope[4][3], double epsilon, double gradient[12], double hessian[12][12]);

#endif
