/* Straight lines at both ends of a signal (calibkit/numeric/wavelet/extension.py): where the signal goes on from, and whether it
 * moves there.
 *
 * Every sum, product and root is the one that is done with arrays without this, in the same order and rounded by itself.
 */

#include <math.h>
#include <stdint.h>

#include "doubles.h"

enum { SECTIONS = 128, TOGETHER = 128 };

int64_t calibkit_medians(const double *const *values, const int64_t *sizes, int64_t count, double *room, double *medians);

/* Sum in numpy's order: eight running sums of up to 128 values, halves of more. */
static double sum_of(const double *values, int64_t size)
{
    if (size < 8) {
        double sum = -0.0;
        for (int64_t i = 0; i < size; i++)
            sum += values[i];
        return sum;
    }
    if (size > TOGETHER) {
        int64_t half = size / 2;
        half -= half % 8;
        return sum_of(values, half) + sum_of(values + half, size - half);
    }
    double r[8];
    int64_t i = 8;
    for (int k = 0; k < 8; k++)
        r[k] = values[k];
    for (; i < size - size % 8; i += 8)
        for (int k = 0; k < 8; k++)
            r[k] += values[i + k];
    double sum = ((r[0] + r[1]) + (r[2] + r[3])) + ((r[4] + r[5]) + (r[6] + r[7]));
    for (; i < size; i++)
        sum += values[i];
    return sum;
}

/* One end: the value at its sample 0, and whether the signal moves there. `at` is its first sample, `step` the way from it into
 * the signal. 0 where a number is not finite, else 1. */
static int fit_end(const double *at, int64_t step, int64_t differences, int64_t limit, int64_t window, const double *sizes,
                   const double *squares, int64_t sections, const double *settings, double *room, double *value, double *moves)
{
    const double unit = settings[0], significant = settings[1], *difference = room;
    double median, *above = room, *moment = room + limit;
    for (int64_t i = 0; i < differences; i++)
        room[i] = at[(i + 1) * step] - at[i * step];
    if (calibkit_medians(&difference, &differences, 1, room + differences, &median))
        return 0;
    const double spread = median / unit / sqrt(2.0);
    for (int64_t i = 0; i < limit; i++) {
        above[i] = at[i * step] - at[0];
        moment[i] = (double)i * above[i];
    }
    double total = 0.0, moments = 0.0, low = -INFINITY, high = INFINITY, slope[SECTIONS], fitted[SECTIONS];
    int64_t straight = -1, start = 0;
    for (int64_t k = 0; k < sections; k++) {
        const int64_t stop = (int64_t)sizes[k], more = stop - start - 1;
        const double of_values = above[start] + sum_of(above + start + 1, more);
        const double of_moments = moment[start] + sum_of(moment + start + 1, more);
        total = k ? total + of_values : of_values;
        moments = k ? moments + of_moments : of_moments;
        start = stop;
        slope[k] = (moments - total * (sizes[k] - 1.0) / 2.0) / squares[k];
        fitted[k] = total / sizes[k] - slope[k] * (sizes[k] - 1.0) / 2.0;
        const double margin = 4.0 * spread / sqrt(sizes[k]);
        low = fitted[k] - margin > low ? fitted[k] - margin : low;
        high = fitted[k] + margin < high ? fitted[k] + margin : high;
        if (low > high)
            break;
        straight = k;
    }
    if (!(fabs(total) <= DBL_MAX && fabs(moments) <= DBL_MAX))
        return 0;
    *value = at[0];
    *moves = 1.0;
    if (straight < 0)
        return 1;
    int64_t taken = straight;
    while (taken > 0 && sizes[taken - 1] >= (double)window)
        taken--;
    *value = at[0] + fitted[taken];
    *moves = fabs(slope[straight]) > significant * spread / sqrt(squares[straight]);
    return 1;
}

/* Both ends of a signal: `found` is the value at the left and at the right end, then whether it moves there. `counts` are the
 * differences that show the noise, the samples in the longest section, those of the window, and the sections; the settings, the
 * median magnitude of unit noise and the standard errors of a slope. Room is for twice as many numbers and four more. 0, or
 * -1 where an end is left to the arrays. */
int64_t calibkit_ends(const double *samples, int64_t size, const int64_t *counts, const double *sizes, const double *squares,
                      const double *settings, double *room, double *found)
{
    if (counts[3] > SECTIONS)
        return -1;
    for (int end = 0; end < 2; end++)
        if (!fit_end(end ? samples + size - 1 : samples, end ? -1 : 1, counts[0], counts[1], counts[2], sizes, squares,
                     counts[3], settings, room, found + end, found + 2 + end))
            return -1;
    return 0;
}
