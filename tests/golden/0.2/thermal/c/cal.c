/*
 * cal: correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 1, effective from 2024-11-24
 * forms         bias-lagged/1
 * coefficients  thermal.json content digest (field sha256)
 *               00681c89c0fc4b6f4f60c45e49bfecdc49e4cbc1bc23476edc018413cab5775e
 * run           run.json content digest (field sha256)
 *               176108a7a3fa705171c0231df0b39dbac496c8729881d167be31a524beb15eb7
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       corrected = indication - bias, each channel in its unit; the bias is 0 at rest at 25
 *               degC, or at the end of the fitted range nearest to it
 * input         temp_case_degc [degC] = column 'temp_case_degc', in degC, or in the unit that its
 *               header states (recipe: sign = +1)
 * indication    gyro_x_dph [deg/h] = column 'gyro_x_dph', in deg/h, or in the unit that its header
 *               states (recipe: sign = +1)
 * indication    gyro_y_dph [deg/h] = column 'gyro_y_dph', in deg/h, or in the unit that its header
 *               states (recipe: sign = +1)
 * indication    gyro_z_dph [deg/h] = column 'gyro_z_dph', in deg/h, or in the unit that its header
 *               states (recipe: sign = +1)
 * indication    accel_x_g [g] = column 'accel_x_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * indication    accel_y_g [g] = column 'accel_y_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * indication    accel_z_g [g] = column 'accel_z_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * fitted over   temp_case_degc of gyro_x_dph -17.99 to 74.02 degC
 * fitted over   these; the case is followed from -70 to 110 degC, as by apply
 * fitted over   temp_case_degc of gyro_y_dph -17.99 to 74.02 degC
 * fitted over   these; the case is followed from -70 to 110 degC, as by apply
 * fitted over   temp_case_degc of gyro_z_dph -17.99 to 74.02 degC
 * fitted over   these; the case is followed from -70 to 110 degC, as by apply
 * fitted over   temp_case_degc of accel_x_g -17.99 to 74.02 degC
 * fitted over   these; the case is followed from -70 to 110 degC, as by apply
 * fitted over   temp_case_degc of accel_y_g -17.99 to 74.02 degC
 * fitted over   these; the case is followed from -70 to 110 degC, as by apply
 * fitted over   temp_case_degc of accel_z_g -17.99 to 74.02 degC
 * fitted over   these; the case is followed from -70 to 110 degC, as by apply
 * interval      update every 10 s, with means over it
 * jump          a temp_case_degc more than 2.11 degC an interval from the last is not used
 * gap           up to 60 s is bridged in a straight line, wrong by up to 0.2 deg/h, 0.059 deg/h, 0.16
 *               deg/h, 9.5e-06 g, 0.00022 g, 0.0017 g while the case moves by no more than 1.5
 *               degC/min; a longer one is a start
 * start         STARTING for 2130 s after a reset, which, while the case moves by no more than 1.5
 *               degC/min, is wrong by up to 23 deg/h, 12 deg/h, 23 deg/h, 0.0016 g, 0.00093 g, 0.0049
 *               g at first, 0.048 deg/h, 0.12 deg/h, 0.098 deg/h, 9e-06 g, 6.2e-06 g, 1.3e-05 g then
 * error bound   bias_gyro_x_dph: 2.6e-04 deg/h
 * error bound   bias_gyro_y_dph: 1.7e-03 deg/h
 * error bound   bias_gyro_z_dph: 3.1e-03 deg/h
 * error bound   bias_accel_x_g: 2.2e-07 g
 * error bound   bias_accel_y_g: 1.5e-07 g
 * error bound   bias_accel_z_g: 7.6e-07 g
 *               (worst case of evaluation, while the case moves by no more than 3 degC/min)
 *
 * Results are bit for bit those of calibkit's twin with -ffp-contract=off; else within twice the error
 *               bound.
 */

#include "cal.h"

#include <float.h>

#if defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0)
#error -ffast-math and -ffinite-math-only delete the guard against NaN
#endif

#define CAL_EARLIEST_MS 8750U
#define CAL_LATEST_MS 11250U
#define CAL_LONGEST 6U /* intervals that are bridged */

typedef struct {
    float middle;
    float reciprocal;
    float range[2];
} cal_map;

static const float cal_temp_case_degc_range[2] = {-115.0F, 155.0F}; /* least and greatest temp_case_degc [degC] */
static const float cal_pace[2] = {213.0F, 2.109375F}; /* updates until the lags have settled; farthest move of temp_case_degc an interval */
static const cal_map cal_x_map_gyro_x_dph = {28.0F, 0.0216802172F, {-2.12466121F, 1.77777779F}};
static const float cal_lag_decay_gyro_x_dph = 0.0284110885F;
static const float cal_lag_move_gyro_x_dph = 0.985726237F;
static const float cal_u_limits_gyro_x_dph[2] = {-0.985735953F, 0.985957861F}; /* least and greatest u_gyro_x_dph */
static const float cal_rate_of_lag_gyro_x_dph = 5.29029655F;
static const float cal_rate_limits_gyro_x_dph[2] = {-0.996675789F, 1.0F}; /* least and greatest rate_gyro_x_dph */
static const float cal_by_rate_gyro_x_dph[2] = {10.7422237F, -0.989783585F};
static const float cal_static_gyro_x_dph[4] = {1.90294468F, 28.7401066F, -7.64498043F, 4.83037853F};
static const cal_map cal_x_map_gyro_y_dph = {28.0F, 0.0216802172F, {-2.12466121F, 1.77777779F}};
static const float cal_lag_decay_gyro_y_dph = 0.0214044452F;
static const float cal_lag_move_gyro_y_dph = 0.989259183F;
static const float cal_u_limits_gyro_y_dph[2] = {-0.970849693F, 0.970888674F}; /* least and greatest u_gyro_y_dph */
static const float cal_rate_of_lag_gyro_y_dph = 3.98578429F;
static const float cal_rate_limits_gyro_y_dph[2] = {-0.996261179F, 1.0F}; /* least and greatest rate_gyro_y_dph */
static const float cal_by_rate_gyro_y_dph[2] = {-4.30330801F, 0.811836064F};
static const float cal_static_gyro_y_dph[4] = {0.981762409F, 14.8364029F, -3.90031481F, 1.06737053F};
static const cal_map cal_x_map_gyro_z_dph = {28.0F, 0.0216802172F, {-2.12466121F, 1.77777779F}};
static const float cal_lag_decay_gyro_z_dph = 0.0251579527F;
static const float cal_lag_move_gyro_z_dph = 0.98736763F;
static const float cal_u_limits_gyro_z_dph[2] = {-0.980598032F, 0.980753362F}; /* least and greatest u_gyro_z_dph */
static const float cal_rate_of_lag_gyro_z_dph = 4.68300724F;
static const float cal_rate_limits_gyro_z_dph[2] = {-0.996794701F, 1.0F}; /* least and greatest rate_gyro_z_dph */
static const float cal_by_rate_gyro_z_dph[2] = {-10.4465246F, -1.67843997F};
static const float cal_static_gyro_z_dph[4] = {1.88222647F, 28.9148636F, 0.0620401241F, 6.71464205F};
static const cal_map cal_x_map_accel_x_g = {28.0F, 0.0216802172F, {-2.12466121F, 1.77777779F}};
static const float cal_lag_decay_accel_x_g = 0.0237636641F;
static const float cal_lag_move_accel_x_g = 0.988070548F;
static const float cal_u_limits_accel_x_g[2] = {-0.977582097F, 0.977698147F}; /* least and greatest u_accel_x_g */
static const float cal_rate_of_lag_accel_x_g = 4.42418003F;
static const float cal_rate_limits_accel_x_g[2] = {-0.996866047F, 1.0F}; /* least and greatest rate_accel_x_g */
static const float cal_by_rate_accel_x_g[2] = {-0.000573277124F, 0.000503712508F};
static const float cal_static_accel_x_g[4] = {
    -7.82129937e-05F, -0.00121290446F, -0.000160868891F, -1.97036898e-05F
};
static const cal_map cal_x_map_accel_y_g = {28.0F, 0.0216802172F, {-2.12466121F, 1.77777779F}};
static const float cal_lag_decay_accel_y_g = 0.023362495F;
static const float cal_lag_move_accel_y_g = 0.988272727F;
static const float cal_fall_move_accel_y_g = 0.0106072724F;
static const float cal_fall_lag_accel_y_g = 0.0200917404F;
static const float cal_fall_decay_accel_y_g = 0.265342057F;
static const float cal_gradient_of_fall_accel_y_g = 56.8146858F;
static const float cal_gradient_limits_accel_y_g[2] = {-0.996906579F, 1.0F}; /* least and greatest gradient_accel_y_g */
static const float cal_u_limits_accel_y_g[2] = {-0.976598859F, 0.976701915F}; /* least and greatest u_accel_y_g */
static const float cal_rate_of_lag_accel_y_g = 4.3499155F;
static const float cal_rate_limits_accel_y_g[2] = {-0.996895254F, 1.0F}; /* least and greatest rate_accel_y_g */
static const float cal_by_gradient_accel_y_g = 0.000327522896F;
static const float cal_by_rate_accel_y_g[2] = {-0.000341517909F, 7.38466479e-05F};
static const float cal_static_accel_y_g[4] = {
    1.57316117e-05F, 0.000226552875F, -0.000232854305F, 4.1524574e-05F
};
static const cal_map cal_x_map_accel_z_g = {28.0F, 0.0216802172F, {-2.12466121F, 1.77777779F}};
static const float cal_lag_decay_accel_z_g = 0.0278498251F;
static const float cal_lag_move_accel_z_g = 0.986009538F;
static const float cal_fall_move_accel_z_g = 0.0126084816F;
static const float cal_fall_lag_accel_z_g = 0.0238191858F;
static const float cal_fall_decay_accel_z_g = 0.273616195F;
static const float cal_gradient_of_fall_accel_z_g = 58.8173485F;
static const float cal_gradient_limits_accel_z_g[2] = {-0.997511983F, 1.0F}; /* least and greatest gradient_accel_z_g */
static const float cal_u_limits_accel_z_g[2] = {-0.985003352F, 0.985214412F}; /* least and greatest u_accel_z_g */
static const float cal_rate_of_lag_accel_z_g = 5.18523979F;
static const float cal_rate_limits_accel_z_g[2] = {-0.996694148F, 1.0F}; /* least and greatest rate_accel_z_g */
static const float cal_by_gradient_accel_z_g = -0.00240823277F;
static const float cal_by_rate_accel_z_g[2] = {0.00180457882F, -0.000199346701F};
static const float cal_static_accel_z_g[4] = {
    -3.68004225e-06F, -1.71544561e-05F, 0.000634496391F, 0.000435399386F
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

void cal_reset(cal_state *state)
{
    state->x_gyro_x_dph = 0.0F;
    state->lag_gyro_x_dph = 0.0F;
    state->x_gyro_y_dph = 0.0F;
    state->lag_gyro_y_dph = 0.0F;
    state->x_gyro_z_dph = 0.0F;
    state->lag_gyro_z_dph = 0.0F;
    state->x_accel_x_g = 0.0F;
    state->lag_accel_x_g = 0.0F;
    state->x_accel_y_g = 0.0F;
    state->lag_accel_y_g = 0.0F;
    state->fall_accel_y_g = 0.0F;
    state->x_accel_z_g = 0.0F;
    state->lag_accel_z_g = 0.0F;
    state->fall_accel_z_g = 0.0F;
    state->last.bias_gyro_x_dph = 0.0F;
    state->last.bias_gyro_y_dph = 0.0F;
    state->last.bias_gyro_z_dph = 0.0F;
    state->last.bias_accel_x_g = 0.0F;
    state->last.bias_accel_y_g = 0.0F;
    state->last.bias_accel_z_g = 0.0F;
    state->before.bias_gyro_x_dph = 0.0F;
    state->before.bias_gyro_y_dph = 0.0F;
    state->before.bias_gyro_z_dph = 0.0F;
    state->before.bias_accel_x_g = 0.0F;
    state->before.bias_accel_y_g = 0.0F;
    state->before.bias_accel_z_g = 0.0F;
    state->in.temp_case_degc = 0.0F;
    state->updates = 0U;
    state->waited_ms = 0U;
}

/* one interval, for inputs that are numbers */
static uint32_t cal_step(cal_state *state, const cal_in *in)
{
    uint32_t status = CAL_OK;
    const float temp_case_degc = cal_limited(in->temp_case_degc, cal_temp_case_degc_range, 0U, &status);
    const float x_gyro_x_dph = cal_mapped(temp_case_degc, &cal_x_map_gyro_x_dph, CAL_TEMP_CLAMPED, &status);
    const float x_before_gyro_x_dph = (state->updates == 0U) ? x_gyro_x_dph : state->x_gyro_x_dph;
    const float move_gyro_x_dph = x_gyro_x_dph - x_before_gyro_x_dph;
    const float lag_before_gyro_x_dph = state->lag_gyro_x_dph;
    const float lag_gyro_x_dph = -(cal_lag_decay_gyro_x_dph * lag_before_gyro_x_dph)
        + (cal_lag_move_gyro_x_dph * move_gyro_x_dph)
        + lag_before_gyro_x_dph;
    const float coil_gyro_x_dph = x_gyro_x_dph - lag_gyro_x_dph;
    const float u_gyro_x_dph = cal_limited(coil_gyro_x_dph, cal_u_limits_gyro_x_dph, CAL_TEMP_CLAMPED, &status);
    const float coil_rate_gyro_x_dph = cal_rate_of_lag_gyro_x_dph * lag_gyro_x_dph;
    const float rate_gyro_x_dph = cal_limited(coil_rate_gyro_x_dph, cal_rate_limits_gyro_x_dph, CAL_RATE_CLAMPED, &status);
    const float drift_gyro_x_dph = (cal_polynomial(cal_by_rate_gyro_x_dph, 2U, u_gyro_x_dph) * rate_gyro_x_dph)
        + cal_polynomial(cal_static_gyro_x_dph, 4U, u_gyro_x_dph);
    const float x_gyro_y_dph = cal_mapped(temp_case_degc, &cal_x_map_gyro_y_dph, CAL_TEMP_CLAMPED, &status);
    const float x_before_gyro_y_dph = (state->updates == 0U) ? x_gyro_y_dph : state->x_gyro_y_dph;
    const float move_gyro_y_dph = x_gyro_y_dph - x_before_gyro_y_dph;
    const float lag_before_gyro_y_dph = state->lag_gyro_y_dph;
    const float lag_gyro_y_dph = -(cal_lag_decay_gyro_y_dph * lag_before_gyro_y_dph)
        + (cal_lag_move_gyro_y_dph * move_gyro_y_dph)
        + lag_before_gyro_y_dph;
    const float coil_gyro_y_dph = x_gyro_y_dph - lag_gyro_y_dph;
    const float u_gyro_y_dph = cal_limited(coil_gyro_y_dph, cal_u_limits_gyro_y_dph, CAL_TEMP_CLAMPED, &status);
    const float coil_rate_gyro_y_dph = cal_rate_of_lag_gyro_y_dph * lag_gyro_y_dph;
    const float rate_gyro_y_dph = cal_limited(coil_rate_gyro_y_dph, cal_rate_limits_gyro_y_dph, CAL_RATE_CLAMPED, &status);
    const float drift_gyro_y_dph = (cal_polynomial(cal_by_rate_gyro_y_dph, 2U, u_gyro_y_dph) * rate_gyro_y_dph)
        + cal_polynomial(cal_static_gyro_y_dph, 4U, u_gyro_y_dph);
    const float x_gyro_z_dph = cal_mapped(temp_case_degc, &cal_x_map_gyro_z_dph, CAL_TEMP_CLAMPED, &status);
    const float x_before_gyro_z_dph = (state->updates == 0U) ? x_gyro_z_dph : state->x_gyro_z_dph;
    const float move_gyro_z_dph = x_gyro_z_dph - x_before_gyro_z_dph;
    const float lag_before_gyro_z_dph = state->lag_gyro_z_dph;
    const float lag_gyro_z_dph = -(cal_lag_decay_gyro_z_dph * lag_before_gyro_z_dph)
        + (cal_lag_move_gyro_z_dph * move_gyro_z_dph)
        + lag_before_gyro_z_dph;
    const float coil_gyro_z_dph = x_gyro_z_dph - lag_gyro_z_dph;
    const float u_gyro_z_dph = cal_limited(coil_gyro_z_dph, cal_u_limits_gyro_z_dph, CAL_TEMP_CLAMPED, &status);
    const float coil_rate_gyro_z_dph = cal_rate_of_lag_gyro_z_dph * lag_gyro_z_dph;
    const float rate_gyro_z_dph = cal_limited(coil_rate_gyro_z_dph, cal_rate_limits_gyro_z_dph, CAL_RATE_CLAMPED, &status);
    const float drift_gyro_z_dph = (cal_polynomial(cal_by_rate_gyro_z_dph, 2U, u_gyro_z_dph) * rate_gyro_z_dph)
        + cal_polynomial(cal_static_gyro_z_dph, 4U, u_gyro_z_dph);
    const float x_accel_x_g = cal_mapped(temp_case_degc, &cal_x_map_accel_x_g, CAL_TEMP_CLAMPED, &status);
    const float x_before_accel_x_g = (state->updates == 0U) ? x_accel_x_g : state->x_accel_x_g;
    const float move_accel_x_g = x_accel_x_g - x_before_accel_x_g;
    const float lag_before_accel_x_g = state->lag_accel_x_g;
    const float lag_accel_x_g = -(cal_lag_decay_accel_x_g * lag_before_accel_x_g)
        + (cal_lag_move_accel_x_g * move_accel_x_g)
        + lag_before_accel_x_g;
    const float coil_accel_x_g = x_accel_x_g - lag_accel_x_g;
    const float u_accel_x_g = cal_limited(coil_accel_x_g, cal_u_limits_accel_x_g, CAL_TEMP_CLAMPED, &status);
    const float coil_rate_accel_x_g = cal_rate_of_lag_accel_x_g * lag_accel_x_g;
    const float rate_accel_x_g = cal_limited(coil_rate_accel_x_g, cal_rate_limits_accel_x_g, CAL_RATE_CLAMPED, &status);
    const float drift_accel_x_g = (cal_polynomial(cal_by_rate_accel_x_g, 2U, u_accel_x_g) * rate_accel_x_g)
        + cal_polynomial(cal_static_accel_x_g, 4U, u_accel_x_g);
    const float x_accel_y_g = cal_mapped(temp_case_degc, &cal_x_map_accel_y_g, CAL_TEMP_CLAMPED, &status);
    const float x_before_accel_y_g = (state->updates == 0U) ? x_accel_y_g : state->x_accel_y_g;
    const float move_accel_y_g = x_accel_y_g - x_before_accel_y_g;
    const float lag_before_accel_y_g = state->lag_accel_y_g;
    const float lag_accel_y_g = -(cal_lag_decay_accel_y_g * lag_before_accel_y_g)
        + (cal_lag_move_accel_y_g * move_accel_y_g)
        + lag_before_accel_y_g;
    const float fall_before_accel_y_g = state->fall_accel_y_g;
    const float fall_accel_y_g = (cal_fall_move_accel_y_g * move_accel_y_g)
        + (cal_fall_lag_accel_y_g * lag_before_accel_y_g)
        - (cal_fall_decay_accel_y_g * fall_before_accel_y_g)
        + fall_before_accel_y_g;
    const float coil_gradient_accel_y_g = cal_gradient_of_fall_accel_y_g * fall_accel_y_g;
    const float gradient_accel_y_g = cal_limited(coil_gradient_accel_y_g, cal_gradient_limits_accel_y_g, CAL_GRADIENT_CLAMPED, &status);
    const float coil_accel_y_g = x_accel_y_g - lag_accel_y_g;
    const float u_accel_y_g = cal_limited(coil_accel_y_g, cal_u_limits_accel_y_g, CAL_TEMP_CLAMPED, &status);
    const float coil_rate_accel_y_g = cal_rate_of_lag_accel_y_g * lag_accel_y_g;
    const float rate_accel_y_g = cal_limited(coil_rate_accel_y_g, cal_rate_limits_accel_y_g, CAL_RATE_CLAMPED, &status);
    const float drift_accel_y_g = (cal_by_gradient_accel_y_g * gradient_accel_y_g)
        + (cal_polynomial(cal_by_rate_accel_y_g, 2U, u_accel_y_g) * rate_accel_y_g)
        + cal_polynomial(cal_static_accel_y_g, 4U, u_accel_y_g);
    const float x_accel_z_g = cal_mapped(temp_case_degc, &cal_x_map_accel_z_g, CAL_TEMP_CLAMPED, &status);
    const float x_before_accel_z_g = (state->updates == 0U) ? x_accel_z_g : state->x_accel_z_g;
    const float move_accel_z_g = x_accel_z_g - x_before_accel_z_g;
    const float lag_before_accel_z_g = state->lag_accel_z_g;
    const float lag_accel_z_g = -(cal_lag_decay_accel_z_g * lag_before_accel_z_g)
        + (cal_lag_move_accel_z_g * move_accel_z_g)
        + lag_before_accel_z_g;
    const float fall_before_accel_z_g = state->fall_accel_z_g;
    const float fall_accel_z_g = (cal_fall_move_accel_z_g * move_accel_z_g)
        + (cal_fall_lag_accel_z_g * lag_before_accel_z_g)
        - (cal_fall_decay_accel_z_g * fall_before_accel_z_g)
        + fall_before_accel_z_g;
    const float coil_gradient_accel_z_g = cal_gradient_of_fall_accel_z_g * fall_accel_z_g;
    const float gradient_accel_z_g = cal_limited(coil_gradient_accel_z_g, cal_gradient_limits_accel_z_g, CAL_GRADIENT_CLAMPED, &status);
    const float coil_accel_z_g = x_accel_z_g - lag_accel_z_g;
    const float u_accel_z_g = cal_limited(coil_accel_z_g, cal_u_limits_accel_z_g, CAL_TEMP_CLAMPED, &status);
    const float coil_rate_accel_z_g = cal_rate_of_lag_accel_z_g * lag_accel_z_g;
    const float rate_accel_z_g = cal_limited(coil_rate_accel_z_g, cal_rate_limits_accel_z_g, CAL_RATE_CLAMPED, &status);
    const float drift_accel_z_g = (cal_by_gradient_accel_z_g * gradient_accel_z_g)
        + (cal_polynomial(cal_by_rate_accel_z_g, 2U, u_accel_z_g) * rate_accel_z_g)
        + cal_polynomial(cal_static_accel_z_g, 4U, u_accel_z_g);

    state->x_gyro_x_dph = x_gyro_x_dph;
    state->lag_gyro_x_dph = lag_gyro_x_dph;
    state->x_gyro_y_dph = x_gyro_y_dph;
    state->lag_gyro_y_dph = lag_gyro_y_dph;
    state->x_gyro_z_dph = x_gyro_z_dph;
    state->lag_gyro_z_dph = lag_gyro_z_dph;
    state->x_accel_x_g = x_accel_x_g;
    state->lag_accel_x_g = lag_accel_x_g;
    state->x_accel_y_g = x_accel_y_g;
    state->lag_accel_y_g = lag_accel_y_g;
    state->fall_accel_y_g = fall_accel_y_g;
    state->x_accel_z_g = x_accel_z_g;
    state->lag_accel_z_g = lag_accel_z_g;
    state->fall_accel_z_g = fall_accel_z_g;
    if (state->updates < UINT32_MAX) {
        state->updates++;
    }
    state->last.bias_gyro_x_dph = drift_gyro_x_dph;
    state->last.bias_gyro_y_dph = drift_gyro_y_dph;
    state->last.bias_gyro_z_dph = drift_gyro_z_dph;
    state->last.bias_accel_x_g = drift_accel_x_g;
    state->last.bias_accel_y_g = drift_accel_y_g;
    state->last.bias_accel_z_g = drift_accel_z_g;
    return status;
}

/* whether the input moved further than so many intervals allow */
static uint32_t cal_jumped(const cal_state *state, const cal_in *in, uint32_t count)
{
    const float away = in->temp_case_degc - state->in.temp_case_degc;
    const float most = cal_pace[1] * (float)count;

    return ((away < -most) || (away > most)) ? 1U : 0U;
}

/* inputs of the k-th of count intervals, in a straight line */
static void cal_bridge(const cal_in *from, const cal_in *to, uint32_t k, uint32_t count, cal_in *in)
{
    if (k < count) {
        const float share = (float)k / (float)count;

        in->temp_case_degc = from->temp_case_degc + ((to->temp_case_degc - from->temp_case_degc) * share);
    } else {
        in->temp_case_degc = to->temp_case_degc;
    }
}

uint32_t cal_update(cal_state *state, uint32_t elapsed_ms, const cal_in *in, cal_out *out)
{
    uint32_t first = 0U;
    uint32_t status = CAL_OK;
    uint32_t count;

    if (state->updates == 0U) {
        first = 1U;
        state->waited_ms = CAL_INTERVAL_MS + (CAL_INTERVAL_MS / 2U);
    } else if (elapsed_ms > (UINT32_MAX - state->waited_ms)) {
        state->waited_ms = UINT32_MAX;
    } else {
        state->waited_ms += elapsed_ms;
    }
    count = state->waited_ms / CAL_INTERVAL_MS;
    if (count != 0U) {
        state->before.bias_gyro_x_dph = state->last.bias_gyro_x_dph;
        state->before.bias_gyro_y_dph = state->last.bias_gyro_y_dph;
        state->before.bias_gyro_z_dph = state->last.bias_gyro_z_dph;
        state->before.bias_accel_x_g = state->last.bias_accel_x_g;
        state->before.bias_accel_y_g = state->last.bias_accel_y_g;
        state->before.bias_accel_z_g = state->last.bias_accel_z_g;
    }
    if (cal_finite(in->temp_case_degc) == 0U) {
        status = CAL_INVALID;
    } else if (count == 0U) {
        status = CAL_INTERVAL;
    } else if ((first == 0U) && (count <= CAL_LONGEST) && (cal_jumped(state, in, count) != 0U)) {
        status = CAL_JUMPED;
    } else {
        const uint32_t steps = (count > CAL_LONGEST) ? 1U : count;
        uint32_t k;

        if (count > CAL_LONGEST) {
            state->updates = 0U;
            state->lag_gyro_x_dph = 0.0F;
            state->lag_gyro_y_dph = 0.0F;
            state->lag_gyro_z_dph = 0.0F;
            state->lag_accel_x_g = 0.0F;
            state->lag_accel_y_g = 0.0F;
            state->fall_accel_y_g = 0.0F;
            state->lag_accel_z_g = 0.0F;
            state->fall_accel_z_g = 0.0F;
        }
        for (k = 1U; k <= steps; k++) {
            cal_in at;

            cal_bridge(&state->in, in, k, steps, &at);
            status = cal_step(state, &at);
        }
        if ((first == 0U) && ((count != 1U) || (elapsed_ms < CAL_EARLIEST_MS) || (elapsed_ms > CAL_LATEST_MS))) {
            status |= CAL_INTERVAL;
        }
        if (state->updates <= (uint32_t)cal_pace[0]) {
            status |= CAL_STARTING;
        }
        if (first != 0U) {
            state->before.bias_gyro_x_dph = state->last.bias_gyro_x_dph;
            state->before.bias_gyro_y_dph = state->last.bias_gyro_y_dph;
            state->before.bias_gyro_z_dph = state->last.bias_gyro_z_dph;
            state->before.bias_accel_x_g = state->last.bias_accel_x_g;
            state->before.bias_accel_y_g = state->last.bias_accel_y_g;
            state->before.bias_accel_z_g = state->last.bias_accel_z_g;
        }
        state->in.temp_case_degc = in->temp_case_degc;
        state->waited_ms %= CAL_INTERVAL_MS;
    }
    out->bias_gyro_x_dph = state->last.bias_gyro_x_dph;
    out->bias_gyro_y_dph = state->last.bias_gyro_y_dph;
    out->bias_gyro_z_dph = state->last.bias_gyro_z_dph;
    out->bias_accel_x_g = state->last.bias_accel_x_g;
    out->bias_accel_y_g = state->last.bias_accel_y_g;
    out->bias_accel_z_g = state->last.bias_accel_z_g;
    return status;
}

void cal_between(const cal_state *state, uint32_t elapsed_ms, cal_out *out)
{
    const uint32_t passed = (elapsed_ms < CAL_INTERVAL_MS) ? elapsed_ms : CAL_INTERVAL_MS;
    const float share = (float)passed / (float)CAL_INTERVAL_MS;
    out->bias_gyro_x_dph = state->before.bias_gyro_x_dph + ((state->last.bias_gyro_x_dph - state->before.bias_gyro_x_dph) * share);
    out->bias_gyro_y_dph = state->before.bias_gyro_y_dph + ((state->last.bias_gyro_y_dph - state->before.bias_gyro_y_dph) * share);
    out->bias_gyro_z_dph = state->before.bias_gyro_z_dph + ((state->last.bias_gyro_z_dph - state->before.bias_gyro_z_dph) * share);
    out->bias_accel_x_g = state->before.bias_accel_x_g + ((state->last.bias_accel_x_g - state->before.bias_accel_x_g) * share);
    out->bias_accel_y_g = state->before.bias_accel_y_g + ((state->last.bias_accel_y_g - state->before.bias_accel_y_g) * share);
    out->bias_accel_z_g = state->before.bias_accel_z_g + ((state->last.bias_accel_z_g - state->before.bias_accel_z_g) * share);
}

#ifndef CAL_NO_SELFTEST
#define CAL_TESTS 31U

/* whether a computed value is within the tolerance of the expected one; never for a NaN */
static uint32_t cal_near(float found, float expected, float tolerance)
{
    const float difference = found - expected;

    return ((difference >= -tolerance) && (difference <= tolerance)) ? 1U : 0U;
}

static const cal_in cal_test_in[CAL_TESTS] = {
    {20.0F},
    {24.5F},
    {29.0F},
    {47.0F},
    {111.75F},
    {106.375F},
    {106.375F},
    {38.0F},
    {-25.0F},
    {-71.75F},
    {-66.375F},
    {-66.375F},
    {108.25F},
    {2.0F},
    {29.0F},
    {20.0F},
    {20.84375F},
    {21.90625F},
    {22.125F},
    {24.21875F},
    {146.5625F},
    {24.625F},
    {24.21875F},
    {24.21875F},
    {24.21875F},
    {27.375F},
    {104.375F},
    {104.375F},
    {105.0F},
    {105.0F},
    {105.0F}
};
static const cal_out cal_test_out[CAL_TESTS] = {
    {-3.33696842F, -1.71438742F, -3.16598463F, 0.000127418796F, -3.07834998e-05F, 1.61105108e-05F},
    {2.25918007F, -3.40656328F, -7.71174908F, -0.000155429545F, -0.000159741932F, 0.000758836628F},
    {7.63468456F, -4.88549519F, -11.7145224F, -0.00042297371F, -0.000192071515F, 0.000676487281F},
    {9.19192314F, -5.47270679F, -12.0098314F, -0.000562915462F, -4.10948123e-05F, -0.000572558667F},
    {14.5197887F, -3.13659334F, -7.4039464F, -0.000673792791F, 9.95064511e-06F, -0.000618516409F},
    {22.9617138F, 0.78806591F, 1.23097801F, -0.000898784841F, 7.48361854e-05F, -0.000566603849F},
    {28.1015816F, 12.0631514F, 35.3375587F, -0.00144673674F, 6.53130119e-05F, 0.000935116375F},
    {17.703558F, 16.1885281F, 48.6885071F, -0.00135571056F, -4.38936695e-06F, 0.0018110401F},
    {17.703558F, 16.1885281F, 48.6885071F, -0.00135571056F, -4.38936695e-06F, 0.0018110401F},
    {17.703558F, 16.1885281F, 48.6885071F, -0.00135571056F, -4.38936695e-06F, 0.0018110401F},
    {5.40681934F, 14.0682917F, 33.3362122F, -0.000747759652F, 3.79838457e-05F, 0.000956277654F},
    {-40.0661697F, -16.2936802F, -30.8713512F, 0.00124590588F, -0.000450442021F, 0.000307347276F},
    {-26.76437F, -23.1665936F, -41.5439682F, -9.35257995e-05F, -0.000552393962F, -0.000194574197F},
    {-26.76437F, -23.1665936F, -41.5439682F, -9.35257995e-05F, -0.000552393962F, -0.000194574197F},
    {-26.76437F, -23.1665936F, -41.5439682F, -9.35257995e-05F, -0.000552393962F, -0.000194574197F},
    {-3.33696842F, -1.71438742F, -3.16598463F, 0.000127418796F, -3.07834998e-05F, 1.61105108e-05F},
    {-2.28758097F, -2.03171968F, -4.01817226F, 7.43466808e-05F, -5.49685501e-05F, 0.000155392176F},
    {-1.00946808F, -2.38850379F, -4.9786129F, 1.01115656e-05F, -6.5663131e-05F, 0.000161601536F},
    {-1.00946808F, -2.38850379F, -4.9786129F, 1.01115656e-05F, -6.5663131e-05F, 0.000161601536F},
    {1.74338055F, -3.13649416F, -6.99994516F, -0.000127424981F, -9.30056704e-05F, 0.000223272451F},
    {1.74338055F, -3.13649416F, -6.99994516F, -0.000127424981F, -9.30056704e-05F, 0.000223272451F},
    {2.05732012F, -3.09865522F, -6.91820812F, -0.00014093917F, -6.07929614e-05F, -5.40151923e-05F},
    {2.05732012F, -3.09865522F, -6.91820812F, -0.00014093917F, -6.07929614e-05F, -5.40151923e-05F},
    {1.42912054F, -2.82112718F, -6.18489075F, -0.000108026259F, -3.35842342e-05F, -0.000227060227F},
    {1.27040958F, -2.65764427F, -5.76788998F, -9.82379424e-05F, -2.68493477e-05F, -0.000243986869F},
    {1.27040958F, -2.65764427F, -5.76788998F, -9.82379424e-05F, -2.68493477e-05F, -0.000243986869F},
    {27.4374313F, 12.6865654F, 36.6346054F, -0.00143625564F, 5.35650033e-05F, 0.00101166207F},
    {27.4374313F, 12.6865654F, 36.6346054F, -0.00143625564F, 5.35650033e-05F, 0.00101166207F},
    {28.1081104F, 12.5027514F, 35.8958549F, -0.00144092878F, 4.47889179e-05F, 0.00106126943F},
    {27.4388771F, 12.6847334F, 36.6313591F, -0.00143628346F, 5.35967592e-05F, 0.00101149129F},
    {27.4388371F, 12.6847725F, 36.6314392F, -0.00143628288F, 5.35960171e-05F, 0.00101149606F}
};
static const uint32_t cal_test_updates[CAL_TESTS] = {
    1U, 1U, 2U, 3U, 4U, 8U, 160U, 3U, 3U, 2U, 8U, 160U,
    4U, 6U, 12U, 1U, 1U, 2U, 1U, 1U, 2U, 1U, 1U, 1U,
    3U, 1U, 1U, 2U, 1U, 213U, 1U
};
static const uint32_t cal_test_elapsed[CAL_TESTS] = {
    0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U,
    0U, 0U, 0U, 10000000U, 10000U, 10000U, 2500U, 27500U, 10000U, 10000U, 7000U, 13000U,
    10000U, 10000U, 10000000U, 10000U, 30000U, 0U, 10000U
};
static const uint32_t cal_test_status[CAL_TESTS] = {
    0x0U, 0x0U, 0x0U, 0x6U, 0x7U, 0x6U, 0x1U, 0x7U, 0x7U, 0x7U, 0x6U, 0x1U,
    0x7U, 0x7U, 0x7U, 0x18U, 0x8U, 0x8U, 0x10U, 0x18U, 0x20U, 0x18U, 0x10U, 0x18U,
    0x8U, 0x20U, 0x19U, 0x9U, 0x19U, 0x1U, 0x1U
};

int32_t cal_selftest(void)
{
    int32_t failed = 0;
    uint32_t k;
    cal_state state;

    cal_reset(&state);
    for (k = 0U; k < CAL_TESTS; k++) {
        cal_out out = {0.0F, 0.0F, 0.0F, 0.0F, 0.0F, 0.0F};
        uint32_t status = CAL_OK;
        uint32_t i;

        for (i = 0U; i < cal_test_updates[k]; i++) {
            if (cal_test_elapsed[k] == 0U) {
                status = cal_step(&state, &cal_test_in[k]);
                out.bias_gyro_x_dph = state.last.bias_gyro_x_dph;
                out.bias_gyro_y_dph = state.last.bias_gyro_y_dph;
                out.bias_gyro_z_dph = state.last.bias_gyro_z_dph;
                out.bias_accel_x_g = state.last.bias_accel_x_g;
                out.bias_accel_y_g = state.last.bias_accel_y_g;
                out.bias_accel_z_g = state.last.bias_accel_z_g;
            } else {
                status = cal_update(&state, cal_test_elapsed[k], &cal_test_in[k], &out);
            }
        }

        if ((status != cal_test_status[k])
            || (cal_near(out.bias_gyro_x_dph, cal_test_out[k].bias_gyro_x_dph, 0.001F) == 0U)
            || (cal_near(out.bias_gyro_y_dph, cal_test_out[k].bias_gyro_y_dph, 0.0064F) == 0U)
            || (cal_near(out.bias_gyro_z_dph, cal_test_out[k].bias_gyro_z_dph, 0.012F) == 0U)
            || (cal_near(out.bias_accel_x_g, cal_test_out[k].bias_accel_x_g, 8.4e-07F) == 0U)
            || (cal_near(out.bias_accel_y_g, cal_test_out[k].bias_accel_y_g, 5.6e-07F) == 0U)
            || (cal_near(out.bias_accel_z_g, cal_test_out[k].bias_accel_z_g, 3e-06F) == 0U)) {
            failed = 1;
        }
    }
    return failed;
}
#endif

/*
 * The steps above as `calibkit verify` reads them again:
 * {"program":{"forms":["bias-lagged/1"],"formula":"corrected = indication - bias, each channel in its unit; the bias is 0 at rest at 25 degC, or at the end of the fitted range nearest to it","interval_s":10.0,"number":"f32","pace":{"flags":["STARTING","INTERVAL","JUMPED"],"followed":"temp_case_degc","lags":["lag_gyro_x_dph","lag_gyro_y_dph","lag_gyro_z_dph","lag_accel_x_g","lag_accel_y_g","fall_accel_y_g","lag_accel_z_g","fall_accel_z_g"],"longest":6,"table":"pace"},"scales":{}}}
 * {"input":{"flag":"","meaning":"temperature of the sensor case, mean of the interval","name":"temp_case_degc","table":"temp_case_degc_range","unit":"degC"}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x_gyro_x_dph","source":"temp_case_degc","table":"x_map_gyro_x_dph"}}
 * {"memory":{"name":"x_before_gyro_x_dph","source":"x_gyro_x_dph","start":"same"}}
 * {"sum":{"name":"move_gyro_x_dph","terms":[{"factors":["x_gyro_x_dph"],"over":"","sign":1,"table":""},{"factors":["x_before_gyro_x_dph"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before_gyro_x_dph","source":"lag_gyro_x_dph","start":"zero"}}
 * {"sum":{"name":"lag_gyro_x_dph","terms":[{"factors":["lag_before_gyro_x_dph"],"over":"","sign":-1,"table":"lag_decay_gyro_x_dph"},{"factors":["move_gyro_x_dph"],"over":"","sign":1,"table":"lag_move_gyro_x_dph"},{"factors":["lag_before_gyro_x_dph"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_gyro_x_dph","terms":[{"factors":["x_gyro_x_dph"],"over":"","sign":1,"table":""},{"factors":["lag_gyro_x_dph"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u_gyro_x_dph","source":"coil_gyro_x_dph","table":"u_limits_gyro_x_dph"}}
 * {"sum":{"name":"coil_rate_gyro_x_dph","terms":[{"factors":["lag_gyro_x_dph"],"over":"","sign":1,"table":"rate_of_lag_gyro_x_dph"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate_gyro_x_dph","source":"coil_rate_gyro_x_dph","table":"rate_limits_gyro_x_dph"}}
 * {"sum":{"name":"drift_gyro_x_dph","terms":[{"factors":["rate_gyro_x_dph"],"over":"u_gyro_x_dph","sign":1,"table":"by_rate_gyro_x_dph"},{"factors":[],"over":"u_gyro_x_dph","sign":1,"table":"static_gyro_x_dph"}]}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x_gyro_y_dph","source":"temp_case_degc","table":"x_map_gyro_y_dph"}}
 * {"memory":{"name":"x_before_gyro_y_dph","source":"x_gyro_y_dph","start":"same"}}
 * {"sum":{"name":"move_gyro_y_dph","terms":[{"factors":["x_gyro_y_dph"],"over":"","sign":1,"table":""},{"factors":["x_before_gyro_y_dph"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before_gyro_y_dph","source":"lag_gyro_y_dph","start":"zero"}}
 * {"sum":{"name":"lag_gyro_y_dph","terms":[{"factors":["lag_before_gyro_y_dph"],"over":"","sign":-1,"table":"lag_decay_gyro_y_dph"},{"factors":["move_gyro_y_dph"],"over":"","sign":1,"table":"lag_move_gyro_y_dph"},{"factors":["lag_before_gyro_y_dph"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_gyro_y_dph","terms":[{"factors":["x_gyro_y_dph"],"over":"","sign":1,"table":""},{"factors":["lag_gyro_y_dph"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u_gyro_y_dph","source":"coil_gyro_y_dph","table":"u_limits_gyro_y_dph"}}
 * {"sum":{"name":"coil_rate_gyro_y_dph","terms":[{"factors":["lag_gyro_y_dph"],"over":"","sign":1,"table":"rate_of_lag_gyro_y_dph"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate_gyro_y_dph","source":"coil_rate_gyro_y_dph","table":"rate_limits_gyro_y_dph"}}
 * {"sum":{"name":"drift_gyro_y_dph","terms":[{"factors":["rate_gyro_y_dph"],"over":"u_gyro_y_dph","sign":1,"table":"by_rate_gyro_y_dph"},{"factors":[],"over":"u_gyro_y_dph","sign":1,"table":"static_gyro_y_dph"}]}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x_gyro_z_dph","source":"temp_case_degc","table":"x_map_gyro_z_dph"}}
 * {"memory":{"name":"x_before_gyro_z_dph","source":"x_gyro_z_dph","start":"same"}}
 * {"sum":{"name":"move_gyro_z_dph","terms":[{"factors":["x_gyro_z_dph"],"over":"","sign":1,"table":""},{"factors":["x_before_gyro_z_dph"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before_gyro_z_dph","source":"lag_gyro_z_dph","start":"zero"}}
 * {"sum":{"name":"lag_gyro_z_dph","terms":[{"factors":["lag_before_gyro_z_dph"],"over":"","sign":-1,"table":"lag_decay_gyro_z_dph"},{"factors":["move_gyro_z_dph"],"over":"","sign":1,"table":"lag_move_gyro_z_dph"},{"factors":["lag_before_gyro_z_dph"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_gyro_z_dph","terms":[{"factors":["x_gyro_z_dph"],"over":"","sign":1,"table":""},{"factors":["lag_gyro_z_dph"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u_gyro_z_dph","source":"coil_gyro_z_dph","table":"u_limits_gyro_z_dph"}}
 * {"sum":{"name":"coil_rate_gyro_z_dph","terms":[{"factors":["lag_gyro_z_dph"],"over":"","sign":1,"table":"rate_of_lag_gyro_z_dph"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate_gyro_z_dph","source":"coil_rate_gyro_z_dph","table":"rate_limits_gyro_z_dph"}}
 * {"sum":{"name":"drift_gyro_z_dph","terms":[{"factors":["rate_gyro_z_dph"],"over":"u_gyro_z_dph","sign":1,"table":"by_rate_gyro_z_dph"},{"factors":[],"over":"u_gyro_z_dph","sign":1,"table":"static_gyro_z_dph"}]}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x_accel_x_g","source":"temp_case_degc","table":"x_map_accel_x_g"}}
 * {"memory":{"name":"x_before_accel_x_g","source":"x_accel_x_g","start":"same"}}
 * {"sum":{"name":"move_accel_x_g","terms":[{"factors":["x_accel_x_g"],"over":"","sign":1,"table":""},{"factors":["x_before_accel_x_g"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before_accel_x_g","source":"lag_accel_x_g","start":"zero"}}
 * {"sum":{"name":"lag_accel_x_g","terms":[{"factors":["lag_before_accel_x_g"],"over":"","sign":-1,"table":"lag_decay_accel_x_g"},{"factors":["move_accel_x_g"],"over":"","sign":1,"table":"lag_move_accel_x_g"},{"factors":["lag_before_accel_x_g"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_accel_x_g","terms":[{"factors":["x_accel_x_g"],"over":"","sign":1,"table":""},{"factors":["lag_accel_x_g"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u_accel_x_g","source":"coil_accel_x_g","table":"u_limits_accel_x_g"}}
 * {"sum":{"name":"coil_rate_accel_x_g","terms":[{"factors":["lag_accel_x_g"],"over":"","sign":1,"table":"rate_of_lag_accel_x_g"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate_accel_x_g","source":"coil_rate_accel_x_g","table":"rate_limits_accel_x_g"}}
 * {"sum":{"name":"drift_accel_x_g","terms":[{"factors":["rate_accel_x_g"],"over":"u_accel_x_g","sign":1,"table":"by_rate_accel_x_g"},{"factors":[],"over":"u_accel_x_g","sign":1,"table":"static_accel_x_g"}]}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x_accel_y_g","source":"temp_case_degc","table":"x_map_accel_y_g"}}
 * {"memory":{"name":"x_before_accel_y_g","source":"x_accel_y_g","start":"same"}}
 * {"sum":{"name":"move_accel_y_g","terms":[{"factors":["x_accel_y_g"],"over":"","sign":1,"table":""},{"factors":["x_before_accel_y_g"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before_accel_y_g","source":"lag_accel_y_g","start":"zero"}}
 * {"sum":{"name":"lag_accel_y_g","terms":[{"factors":["lag_before_accel_y_g"],"over":"","sign":-1,"table":"lag_decay_accel_y_g"},{"factors":["move_accel_y_g"],"over":"","sign":1,"table":"lag_move_accel_y_g"},{"factors":["lag_before_accel_y_g"],"over":"","sign":1,"table":""}]}}
 * {"memory":{"name":"fall_before_accel_y_g","source":"fall_accel_y_g","start":"zero"}}
 * {"sum":{"name":"fall_accel_y_g","terms":[{"factors":["move_accel_y_g"],"over":"","sign":1,"table":"fall_move_accel_y_g"},{"factors":["lag_before_accel_y_g"],"over":"","sign":1,"table":"fall_lag_accel_y_g"},{"factors":["fall_before_accel_y_g"],"over":"","sign":-1,"table":"fall_decay_accel_y_g"},{"factors":["fall_before_accel_y_g"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_gradient_accel_y_g","terms":[{"factors":["fall_accel_y_g"],"over":"","sign":1,"table":"gradient_of_fall_accel_y_g"}]}}
 * {"limit":{"flag":"GRADIENT_CLAMPED","name":"gradient_accel_y_g","source":"coil_gradient_accel_y_g","table":"gradient_limits_accel_y_g"}}
 * {"sum":{"name":"coil_accel_y_g","terms":[{"factors":["x_accel_y_g"],"over":"","sign":1,"table":""},{"factors":["lag_accel_y_g"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u_accel_y_g","source":"coil_accel_y_g","table":"u_limits_accel_y_g"}}
 * {"sum":{"name":"coil_rate_accel_y_g","terms":[{"factors":["lag_accel_y_g"],"over":"","sign":1,"table":"rate_of_lag_accel_y_g"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate_accel_y_g","source":"coil_rate_accel_y_g","table":"rate_limits_accel_y_g"}}
 * {"sum":{"name":"drift_accel_y_g","terms":[{"factors":["gradient_accel_y_g"],"over":"","sign":1,"table":"by_gradient_accel_y_g"},{"factors":["rate_accel_y_g"],"over":"u_accel_y_g","sign":1,"table":"by_rate_accel_y_g"},{"factors":[],"over":"u_accel_y_g","sign":1,"table":"static_accel_y_g"}]}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x_accel_z_g","source":"temp_case_degc","table":"x_map_accel_z_g"}}
 * {"memory":{"name":"x_before_accel_z_g","source":"x_accel_z_g","start":"same"}}
 * {"sum":{"name":"move_accel_z_g","terms":[{"factors":["x_accel_z_g"],"over":"","sign":1,"table":""},{"factors":["x_before_accel_z_g"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before_accel_z_g","source":"lag_accel_z_g","start":"zero"}}
 * {"sum":{"name":"lag_accel_z_g","terms":[{"factors":["lag_before_accel_z_g"],"over":"","sign":-1,"table":"lag_decay_accel_z_g"},{"factors":["move_accel_z_g"],"over":"","sign":1,"table":"lag_move_accel_z_g"},{"factors":["lag_before_accel_z_g"],"over":"","sign":1,"table":""}]}}
 * {"memory":{"name":"fall_before_accel_z_g","source":"fall_accel_z_g","start":"zero"}}
 * {"sum":{"name":"fall_accel_z_g","terms":[{"factors":["move_accel_z_g"],"over":"","sign":1,"table":"fall_move_accel_z_g"},{"factors":["lag_before_accel_z_g"],"over":"","sign":1,"table":"fall_lag_accel_z_g"},{"factors":["fall_before_accel_z_g"],"over":"","sign":-1,"table":"fall_decay_accel_z_g"},{"factors":["fall_before_accel_z_g"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_gradient_accel_z_g","terms":[{"factors":["fall_accel_z_g"],"over":"","sign":1,"table":"gradient_of_fall_accel_z_g"}]}}
 * {"limit":{"flag":"GRADIENT_CLAMPED","name":"gradient_accel_z_g","source":"coil_gradient_accel_z_g","table":"gradient_limits_accel_z_g"}}
 * {"sum":{"name":"coil_accel_z_g","terms":[{"factors":["x_accel_z_g"],"over":"","sign":1,"table":""},{"factors":["lag_accel_z_g"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u_accel_z_g","source":"coil_accel_z_g","table":"u_limits_accel_z_g"}}
 * {"sum":{"name":"coil_rate_accel_z_g","terms":[{"factors":["lag_accel_z_g"],"over":"","sign":1,"table":"rate_of_lag_accel_z_g"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate_accel_z_g","source":"coil_rate_accel_z_g","table":"rate_limits_accel_z_g"}}
 * {"sum":{"name":"drift_accel_z_g","terms":[{"factors":["gradient_accel_z_g"],"over":"","sign":1,"table":"by_gradient_accel_z_g"},{"factors":["rate_accel_z_g"],"over":"u_accel_z_g","sign":1,"table":"by_rate_accel_z_g"},{"factors":[],"over":"u_accel_z_g","sign":1,"table":"static_accel_z_g"}]}}
 * {"output":{"meaning":"bias of gyro_x_dph, to be subtracted from it","name":"bias_gyro_x_dph","source":"drift_gyro_x_dph","unit":"deg/h"}}
 * {"output":{"meaning":"bias of gyro_y_dph, to be subtracted from it","name":"bias_gyro_y_dph","source":"drift_gyro_y_dph","unit":"deg/h"}}
 * {"output":{"meaning":"bias of gyro_z_dph, to be subtracted from it","name":"bias_gyro_z_dph","source":"drift_gyro_z_dph","unit":"deg/h"}}
 * {"output":{"meaning":"bias of accel_x_g, to be subtracted from it","name":"bias_accel_x_g","source":"drift_accel_x_g","unit":"g"}}
 * {"output":{"meaning":"bias of accel_y_g, to be subtracted from it","name":"bias_accel_y_g","source":"drift_accel_y_g","unit":"g"}}
 * {"output":{"meaning":"bias of accel_z_g, to be subtracted from it","name":"bias_accel_z_g","source":"drift_accel_z_g","unit":"g"}}
 */
/* sha256 of all lines above: a6796eec3aafe5b1bf7ae668db5aa5c5096c238177ae03dd5536d52861506b96 */
