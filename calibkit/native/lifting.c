/* Lifting steps of the wavelet transform, a stretch of one level at a time.
 *
 * Every sum and product is the one that calibkit/numeric/wavelet/level.py does with arrays, in the same order and each rounded by
 * itself, so that the results are the same to the last bit. A block of pairs goes through all steps of a level while it lies
 * in the first-level cache.
 *
 * A plan [whole numbers] says what the steps are: number of moves; then the reach (low, high) of the approximation channel and
 * of the detail channel, both shifts, the parity; then for every move its target channel, low, high, number of terms, and for
 * every term the number of offsets and the offsets. The taps of the terms stand in the order of the terms behind four factors:
 * the gains of analysis of both channels, then what synthesis multiplies both with.
 */

#if defined(__GNUC__) && !defined(__clang__)
/* Nobody asks which exceptions these comparisons raised; while somebody might, gcc keeps the rules from being vectorised.
 * No number depends on it. */
#pragma GCC optimize("no-trapping-math")
#endif

#include <math.h>
#include <stdint.h>

#include "doubles.h"

#if defined(__clang__)
#define PREFERRED ""
#else
#define PREFERRED ",prefer-vector-width=512"    /* gcc halves registers by itself */
#endif

enum { PAIRS = 1024 };   /* of a block: two channels of them are 16 KiB */
enum { WIDEST = 256 };   /* reach of the steps beyond a block; calibkit/numeric/wavelet/level.py asks for no more */
enum { MOVES = 8 };      /* where in a plan the moves begin */
enum { SOFT = 1, HARD = 2, GARROTE = 3, FIRM = 4 };

typedef struct {
    const int64_t *plan;
    const double *factors;
    _Alignas(64) double room[2][PAIRS + WIDEST];    /* of both channels of a block with its reach */
    _Alignas(64) double scratch[PAIRS + WIDEST];    /* of one term */
} level_t;

typedef struct {
    int rule;
    double threshold, square;   /* of the threshold */
} shrinkage_t;

INLINED int64_t least(int64_t a, int64_t b) { return a < b ? a : b; }
INLINED int64_t most(int64_t a, int64_t b) { return a > b ? a : b; }
INLINED int64_t reach_low(const level_t *level, int channel) { return level->plan[1 + 2 * channel]; }
INLINED int64_t reach_high(const level_t *level, int channel) { return level->plan[2 + 2 * channel]; }
INLINED int64_t shift_of(const level_t *level, int channel) { return level->plan[5 + channel]; }
INLINED int64_t parity_of(const level_t *level) { return level->plan[7]; }

/* target += tap · (sum of shifted sources), as one step of a block */
INLINED void add_one(double *restrict target, const double *restrict source, double tap, int64_t size)
{
    for (int64_t i = 0; i < size; i++)
        target[i] += source[i] * tap;
}

INLINED void add_two(double *restrict target, const double *restrict a, const double *restrict b, double tap, int64_t size)
{
    for (int64_t i = 0; i < size; i++)
        target[i] += (a[i] + b[i]) * tap;
}

INLINED void add_many(double *restrict target, const double *source, const int64_t *offsets, int64_t count, double tap,
                      int64_t size, double *restrict scratch)
{
    const double *a = source + offsets[0], *b = source + offsets[1];
    for (int64_t i = 0; i < size; i++)
        scratch[i] = a[i] + b[i];
    for (int64_t k = 2; k < count; k++) {
        const double *more = source + offsets[k];
        for (int64_t i = 0; i < size; i++)
            scratch[i] += more[i];
    }
    add_one(target, scratch, tap, size);
}

/* All steps on a block of pairs low … high − 1, whose channels begin at low + their reach. */
INLINED void lift(level_t *level, int64_t low, int64_t high)
{
    const int64_t *at = level->plan + MOVES;
    const double *tap = level->factors + 4;
    for (int64_t moves = level->plan[0]; moves > 0; moves--) {
        int target = (int)at[0];
        int64_t from = at[1], size = high - low + at[2] - at[1], terms = at[3];
        double *into = level->room[target] + (from - reach_low(level, target));
        const double *source = level->room[1 - target] + (from - reach_low(level, 1 - target));
        at += 4;
        for (; terms > 0; terms--, tap++) {
            int64_t count = at[0];
            if (count == 1)
                add_one(into, source + at[1], *tap, size);
            else if (count == 2)
                add_two(into, source + at[1], source + at[2], *tap, size);
            else
                add_many(into, source, at + 1, count, *tap, size, level->scratch);
            at += 1 + count;
        }
    }
}

INLINED void scaled(double *restrict into, const double *restrict from, double factor, int64_t size)
{
    for (int64_t i = 0; i < size; i++)
        into[i] = from[i] * factor;
}

INLINED void every_second(double *restrict into, const double *restrict samples, int64_t size)
{
    for (int64_t i = 0; i < size; i++)
        into[i] = samples[2 * i];
}

/* Every second sample into each channel: the common stretch at once, what one channel has beyond the other by itself. */
INLINED void split(level_t *level, const double *samples, int64_t first, int64_t low, int64_t high)
{
    int64_t begin[2], end[2];
    for (int c = 0; c < 2; c++) {
        begin[c] = low + reach_low(level, c);
        end[c] = high + reach_high(level, c);
    }
    int64_t from = most(begin[0], begin[1]), to = least(end[0], end[1]), origin = parity_of(level) - first;
    for (int c = 0; c < 2; c++) {
        double *room = level->room[c];
        int64_t near = least(from, end[c]), far = most(to, near);
        every_second(room, samples + 2 * begin[c] + c + origin, near - begin[c]);
        if (far < end[c])
            every_second(room + far - begin[c], samples + 2 * far + c + origin, end[c] - far);
    }
    if (from >= to)
        return;
    double *restrict even = level->room[0] + from - begin[0], *restrict odd = level->room[1] + from - begin[1];
    const double *restrict both = samples + 2 * from + origin;
    for (int64_t i = 0; i < to - from; i++) {
        even[i] = both[2 * i];
        odd[i] = both[2 * i + 1];
    }
}

/* Analysis: coefficients low … high − 1 from samples whose element 0 has the index `first`, each channel into an array of
 * `size` coefficients whose element 0 has the index `origin`; those outside of it are dropped. */
INLINED void analyse(level_t *level, const double *samples, int64_t first, int64_t low, int64_t high, double *const out[2],
                     const int64_t origin[2], const int64_t size[2])
{
    for (int64_t begin = low; begin < high; begin += PAIRS) {
        int64_t end = least(begin + PAIRS, high);
        split(level, samples, first, begin, end);
        lift(level, begin, end);
        for (int c = 0; c < 2; c++) {
            int64_t from = most(begin, origin[c]), to = least(end, origin[c] + size[c]);
            const double *made = level->room[c] + (from + shift_of(level, c) - begin - reach_low(level, c));
            if (from < to)
                scaled(out[c] + (from - origin[c]), made, level->factors[c], to - from);
        }
    }
}

/* Details thresholded by a rule, times a factor. */
INLINED void shrunk(double *restrict into, const double *restrict from, double factor, int64_t size,
                    const shrinkage_t *shrinkage)
{
    const double threshold = shrinkage->threshold, square = shrinkage->square;
    switch (shrinkage->rule) {
    case SOFT:
        for (int64_t i = 0; i < size; i++) {
            double d = from[i];
            double clipped = d > threshold ? threshold : (d < -threshold ? -threshold : d);
            into[i] = (d - clipped) * factor;
        }
        break;
    case HARD:
        for (int64_t i = 0; i < size; i++)
            into[i] = (fabs(from[i]) > threshold ? from[i] : 0.0) * factor;
        break;
    case GARROTE:
        for (int64_t i = 0; i < size; i++) {
            double d = from[i];
            double kept = d - square / (fabs(d) > threshold ? d : 1.0);
            into[i] = (fabs(d) > threshold ? kept : 0.0) * factor;
        }
        break;
    case FIRM:
        for (int64_t i = 0; i < size; i++) {
            double magnitude = fabs(from[i]), over = magnitude - threshold;
            double twice = 2.0 * (over < 0.0 ? 0.0 : over);
            into[i] = copysign(twice > magnitude ? magnitude : twice, from[i]) * factor;
        }
        break;
    default:
        scaled(into, from, factor, size);
    }
}

/* Pairs low … high − 1 of both channels into samples whose element 0 has the index `first`, those outside of it dropped. */
INLINED void join(const level_t *level, double *samples, int64_t first, int64_t size, int64_t low, int64_t high)
{
    const double *even = level->room[0] - reach_low(level, 0), *odd = level->room[1] - reach_low(level, 1);
    int64_t at = 2 * low + parity_of(level) - first;    /* where the first pair goes */
    int64_t from = 0, to = high - low;
    for (; from < to && at + 2 * from < 0; from++)      /* half a pair is kept at most */
        if (at + 2 * from == -1 && size > 0)
            samples[0] = odd[from];
    for (; from < to && at + 2 * to - 1 >= size; to--)
        if (at + 2 * to - 2 < size)
            samples[at + 2 * to - 2] = even[to - 1];
    if (from >= to)
        return;
    double *restrict into = samples + at + 2 * from;
    const double *restrict a = even + from, *restrict b = odd + from;
    for (int64_t i = 0; i < to - from; i++) {
        into[2 * i] = a[i];
        into[2 * i + 1] = b[i];
    }
}

/* Synthesis: samples of the pairs low … high − 1 from coefficients whose element 0 has the index `first`. */
INLINED void synthesise(level_t *level, const double *const coefficients[2], int64_t first, int64_t low, int64_t high,
                        const shrinkage_t *shrinkage, double *out, int64_t out_first, int64_t out_size)
{
    for (int64_t begin = low; begin < high; begin += PAIRS) {
        int64_t end = least(begin + PAIRS, high);
        for (int c = 0; c < 2; c++) {
            int64_t from = begin + reach_low(level, c), size = end + reach_high(level, c) - from;
            const double *given = coefficients[c] + (from - shift_of(level, c) - first);
            if (c == 0)
                scaled(level->room[c], given, level->factors[2 + c], size);
            else
                shrunk(level->room[c], given, level->factors[2 + c], size, shrinkage);
        }
        lift(level, begin, end);
        join(level, out, out_first, out_size, begin, end);
    }
}

static void analyse_plainly(level_t *level, const double *samples, int64_t first, int64_t low, int64_t high,
                            double *const out[2], const int64_t origin[2], const int64_t size[2])
{
    analyse(level, samples, first, low, high, out, origin, size);
}

static void synthesise_plainly(level_t *level, const double *const coefficients[2], int64_t first, int64_t low, int64_t high,
                               const shrinkage_t *shrinkage, double *out, int64_t out_first, int64_t out_size)
{
    synthesise(level, coefficients, first, low, high, shrinkage, out, out_first, out_size);
}

#if WIDE
/* The same for processors with wider registers: without fused products, so that the numbers are the same. */
#define VARIANT(name, registers) \
    __attribute__((target(registers))) static void \
    analyse_##name(level_t *level, const double *samples, int64_t first, int64_t low, int64_t high, double *const out[2], \
                   const int64_t origin[2], const int64_t size[2]) \
    { \
        analyse(level, samples, first, low, high, out, origin, size); \
    } \
    __attribute__((target(registers))) static void \
    synthesise_##name(level_t *level, const double *const coefficients[2], int64_t first, int64_t low, int64_t high, \
                      const shrinkage_t *shrinkage, double *out, int64_t out_first, int64_t out_size) \
    { \
        synthesise(level, coefficients, first, low, high, shrinkage, out, out_first, out_size); \
    }

VARIANT(widely, "avx2")
VARIANT(widest, "avx512f,avx512vl,avx512dq" PREFERRED)

#define CHOSEN(step) \
    (__builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512vl") && __builtin_cpu_supports("avx512dq") \
         ? step##_widest \
         : __builtin_cpu_supports("avx2") ? step##_widely : step##_plainly)
#else
#define CHOSEN(step) step##_plainly
#endif

void calibkit_analysed(const int64_t *plan, const double *factors, const double *samples, int64_t first,
                     int64_t low, int64_t high, double *approximation, int64_t approximation_first, int64_t approximation_size,
                     double *detail, int64_t detail_first, int64_t detail_size)
{
    level_t level;  /* its room is written before it is read */
    level.plan = plan;
    level.factors = factors;
    double *const out[2] = {approximation, detail};
    const int64_t origin[2] = {approximation_first, detail_first}, size[2] = {approximation_size, detail_size};
    CHOSEN(analyse)(&level, samples, first, low, high, out, origin, size);
}

void calibkit_synthesised(const int64_t *plan, const double *factors, const double *approximation,
                        const double *detail, int64_t first, int64_t low, int64_t high, int64_t rule, double threshold,
                        double square, double *out, int64_t out_first, int64_t out_size)
{
    level_t level;  /* its room is written before it is read */
    level.plan = plan;
    level.factors = factors;
    const double *const coefficients[2] = {approximation, detail};
    const shrinkage_t shrinkage = {(int)rule, threshold, square};
    CHOSEN(synthesise)(&level, coefficients, first, low, high, &shrinkage, out, out_first, out_size);
}

enum { FORTH = 10, BACK = 9 };    /* numbers of an operation */

/* Analyses one after the other in one room. Each operation says: where the samples lie in it, their first index, low, high;
 * where the approximation goes, its first index, its size; the same of the detail. */
void calibkit_analysed_levels(const int64_t *plan, const double *factors, const int64_t *operations, int64_t count, double *room)
{
    level_t level;  /* its room is written before it is read */
    level.plan = plan;
    level.factors = factors;
    for (const int64_t *at = operations; count > 0; count--, at += FORTH) {
        double *const out[2] = {room + at[4], room + at[7]};
        const int64_t origin[2] = {at[5], at[8]}, size[2] = {at[6], at[9]};
        CHOSEN(analyse)(&level, room + at[0], at[1], at[2], at[3], out, origin, size);
    }
}

/* Syntheses one after the other in one room. Each operation says: where approximation and detail lie in it, their first index,
 * the pairs low and high; the level, which has a threshold; where the samples go, their first index, their size. */
void calibkit_synthesised_levels(const int64_t *plan, const double *factors, const int64_t *operations, int64_t count,
                                 int64_t rule, const double *thresholds, double *room)
{
    level_t level;  /* its room is written before it is read */
    level.plan = plan;
    level.factors = factors;
    for (const int64_t *at = operations; count > 0; count--, at += BACK) {
        const double *const coefficients[2] = {room + at[0], room + at[1]};
        const double threshold = thresholds[at[5]];
        const shrinkage_t shrinkage = {(int)rule, threshold, threshold * threshold};
        CHOSEN(synthesise)(&level, coefficients, at[2], at[3], at[4], &shrinkage, room + at[6], at[7],
                                                      at[8]);
    }
}
