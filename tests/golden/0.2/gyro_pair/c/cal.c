/*
 * cal: correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 2, effective from 2025-11-24
 * forms         gyro-scale/1, gyro-orthogonality/1
 * coefficients  gyro_scale.json content digest (field sha256)
 *               2706758056717a8d6f6ba73afc95b6bdd8cab416d9a4607e5a95750ea5678c0b
 * coefficients  gyro_orthogonality.json content digest (field sha256)
 *               e5c53c249ffafe6f86192a495c26023fa3c28674f2a10806ddc888428e8fc194
 * run           run.json content digest (field sha256)
 *               5ba4af7091c08936630ea009c74947682d77b872c9945ef78143b4a2e0c26b82
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       rate = (indication - F0(T)) / K(T), in deg/s, zero at rest on the laboratory's table
 * input         gyro_a_lsb [1/s] = column 'gyro_a_lsb', in 1/s, or in the unit that its header states
 *               (recipe: sign = +1)
 * input         gyro_b_lsb [1/s] = column 'gyro_b_lsb', in 1/s, or in the unit that its header states
 *               (recipe: sign = +1)
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * fitted over   rate of gyro a -100 to 100 deg/s
 * fitted over   rate of gyro b -100 to 100 deg/s
 * error bound   gyro_a_dps: 1.7e-05 deg/s; up to the full scale 3.3e-04 deg/s
 * error bound   gyro_b_dps: 1.6e-05 deg/s; up to the full scale 2.8e-04 deg/s
 * error bound   gyro_b_orthogonal_dps: 3.0e-05 deg/s; up to the full scale 5.6e-04 deg/s
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

static const float cal_gyro_a_lsb_range[2] = {-1058149.0F, 1058149.0F}; /* least and greatest gyro_a_lsb [1/s] */
static const float cal_gyro_b_lsb_range[2] = {-1048985.0F, 1048985.0F}; /* least and greatest gyro_b_lsb [1/s] */
static const float cal_zero_a = 22.7746429F;
static const float cal_scale_factor_a = 10077.3896F;
static const float cal_zero_b = 25.5198021F;
static const float cal_scale_factor_b = 9990.08691F;
static const float cal_misalignment_first = 0.000990157248F;
static const float cal_misalignment_second = 1.00000048F;

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

    if ((cal_finite(in->gyro_a_lsb) == 0U)
        || (cal_finite(in->gyro_b_lsb) == 0U)) {
        const float none = (in->gyro_a_lsb - in->gyro_a_lsb)
            + (in->gyro_b_lsb - in->gyro_b_lsb); /* a NaN */

        out->gyro_a_dps = none;
        out->gyro_b_dps = none;
        out->gyro_b_orthogonal_dps = none;
        status = CAL_INVALID;
    } else {
        const float gyro_a_lsb = cal_indicated(in->gyro_a_lsb, cal_gyro_a_lsb_range, CAL_RATE_BEYOND, &status);
        const float gyro_b_lsb = cal_indicated(in->gyro_b_lsb, cal_gyro_b_lsb_range, CAL_RATE_BEYOND, &status);
        const float above_a = -cal_zero_a + gyro_a_lsb;
        const float scale_a = cal_scale_factor_a;
        const float rate_a = above_a / scale_a;
        const float above_b = -cal_zero_b + gyro_b_lsb;
        const float scale_b = cal_scale_factor_b;
        const float rate_b = above_b / scale_b;
        const float across = (cal_misalignment_first * rate_a) + (cal_misalignment_second * rate_b);

        out->gyro_a_dps = rate_a;
        out->gyro_b_dps = rate_b;
        out->gyro_b_orthogonal_dps = across;
    }
    return status;
}

#ifndef CAL_NO_SELFTEST
#define CAL_TESTS 20U

/* whether a computed value is within the tolerance of the expected one; never for a NaN */
static uint32_t cal_near(float found, float expected, float tolerance)
{
    const float difference = found - expected;

    return ((difference >= -tolerance) && (difference <= tolerance)) ? 1U : 0U;
}

static const cal_in cal_test_in[CAL_TESTS] = {
    {-532480.0F, -239616.0F},
    {-436224.0F, 239616.0F},
    {-339968.0F, -432128.0F},
    {-241664.0F, 47104.0F},
    {-145408.0F, 528384.0F},
    {-49152.0F, -143360.0F},
    {49152.0F, 335872.0F},
    {145408.0F, -335872.0F},
    {241664.0F, 143360.0F},
    {339968.0F, -528384.0F},
    {436224.0F, -47104.0F},
    {532480.0F, 432128.0F},
    {210944.0F, 208896.0F},
    {-634880.0F, -628736.0F},
    {528384.0F, 524288.0F},
    {-741376.0F, -735232.0F},
    {-1079296.0F, 208896.0F},
    {1079296.0F, -628736.0F},
    {210944.0F, -1069056.0F},
    {-634880.0F, 1069056.0F}
};
static const cal_out cal_test_out[CAL_TESTS] = {
    {-52.8413391F, -23.9879303F, -24.0402622F},
    {-43.2896614F, 23.9828224F, 23.93997F},
    {-33.7379799F, -43.2582359F, -43.2916603F},
    {-23.9830742F, 4.71251965F, 4.68877506F},
    {-14.4313936F, 52.888279F, 52.8740158F},
    {-4.87971354F, -14.3527794F, -14.3576174F},
    {4.8751936F, 33.6179733F, 33.6228142F},
    {14.4268732F, -33.623085F, -33.6088142F},
    {23.9785519F, 14.3476715F, 14.3714209F},
    {33.7334595F, -52.893383F, -52.8600082F},
    {43.285141F, -4.71762848F, -4.67477179F},
    {52.8368225F, 43.2531242F, 43.3054619F},
    {20.9301434F, 20.907774F, 20.9285069F},
    {-63.0027008F, -62.9385414F, -63.0009537F},
    {52.4303665F, 52.4782677F, 52.5302086F},
    {-73.5705185F, -73.5987091F, -73.6715927F},
    {-107.103012F, 20.907774F, 20.8017349F},
    {107.098495F, -62.9385414F, -62.8325272F},
    {20.9301434F, -107.014236F, -106.993568F},
    {-63.0027008F, 107.009132F, 106.9468F}
};
static const uint32_t cal_test_status[CAL_TESTS] = {
    0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U,
    0x0U, 0x0U, 0x0U, 0x0U, 0x1U, 0x1U, 0x1U, 0x1U
};

int32_t cal_selftest(void)
{
    int32_t failed = 0;
    uint32_t k;

    for (k = 0U; k < CAL_TESTS; k++) {
        cal_out out;
        const uint32_t status = cal_correct(&cal_test_in[k], &out);

        if ((status != cal_test_status[k])
            || (cal_near(out.gyro_a_dps, cal_test_out[k].gyro_a_dps, 3.4e-05F) == 0U)
            || (cal_near(out.gyro_b_dps, cal_test_out[k].gyro_b_dps, 3e-05F) == 0U)
            || (cal_near(out.gyro_b_orthogonal_dps, cal_test_out[k].gyro_b_orthogonal_dps, 5.8e-05F) == 0U)) {
            failed = 1;
        }
    }
    return failed;
}
#endif

/*
 * The steps above as `calibkit verify` reads them again:
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
 */
/* sha256 of all lines above: 1dee050b9cf4d179acfc603bd071b993b58934b97eff8fcd870b464cacf02b60 */
