/* Magnitudes within a bracket, for the search for their median (numeric/order_statistics.py), in one pass.
 *
 * Nothing is computed but |value - about|: the median is one of those, or the mean of two, as by sorting.
 */

#include <math.h>
#include <stdint.h>
#include <string.h>

#include "doubles.h"
#if WIDE
#include <immintrin.h>
#endif

enum { BLOCK = 1024 };
enum { NOT_FINITE = -1, TOO_MANY = -2 };

typedef struct {
    double about, first, last;
    double *room;       /* of the magnitudes between first and last */
    int64_t held, over; /* how many they are, and how many of all are above first */
} Bracket;

/* One block of magnitudes; whether all of them are finite. */
static int bracketed(Bracket *to, const double *values, int64_t count)
{
    int unusable = 0;
    for (int64_t i = 0; i < count; i++) {
        const double magnitude = fabs(values[i] - to->about);
        const int above = magnitude > to->first;
        unusable |= !(magnitude <= DBL_MAX);
        to->room[to->held] = magnitude; /* stays where it is between both */
        to->over += above;
        to->held += above & (magnitude < to->last);
    }
    return !unusable;
}

#if WIDE
/* Where the 32-bit halves of the doubles of each set of four lanes go so that they are adjacent. */
static const int32_t PACKED[16][8] = {
    {0},                      {0, 1},                   {2, 3},                   {0, 1, 2, 3},
    {4, 5},                   {0, 1, 4, 5},             {2, 3, 4, 5},             {0, 1, 2, 3, 4, 5},
    {6, 7},                   {0, 1, 6, 7},             {2, 3, 6, 7},             {0, 1, 2, 3, 6, 7},
    {4, 5, 6, 7},             {0, 1, 4, 5, 6, 7},       {2, 3, 4, 5, 6, 7},       {0, 1, 2, 3, 4, 5, 6, 7},
};
static const int8_t MEMBERS[16] = {0, 1, 1, 2, 1, 2, 2, 3, 1, 2, 2, 3, 2, 3, 3, 4};

/* The same four at a time; writes up to four numbers behind those that are held. */
__attribute__((target("avx2"))) static int bracketed_widely(Bracket *to, const double *values, int64_t count)
{
    const __m256d about = _mm256_set1_pd(to->about), first = _mm256_set1_pd(to->first), last = _mm256_set1_pd(to->last);
    const __m256d sign = _mm256_set1_pd(-0.0), largest = _mm256_set1_pd(DBL_MAX);
    __m256d finite = _mm256_cmp_pd(about, about, _CMP_EQ_OQ);
    __m256i over = _mm256_setzero_si256();
    double *room = to->room + to->held;
    int64_t i = 0;
    for (; i + 4 <= count; i += 4) {
        const __m256d magnitude = _mm256_andnot_pd(sign, _mm256_sub_pd(_mm256_loadu_pd(values + i), about));
        const __m256d above = _mm256_cmp_pd(magnitude, first, _CMP_GT_OQ);
        const int inside = _mm256_movemask_pd(_mm256_and_pd(above, _mm256_cmp_pd(magnitude, last, _CMP_LT_OQ)));
        finite = _mm256_and_pd(finite, _mm256_cmp_pd(magnitude, largest, _CMP_LE_OQ));
        over = _mm256_sub_epi64(over, _mm256_castpd_si256(above));
        const __m256i order = _mm256_loadu_si256((const __m256i *)PACKED[inside]);
        const __m256i packed = _mm256_permutevar8x32_epi32(_mm256_castpd_si256(magnitude), order);
        _mm256_storeu_pd(room, _mm256_castsi256_pd(packed));
        room += MEMBERS[inside];
    }
    int64_t sums[4];
    _mm256_storeu_si256((__m256i *)sums, over);
    to->over += sums[0] + sums[1] + sums[2] + sums[3];
    to->held = room - to->room;
    return bracketed(to, values + i, count - i) && _mm256_movemask_pd(finite) == 15;
}
#endif

/* Puts the magnitudes |value - about| between `first` and `last`, neither included, one behind the other into room for
 * `capacity` of them, and says how many of all are above `first`. How many were put there, NOT_FINITE where a value is not, or
 * TOO_MANY where they may not find room. */
int64_t calibkit_bracketed(const double *values, int64_t size, double about, double first, double last, double *room,
                           int64_t capacity, int64_t *above_first)
{
    Bracket to = {about, first, last, room, 0, 0};
    int (*block)(Bracket *, const double *, int64_t) = bracketed;
#if WIDE
    if (__builtin_cpu_supports("avx2"))
        block = bracketed_widely;
#endif
    for (int64_t begin = 0; begin < size; begin += BLOCK) {
        const int64_t count = size - begin < BLOCK ? size - begin : BLOCK;
        if (to.held + count + 4 > capacity)
            return TOO_MANY;
        if (!block(&to, values + begin, count))
            return NOT_FINITE;
    }
    *above_first = to.over;
    return to.held;
}

/* Moves the value of rank k [0 the least] of a part of values to index k, none above it before, none below it behind. */
static void placed(double *values, int64_t low, int64_t high, int64_t k)
{
    while (low < high) {
        const double a = values[low], b = values[low + (high - low) / 2], c = values[high];
        const double most = a > b ? a : b, least = a > b ? b : a;
        const double pivot = c > most ? most : (c < least ? least : c);
        int64_t below = low, same;
        for (int64_t i = low; i <= high; i++) {     /* no branch hangs on a value */
            const double value = values[i];
            values[i] = values[below];
            values[below] = value;
            below += value < pivot;
        }
        if (k < below) {
            high = below - 1;
            continue;
        }
        same = below;
        for (int64_t i = below; i <= high; i++) {
            const double value = values[i];
            values[i] = values[same];
            values[same] = value;
            same += value == pivot;
        }
        if (k < same)
            return;
        low = same;
    }
}

/* Values of ranks k - 1 (where a value has it) and k of the first `size` numbers of room, which it orders. */
static void two_ranks(double *room, int64_t size, int64_t k, double *lower, double *upper)
{
    placed(room, 0, size - 1, k);
    *lower = room[0];
    for (int64_t i = 1; i < k; i++)
        *lower = room[i] > *lower ? room[i] : *lower;
    *upper = room[k];
}

/* Medians of `count` runs of finite values, run j from first[j] to before first[j + 1]; room is that of the largest. A median
 * that is zero is positive. */
void calibkit_run_medians(const double *values, const int64_t *first, double *room, double *medians, int64_t count)
{
    for (int64_t j = 0; j < count; j++) {
        const int64_t size = first[j + 1] - first[j];
        double lower, upper;
        memcpy(room, values + first[j], (size_t)size * sizeof *room);
        two_ranks(room, size, size / 2, &lower, &upper);
        medians[j] = (size % 2 ? upper : (lower + upper) / 2.0) + 0.0;
    }
}
