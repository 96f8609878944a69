/* marks beginning with @ are filled in by firmware_damage.py */
#define _POSIX_C_SOURCE 199309L
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include "unit.c"

static uint64_t seed;
static uint32_t drawn(uint32_t below)
{
    seed = seed * 6364136223846793005ULL + 1442695040888963407ULL;
    return (uint32_t)(seed >> 33) % below;
}
static double least[@inputs] = {@least}, most[@inputs] = {@most};
static void put(unit_in *in, uint32_t k)
{
    double x[@inputs];
    for (int i = 0; i < @inputs; i++) {
        x[i] = least[i] + (most[i] - least[i]) * (double)((k * (7919u + 104729u * i)) % 1000u) / 1000.0;
    }
@fields
}
/* largest difference of the results of two units, in tolerances of the self-test */
static double apart(const unit_unit *a, const unit_unit *b)
{
    double found = 0.0;
@begin
    for (uint32_t k = 0; k < 300u; k++) {
        unit_in in;
        unit_out x, y;
        put(&in, k);
@calls
@compare
    }
    return found;
}
static void seal(uint8_t *bytes, uint32_t length)
{
    uint32_t crc = unit_crc(bytes, length - 4U);
    for (int k = 0; k < 4; k++) { bytes[length - 4U + k] = (uint8_t)(crc >> (8 * k)); }
}
static void number(uint8_t *at)
{
    static const double special[] = {0.0, -0.0, 1.0, -1.0, 1e30, -1e30, 1e-30, 1e300, 4294967296.0,
        16777216.0, 1e-310, 0.5, 65536.0, 1e9};
    const uint32_t kind = drawn(18U);
    @real x;
    memcpy(&x, at, sizeof x);
    if (kind < 14U) { x = (@real)special[kind]; }
    else if (kind == 14U) { x = (@real)NAN; }
    else if (kind == 15U) { x = -(@real)INFINITY; }
    else if (kind == 16U) { x = -x; }
    else { x = x * (@real)(1.0 + 1e-3 * (double)drawn(2000U)); }
    memcpy(at, &x, sizeof x);
}
int main(int count, char **arguments)
{
    static uint8_t good[1 << 20];
    const uint32_t size = (uint32_t)fread(good, 1, sizeof good, stdin), times = (uint32_t)atoi(arguments[1]);
    uint8_t *bytes = malloc(size);
    unit_unit *right = calloc(1, sizeof *right), *unit = calloc(1, sizeof *unit);
    uint32_t taken = 0, reasons[16] = {0}, kept = 0;
    double longest = 0.0, worst = 0.0;
    seed = strtoull(arguments[2], NULL, 10);
    if (unit_load(right, good, size, NULL, 0U) != UNIT_LOADED) { return 2; }
    if (count > 3) { /* every bit and every length */
        for (uint32_t k = 0; k < size * 8U; k++) {
            good[k / 8U] ^= (uint8_t)(1U << (k % 8U));
            taken += unit_load(unit, good, size, NULL, 0U) == UNIT_LOADED;
            good[k / 8U] ^= (uint8_t)(1U << (k % 8U));
        }
        for (uint32_t k = 0; k < size; k++) {
            uint8_t *cut = malloc(k + 1U); /* of its own, so that a read beyond it is seen */
            memcpy(cut, good, k);
            taken += unit_load(unit, cut, k, NULL, 0U) == UNIT_LOADED;
            free(cut);
        }
    }
    (void)printf("flips and cuts %u taken %u\n", count > 3 ? size * 9U : 0U, taken);
    taken = 0;
    for (uint32_t k = 0; k < times; k++) { /* bursts of up to 32 bits */
        const uint32_t first = drawn(size * 8U), width = 1U + drawn(32U);
        memcpy(bytes, good, size);
        bytes[first / 8U] ^= (uint8_t)(1U << (first % 8U));
        for (uint32_t i = first + 1U; i < first + width && i < size * 8U; i++) {
            if (drawn(2U)) { bytes[i / 8U] ^= (uint8_t)(1U << (i % 8U)); }
        }
        taken += unit_load(unit, bytes, size, NULL, 0U) == UNIT_LOADED;
    }
    (void)printf("bursts %u taken %u\n", times, taken);
    taken = 0;
    for (uint32_t k = 0; k < times; k++) { /* mutants with a right CRC */
        uint32_t changes = 1U + drawn(3U), intact = 1U, reason;
        struct timespec begun, ended;
        const unit_unit before = *unit;
        memcpy(bytes, good, size);
        while (changes-- > 0U) {
            const uint32_t kind = drawn(8U);
            uint32_t at = 112U + @sizeU * drawn(UNIT_NUMBERS);
            if (kind < 3U) { number(&bytes[at]); }
            else if (kind == 3U) { at = UNIT_TESTS_AT + @sizeU * drawn((UNIT_ROW * unit_u32(&good[108])) / @sizeU); number(&bytes[at]); }
            else if (kind == 4U) { at = 8U + 4U * drawn(26U); bytes[at + drawn(4U)] = (uint8_t)drawn(256U); }
            else if (kind == 5U) { at = 112U + drawn(UNIT_TESTS_AT - 112U); bytes[at] ^= (uint8_t)(1U << drawn(8U)); }
            else if (kind == 6U) { at = drawn(size); bytes[at] = (uint8_t)drawn(256U); }
            else { at = 104U; memset(&bytes[at + 4U * drawn(2U)], drawn(2U) ? 255 : (int)drawn(4U), 4U); }
            intact &= (at + @sizeU <= UNIT_TESTS_AT) ? 1U : 0U;
        }
        seal(bytes, size);
        (void)clock_gettime(CLOCK_MONOTONIC, &begun);
        reason = unit_load(unit, bytes, size, NULL, 0U);
        (void)clock_gettime(CLOCK_MONOTONIC, &ended);
        longest = fmax(longest, (double)(ended.tv_sec - begun.tv_sec) + 1e-9 * (double)(ended.tv_nsec - begun.tv_nsec));
        reasons[reason & 15U]++;
        if (reason == UNIT_LOADED) {
            taken++;
            if (intact != 0U) { kept++; worst = fmax(worst, apart(right, unit)); }
            (void)unit_selftest(unit);
            (void)unit_serial(unit)[0];
        } else if (before.active != unit->active) {
            (void)printf("a refused blob changed the slot\n");
            return 3;
        }
        (void)unit_load(unit, good, size, NULL, 0U);
    }
    (void)printf("mutants %u taken %u intact %u apart %.3g tolerances longest %.3g s\n", times, taken, kept, worst, longest);
    for (int k = 0; k < 16; k++) { if (reasons[k]) { (void)printf("reason %d: %u\n", k, reasons[k]); } }
    free(bytes); free(right); free(unit);
    return 0;
}
