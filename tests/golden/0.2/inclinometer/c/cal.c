/*
 * cal: correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 2, effective from 2025-11-24
 * forms         inclinometer-scale/1
 * coefficients  inclinometer_scale.json content digest (field sha256)
 *               f418a40d6241b93a0e201b5f122741d33fc25850e355ad61ae4592b9fcc1ffb3
 * run           run.json content digest (field sha256)
 *               95d35bf421fe0b9e2f81bc67caf46f0556007626e370912f310c6cb336189529
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       corrected = scale * indication, for each gyro
 * input         temp_case_degc [degC] = column 'temp_case_degc', in degC, or in the unit that its
 *               header states (recipe: sign = +1)
 * indication    gyro_x_dph [deg/h] = column 'gyro_x_dph', in deg/h, or in the unit that its header
 *               states (recipe: sign = +1)
 * indication    gyro_y_dph [deg/h] = column 'gyro_y_dph', in deg/h, or in the unit that its header
 *               states (recipe: sign = +1)
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * fitted over   temp_case_degc 20.64 to 119.2 degC
 * error bound   scale_x: 8.7e-08
 * error bound   scale_y: 1.2e-07
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

static const float cal_temp_case_degc_range[2] = {8.15625F, 131.59375F}; /* least and greatest temp_case_degc [degC] */
static const cal_map cal_u_map = {69.875F, 0.0202531647F, {-0.997164547F, 0.998582304F}};
static const float cal_s_x_of_t[4] = {1.00258482F, -0.00357509241F, 0.0F, 0.0F};
static const float cal_s_y_of_t[4] = {1.01027954F, 0.0F, 0.0F, 0.0F};

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

        out->scale_x = none;
        out->scale_y = none;
        status = CAL_INVALID;
    } else {
        const float temp_case_degc = cal_limited(in->temp_case_degc, cal_temp_case_degc_range, 0U, &status);
        const float u = cal_mapped(temp_case_degc, &cal_u_map, CAL_TEMP_CLAMPED, &status);
        const float s_x = cal_polynomial(cal_s_x_of_t, 4U, u);
        const float s_y = cal_polynomial(cal_s_y_of_t, 4U, u);

        out->scale_x = s_x;
        out->scale_y = s_y;
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
    {27.4375F},
    {35.1875F},
    {42.875F},
    {50.5625F},
    {58.3125F},
    {66.0F},
    {73.75F},
    {81.4375F},
    {89.1875F},
    {96.875F},
    {104.5625F},
    {112.3125F},
    {6.9375F},
    {132.8125F},
    {89.0F},
    {43.3125F}
};
static const cal_out cal_test_out[CAL_TESTS] = {
    {1.00565755F, 1.01027954F},
    {1.00509644F, 1.01027954F},
    {1.00453985F, 1.01027954F},
    {1.00398314F, 1.01027954F},
    {1.00342202F, 1.01027954F},
    {1.00286543F, 1.01027954F},
    {1.0023042F, 1.01027954F},
    {1.00174761F, 1.01027954F},
    {1.00118649F, 1.01027954F},
    {1.00062978F, 1.01027954F},
    {1.00007319F, 1.01027954F},
    {0.999512017F, 1.01027954F},
    {1.00614977F, 1.01027954F},
    {0.999014795F, 1.01027954F},
    {1.00120008F, 1.01027954F},
    {1.00450814F, 1.01027954F}
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
            || (cal_near(out.scale_x, cal_test_out[k].scale_x, 1.7e-07F) == 0U)
            || (cal_near(out.scale_y, cal_test_out[k].scale_y, 2.4e-07F) == 0U)) {
            failed = 1;
        }
    }
    return failed;
}
#endif

/*
 * The steps above as `calibkit verify` reads them again:
 * {"program":{"forms":["inclinometer-scale/1"],"formula":"corrected = scale * indication, for each gyro","interval_s":null,"number":"f32","scales":{}}}
 * {"input":{"flag":"","meaning":"temperature of the sensor case","name":"temp_case_degc","table":"temp_case_degc_range","unit":"degC"}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"u","source":"temp_case_degc","table":"u_map"}}
 * {"sum":{"name":"s_x","terms":[{"factors":[],"over":"u","sign":1,"table":"s_x_of_t"}]}}
 * {"sum":{"name":"s_y","terms":[{"factors":[],"over":"u","sign":1,"table":"s_y_of_t"}]}}
 * {"output":{"meaning":"scale factor of the x gyro, to be multiplied with its indication","name":"scale_x","source":"s_x","unit":"1"}}
 * {"output":{"meaning":"scale factor of the y gyro, to be multiplied with its indication","name":"scale_y","source":"s_y","unit":"1"}}
 */
/* sha256 of all lines above: c50b5f41b8b2fc64c90b0e9183425f61e8a58b8fe136f59f24d4f8b52ce0f0c0 */
