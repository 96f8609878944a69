/* Slopes of least squares over windows that end at each sample, with sums that run along instead of arrays of them.
 *
 * Every sum and product is the one that calibkit/numeric/segments.py does with arrays, in the same order and each rounded by
 * itself: the sums up to a window's first sample are added up a second time where it begins, and are the same to the last bit.
 */

#include <stdint.h>

#include "doubles.h"

#define NOT_SORTED (-1)

typedef struct {
    double t, v, tt, tv;
} Sums;

typedef struct {
    const double *time, *values;
    double origin, level;
} Series;

/* The sums with sample k: its minutes since the origin, its value above the level, and their products. */
static inline Sums with(Sums sums, const Series *of, int64_t k)
{
    const double t = (of->time[k] - of->origin) / 60.0;
    const double v = of->values[k] - of->level;
    if (k == 0) /* as a running sum of an array begins: with the value itself, whose zero may have a sign */
        return (Sums){t, v, t * t, t * v};
    return (Sums){sums.t + t, sums.v + v, sums.tt + t * t, sums.tv + t * v};
}

/* Slopes [value/min] at samples skipped ... n - 1 of a series of n, over the samples of the last `reach` seconds, 0 where there
 * are less than three or the first of them is less than `least` seconds old. 0, or NOT_SORTED where the time runs backwards. */
int64_t calibkit_slopes(const double *time, const double *values, int64_t n, int64_t skipped, double reach, double least,
                        double *slopes)
{
    const Series of = {time, values, time[n / 2], values[n / 2]};
    Sums to = {0}, before = {0};
    int64_t first = 0;
    for (int64_t k = 0; k < n; k++) {
        if (k > 0 && !(time[k] >= time[k - 1]))
            return NOT_SORTED;
        to = with(to, &of, k);
        if (k < skipped)
            continue;
        const double begins = time[k] - reach;
        for (; time[first] < begins; first++)
            before = with(before, &of, first);
        const double count = (double)(k + 1 - first);
        const double t = to.t - before.t, v = to.v - before.v, tt = to.tt - before.tt, tv = to.tv - before.tv;
        const double spread = count * tt - t * t;
        const int started = count >= 3.0 && time[k] - time[first] >= least && spread > 0.0;
        slopes[k - skipped] = started ? (count * tv - t * v) / spread : 0.0;
    }
    return 0;
}
