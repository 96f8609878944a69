/*
 * cal: correction chain as firmware; C99, no library
 *
 * device        U2 revision 1, effective from 2026-11-21
 * forms         polynomial/1
 * coefficients  bias.json content digest (field sha256)
 *               4f630ef5fa77f8d03082fd474869ccbe47cf1ccdc2393fd30ba89dd8ffeb0ade
 * run           run.json content digest (field sha256)
 *               b0e24ee6a0345f0b9773fc4dfa0b42b8beddb42c65c02516f75ffd9fbce95c5e
 * schema        calibkit-firmware/1, made by calibkit 0.1.0
 * number        f32: IEEE 754 single precision
 * formula       corrected = indication - bias, each channel in its unit
 * fitted over   temp_case_degc 20 to 49.9 degC
 * error bound   bias_gyro_dph: 7.4e-07 deg/h
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

static const float cal_temp_case_degc_range[2] = {16.2265625F, 53.6484375F}; /* least and greatest temp_case_degc [degC] */
static const cal_map cal_u_map = {34.9375F, 0.066805847F, {-0.997912288F, 0.999582469F}};
static const float cal_p_gyro_dph[4] = {0.982407868F, 1.5154413F, 0.0226044115F, -0.0468395948F};

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

        out->bias_gyro_dph = none;
        status = CAL_INVALID;
    } else {
        const float temp_case_degc = cal_limited(in->temp_case_degc, cal_temp_case_degc_range, 0U, &status);
        const float u = cal_mapped(temp_case_degc, &cal_u_map, CAL_TEMP_CLAMPED, &status);
        const float bias_gyro_dph = cal_polynomial(cal_p_gyro_dph, 4U, u);

        out->bias_gyro_dph = bias_gyro_dph;
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
    {22.0625F},
    {24.40625F},
    {26.75F},
    {29.09375F},
    {31.4375F},
    {33.78125F},
    {36.09375F},
    {38.4375F},
    {40.78125F},
    {43.125F},
    {45.46875F},
    {47.8125F},
    {15.84375F},
    {54.03125F},
    {40.75F},
    {26.90625F}
};
static const cal_out cal_test_out[CAL_TESTS] = {
    {-0.274532855F},
    {-0.0562791228F},
    {0.167930305F},
    {0.397016704F},
    {0.62990129F},
    {0.865505159F},
    {1.09958029F},
    {1.33738613F},
    {1.57468915F},
    {1.81041098F},
    {2.04347229F},
    {2.27279472F},
    {-0.460812628F},
    {2.47302103F},
    {1.5715332F},
    {0.183062911F}
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
            || (cal_near(out.bias_gyro_dph, cal_test_out[k].bias_gyro_dph, 1.5e-06F) == 0U)) {
            failed = 1;
        }
    }
    return failed;
}
#endif

/*
 * The steps above as `calibkit verify` reads them again:
 * {"program":{"forms":["polynomial/1"],"formula":"corrected = indication - bias, each channel in its unit","interval_s":null,"number":"f32","scales":{}}}
 * {"input":{"flag":"","meaning":"abscissa of the bias","name":"temp_case_degc","table":"temp_case_degc_range","unit":"degC"}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"u","source":"temp_case_degc","table":"u_map"}}
 * {"sum":{"name":"bias_gyro_dph","terms":[{"factors":[],"over":"u","sign":1,"table":"p_gyro_dph"}]}}
 * {"output":{"meaning":"bias of gyro_dph, to be subtracted from it","name":"bias_gyro_dph","source":"bias_gyro_dph","unit":"deg/h"}}
 */
/* sha256 of all lines above: abc7190d6341dc6dd7fe2658a31957abf0c49ed1a63ae815e7b8ee1d9fc41f4c */
