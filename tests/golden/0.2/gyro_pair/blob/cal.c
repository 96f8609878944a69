/*
 * cal: loader of blobs, correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * layout        e708e4a8a29ecb26: a blob of any other is refused
 * forms         gyro-scale/1, gyro-orthogonality/1
 * number        f32: IEEE 754 single precision
 * formula       rate = (indication - F0(T)) / K(T), in deg/s, zero at rest on the laboratory's table
 * units         of every input and output below; ranges and error bounds are each unit's own and stand
 *               in
 *               the text of its blob
 *
 * Results are bit for bit those of calibkit's twin with -ffp-contract=off; else within twice the error
 *               bound.
 */

#include <stddef.h>

#include "cal.h"

/* what a slot holds is in memory before it is in use; define it for other compilers and several cores */
#ifndef CAL_BARRIER
#ifdef __GNUC__
#define CAL_BARRIER() __sync_synchronize()
#else
#define CAL_BARRIER() ((void)0)
#endif
#endif

#include <float.h>

#if defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0)
#error -ffast-math and -ffinite-math-only delete the guard against NaN
#endif

/* an indication as it is, which may be outside [range[0], range[1]] */
static float cal_indicated(float x, const float range[], uint32_t beyond, uint32_t *status)
{
    if ((x < range[0]) || (x > range[1])) {
        *status |= beyond;
    }
    return x;
}

/* 0 for a NaN or an infinity */
static uint32_t cal_finite(float x)
{
    return ((x >= -FLT_MAX) && (x <= FLT_MAX)) ? 1U : 0U;
}

/* one byte after the other, whatever the core's own order */
static uint32_t cal_u32(const uint8_t bytes[])
{
    return (uint32_t)bytes[0] | ((uint32_t)bytes[1] << 8U) | ((uint32_t)bytes[2] << 16U)
        | ((uint32_t)bytes[3] << 24U);
}

/* CRC-32 of IEEE 802.3 */
static uint32_t cal_crc(const uint8_t bytes[], uint32_t count)
{
    uint32_t crc = 0xFFFFFFFFU;
    uint32_t i;

    for (i = 0U; i < count; i++) {
        uint32_t k;

        crc ^= (uint32_t)bytes[i];
        for (k = 0U; k < 8U; k++) {
            crc = ((crc & 1U) != 0U) ? ((crc >> 1U) ^ 0xEDB88320U) : (crc >> 1U);
        }
    }
    return crc ^ 0xFFFFFFFFU;
}

/* MISRA C:2012 rule 19.2, deviation: a union turns the bits of a number into the number */
typedef union {
    uint32_t bits;
    float value;
} cal_bits;

static float cal_number(const uint8_t bytes[])
{
    cal_bits number;

    number.bits = cal_u32(bytes);
    return number.value;
}

static float cal_none(void)
{
    cal_bits number;

    number.bits = 0x7FC00000U;
    return number.value;
}

/* a number as a count below most, or most where it is none */
static uint32_t cal_count(float x, uint32_t most)
{
    uint32_t count = most;

    if ((x >= 0.0F) && (x < (float)most)) {
        count = (uint32_t)x;
    }
    return count;
}

static uint32_t cal_corrected(const cal_numbers *n, const cal_in *in, cal_out *out)
{
    uint32_t status = CAL_OK;

    if ((cal_finite(in->gyro_a_lsb) == 0U)
        || (cal_finite(in->gyro_b_lsb) == 0U)) {
        const float none = (in->gyro_a_lsb - in->gyro_a_lsb)
            + (in->gyro_b_lsb - in->gyro_b_lsb); /* a NaN */

        out->gyro_a_dps = none;
        out->gyro_b_dps = none;
        out->gyro_b_orthogonal_dps = none;
        status = CAL_INVALID;
    } else {
        const float gyro_a_lsb = cal_indicated(in->gyro_a_lsb, n->t_gyro_a_lsb_range, CAL_RATE_BEYOND, &status);
        const float gyro_b_lsb = cal_indicated(in->gyro_b_lsb, n->t_gyro_b_lsb_range, CAL_RATE_BEYOND, &status);
        const float above_a = -n->t_zero_a + gyro_a_lsb;
        const float scale_a = n->t_scale_factor_a;
        const float rate_a = above_a / scale_a;
        const float above_b = -n->t_zero_b + gyro_b_lsb;
        const float scale_b = n->t_scale_factor_b;
        const float rate_b = above_b / scale_b;
        const float across = (n->t_misalignment_first * rate_a)
            + (n->t_misalignment_second * rate_b);

        out->gyro_a_dps = rate_a;
        out->gyro_b_dps = rate_b;
        out->gyro_b_orthogonal_dps = across;
    }
    return status;
}

/* whether a computed value is within the tolerance of the expected one; never for a NaN */
static uint32_t cal_near(float found, float expected, float tolerance)
{
    const float difference = found - expected;

    return ((difference >= -tolerance) && (difference <= tolerance)) ? 1U : 0U;
}

static const cal_numbers *cal_in_use(const cal_unit *unit)
{
    const uint32_t active = unit->active;

    return ((active == 1U) || (active == 2U)) ? &unit->slots[active - 1U] : NULL;
}

void cal_init(cal_unit *unit)
{
    unit->active = 0U;
}

const char *cal_serial(const cal_unit *unit)
{
    const cal_numbers *n = cal_in_use(unit);

    return (n != NULL) ? n->serial : "";
}

uint32_t cal_revision(const cal_unit *unit)
{
    const cal_numbers *n = cal_in_use(unit);

    return (n != NULL) ? n->revision : 0U;
}

const char *cal_date(const cal_unit *unit)
{
    const cal_numbers *n = cal_in_use(unit);

    return (n != NULL) ? n->date : "";
}

const uint8_t *cal_digest(const cal_unit *unit)
{
    const cal_numbers *n = cal_in_use(unit);

    return (n != NULL) ? n->digest : NULL;
}

uint32_t cal_correct(const cal_unit *unit, const cal_in *in, cal_out *out)
{
    const cal_numbers *n = cal_in_use(unit);
    uint32_t status = 0xc000U;

    if (n != NULL) {
        status = cal_corrected(n, in, out);
    } else {
        out->gyro_a_dps = cal_none();
        out->gyro_b_dps = cal_none();
        out->gyro_b_orthogonal_dps = cal_none();
    }
    return status;
}

#define CAL_NUMBERS 10U
#define CAL_TESTS_AT 152U /* tolerances, vectors */
#define CAL_ROW 28U /* bytes of a vector */
#define CAL_MOST_ROWS 1024U
#define CAL_MOST_UPDATES 8192U
#define CAL_MOST_COUNT 16777216U

static uint32_t cal_fill(cal_numbers *n, const uint8_t at[])
{
    uint32_t finite = 1U;
    uint32_t k;

    n->t_gyro_a_lsb_range[0] = cal_number(&at[0]);
    n->t_gyro_a_lsb_range[1] = cal_number(&at[4]);
    n->t_gyro_b_lsb_range[0] = cal_number(&at[8]);
    n->t_gyro_b_lsb_range[1] = cal_number(&at[12]);
    n->t_zero_a = cal_number(&at[16]);
    n->t_scale_factor_a = cal_number(&at[20]);
    n->t_zero_b = cal_number(&at[24]);
    n->t_scale_factor_b = cal_number(&at[28]);
    n->t_misalignment_first = cal_number(&at[32]);
    n->t_misalignment_second = cal_number(&at[36]);
    for (k = 0U; k < CAL_NUMBERS; k++) {
        finite &= cal_finite(cal_number(&at[k * 4U]));
    }
    return finite;
}

static uint32_t cal_testable(const cal_numbers *n)
{
    uint32_t sane = 1U;
    uint32_t updates = 0U;
    uint32_t k;

    for (k = 0U; k < 3U; k++) {
        const float tolerance = cal_number(&n->tests[k * 4U]);

        sane &= ((tolerance >= 0.0F) && (cal_finite(tolerance) != 0U)) ? 1U : 0U;
    }
    for (k = 0U; k < n->rows; k++) {
        const uint8_t *row = &n->tests[12U + (k * CAL_ROW)];
        const uint32_t count = cal_count(cal_number(&row[20]), CAL_MOST_UPDATES);

        sane &= (cal_count(cal_number(&row[24]), 0x10000U) < 0x10000U) ? 1U : 0U;
        sane &= (count > 0U) ? 1U : 0U;
        updates += count;
    }
    return ((sane != 0U) && (updates < CAL_MOST_UPDATES)) ? 1U : 0U;
}

static uint32_t cal_sane(const cal_numbers *n)
{
    uint32_t sane = 0U;

    if ((n->t_gyro_a_lsb_range[0] < n->t_gyro_a_lsb_range[1])
        && (n->t_gyro_b_lsb_range[0] < n->t_gyro_b_lsb_range[1])) {
        sane = cal_testable(n);
    }
    return sane;
}

/* whether the chain gives what the blob says it gives */
static uint32_t cal_hold(const cal_numbers *n)
{
    uint32_t holds = 1U;
    uint32_t k;

    for (k = 0U; k < n->rows; k++) {
        const uint8_t *row = &n->tests[12U + (k * CAL_ROW)];
        uint32_t status = CAL_OK;
        cal_in in;
        cal_out out;

        in.gyro_a_lsb = cal_number(&row[0]);
        in.gyro_b_lsb = cal_number(&row[4]);
        out.gyro_a_dps = 0.0F;
        out.gyro_b_dps = 0.0F;
        out.gyro_b_orthogonal_dps = 0.0F;
        status = cal_corrected(n, &in, &out);
        if ((status != cal_count(cal_number(&row[24]), 0x10000U))
            || (cal_near(out.gyro_a_dps, cal_number(&row[8]), cal_number(&n->tests[0])) == 0U)
            || (cal_near(out.gyro_b_dps, cal_number(&row[12]), cal_number(&n->tests[4])) == 0U)
            || (cal_near(out.gyro_b_orthogonal_dps, cal_number(&row[16]), cal_number(&n->tests[8])) == 0U)) {
            holds = 0U;
        }
    }
    return holds;
}

/* why the frame of a blob is not taken; CAL_LOADED where it is right */
static uint32_t cal_frame(const uint8_t blob[], uint32_t size)
{
    static const uint8_t digits[9] = {0x31U, 0x32U, 0x33U, 0x34U, 0x35U, 0x36U, 0x37U, 0x38U, 0x39U};
    const uint32_t length = (size >= 112U) ? cal_u32(&blob[8]) : 0U;
    uint32_t reason = CAL_LOADED;

    if (cal_crc(digits, 9U) != 0xCBF43926U) {
        reason = CAL_LOAD_CRC_ENGINE;
    } else if ((length < 116U) || (length > size)) {
        reason = CAL_LOAD_LENGTH;
    } else if (cal_u32(blob) != 0x424C4143U) {
        reason = CAL_LOAD_MAGIC;
    } else if (((uint32_t)blob[4] | ((uint32_t)blob[5] << 8U)) != 1U) {
        reason = CAL_LOAD_SCHEMA;
    } else if (cal_crc(blob, length - 4U) != cal_u32(&blob[length - 4U])) {
        reason = CAL_LOAD_CRC;
    } else {
        /* whole */
    }
    return reason;
}

/* whether a blob with a right frame is laid out for this loader, and holds all that it counts */
static uint32_t cal_laid_out(const uint8_t blob[])
{
    static const uint8_t layout[8] = {0xe7U, 0x08U, 0xe4U, 0xa8U, 0xa2U, 0x9eU, 0xcbU, 0x26U};
    const uint32_t rows = cal_u32(&blob[108]);
    uint32_t same = 1U;
    uint32_t k;

    for (k = 0U; k < 8U; k++) {
        same &= (blob[16U + k] == layout[k]) ? 1U : 0U;
    }
    if ((((uint32_t)blob[12] | ((uint32_t)blob[13] << 8U)) != 32U) || (cal_u32(&blob[104]) != CAL_NUMBERS)
        || (rows == 0U) || (rows > CAL_MOST_ROWS)) {
        same = 0U;
    } else if (cal_u32(&blob[8]) < (CAL_TESTS_AT + 12U + (rows * CAL_ROW) + 4U)) {
        same = 0U;
    } else {
        /* all there */
    }
    return same;
}

/* whether a blob is for the device that is expected */
static uint32_t cal_is_for(const uint8_t blob[], const char *serial)
{
    uint32_t same = 1U;
    uint32_t ended = 0U;
    uint32_t k;

    for (k = 0U; k < 32U; k++) {
        const uint32_t wanted = (ended != 0U) ? 0U : (uint32_t)(uint8_t)serial[k];

        ended |= (wanted == 0U) ? 1U : 0U;
        same &= (wanted == (uint32_t)blob[28U + k]) ? 1U : 0U;
    }
    return (ended != 0U) ? same : (same & ((serial[32] == '\0') ? 1U : 0U));
}

/* whom the numbers are of */
static void cal_name(const uint8_t blob[], cal_numbers *n)
{
    uint32_t k;

    for (k = 0U; k < 32U; k++) {
        n->serial[k] = (char)blob[28U + k];
    }
    n->serial[32] = '\0';
    for (k = 0U; k < 32U; k++) {
        n->digest[k] = blob[60U + k];
    }
    for (k = 0U; k < 12U; k++) {
        n->date[k] = (char)blob[92U + k];
    }
    n->date[12] = '\0';
    n->revision = cal_u32(&blob[24]);
    n->tests = &blob[CAL_TESTS_AT];
    n->rows = cal_u32(&blob[108]);
}

uint32_t cal_load(cal_unit *unit, const uint8_t blob[], uint32_t size, const char *serial,
    uint32_t least_revision)
{
    uint32_t next = 1U;
    cal_numbers *n = &unit->slots[0];
    uint32_t reason = cal_frame(blob, size);

    if (unit->active == 1U) {
        next = 2U;
        n = &unit->slots[1];
    }
    if (reason == CAL_LOADED) {
        if (cal_laid_out(blob) == 0U) {
            reason = CAL_LOAD_LAYOUT;
#ifndef CAL_ALLOW_REJECTED
        } else if ((blob[14] & 1U) == 0U) {
            reason = CAL_LOAD_REJECTED;
#endif
        } else if ((serial != NULL) && (cal_is_for(blob, serial) == 0U)) {
            reason = CAL_LOAD_SERIAL;
        } else if (cal_u32(&blob[24]) < least_revision) {
            reason = CAL_LOAD_REVISION;
        } else {
            cal_name(blob, n);
            if ((cal_fill(n, &blob[112]) == 0U) || (cal_sane(n) == 0U)) {
                reason = CAL_LOAD_VALUES;
            } else if (cal_hold(n) == 0U) {
                reason = CAL_LOAD_VECTORS;
            } else {
                CAL_BARRIER();
                unit->active = next;
            }
        }
    }
    return reason;
}

#ifndef CAL_NO_SELFTEST
int32_t cal_selftest(const cal_unit *unit)
{
    const cal_numbers *n = cal_in_use(unit);
    int32_t failed = 1;

    if ((n != NULL) && (cal_hold(n) != 0U)) {
        failed = 0;
    }
    return failed;
}
#endif

/*
 * The steps above:
 * {"program":{"forms":["gyro-scale/1","gyro-orthogonality/1"],"formula":"rate = (indication - F0(T)) / K(T), in deg/s, zero at rest on the laboratory's table","interval_s":null,"number":"f32","scales":{}}}
 * {"input":{"beyond":"RATE_BEYOND","flag":"FULL_SCALE","meaning":"indication of gyro a, counts per second","name":"gyro_a_lsb","table":"gyro_a_lsb_range","unit":"1/s"}}
 * {"input":{"beyond":"RATE_BEYOND","flag":"FULL_SCALE","meaning":"indication of gyro b, counts per second","name":"gyro_b_lsb","table":"gyro_b_lsb_range","unit":"1/s"}}
 * {"sum":{"name":"above_a","terms":[{"factors":[],"over":"","sign":-1,"table":"zero_a"},{"factors":["gyro_a_lsb"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"scale_a","terms":[{"factors":[],"over":"","sign":1,"table":"scale_factor_a"}]}}
 * {"quotient":{"denominator":"scale_a","name":"rate_a","numerator":"above_a"}}
 * {"sum":{"name":"above_b","terms":[{"factors":[],"over":"","sign":-1,"table":"zero_b"},{"factors":["gyro_b_lsb"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"scale_b","terms":[{"factors":[],"over":"","sign":1,"table":"scale_factor_b"}]}}
 * {"quotient":{"denominator":"scale_b","name":"rate_b","numerator":"above_b"}}
 * {"sum":{"name":"across","terms":[{"factors":["rate_a"],"over":"","sign":1,"table":"misalignment_first"},{"factors":["rate_b"],"over":"","sign":1,"table":"misalignment_second"}]}}
 * {"output":{"meaning":"rate about the axis of gyro a","name":"gyro_a_dps","source":"rate_a","unit":"deg/s"}}
 * {"output":{"meaning":"rate about the axis of gyro b","name":"gyro_b_dps","source":"rate_b","unit":"deg/s"}}
 * {"output":{"meaning":"rate about the axis at right angles to gyro a in the plane of both","name":"gyro_b_orthogonal_dps","source":"across","unit":"deg/s"}}
 * {"tables":[["gyro_a_lsb_range",2],["gyro_b_lsb_range",2],["zero_a",1],["scale_factor_a",1],["zero_b",1],["scale_factor_b",1],["misalignment_first",1],["misalignment_second",1]]}
 */
/* sha256 of all lines above: 5f957e3d5600321a82af435a469a6a8738f4e9aaafd561d0e5e2c251eb96180c */
