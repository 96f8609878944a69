/*
 * cal: correction chain as firmware
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
 */

#ifndef CAL_H
#define CAL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CAL_SERIAL "G-1"
#define CAL_REVISION 1
/* content digest (field sha256) of thermal.json */
#define CAL_COEFFICIENTS_SHA256 "00681c89c0fc4b6f4f60c45e49bfecdc49e4cbc1bc23476edc018413cab5775e"
/* 0 rejected, 1 accepted, 2 no verdict */
#define CAL_VERDICT 1
#define CAL_ACCEPTED 1

/* status: 0, or the sum of */
#define CAL_OK 0x0000U
#define CAL_TEMP_CLAMPED 0x0001U /* temperature outside the fitted range: the correction at its end was used */
#define CAL_RATE_CLAMPED 0x0002U /* temperature rate outside the fitted range: the end of the range was used */
#define CAL_GRADIENT_CLAMPED 0x0004U /* temperature gradient outside the fitted range: the correction at its end was used */
#define CAL_STARTING 0x0008U /* the lags have not settled since the reset or since a gap too long to bridge: the header states by how much the result may be wrong */
#define CAL_INTERVAL 0x0010U /* not one interval after the inputs that were used last: a gap was bridged in a straight line, or the call came too early and nothing changed */
#define CAL_JUMPED 0x0020U /* the temperature moved faster than it can: not used, the drift is held */
#define CAL_INVALID 0x8000U /* an input is a NaN or an infinity: drift and state are held */

typedef struct {
    float temp_case_degc; /* [degC] temperature of the sensor case, mean of the interval; -115 to 155 */
} cal_in;

typedef struct {
    float bias_gyro_x_dph; /* [deg/h] bias of gyro_x_dph, to be subtracted from it */
    float bias_gyro_y_dph; /* [deg/h] bias of gyro_y_dph, to be subtracted from it */
    float bias_gyro_z_dph; /* [deg/h] bias of gyro_z_dph, to be subtracted from it */
    float bias_accel_x_g; /* [g] bias of accel_x_g, to be subtracted from it */
    float bias_accel_y_g; /* [g] bias of accel_y_g, to be subtracted from it */
    float bias_accel_z_g; /* [g] bias of accel_z_g, to be subtracted from it */
} cal_out;

typedef struct { /* call cal_reset before the first update */
    float x_gyro_x_dph;
    float lag_gyro_x_dph;
    float x_gyro_y_dph;
    float lag_gyro_y_dph;
    float x_gyro_z_dph;
    float lag_gyro_z_dph;
    float x_accel_x_g;
    float lag_accel_x_g;
    float x_accel_y_g;
    float lag_accel_y_g;
    float fall_accel_y_g;
    float x_accel_z_g;
    float lag_accel_z_g;
    float fall_accel_z_g;
    cal_out last;
    cal_out before; /* the update before */
    cal_in in; /* the last that was used */
    uint32_t updates;
    uint32_t waited_ms;
} cal_state;

#define CAL_INTERVAL_MS 10000U /* from update to update */

/** Forgets the past: the next update starts at rest, in equilibrium. */
void cal_reset(cal_state *state);
/** Call it every CAL_INTERVAL_MS with means over them; elapsed_ms is the time since the
    call before by a clock. Returns a status, of which 0 is all right. */
uint32_t cal_update(cal_state *state, uint32_t elapsed_ms, const cal_in *in,
    cal_out *out);
/** Output elapsed_ms after the last update, in a straight line from the output of the
    update before to that of the last: one interval late, and without steps. */
void cal_between(const cal_state *state, uint32_t elapsed_ms, cal_out *out);

#ifndef CAL_NO_SELFTEST
/** 0 = pass; run it once after every start. */
int32_t cal_selftest(void);
#endif

#ifdef __cplusplus
}
#endif

#endif /* CAL_H */
/* sha256 of all lines above: 33fce02b50846f23160ed4d35a1a681a8e958bb953e3924a9306961e76b3d193 */
