/* Lengths of the corrected vectors of a triad, and their derivatives (calibkit/instruments/accelerometer/numeric/norms.py), in one pass.
 *
 * Every product, sum, quotient and root is the one that is done with arrays without this, each rounded by itself. The products
 * of matrices stay with BLAS, whose order of summation is its own.
 */

#include <math.h>
#include <stdint.h>

#include "doubles.h"

enum { BLOCK = 256 };

INLINED void products(const double *restrict a, const double *restrict b, int64_t count, double *restrict into)
{
    for (int64_t i = 0; i < count; i++)
        into[i] = a[i] * b[i];
}

INLINED void lengths(const double *vector, const double *shifted, const double *root, int64_t size, double gravity,
                     double *residual, double *direction, double *slopes)
{
    double length[BLOCK], scale[BLOCK];
    for (int64_t begin = 0; begin < size; begin += BLOCK) {
        const int64_t count = size - begin < BLOCK ? size - begin : BLOCK;
        const double *x = vector + begin, *y = x + size, *z = y + size, *weight = root + begin;
        double *left = residual + begin;
        for (int64_t i = 0; i < count; i++)
            length[i] = x[i] * x[i] + y[i] * y[i] + z[i] * z[i];
        for (int64_t i = 0; i < count; i++)
            length[i] = sqrt(length[i]);
        for (int64_t i = 0; i < count; i++)
            scale[i] = weight[i] / length[i];
        for (int64_t i = 0; i < count; i++)
            length[i] -= gravity;
        products(length, weight, count, left);
        for (int k = 0; k < 3; k++)
            products(vector + k * size + begin, scale, count, direction + k * size + begin);
        double *row = slopes + begin;
        for (int k = 0; k < 3; k++)
            for (int j = 0; j <= k; j++, row += size)
                products(direction + k * size + begin, shifted + j * size + begin, count, row);
    }
}

static void lengths_plainly(const double *vector, const double *shifted, const double *root, int64_t size, double gravity,
                            double *residual, double *direction, double *slopes)
{
    lengths(vector, shifted, root, size, gravity, residual, direction, slopes);
}

#if WIDE
/* The same for processors with wider registers: without fused products, so that the numbers are the same. */
__attribute__((target("avx2"))) static void lengths_widely(const double *vector, const double *shifted, const double *root,
                                                           int64_t size, double gravity, double *residual, double *direction,
                                                           double *slopes)
{
    lengths(vector, shifted, root, size, gravity, residual, direction, slopes);
}
#endif

/* Of vectors and shifted indications, three rows of `size` each: weighted residuals |v| - gravity, weighted directions [three
 * rows], and the derivatives by the six entries of the lower triangular matrix [six rows], in the order of its rows. */
void calibkit_lengths(const double *vector, const double *shifted, const double *root, int64_t size, double gravity,
                      double *residual, double *direction, double *slopes)
{
#if WIDE
    if (__builtin_cpu_supports("avx2")) {
        lengths_widely(vector, shifted, root, size, gravity, residual, direction, slopes);
        return;
    }
#endif
    lengths_plainly(vector, shifted, root, size, gravity, residual, direction, slopes);
}

/* Rows of three values each, less three others, as three rows. */
void calibkit_components(const double *restrict rows, int64_t size, const double *restrict less, double *restrict components)
{
    const double a = less[0], b = less[1], c = less[2];
    for (int64_t i = 0; i < size; i++) {
        components[i] = rows[3 * i] - a;
        components[size + i] = rows[3 * i + 1] - b;
        components[2 * size + i] = rows[3 * i + 2] - c;
    }
}
