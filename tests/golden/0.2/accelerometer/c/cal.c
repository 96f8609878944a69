/*
 * cal: correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 1, effective from 2024-11-24
 * forms         accel-affine/1
 * coefficients  accel_affine.json content digest (field sha256)
 *               8bfe27b3a2f302cd2a40fe5e2070312c912b6bd6f529333b510da482cc064fb1
 * run           run.json content digest (field sha256)
 *               3dc59bc5ed96de4907d40a42154bae351933e8d3d17f7f6d15d45bd3d67e1a93
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       corrected = M(T) (indication - b(T)), in local g
 * input         temp_case_degc [degC] = column 'temp_case_degc', in degC, or in the unit that its
 *               header states (recipe: sign = +1)
 * input         accel_x_g [g] = column 'accel_x_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * input         accel_y_g [g] = column 'accel_y_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * input         accel_z_g [g] = column 'accel_z_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * convention    accelerometers in and out: positive along gravity
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * fitted over   temp_case_degc -20.5 to 125.4 degC
 * error bound   accel_x_g: 3.9e-07 g; up to the full scale 4.7e-06 g
 * error bound   accel_y_g: 3.4e-07 g; up to the full scale 4.2e-06 g
 * error bound   accel_z_g: 3.9e-07 g; up to the full scale 4.8e-06 g
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

static const float cal_temp_case_degc_range[2] = {-38.75F, 143.75F}; /* least and greatest temp_case_degc [degC] */
static const float cal_accel_x_g_range[2] = {-1.25F, 1.25F}; /* least and greatest accel_x_g [g] */
static const float cal_accel_y_g_range[2] = {-1.25F, 1.25F}; /* least and greatest accel_y_g [g] */
static const float cal_accel_z_g_range[2] = {-1.25F, 1.25F}; /* least and greatest accel_z_g [g] */
static const cal_map cal_u_map = {52.5F, 0.01369863F, {-0.999876738F, 0.998273969F}};
static const float cal_b_x[4] = {0.0100334985F, 0.000382212282F, -1.58069793e-06F, -4.11696492e-05F};
static const float cal_b_y[4] = {0.00320665096F, 0.00412025768F, -5.55847801e-05F, 1.30492963e-05F};
static const float cal_b_z[4] = {0.00166331173F, -0.0011700344F, 6.12165923e-06F, 1.69145405e-05F};
static const float cal_m_xy[4] = {0.00761798304F, 8.22595466e-05F, 0.0F, 0.0F};
static const float cal_m_xz[4] = {-0.0012815845F, -4.10875764e-05F, 0.0F, 0.0F};
static const float cal_m_xx[4] = {1.00934851F, 0.00881431345F, 0.000455827249F, -1.55928556e-05F};
static const float cal_m_yx[4] = {-0.00142050558F, 6.86686762e-05F, 0.0F, 0.0F};
static const float cal_m_yz[4] = {-0.00288481452F, -1.25198449e-05F, 0.0F, 0.0F};
static const float cal_m_yy[4] = {1.00146389F, 0.00839525927F, 0.000579521467F, 2.85350761e-05F};
static const float cal_m_zx[4] = {-0.00258280896F, 0.000135154158F, 0.0F, 0.0F};
static const float cal_m_zy[4] = {-0.00175359612F, 3.09369716e-05F, 0.0F, 0.0F};
static const float cal_m_zz[4] = {1.00538695F, 0.00682104845F, 0.000559162814F, -2.38631674e-05F};

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
        || (cal_finite(in->accel_x_g) == 0U)
        || (cal_finite(in->accel_y_g) == 0U)
        || (cal_finite(in->accel_z_g) == 0U)) {
        const float none = (in->temp_case_degc - in->temp_case_degc)
            + (in->accel_x_g - in->accel_x_g)
            + (in->accel_y_g - in->accel_y_g)
            + (in->accel_z_g - in->accel_z_g); /* a NaN */

        out->accel_x_g = none;
        out->accel_y_g = none;
        out->accel_z_g = none;
        status = CAL_INVALID;
    } else {
        const float temp_case_degc = cal_limited(in->temp_case_degc, cal_temp_case_degc_range, 0U, &status);
        const float accel_x_g = cal_indicated(in->accel_x_g, cal_accel_x_g_range, CAL_ACCEL_BEYOND, &status);
        const float accel_y_g = cal_indicated(in->accel_y_g, cal_accel_y_g_range, CAL_ACCEL_BEYOND, &status);
        const float accel_z_g = cal_indicated(in->accel_z_g, cal_accel_z_g_range, CAL_ACCEL_BEYOND, &status);
        const float u = cal_mapped(temp_case_degc, &cal_u_map, CAL_TEMP_CLAMPED, &status);
        const float x = -cal_polynomial(cal_b_x, 4U, u) + accel_x_g;
        const float y = -cal_polynomial(cal_b_y, 4U, u) + accel_y_g;
        const float z = -cal_polynomial(cal_b_z, 4U, u) + accel_z_g;
        const float k_x = (cal_polynomial(cal_m_xy, 4U, u) * y)
            + (cal_polynomial(cal_m_xz, 4U, u) * z)
            + (cal_polynomial(cal_m_xx, 4U, u) * x);
        const float k_y = (cal_polynomial(cal_m_yx, 4U, u) * x)
            + (cal_polynomial(cal_m_yz, 4U, u) * z)
            + (cal_polynomial(cal_m_yy, 4U, u) * y);
        const float k_z = (cal_polynomial(cal_m_zx, 4U, u) * x)
            + (cal_polynomial(cal_m_zy, 4U, u) * y)
            + (cal_polynomial(cal_m_zz, 4U, u) * z);

        out->accel_x_g = k_x;
        out->accel_y_g = k_y;
        out->accel_z_g = k_z;
    }
    return status;
}

#ifndef CAL_NO_SELFTEST
#define CAL_TESTS 22U

/* whether a computed value is within the tolerance of the expected one; never for a NaN */
static uint32_t cal_near(float found, float expected, float tolerance)
{
    const float difference = found - expected;

    return ((difference >= -tolerance) && (difference <= tolerance)) ? 1U : 0U;
}

static const cal_in cal_test_in[CAL_TESTS] = {
    {-10.25F, -0.287109375F, 0.056640625F, 0.400390625F},
    {1.125F, 0.287109375F, -0.515625F, 0.287109375F},
    {12.625F, -0.515625F, 0.287109375F, 0.171875F},
    {24.0F, 0.056640625F, -0.287109375F, 0.056640625F},
    {35.375F, 0.630859375F, 0.515625F, -0.056640625F},
    {46.75F, -0.171875F, -0.056640625F, -0.171875F},
    {58.25F, 0.400390625F, -0.630859375F, -0.287109375F},
    {69.625F, -0.400390625F, 0.171875F, -0.400390625F},
    {81.0F, 0.171875F, -0.400390625F, -0.515625F},
    {92.375F, -0.630859375F, 0.400390625F, -0.630859375F},
    {103.875F, -0.056640625F, -0.171875F, 0.630859375F},
    {115.25F, 0.515625F, 0.630859375F, 0.515625F},
    {-40.625F, 0.25F, 0.25F, 0.25F},
    {145.625F, -0.75F, -0.75F, -0.75F},
    {80.75F, 0.625F, 0.625F, 0.625F},
    {13.25F, -0.875F, -0.875F, -0.875F},
    {-40.625F, -1.27539062F, 0.25F, 0.25F},
    {145.625F, 1.27539062F, -0.75F, -0.75F},
    {-40.625F, 0.25F, -1.27539062F, 0.25F},
    {145.625F, -0.75F, 1.27539062F, -0.75F},
    {-40.625F, 0.25F, 0.25F, -1.27539062F},
    {145.625F, -0.75F, -0.75F, 1.27539062F}
};
static const cal_out cal_test_out[CAL_TESTS] = {
    {-0.297533482F, 0.0560164973F, 0.398408324F},
    {0.274010926F, -0.514975905F, 0.285046875F},
    {-0.525957406F, 0.285604924F, 0.170773387F},
    {0.0447745994F, -0.288424253F, 0.0550603494F},
    {0.629427135F, 0.512421608F, -0.0613295734F},
    {-0.183684036F, -0.0588103086F, -0.173896939F},
    {0.389782161F, -0.63545996F, -0.290284872F},
    {-0.413410306F, 0.170022622F, -0.403845161F},
    {0.161344945F, -0.405887783F, -0.520740688F},
    {-0.646409512F, 0.400121093F, -0.636826873F},
    {-0.0701751933F, -0.181054339F, 0.637072623F},
    {0.518128276F, 0.627661109F, 0.518626213F},
    {0.242135689F, 0.248312756F, 0.245866358F},
    {-0.779343545F, -0.761988878F, -0.756906211F},
    {0.626642585F, 0.620524585F, 0.626209915F},
    {-0.894560575F, -0.86962986F, -0.875044763F},
    {-1.2847904F, 0.250584334F, 0.250012279F},
    {1.28369176F, -0.764727116F, -0.761864185F},
    {0.230640754F, -1.26734674F, 0.248588458F},
    {-0.763747871F, 1.28456819F, -0.760395408F},
    {0.244027942F, 0.25269413F, -1.27822709F},
    {-0.782022357F, -0.767857075F, 1.29426706F}
};
static const uint32_t cal_test_status[CAL_TESTS] = {
    0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U,
    0x2U, 0x2U, 0x0U, 0x0U, 0x3U, 0x3U, 0x3U, 0x3U, 0x3U, 0x3U
};

int32_t cal_selftest(void)
{
    int32_t failed = 0;
    uint32_t k;

    for (k = 0U; k < CAL_TESTS; k++) {
        cal_out out;
        const uint32_t status = cal_correct(&cal_test_in[k], &out);

        if ((status != cal_test_status[k])
            || (cal_near(out.accel_x_g, cal_test_out[k].accel_x_g, 7.6e-07F) == 0U)
            || (cal_near(out.accel_y_g, cal_test_out[k].accel_y_g, 6.6e-07F) == 0U)
            || (cal_near(out.accel_z_g, cal_test_out[k].accel_z_g, 7.6e-07F) == 0U)) {
            failed = 1;
        }
    }
    return failed;
}
#endif

/*
 * The steps above as `calibkit verify` reads them again:
 * {"program":{"forms":["accel-affine/1"],"formula":"corrected = M(T) (indication - b(T)), in local g","interval_s":null,"number":"f32","scales":{}}}
 * {"input":{"flag":"","meaning":"temperature of the sensor case","name":"temp_case_degc","table":"temp_case_degc_range","unit":"degC"}}
 * {"input":{"beyond":"ACCEL_BEYOND","flag":"FULL_SCALE","meaning":"indication of the x accelerometer, positive along gravity","name":"accel_x_g","table":"accel_x_g_range","unit":"g"}}
 * {"input":{"beyond":"ACCEL_BEYOND","flag":"FULL_SCALE","meaning":"indication of the y accelerometer, positive along gravity","name":"accel_y_g","table":"accel_y_g_range","unit":"g"}}
 * {"input":{"beyond":"ACCEL_BEYOND","flag":"FULL_SCALE","meaning":"indication of the z accelerometer, positive along gravity","name":"accel_z_g","table":"accel_z_g_range","unit":"g"}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"u","source":"temp_case_degc","table":"u_map"}}
 * {"sum":{"name":"x","terms":[{"factors":[],"over":"u","sign":-1,"table":"b_x"},{"factors":["accel_x_g"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"y","terms":[{"factors":[],"over":"u","sign":-1,"table":"b_y"},{"factors":["accel_y_g"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"z","terms":[{"factors":[],"over":"u","sign":-1,"table":"b_z"},{"factors":["accel_z_g"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"k_x","terms":[{"factors":["y"],"over":"u","sign":1,"table":"m_xy"},{"factors":["z"],"over":"u","sign":1,"table":"m_xz"},{"factors":["x"],"over":"u","sign":1,"table":"m_xx"}]}}
 * {"sum":{"name":"k_y","terms":[{"factors":["x"],"over":"u","sign":1,"table":"m_yx"},{"factors":["z"],"over":"u","sign":1,"table":"m_yz"},{"factors":["y"],"over":"u","sign":1,"table":"m_yy"}]}}
 * {"sum":{"name":"k_z","terms":[{"factors":["x"],"over":"u","sign":1,"table":"m_zx"},{"factors":["y"],"over":"u","sign":1,"table":"m_zy"},{"factors":["z"],"over":"u","sign":1,"table":"m_zz"}]}}
 * {"output":{"meaning":"corrected component along x, positive along gravity","name":"accel_x_g","source":"k_x","unit":"g"}}
 * {"output":{"meaning":"corrected component along y, positive along gravity","name":"accel_y_g","source":"k_y","unit":"g"}}
 * {"output":{"meaning":"corrected component along z, positive along gravity","name":"accel_z_g","source":"k_z","unit":"g"}}
 */
/* sha256 of all lines above: 9bd57b012a505d3557463788ef0676ce101f6c1724b655587d9a2fdd744e0622 */
