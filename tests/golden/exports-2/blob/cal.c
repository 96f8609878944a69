/*
 * cal: loader of blobs, correction chain as firmware; C99, no library
 *
 * layout        8f085b1a95605754: a blob of any other is refused
 * forms         gyro-scale/1
 * number        f32: IEEE 754 single precision
 * formula       rate = (indication - F0(T)) / K(T), in deg/s, zero at rest on the laboratory's table
 * units         of every input and output below; ranges and error bounds are each unit's own and stand
 *               in
 *               the text of its blob
 *
 * Results are bit for bit those of calibkit's twin with -ffp-contract=off; else within twice the error
 *               bound.
 */

#include "cal.h"

#include <float.h>

#if defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0)
#error -ffast-math and -ffinite-math-only delete the guard against NaN
#endif

#define CAL_TESTS_AT 160U /* tolerances, then vectors */
#define CAL_NEEDED 488U

typedef struct {
    float middle;
    float reciprocal;
    float range[2];
} cal_map;

static float cal_temp_case_degc_range[2];
static float cal_gyro_x_lsb_range[2];
static cal_map cal_u_x_map;
static float cal_zero_x[2];
static float cal_scale_factor_x[2];
static uint32_t cal_ready = 0U; /* 1: a blob was accepted */
static const uint8_t *cal_tests = (const uint8_t *)0; /* its tolerances and vectors */

/* x brought into [range[0], range[1]] */
static float cal_limited(float x, const float range[], uint32_t flag, uint32_t *status)
{
    float y = x;

    if (x < range[0]) {
        y = range[0];
        *status |= flag;
    } else if (x > range[1]) {
        y = range[1];
        *status |= flag;
    } else {
        /* inside */
    }
    return y;
}

/* u = (x - middle) / half, brought into its range */
static float cal_mapped(float x, const cal_map *map, uint32_t flag, uint32_t *status)
{
    const float u = (x - map->middle) * map->reciprocal;

    return cal_limited(u, map->range, flag, status);
}

/* c[0] + c[1] x + ... + c[count - 1] x^(count - 1) by Horner's scheme: ascending, index = power */
static float cal_polynomial(const float c[], uint32_t count, float x)
{
    float y = c[count - 1U];
    uint32_t k;

    for (k = count - 1U; k > 0U; k--) {
        y = (y * x) + c[k - 1U];
    }
    return y;
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

static uint32_t cal_evaluated(const cal_in *in, cal_out *out)
{
    uint32_t status = CAL_OK;

    if ((cal_finite(in->temp_case_degc) == 0U)
        || (cal_finite(in->gyro_x_lsb) == 0U)) {
        const float none = (in->temp_case_degc - in->temp_case_degc)
            + (in->gyro_x_lsb - in->gyro_x_lsb); /* a NaN */

        out->gyro_x_dps = none;
        status = CAL_INVALID;
    } else {
        const float temp_case_degc = cal_limited(in->temp_case_degc, cal_temp_case_degc_range, 0U, &status);
        const float gyro_x_lsb = cal_limited(in->gyro_x_lsb, cal_gyro_x_lsb_range, CAL_RATE_CLAMPED, &status);
        const float u_x = cal_mapped(temp_case_degc, &cal_u_x_map, CAL_TEMP_CLAMPED, &status);
        const float above_x = -cal_polynomial(cal_zero_x, 2U, u_x) + gyro_x_lsb;
        const float scale_x = cal_polynomial(cal_scale_factor_x, 2U, u_x);
        const float rate_x = above_x / scale_x;

        out->gyro_x_dps = rate_x;
    }
    return status;
}

uint32_t cal_correct(const cal_in *in, cal_out *out)
{
    uint32_t status = 0xc000U;

    if (cal_ready != 0U) {
        status = cal_evaluated(in, out);
    } else {
        out->gyro_x_dps = cal_none();
    }
    return status;
}

/* whether a computed value is within the tolerance of the expected one; never for a NaN */
static uint32_t cal_near(float found, float expected, float tolerance)
{
    const float difference = found - expected;

    return ((difference >= -tolerance) && (difference <= tolerance)) ? 1U : 0U;
}

static uint32_t cal_fill(const uint8_t at[])
{
    uint32_t finite = 1U;
    uint32_t k;

    cal_temp_case_degc_range[0] = cal_number(&at[0]);
    cal_temp_case_degc_range[1] = cal_number(&at[4]);
    cal_gyro_x_lsb_range[0] = cal_number(&at[8]);
    cal_gyro_x_lsb_range[1] = cal_number(&at[12]);
    cal_u_x_map.middle = cal_number(&at[16]);
    cal_u_x_map.reciprocal = cal_number(&at[20]);
    cal_u_x_map.range[0] = cal_number(&at[24]);
    cal_u_x_map.range[1] = cal_number(&at[28]);
    cal_zero_x[0] = cal_number(&at[32]);
    cal_zero_x[1] = cal_number(&at[36]);
    cal_scale_factor_x[0] = cal_number(&at[40]);
    cal_scale_factor_x[1] = cal_number(&at[44]);
    for (k = 0U; k < 12U; k++) {
        finite &= cal_finite(cal_number(&at[k * 4U]));
    }
    return finite;
}

static uint32_t cal_sane(void)
{
    return ((cal_temp_case_degc_range[0] < cal_temp_case_degc_range[1])
        && (cal_gyro_x_lsb_range[0] < cal_gyro_x_lsb_range[1])
        && (cal_u_x_map.range[0] < cal_u_x_map.range[1])) ? 1U : 0U;
}

/* whether the chain gives what the blob says it gives */
static uint32_t cal_hold(const uint8_t at[])
{
    uint32_t holds = 1U;
    uint32_t k;

    for (k = 0U; k < 16U; k++) {
        const uint8_t *row = &at[(1U + (k * 5U)) * 4U];
        cal_in in;
        cal_out out;
        uint32_t status = CAL_OK;

        in.temp_case_degc = cal_number(&row[0]);
        in.gyro_x_lsb = cal_number(&row[4]);
        status = cal_evaluated(&in, &out);
        if ((status != (uint32_t)cal_number(&row[16]))
            || (cal_near(out.gyro_x_dps, cal_number(&row[8]), cal_number(&at[0])) == 0U)) {
            holds = 0U;
        }
    }
    return holds;
}

uint32_t cal_load(const uint8_t blob[], uint32_t size)
{
    static const uint8_t digits[9] = {0x31U, 0x32U, 0x33U, 0x34U, 0x35U, 0x36U, 0x37U, 0x38U, 0x39U};
    static const uint8_t layout[8] = {0x8fU, 0x08U, 0x5bU, 0x1aU, 0x95U, 0x60U, 0x57U, 0x54U};
    const uint32_t length = (size >= 112U) ? cal_u32(&blob[8]) : 0U;
    uint32_t reason = CAL_LOADED;
    uint32_t same = 1U;
    uint32_t k;

    cal_ready = 0U;
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
        for (k = 0U; k < 8U; k++) {
            same &= (blob[16U + k] == layout[k]) ? 1U : 0U;
        }
        if ((same == 0U) || (length < CAL_NEEDED)) {
            reason = CAL_LOAD_LAYOUT;
#ifndef CAL_ALLOW_REJECTED
        } else if ((blob[14] & 1U) == 0U) {
            reason = CAL_LOAD_REJECTED;
#endif
        } else if ((cal_fill(&blob[112]) == 0U) || (cal_sane() == 0U)) {
            reason = CAL_LOAD_VALUES;
        } else if (cal_hold(&blob[CAL_TESTS_AT]) == 0U) {
            reason = CAL_LOAD_VECTORS;
        } else {
            cal_tests = &blob[CAL_TESTS_AT];
            cal_ready = 1U;
        }
    }
    return reason;
}

#ifndef CAL_NO_SELFTEST
int32_t cal_selftest(void)
{
    int32_t failed = 1;

    if (cal_ready != 0U) {
        failed = (cal_hold(cal_tests) != 0U) ? 0 : 1;
    }
    return failed;
}
#endif

/*
 * The steps above:
 * {"program":{"forms":["gyro-scale/1"],"formula":"rate = (indication - F0(T)) / K(T), in deg/s, zero at rest on the laboratory's table","interval_s":null,"number":"f32","scales":{}}}
 * {"input":{"flag":"","meaning":"temperature of the sensor case","name":"temp_case_degc","table":"temp_case_degc_range","unit":"degC"}}
 * {"input":{"flag":"RATE_CLAMPED","meaning":"indication of gyro x, counts per second","name":"gyro_x_lsb","table":"gyro_x_lsb_range","unit":"1/s"}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"u_x","source":"temp_case_degc","table":"u_x_map"}}
 * {"sum":{"name":"above_x","terms":[{"factors":[],"over":"u_x","sign":-1,"table":"zero_x"},{"factors":["gyro_x_lsb"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"scale_x","terms":[{"factors":[],"over":"u_x","sign":1,"table":"scale_factor_x"}]}}
 * {"quotient":{"denominator":"scale_x","name":"rate_x","numerator":"above_x"}}
 * {"output":{"meaning":"rate about the axis of gyro x","name":"gyro_x_dps","source":"rate_x","unit":"deg/s"}}
 * {"tables":[["temp_case_degc_range",2],["gyro_x_lsb_range",2],["u_x_map",4],["zero_x",2],["scale_factor_x",2]]}
 */
/* sha256 of all lines above: 5bab7bfe6719bc42d602f995410ed60a93192d3c910c4350125b05042d5ef045 */
