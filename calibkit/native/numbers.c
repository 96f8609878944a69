/* Decimal numbers of comma-separated lines into columns, correctly rounded; what is anything else is refused, never guessed. */

#define _GNU_SOURCE /* strtod_l */
#include <float.h>
#include <locale.h>
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#if defined(__APPLE__)
#include <xlocale.h>
#endif

#if FLT_EVAL_METHOD != 0
#error "doubles are not rounded at every operation here: this kernel would not have the bits of numpy"
#endif

#define NOT_CLEAN (-1)
#define MOST_DIGITS 19    /* decimal digits that always fit 64 bits */
#define EXACT (1LL << 53) /* integers up to this one, and powers of ten up to the 22nd, are doubles themselves */

static const double POWER[23] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8,  1e9,  1e10, 1e11,
                                 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20, 1e21, 1e22};

/* The C library's conversion, with a point whatever the process's locale; not a number where the library has none. */
static double by_library(const char *text)
{
#if defined(__GLIBC__) || defined(__APPLE__)
    static locale_t plain; /* two threads that both make it make the same */
    locale_t known = plain;
    if (!known)
        plain = known = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    return known ? strtod_l(text, NULL, known) : NAN;
#else
    (void)text;
    return NAN;
#endif
}

#if defined(__SIZEOF_INT128__)
/* digits / 10^places to the nearest double, ties to even, for digits > 0 and 0 <= places <= 19. */
static double divided(uint64_t digits, int places)
{
    uint64_t divisor = 1;
    for (int k = 0; k < places; k++)
        divisor *= 10;
    const int raised = __builtin_clzll(digits), lowered = __builtin_clzll(divisor);
    const unsigned __int128 dividend = (unsigned __int128)(digits << raised) << 63;
    divisor <<= lowered;
    /* 63 or 64 bits; whether anything remains is all that the rounding to 53 still asks */
    const uint64_t quotient = (uint64_t)(dividend / divisor);
    const uint64_t remains = dividend % divisor != 0;
    return ldexp((double)(quotient | remains), lowered - raised - 63);
}
#endif

/* digits * 10^exponent to the nearest double where it can be told without the text, or not a number. */
static inline double rounded(uint64_t digits, int64_t exponent)
{
    if (digits == 0)
        return 0.0;
    if (digits <= EXACT && exponent <= 0 && exponent >= -22)
        return (double)digits / POWER[-exponent];
    if (digits <= EXACT && exponent > 0 && exponent <= 22)
        return (double)digits * POWER[exponent];
#if defined(__SIZEOF_INT128__)
    if (exponent <= 0 && exponent >= -MOST_DIGITS)
        return divided(digits, (int)-exponent);
#endif
    return NAN;
}

/* Decimal digits from *at on, which is moved behind them, appended to a number. */
static inline uint64_t appended(uint64_t number, const char **at)
{
    const char *next = *at;
    for (unsigned digit; (digit = (unsigned char)*next - (unsigned)'0') < 10; next++)
        number = 10 * number + digit;
    *at = next;
    return number;
}

/* The exponent from *at on, behind its letter; *at is moved behind it, or stays where there is none. */
static int power(const char **at)
{
    const char *next = *at;
    const int negative = *next == '-';
    next += negative || *next == '+';
    const char *const first = next;
    const uint64_t size = appended(0, &next);
    if (next == first)
        return 0;
    *at = next;
    /* longer ones are beyond any double, and left to the library */
    const int capped = next - first > 6 ? 999999 : (int)size;
    return negative ? -capped : capped;
}

/* The number that starts at *at, which is then moved behind it; not a number where there is none, or none of a finite value. */
static inline double number(const char **at)
{
    const char *const text = *at, *next = text;
    next += *next == '-' || *next == '+';
    const char *first = next;
    uint64_t digits = appended(0, &next);
    int64_t seen = next - first, exponent = 0;
    if (*next == '.') {
        first = ++next;
        digits = appended(digits, &next);
        exponent = first - next;
        seen -= exponent;
    }
    if (seen == 0)
        return NAN;
    if (*next == 'e' || *next == 'E') {
        first = ++next;
        exponent += power(&next);
        if (next == first)
            return NAN;
    }
    *at = next;
    double value = seen > MOST_DIGITS ? NAN : rounded(digits, exponent);
    if (isnan(value)) {
        value = by_library(text); /* with its sign */
        return isfinite(value) ? value : NAN;
    }
    return *text == '-' ? -value : value;
}

/* Whether a missing value stands at *at, which is then moved behind it: an empty field, or nan, NaN, NAN. */
static inline int missing(const char **at)
{
    const char *next = *at;
    if (*next == 'n' ? next[1] == 'a' && next[2] == 'n' : *next == 'N' && (next[1] == 'a' || next[1] == 'A') && next[2] == 'N')
        next += 3;
    if (*next != ',' && *next != '\n' && *next != '\r')
        return 0;
    *at = next;
    return 1;
}

/*
 * Parse whole lines of `fields` numbers or missing values each, the last with its end, into row 0, 1, ... of the columns, which have room for
 * `rows`. Returns the rows, or NOT_CLEAN where anything stands that is no such line, or more than there is room for.
 */
int64_t calibkit_numbers(const char *text, int64_t size, int64_t fields, int64_t rows, double *const *columns)
{
    const char *next = text, *const stop = text + size;
    int64_t row = 0;
    if (size <= 0 || fields < 1 || stop[-1] != '\n')
        return NOT_CLEAN;
    for (; next < stop; row++) {
        if (row == rows)
            return NOT_CLEAN;
        for (int64_t k = 0; k < fields; k++) {
            const char *const first = next;
            const double value = number(&next);
            /* a number that is not finite is moved behind, too: it is none that is missing */
            if (isnan(value) && (next != first || !missing(&next)))
                return NOT_CLEAN;
            if (k < fields - 1 && *next++ != ',')
                return NOT_CLEAN;
            columns[k][row] = value;
        }
        next += *next == '\r';
        if (*next++ != '\n')
            return NOT_CLEAN;
    }
    return row;
}
