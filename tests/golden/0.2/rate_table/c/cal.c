/*
 * cal: correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 2, effective from 2025-11-24
 * forms         gyro-scale/1
 * coefficients  gyro_scale.json content digest (field sha256)
 *               dee297ada29192e25d2b4bd44c83beafc1c57e58dc449477a84203ddc81467f5
 * run           run.json content digest (field sha256)
 *               6fbe2cceb8990492b941ab0e0175720979ee7e313716f5c3dd9b14cd8c9abd8e
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       rate = (indication - F0(T)) / K(T), in deg/s, zero at rest on the laboratory's table
 * input         temp_case_degc [degC] = column 'temp_case_degc', in degC, or in the unit that its
 *               header states (recipe: sign = +1)
 * input         gyro_x_lsb [1/s] = column 'gyro_x_lsb', in 1/s, or in the unit that its header states
 *               (recipe: sign = +1)
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * fitted over   temp_case_degc -40.04 to 60.18 degC
 * fitted over   rate of gyro x -100 to 100 deg/s
 * error bound   gyro_x_dps: 2.2e-05 deg/s; up to the full scale 4.3e-04 deg/s
 *               (worst case of evaluation against the exact chain, over all inputs in range)
 *
 * Results are bit for bit those of calibkit's twin with -ffp-contract=off; else within twice the error
 *               bound.
 */

#include "cal.h"

#include <float.h>

#if defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0)
#error -ffast-math and -ffinite-math-only delete the guard against NaN
#endif

typedef struct {
    float middle;
    float reciprocal;
    float range[2];
} cal_map;

static const float cal_temp_case_degc_range[2] = {-52.6875F, 72.9375F}; /* least and greatest temp_case_degc [degC] */
static const float cal_gyro_x_lsb_range[2] = {-1047351.0F, 1047351.0F}; /* least and greatest gyro_x_lsb [1/s] */
static const cal_map cal_u_x_map = {10.125F, 0.019900497F, {-0.99810946F, 0.99611938F}};
static const float cal_zero_x[4] = {25.4851189F, 0.152640805F, 0.0F, 0.0F};
static const float cal_scale_factor_x[4] = {9962.29688F, -12.2223473F, 0.0F, 0.0F};

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

/* an indication as it is, which may be outside [range[0], range[1]] */
static float cal_indicated(float x, const float range[], uint32_t beyond, uint32_t *status)
{
    if ((x < range[0]) || (x > range[1])) {
        *status |= beyond;
    }
    return x;
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

uint32_t cal_correct(const cal_in *in, cal_out *out)
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
        const float gyro_x_lsb = cal_indicated(in->gyro_x_lsb, cal_gyro_x_lsb_range, CAL_RATE_BEYOND, &status);
        const float u_x = cal_mapped(temp_case_degc, &cal_u_x_map, CAL_TEMP_CLAMPED, &status);
        const float above_x = -cal_polynomial(cal_zero_x, 4U, u_x) + gyro_x_lsb;
        const float scale_x = cal_polynomial(cal_scale_factor_x, 4U, u_x);
        const float rate_x = above_x / scale_x;

        out->gyro_x_dps = rate_x;
    }
    return status;
}

#ifndef CAL_NO_SELFTEST
#define CAL_TESTS 18U

/* whether a computed value is within the tolerance of the expected one; never for a NaN */
static uint32_t cal_near(float found, float expected, float tolerance)
{
    const float difference = found - expected;

    return ((difference >= -tolerance) && (difference <= tolerance)) ? 1U : 0U;
}

static const cal_in cal_test_in[CAL_TESTS] = {
    {-33.0625F, -239616.0F},
    {-25.1875F, 239616.0F},
    {-17.375F, -432128.0F},
    {-9.5F, 48128.0F},
    {-1.625F, 528384.0F},
    {6.1875F, -144384.0F},
    {14.0625F, 335872.0F},
    {21.875F, -335872.0F},
    {29.75F, 144384.0F},
    {37.625F, -528384.0F},
    {45.4375F, -48128.0F},
    {53.3125F, 432128.0F},
    {-53.9375F, 209920.0F},
    {74.1875F, -628736.0F},
    {29.625F, 523264.0F},
    {-16.875F, -733184.0F},
    {-53.9375F, -1068032.0F},
    {74.1875F, 1068032.0F}
};
static const cal_out cal_test_out[CAL_TESTS] = {
    {-24.0294914F},
    {24.0290203F},
    {-43.3497887F},
    {4.82614994F},
    {53.020607F},
    {-14.4942064F},
    {33.7149963F},
    {-33.7265549F},
    {14.4974251F},
    {-53.0765724F},
    {-4.83775425F},
    {43.4195557F},
    {21.0431347F},
    {-63.191349F},
    {52.5468903F},
    {-73.549942F},
    {-107.078827F},
    {107.336006F}
};
static const uint32_t cal_test_status[CAL_TESTS] = {
    0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U,
    0x2U, 0x2U, 0x0U, 0x0U, 0x3U, 0x3U
};

int32_t cal_selftest(void)
{
    int32_t failed = 0;
    uint32_t k;

    for (k = 0U; k < CAL_TESTS; k++) {
        cal_out out;
        const uint32_t status = cal_correct(&cal_test_in[k], &out);

        if ((status != cal_test_status[k])
            || (cal_near(out.gyro_x_dps, cal_test_out[k].gyro_x_dps, 4.4e-05F) == 0U)) {
            failed = 1;
        }
    }
    return failed;
}
#endif

/*
 * The steps above as `calibkit verify` reads them again:
 * {"program":{"forms":["gyro-scale/1"],"formula":"rate = (indication - F0(T)) / K(T), in deg/s, zero at rest on the laboratory's table","interval_s":null,"number":"f32","scales":{}}}
 * {"input":{"flag":"","meaning":"temperature of the sensor case","name":"temp_case_degc","table":"temp_case_degc_range","unit":"degC"}}
 * {"input":{"beyond":"RATE_BEYOND","flag":"FULL_SCALE","meaning":"indication of gyro x, counts per second","name":"gyro_x_lsb","table":"gyro_x_lsb_range","unit":"1/s"}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"u_x","source":"temp_case_degc","table":"u_x_map"}}
 * {"sum":{"name":"above_x","terms":[{"factors":[],"over":"u_x","sign":-1,"table":"zero_x"},{"factors":["gyro_x_lsb"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"scale_x","terms":[{"factors":[],"over":"u_x","sign":1,"table":"scale_factor_x"}]}}
 * {"quotient":{"denominator":"scale_x","name":"rate_x","numerator":"above_x"}}
 * {"output":{"meaning":"rate about the axis of gyro x","name":"gyro_x_dps","source":"rate_x","unit":"deg/s"}}
 */
/* sha256 of all lines above: 652ba52226dd63bafd6ade76ef22ec71379fa821877e678bc2d719d7e411e106 */
