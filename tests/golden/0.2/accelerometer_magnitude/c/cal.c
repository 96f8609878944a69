/*
 * cal: correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 2, effective from 2025-11-24
 * forms         accel-affine/1
 * coefficients  accel_affine.json content digest (field sha256)
 *               05e60c87d996b0b18a603d3122ffde4c9e5dbe8d49fb549d2f58959266c19220
 * run           run.json content digest (field sha256)
 *               4f5d827e41ef674703874ffe3347ecdb0c3eeb4710c170d44c102aa2c30f19a8
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       corrected = M(T) (indication - b(T)), in local g
 * input         accel_x_g [g] = column 'accel_x_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * input         accel_y_g [g] = column 'accel_y_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * input         accel_z_g [g] = column 'accel_z_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * convention    accelerometers in and out: positive along gravity
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * error bound   accel_x_g: 1.8e-07 g; up to the full scale 2.4e-06 g
 * error bound   accel_y_g: 3.0e-07 g; up to the full scale 3.9e-06 g
 * error bound   accel_z_g: 2.6e-07 g; up to the full scale 3.4e-06 g
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

static const float cal_accel_x_g_range[2] = {-1.25F, 1.25F}; /* least and greatest accel_x_g [g] */
static const float cal_accel_y_g_range[2] = {-1.25F, 1.25F}; /* least and greatest accel_y_g [g] */
static const float cal_accel_z_g_range[2] = {-1.25F, 1.25F}; /* least and greatest accel_z_g [g] */
static const float cal_b_x = -0.0112969624F;
static const float cal_b_y = -0.00933158211F;
static const float cal_b_z = -0.00417460827F;
static const float cal_m_xx = 0.989859641F;
static const float cal_m_yx = -0.00684025511F;
static const float cal_m_yy = 1.0129658F;
static const float cal_m_zx = -0.0018510638F;
static const float cal_m_zy = -0.0163244456F;
static const float cal_m_zz = 0.998084188F;

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

uint32_t cal_correct(const cal_in *in, cal_out *out)
{
    uint32_t status = CAL_OK;

    if ((cal_finite(in->accel_x_g) == 0U)
        || (cal_finite(in->accel_y_g) == 0U)
        || (cal_finite(in->accel_z_g) == 0U)) {
        const float none = (in->accel_x_g - in->accel_x_g)
            + (in->accel_y_g - in->accel_y_g)
            + (in->accel_z_g - in->accel_z_g); /* a NaN */

        out->accel_x_g = none;
        out->accel_y_g = none;
        out->accel_z_g = none;
        status = CAL_INVALID;
    } else {
        const float accel_x_g = cal_indicated(in->accel_x_g, cal_accel_x_g_range, CAL_ACCEL_BEYOND, &status);
        const float accel_y_g = cal_indicated(in->accel_y_g, cal_accel_y_g_range, CAL_ACCEL_BEYOND, &status);
        const float accel_z_g = cal_indicated(in->accel_z_g, cal_accel_z_g_range, CAL_ACCEL_BEYOND, &status);
        const float x = -cal_b_x + accel_x_g;
        const float y = -cal_b_y + accel_y_g;
        const float z = -cal_b_z + accel_z_g;
        const float k_x = cal_m_xx * x;
        const float k_y = (cal_m_yx * x) + (cal_m_yy * y);
        const float k_z = (cal_m_zx * x) + (cal_m_zy * y) + (cal_m_zz * z);

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
    {-0.630859375F, -0.287109375F, 0.056640625F},
    {-0.515625F, 0.287109375F, -0.515625F},
    {-0.400390625F, -0.515625F, 0.287109375F},
    {-0.287109375F, 0.056640625F, -0.287109375F},
    {-0.171875F, 0.630859375F, 0.515625F},
    {-0.056640625F, -0.171875F, -0.056640625F},
    {0.056640625F, 0.400390625F, -0.630859375F},
    {0.171875F, -0.400390625F, 0.171875F},
    {0.287109375F, 0.171875F, -0.400390625F},
    {0.400390625F, -0.630859375F, 0.400390625F},
    {0.515625F, -0.056640625F, -0.171875F},
    {0.630859375F, 0.515625F, 0.630859375F},
    {0.25F, 0.25F, 0.25F},
    {-0.75F, -0.75F, -0.75F},
    {0.625F, 0.625F, 0.625F},
    {-0.875F, -0.875F, -0.875F},
    {-1.27539062F, 0.25F, 0.25F},
    {1.27539062F, -0.75F, -0.75F},
    {0.25F, -1.27539062F, 0.25F},
    {-0.75F, 1.27539062F, -0.75F},
    {0.25F, 0.25F, -1.27539062F},
    {-0.75F, -0.75F, 1.27539062F}
};
static const cal_out cal_test_out[CAL_TESTS] = {
    {-0.613279819F, -0.277141452F, 0.0663801432F},
    {-0.499213934F, 0.303734303F, -0.514376283F},
    {-0.385148108F, -0.510196388F, 0.299711138F},
    {-0.273015589F, 0.0687142164F, -0.282959133F},
    {-0.158949718F, 0.649589956F, 0.508650243F},
    {-0.0448838621F, -0.164340749F, -0.0496281348F},
    {0.0672486797F, 0.414569885F, -0.63229841F},
    {0.181314528F, -0.397382379F, 0.181757092F},
    {0.295380384F, 0.181514889F, -0.398967415F},
    {0.407512933F, -0.63240242F, 0.413174212F},
    {0.521578789F, -0.0515267216F, -0.167582184F},
    {0.635644674F, 0.527370572F, 0.624059081F},
    {0.258647323F, 0.260906696F, 0.248970553F},
    {-0.731212318F, -0.745218873F, -0.730938196F},
    {0.629844725F, 0.63820374F, 0.616436243F},
    {-0.854944766F, -0.870984554F, -0.853426754F},
    {-1.2512753F, 0.271340758F, 0.251794159F},
    {1.27364016F, -0.759073079F, -0.734687328F},
    {0.258647323F, -1.28426182F, 0.27387172F},
    {-0.731212318F, 1.3064326F, -0.764001548F},
    {0.258647323F, 0.260906696F, -1.2734977F},
    {-0.731212318F, -0.745218873F, 1.29057217F}
};
static const uint32_t cal_test_status[CAL_TESTS] = {
    0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U,
    0x0U, 0x0U, 0x0U, 0x0U, 0x1U, 0x1U, 0x1U, 0x1U, 0x1U, 0x1U
};

int32_t cal_selftest(void)
{
    int32_t failed = 0;
    uint32_t k;

    for (k = 0U; k < CAL_TESTS; k++) {
        cal_out out;
        const uint32_t status = cal_correct(&cal_test_in[k], &out);

        if ((status != cal_test_status[k])
            || (cal_near(out.accel_x_g, cal_test_out[k].accel_x_g, 3.6e-07F) == 0U)
            || (cal_near(out.accel_y_g, cal_test_out[k].accel_y_g, 6e-07F) == 0U)
            || (cal_near(out.accel_z_g, cal_test_out[k].accel_z_g, 5.2e-07F) == 0U)) {
            failed = 1;
        }
    }
    return failed;
}
#endif

/*
 * The steps above as `calibkit verify` reads them again:
 * {"program":{"forms":["accel-affine/1"],"formula":"corrected = M(T) (indication - b(T)), in local g","interval_s":null,"number":"f32","scales":{}}}
 * {"input":{"beyond":"ACCEL_BEYOND","flag":"FULL_SCALE","meaning":"indication of the x accelerometer, positive along gravity","name":"accel_x_g","table":"accel_x_g_range","unit":"g"}}
 * {"input":{"beyond":"ACCEL_BEYOND","flag":"FULL_SCALE","meaning":"indication of the y accelerometer, positive along gravity","name":"accel_y_g","table":"accel_y_g_range","unit":"g"}}
 * {"input":{"beyond":"ACCEL_BEYOND","flag":"FULL_SCALE","meaning":"indication of the z accelerometer, positive along gravity","name":"accel_z_g","table":"accel_z_g_range","unit":"g"}}
 * {"sum":{"name":"x","terms":[{"factors":[],"over":"","sign":-1,"table":"b_x"},{"factors":["accel_x_g"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"y","terms":[{"factors":[],"over":"","sign":-1,"table":"b_y"},{"factors":["accel_y_g"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"z","terms":[{"factors":[],"over":"","sign":-1,"table":"b_z"},{"factors":["accel_z_g"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"k_x","terms":[{"factors":["x"],"over":"","sign":1,"table":"m_xx"}]}}
 * {"sum":{"name":"k_y","terms":[{"factors":["x"],"over":"","sign":1,"table":"m_yx"},{"factors":["y"],"over":"","sign":1,"table":"m_yy"}]}}
 * {"sum":{"name":"k_z","terms":[{"factors":["x"],"over":"","sign":1,"table":"m_zx"},{"factors":["y"],"over":"","sign":1,"table":"m_zy"},{"factors":["z"],"over":"","sign":1,"table":"m_zz"}]}}
 * {"output":{"meaning":"corrected component along x, positive along gravity","name":"accel_x_g","source":"k_x","unit":"g"}}
 * {"output":{"meaning":"corrected component along y, positive along gravity","name":"accel_y_g","source":"k_y","unit":"g"}}
 * {"output":{"meaning":"corrected component along z, positive along gravity","name":"accel_z_g","source":"k_z","unit":"g"}}
 */
/* sha256 of all lines above: e9b748de8f91786c27d91b22eef81dcd5967ad41d95b71e9e2e9f82835fa45cf */
