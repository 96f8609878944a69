/*
 * cal: correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 1, effective from 2024-11-24
 * forms         gyro-triad/1
 * coefficients  gyro_scale.json content digest (field sha256)
 *               05f77938f8b96b8aa1eba506d8bd6d48864833ea5def80a411b0f0d2b1b93ae7
 * coefficients  gyro_orthogonality.json content digest (field sha256)
 *               e1755410776636c21af837cd54de8ca389b5be41bf1994ba4435b29327d18dd4
 * run           run.json content digest (field sha256)
 *               92eee6843be9a64f2a912c5daa4868d31679731a48b2c949ca74eb67518cd8b3
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       rate = S(T)^-1 (indication - B(T)), in deg/s about the axes of the base
 * input         temp_case_degc [degC] = column 'temp_case_degc', in degC, or in the unit that its
 *               header states (recipe: sign = +1)
 * input         gyro_x_lsb [1/s] = column 'gyro_x_lsb', in 1/s, or in the unit that its header states
 *               (recipe: sign = +1)
 * input         gyro_y_lsb [1/s] = column 'gyro_y_lsb', in 1/s, or in the unit that its header states
 *               (recipe: sign = +1)
 * input         gyro_z_lsb [1/s] = column 'gyro_z_lsb', in 1/s, or in the unit that its header states
 *               (recipe: sign = +1)
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * fitted over   temp_case_degc -40.04 to 60.14 degC
 * fitted over   rate about each axis -100 to 100 deg/s
 * error bound   rate_x_dps: 4.2e-05 deg/s; up to the full scale 7.7e-04 deg/s
 * error bound   rate_y_dps: 4.2e-05 deg/s; up to the full scale 8.1e-04 deg/s
 * error bound   rate_z_dps: 4.2e-05 deg/s; up to the full scale 8.0e-04 deg/s
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

static const float cal_temp_case_degc_range[2] = {-52.8125F, 72.8125F}; /* least and greatest temp_case_degc [degC] */
static const float cal_gyro_x_lsb_range[2] = {-1051943.0F, 1051943.0F}; /* least and greatest gyro_x_lsb [1/s] */
static const float cal_gyro_y_lsb_range[2] = {-1072736.0F, 1072736.0F}; /* least and greatest gyro_y_lsb [1/s] */
static const float cal_gyro_z_lsb_range[2] = {-1052313.0F, 1052313.0F}; /* least and greatest gyro_z_lsb [1/s] */
static const cal_map cal_u_map = {10.0F, 0.019900497F, {-0.99562192F, 0.99761194F}};
static const float cal_bias_x[4] = {1.59366405F, -1.46290636F, 0.0F, 0.0F};
static const float cal_bias_y[4] = {0.0968752652F, 1.4772017F, 0.0F, 0.0F};
static const float cal_bias_z[4] = {-1.3734479F, 0.278221101F, -0.0749823079F, 0.0F};
static const float cal_determinant_of_s[10] = {
    1.0F, -0.00112834293F, -1.27061867e-06F, 2.99218916e-09F,
    2.23330729e-11F, -2.04923613e-15F, 1.86435102e-16F, 0.0F,
    0.0F, 0.0F
};
static const float cal_inverse_xy[7] = {
    1.46005661e-07F, -2.03366501e-09F, -1.46659879e-10F, -3.15244494e-13F,
    -1.19090037e-14F, 0.0F, 0.0F
};
static const float cal_inverse_xz[7] = {
    -2.36088425e-07F, 1.20407737e-08F, 9.70084568e-10F, -8.13563572e-13F,
    -2.52301972e-16F, 0.0F, 0.0F
};
static const float cal_inverse_xx[7] = {
    9.98602263e-05F, -6.7903791e-08F, -1.55848473e-10F, 1.76929164e-13F,
    2.07266188e-15F, 0.0F, 0.0F
};
static const float cal_inverse_yx[7] = {
    3.00681251e-07F, 2.04998596e-09F, 1.53260862e-10F, 1.18009054e-14F,
    -2.17504747e-16F, 0.0F, 0.0F
};
static const float cal_inverse_yz[7] = {
    -1.70371109e-07F, 2.84602053e-09F, 1.65863726e-10F, -3.5888105e-14F,
    1.50195543e-15F, 0.0F, 0.0F
};
static const float cal_inverse_yy[7] = {
    9.79611723e-05F, -2.99040899e-08F, -1.47129989e-10F, 1.04945302e-13F,
    0.0F, 0.0F, 0.0F
};
static const float cal_inverse_zx[7] = {
    2.32981918e-07F, -4.65760053e-09F, 4.58655602e-14F, -4.90559741e-14F,
    -1.93107651e-15F, 0.0F, 0.0F
};
static const float cal_inverse_zy[7] = {
    3.27771431e-07F, -1.54621453e-08F, -1.22864696e-09F, 5.60064907e-13F,
    0.0F, 0.0F, 0.0F
};
static const float cal_inverse_zz[7] = {
    9.97936877e-05F, -1.2681042e-07F, 3.70598344e-11F, 6.38633747e-15F,
    2.35066995e-16F, 0.0F, 0.0F
};

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
        || (cal_finite(in->gyro_x_lsb) == 0U)
        || (cal_finite(in->gyro_y_lsb) == 0U)
        || (cal_finite(in->gyro_z_lsb) == 0U)) {
        const float none = (in->temp_case_degc - in->temp_case_degc)
            + (in->gyro_x_lsb - in->gyro_x_lsb)
            + (in->gyro_y_lsb - in->gyro_y_lsb)
            + (in->gyro_z_lsb - in->gyro_z_lsb); /* a NaN */

        out->rate_x_dps = none;
        out->rate_y_dps = none;
        out->rate_z_dps = none;
        status = CAL_INVALID;
    } else {
        const float temp_case_degc = cal_limited(in->temp_case_degc, cal_temp_case_degc_range, 0U, &status);
        const float gyro_x_lsb = cal_indicated(in->gyro_x_lsb, cal_gyro_x_lsb_range, CAL_RATE_BEYOND, &status);
        const float gyro_y_lsb = cal_indicated(in->gyro_y_lsb, cal_gyro_y_lsb_range, CAL_RATE_BEYOND, &status);
        const float gyro_z_lsb = cal_indicated(in->gyro_z_lsb, cal_gyro_z_lsb_range, CAL_RATE_BEYOND, &status);
        const float u = cal_mapped(temp_case_degc, &cal_u_map, CAL_TEMP_CLAMPED, &status);
        const float above_x = -cal_polynomial(cal_bias_x, 4U, u) + gyro_x_lsb;
        const float above_y = -cal_polynomial(cal_bias_y, 4U, u) + gyro_y_lsb;
        const float above_z = -cal_polynomial(cal_bias_z, 4U, u) + gyro_z_lsb;
        const float determinant = cal_polynomial(cal_determinant_of_s, 10U, u);
        const float numerator_x = (cal_polynomial(cal_inverse_xy, 7U, u) * above_y)
            + (cal_polynomial(cal_inverse_xz, 7U, u) * above_z)
            + (cal_polynomial(cal_inverse_xx, 7U, u) * above_x);
        const float rate_x = numerator_x / determinant;
        const float numerator_y = (cal_polynomial(cal_inverse_yx, 7U, u) * above_x)
            + (cal_polynomial(cal_inverse_yz, 7U, u) * above_z)
            + (cal_polynomial(cal_inverse_yy, 7U, u) * above_y);
        const float rate_y = numerator_y / determinant;
        const float numerator_z = (cal_polynomial(cal_inverse_zx, 7U, u) * above_x)
            + (cal_polynomial(cal_inverse_zy, 7U, u) * above_y)
            + (cal_polynomial(cal_inverse_zz, 7U, u) * above_z);
        const float rate_z = numerator_z / determinant;

        out->rate_x_dps = rate_x;
        out->rate_y_dps = rate_y;
        out->rate_z_dps = rate_z;
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
    {-33.1875F, -241664.0F, 49152.0F, 337920.0F},
    {-25.3125F, 241664.0F, -442368.0F, 241664.0F},
    {-17.5F, -434176.0F, 245760.0F, 145408.0F},
    {-9.625F, 49152.0F, -245760.0F, 49152.0F},
    {-1.75F, 530432.0F, 442368.0F, -49152.0F},
    {6.0625F, -145408.0F, -49152.0F, -145408.0F},
    {13.9375F, 337920.0F, -540672.0F, -241664.0F},
    {21.75F, -337920.0F, 147456.0F, -337920.0F},
    {29.625F, 145408.0F, -344064.0F, -434176.0F},
    {37.5F, -530432.0F, 344064.0F, -530432.0F},
    {45.3125F, -49152.0F, -147456.0F, 530432.0F},
    {53.1875F, 434176.0F, 540672.0F, 434176.0F},
    {-54.0625F, 210944.0F, 215040.0F, 210944.0F},
    {74.0625F, -630784.0F, -643072.0F, -630784.0F},
    {29.5F, 526336.0F, 536576.0F, 526336.0F},
    {-17.0F, -737280.0F, -751616.0F, -737280.0F},
    {-54.0625F, -1073152.0F, 215040.0F, 210944.0F},
    {74.0625F, 1073152.0F, -643072.0F, -630784.0F},
    {-54.0625F, 210944.0F, -1093632.0F, 210944.0F},
    {74.0625F, -630784.0F, 1093632.0F, -630784.0F},
    {-54.0625F, 210944.0F, 215040.0F, -1073152.0F},
    {74.0625F, -630784.0F, -643072.0F, 1073152.0F}
};
static const cal_out cal_test_out[CAL_TESTS] = {
    {-24.1993141F, 4.68120146F, 33.6861038F},
    {24.0006866F, -43.2790718F, 24.0267677F},
    {-43.3456154F, 23.9091892F, 14.4923849F},
    {4.85937548F, -24.0608425F, 4.83506298F},
    {53.0398254F, 43.494175F, -4.63442659F},
    {-14.492857F, -4.83356619F, -14.5609188F},
    {33.723774F, -52.8255043F, -24.2140961F},
    {-33.64814F, 14.4032612F, -33.7516098F},
    {14.5733833F, -33.5984497F, -43.4025497F},
    {-52.8106155F, 33.6493759F, -52.9420395F},
    {-5.05184174F, -14.5576382F, 52.8706551F},
    {43.3538094F, 53.0607872F, 43.5921097F},
    {21.0349102F, 21.0749531F, 21.1775856F},
    {-62.9701347F, -63.1335869F, -63.283783F},
    {52.525238F, 52.6499825F, 52.8166046F},
    {-73.5393829F, -73.6907196F, -74.0070877F},
    {-107.137993F, 20.6917057F, 20.8728008F},
    {107.261436F, -62.6169167F, -62.8942757F},
    {20.8415947F, -107.019127F, 20.7305889F},
    {-62.7200623F, 107.13578F, -62.7428474F},
    {21.3518715F, 21.2969055F, -106.985443F},
    {-63.3507309F, -63.4190903F, 106.734352F}
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
            || (cal_near(out.rate_x_dps, cal_test_out[k].rate_x_dps, 8.2e-05F) == 0U)
            || (cal_near(out.rate_y_dps, cal_test_out[k].rate_y_dps, 8.4e-05F) == 0U)
            || (cal_near(out.rate_z_dps, cal_test_out[k].rate_z_dps, 8.4e-05F) == 0U)) {
            failed = 1;
        }
    }
    return failed;
}
#endif

/*
 * The steps above as `calibkit verify` reads them again:
 * {"program":{"forms":["gyro-triad/1"],"formula":"rate = S(T)^-1 (indication - B(T)), in deg/s about the axes of the base","interval_s":null,"number":"f32","scales":{}}}
 * {"input":{"flag":"","meaning":"temperature of the sensor case","name":"temp_case_degc","table":"temp_case_degc_range","unit":"degC"}}
 * {"input":{"beyond":"RATE_BEYOND","flag":"FULL_SCALE","meaning":"indication of gyro x, counts per second","name":"gyro_x_lsb","table":"gyro_x_lsb_range","unit":"1/s"}}
 * {"input":{"beyond":"RATE_BEYOND","flag":"FULL_SCALE","meaning":"indication of gyro y, counts per second","name":"gyro_y_lsb","table":"gyro_y_lsb_range","unit":"1/s"}}
 * {"input":{"beyond":"RATE_BEYOND","flag":"FULL_SCALE","meaning":"indication of gyro z, counts per second","name":"gyro_z_lsb","table":"gyro_z_lsb_range","unit":"1/s"}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"u","source":"temp_case_degc","table":"u_map"}}
 * {"sum":{"name":"above_x","terms":[{"factors":[],"over":"u","sign":-1,"table":"bias_x"},{"factors":["gyro_x_lsb"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"above_y","terms":[{"factors":[],"over":"u","sign":-1,"table":"bias_y"},{"factors":["gyro_y_lsb"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"above_z","terms":[{"factors":[],"over":"u","sign":-1,"table":"bias_z"},{"factors":["gyro_z_lsb"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"determinant","terms":[{"factors":[],"over":"u","sign":1,"table":"determinant_of_s"}]}}
 * {"sum":{"name":"numerator_x","terms":[{"factors":["above_y"],"over":"u","sign":1,"table":"inverse_xy"},{"factors":["above_z"],"over":"u","sign":1,"table":"inverse_xz"},{"factors":["above_x"],"over":"u","sign":1,"table":"inverse_xx"}]}}
 * {"quotient":{"denominator":"determinant","name":"rate_x","numerator":"numerator_x"}}
 * {"sum":{"name":"numerator_y","terms":[{"factors":["above_x"],"over":"u","sign":1,"table":"inverse_yx"},{"factors":["above_z"],"over":"u","sign":1,"table":"inverse_yz"},{"factors":["above_y"],"over":"u","sign":1,"table":"inverse_yy"}]}}
 * {"quotient":{"denominator":"determinant","name":"rate_y","numerator":"numerator_y"}}
 * {"sum":{"name":"numerator_z","terms":[{"factors":["above_x"],"over":"u","sign":1,"table":"inverse_zx"},{"factors":["above_y"],"over":"u","sign":1,"table":"inverse_zy"},{"factors":["above_z"],"over":"u","sign":1,"table":"inverse_zz"}]}}
 * {"quotient":{"denominator":"determinant","name":"rate_z","numerator":"numerator_z"}}
 * {"output":{"meaning":"rate about axis x of the base","name":"rate_x_dps","source":"rate_x","unit":"deg/s"}}
 * {"output":{"meaning":"rate about axis y of the base","name":"rate_y_dps","source":"rate_y","unit":"deg/s"}}
 * {"output":{"meaning":"rate about axis z of the base","name":"rate_z_dps","source":"rate_z","unit":"deg/s"}}
 */
/* sha256 of all lines above: 393b24bfa36e71bf8e1e8a7cbe0819834792d7afb22433539ae489e4fe8e3cb0 */
