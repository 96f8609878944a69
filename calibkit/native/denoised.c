/* A signal denoised with the shifts of its coarsest levels, from its samples to the mean (calibkit/numeric/wavelet/shifted.py),
 * where the threshold is the universal one.
 *
 * Every sum and product is the one that is done with arrays without this, in the same order and rounded by itself.
 */

#include <math.h>
#include <stdint.h>

#include "doubles.h"

enum { SOFT = 1 };
enum { SYMMETRIC, ANTISYMMETRIC, TREND, CONSTANT, PERIODIC };   /* as extension.EXTENSIONS */

/* The numbers that the layout begins with; behind them place and number of the details of each level, then the operations forth,
 * back from the coarse levels, and back, and the values beyond the ends. */
enum { SIZE, START, EXTENSION, RULE, LEVELS, KNOWN, TURNS, COUNT, SHIFTS, MEAN, MADE, FORTH, COARSE, BACK, COUNTS };
enum { COUNTED = 4, NUMBERS = COUNTS + COUNTED, OF_FORTH = 12, OF_BACK = 9, OF_END = 4 };

int64_t calibkit_ends(const double *samples, int64_t size, const int64_t *counts, const double *sizes, const double *squares,
                      const double *settings, double *room, double *found);
int64_t calibkit_medians(const double *const *values, const int64_t *sizes, int64_t count, double *room, double *medians);
void calibkit_analysed_levels(const int64_t *plan, const double *factors, const int64_t *operations, int64_t count, double *room);
void calibkit_synthesised_levels(const int64_t *plan, const double *factors, const int64_t *operations, int64_t count,
                                 int64_t rule, const double *thresholds, double *room);

/* Values beyond the ends of a level: what is added at each end and what a value within is multiplied by, then the places of each
 * value and of the two that it is made of, and its end; the share of the second, and what a constant of 1 is. */
static void continued(const double *added, const double *factor, const int64_t *at, const double *share, int64_t count,
                      double *room)
{
    for (; count > 0; count--, at += OF_END, share += 2) {
        const double within = room[at[1]] + share[0] * (room[at[2]] - room[at[1]]);
        room[at[0]] = added[at[3]] * share[1] + factor[at[3]] * within;
    }
}

/* Noise and thresholds of all levels, from the details of those that have enough of them. */
static int64_t thresholds_of(const int64_t *layout, const double *tables, double *room, double *noise)
{
    const int64_t levels = layout[LEVELS], known = layout[KNOWN], *own = layout + NUMBERS;
    const double unit = tables[0], universal = tables[2], *gains = tables + 3;
    for (int64_t j = 0; j < levels; j++) {
        const double *details = room + own[2 * j];
        if (j >= known)
            noise[j] = noise[j - 1] * gains[j] / gains[j - 1];
        else if (calibkit_medians(&details, own + 2 * j + 1, 1, room + layout[START], noise + j))
            return -1;
        else
            noise[j] /= unit;
        noise[levels + j] = noise[j] * universal;
        if (layout[RULE] == SOFT && noise[levels + j] == 0.0)
            return -1;
    }
    return 0;
}

/* Plans and factors of analysis and synthesis are those of lifting.c. Tables: median magnitude of unit noise, the standard
 * errors of a slope, the universal threshold of unit noise; noise gains of the levels; sizes of the sections at an end and the
 * sums of their squares; shares of the values beyond the ends. `found` is the noise of the levels, then their thresholds; the
 * signal lies in the room where it began. 0, or -1 where the arrays must do it. */
int64_t calibkit_denoised(const int64_t *forth_plan, const double *forth_factors, const int64_t *back_plan,
                          const double *back_factors, const int64_t *layout, const double *tables, const double *samples,
                          double *room, double *found)
{
    const int64_t size = layout[SIZE], levels = layout[LEVELS], extension = layout[EXTENSION];
    const int64_t *forth = layout + NUMBERS + 2 * levels, *coarse = forth + OF_FORTH * layout[FORTH];
    const int64_t *back = coarse + OF_BACK * layout[COARSE], *places = back + OF_BACK * layout[BACK];
    const int64_t *counts = layout + COUNTS, sections = counts[COUNTED - 1];
    const double *sizes = tables + 3 + levels, *squares = sizes + sections, *shares = squares + sections;
    const double turns_over = extension == ANTISYMMETRIC;
    double ends[4] = {samples[0], samples[size - 1], turns_over, turns_over}, added[2], factor[2];
    if (extension == TREND && calibkit_ends(samples, size, counts, sizes, squares, tables, room, ends))
        return -1;
    for (int end = 0; end < 2; end++) {
        const int turned = ends[2 + end] > 0.0;
        added[end] = extension == CONSTANT ? ends[end] : (turned ? 2.0 * ends[end] : 0.0);
        factor[end] = extension == CONSTANT ? 0.0 : (turned ? -1.0 : 1.0);
    }
    for (int64_t i = 0; i < size; i++)
        room[layout[START] + i] = samples[i];
    for (int64_t k = 0; k < layout[FORTH]; k++, forth += OF_FORTH) {
        continued(added, factor, places + OF_END * forth[OF_FORTH - 2], shares + 2 * forth[OF_FORTH - 2], forth[OF_FORTH - 1], room);
        calibkit_analysed_levels(forth_plan, forth_factors, forth, 1, room);
    }
    if (thresholds_of(layout, tables, room, found))
        return -1;
    calibkit_synthesised_levels(back_plan, back_factors, coarse, layout[COARSE], layout[RULE], found + levels, room);
    const int64_t count = layout[COUNT], turns = layout[TURNS];
    double *mean = room + layout[MEAN], *shifts = room + layout[SHIFTS];
    for (int64_t i = 0; i < count; i++) {
        double sum = shifts[i];
        for (int64_t k = 1; k < turns; k++)
            sum += shifts[k * count + i];
        mean[i] = sum / (double)turns;
    }
    calibkit_synthesised_levels(back_plan, back_factors, back, layout[BACK], layout[RULE], found + levels, room);
    return 0;
}
