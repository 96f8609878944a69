/*
 * cal: correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 2, effective from 2025-11-24
 * forms         polynomial/1
 * coefficients  bias.json content digest (field sha256)
 *               752e38b46ef6bacdbff3b31b61d75c283a4dae06054db986b85215571d4f053d
 * run           run.json content digest (field sha256)
 *               ccc2df0912fc8ff60974a67f1a81a8e624744dee95b81fe2028d686e328933f8
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       corrected = indication - bias, each channel in its unit; the bias is 0 at 25 degC, or
 *               at the end of the fitted range nearest to it
 * input         temp_case_degc [degC] = column 'temp_case_degc', in degC, or in the unit that its
 *               header states (recipe: sign = +1)
 * indication    gyro_x_dph [deg/h] = column 'gyro_x_dph', in deg/h, or in the unit that its header
 *               states (recipe: sign = +1)
 * indication    accel_x_g [g] = column 'accel_x_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * fitted over   temp_case_degc 20 to 49.034 degC
 * error bound   bias_gyro_x_dph: 3.3e-07 deg/h
 * error bound   bias_accel_x_g: 5.8e-10 g
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

static const float cal_temp_case_degc_range[2] = {16.3671875F, 52.6953125F}; /* least and greatest temp_case_degc [degC] */
static const cal_map cal_u_map = {34.53125F, 0.0688172057F, {-1.0F, 0.998038709F}};
static const float cal_p_gyro_x_dph[4] = {0.446213514F, 0.699484348F, 0.0389822796F, 0.0148235587F};
static const float cal_p_accel_x_g[4] = {0.000949255773F, 0.00145014224F, 4.44598072e-06F, 0.0F};

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

uint32_t cal_correct(const cal_in *in, cal_out *out)
{
    uint32_t status = CAL_OK;

    if (cal_finite(in->temp_case_degc) == 0U) {
        const float none = in->temp_case_degc - in->temp_case_degc; /* a NaN */

        out->bias_gyro_x_dph = none;
        out->bias_accel_x_g = none;
        status = CAL_INVALID;
    } else {
        const float temp_case_degc = cal_limited(in->temp_case_degc, cal_temp_case_degc_range, 0U, &status);
        const float u = cal_mapped(temp_case_degc, &cal_u_map, CAL_TEMP_CLAMPED, &status);
        const float bias_gyro_x_dph = cal_polynomial(cal_p_gyro_x_dph, 4U, u);
        const float bias_accel_x_g = cal_polynomial(cal_p_accel_x_g, 4U, u);

        out->bias_gyro_x_dph = bias_gyro_x_dph;
        out->bias_accel_x_g = bias_accel_x_g;
    }
    return status;
}

#ifndef CAL_NO_SELFTEST
#define CAL_TESTS 16U

/* whether a computed value is within the tolerance of the expected one; never for a NaN */
static uint32_t cal_near(float found, float expected, float tolerance)
{
    const float difference = found - expected;

    return ((difference >= -tolerance) && (difference <= tolerance)) ? 1U : 0U;
}

static const cal_in cal_test_in[CAL_TESTS] = {
    {22.03125F},
    {24.3125F},
    {26.59375F},
    {28.84375F},
    {31.125F},
    {33.40625F},
    {35.65625F},
    {37.9375F},
    {40.21875F},
    {42.46875F},
    {44.75F},
    {47.03125F},
    {16.0F},
    {53.0625F},
    {40.15625F},
    {26.71875F}
};
static const cal_out cal_test_out[CAL_TESTS] = {
    {-0.136083394F, -0.000294888509F},
    {-0.0315592289F, -6.83229882e-05F},
    {0.0733448863F, 0.000158461626F},
    {0.177519798F, 0.000382354308F},
    {0.284199417F, 0.000609574257F},
    {0.392286658F, 0.000837013358F},
    {0.500607669F, 0.00106155151F},
    {0.612511575F, 0.00128942588F},
    {0.726850748F, 0.00151751947F},
    {0.842344761F, 0.00174270314F},
    {0.962541819F, 0.00197123177F},
    {1.08620191F, 0.00219997996F},
    {-0.229112118F, -0.000496440451F},
    {1.19789195F, 0.00240098243F},
    {0.723682761F, 0.00151126739F},
    {0.0791108608F, 0.000170894491F}
};
static const uint32_t cal_test_status[CAL_TESTS] = {
    0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U,
    0x1U, 0x1U, 0x0U, 0x0U
};

int32_t cal_selftest(void)
{
    int32_t failed = 0;
    uint32_t k;

    for (k = 0U; k < CAL_TESTS; k++) {
        cal_out out;
        const uint32_t status = cal_correct(&cal_test_in[k], &out);

        if ((status != cal_test_status[k])
            || (cal_near(out.bias_gyro_x_dph, cal_test_out[k].bias_gyro_x_dph, 6.4e-07F) == 0U)
            || (cal_near(out.bias_accel_x_g, cal_test_out[k].bias_accel_x_g, 1.2e-09F) == 0U)) {
            failed = 1;
        }
    }
    return failed;
}
#endif

/*
 * The steps above as `calibkit verify` reads them again:
 * {"program":{"forms":["polynomial/1"],"formula":"corrected = indication - bias, each channel in its unit; the bias is 0 at 25 degC, or at the end of the fitted range nearest to it","interval_s":null,"number":"f32","scales":{}}}
 * {"input":{"flag":"","meaning":"abscissa of the bias","name":"temp_case_degc","table":"temp_case_degc_range","unit":"degC"}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"u","source":"temp_case_degc","table":"u_map"}}
 * {"sum":{"name":"bias_gyro_x_dph","terms":[{"factors":[],"over":"u","sign":1,"table":"p_gyro_x_dph"}]}}
 * {"sum":{"name":"bias_accel_x_g","terms":[{"factors":[],"over":"u","sign":1,"table":"p_accel_x_g"}]}}
 * {"output":{"meaning":"bias of gyro_x_dph, to be subtracted from it","name":"bias_gyro_x_dph","source":"bias_gyro_x_dph","unit":"deg/h"}}
 * {"output":{"meaning":"bias of accel_x_g, to be subtracted from it","name":"bias_accel_x_g","source":"bias_accel_x_g","unit":"g"}}
 */
/* sha256 of all lines above: 49b62f856fc1c5286d66c61189e3563b687ba4f5fa179a412a7c01d309f8fbd2 */
