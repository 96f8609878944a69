/*
 * cal: correction chain as firmware
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 1, effective from 2024-11-24
 * forms         fog-drift-lagged/1
 * coefficients  drift_rate.json content digest (field sha256)
 *               76331a143aa53776035513d727a51270bca857bb273cc8d2bd425e7e99faef04
 * run           run.json content digest (field sha256)
 *               a5f09a77837f09179f586922b963a6261eff2c1ead49c4c3e3391dec5b1689aa
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       corrected = indication - drift, both in deg/h; the drift is 0 at rest at 25 degC, or
 *               at the end of the fitted range nearest to it
 * input         temp_case_degc [degC] = column 'temp_case_degc', in degC, or in the unit that its
 *               header states (recipe: sign = +1)
 * indication    gyro_dph [deg/h] = column 'gyro_dph', in deg/h, or in the unit that its header states
 *               (recipe: sign = +1)
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * fitted over   temp_case_degc of the coil -36.69 to 63.36 degC
 * fitted over   temp_rate_degc_min of the coil -6.652 to 6.583 degC/min
 * fitted over   gradient_degc of the coil -6.364 to 6.301 degC
 * fitted over   gradient_rate_degc_min of the coil -0.7678 to 0.7574 degC/min
 * fitted over   these; the case is followed from -70 to 110 degC, as by apply
 * interval      update every 10 s, with means over it
 * jump          a temp_case_degc more than 2.22 degC an interval from the last is not used
 * gap           up to 60 s is bridged in a straight line, wrong by up to 1.8 deg/h while the case
 *               moves by no more than 6.65 degC/min; a longer one is a start
 * start         STARTING for 1620 s after a reset, which, while the case moves by no more than 6.65
 *               degC/min, is wrong by up to 10 deg/h at first, 0.099 deg/h then
 * error bound   drift_dph: 8.4e-05 deg/h
 *               (worst case of evaluation, while the case moves by no more than 13.3 degC/min)
 */

#ifndef CAL_H
#define CAL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CAL_SERIAL "G-1"
#define CAL_REVISION 1
/* content digest (field sha256) of drift_rate.json */
#define CAL_COEFFICIENTS_SHA256 "76331a143aa53776035513d727a51270bca857bb273cc8d2bd425e7e99faef04"
/* 0 rejected, 1 accepted, 2 no verdict */
#define CAL_VERDICT 1
#define CAL_ACCEPTED 1

/* status: 0, or the sum of */
#define CAL_OK 0x0000U
#define CAL_TEMP_CLAMPED 0x0001U /* temperature outside the fitted range: the correction at its end was used */
#define CAL_GRADIENT_CLAMPED 0x0002U /* temperature gradient outside the fitted range: the correction at its end was used */
#define CAL_RATE_CLAMPED 0x0004U /* temperature rate outside the fitted range: the end of the range was used */
#define CAL_STARTING 0x0008U /* the lags have not settled since the reset or since a gap too long to bridge: the header states by how much the result may be wrong */
#define CAL_INTERVAL 0x0010U /* not one interval after the inputs that were used last: a gap was bridged in a straight line, or the call came too early and nothing changed */
#define CAL_JUMPED 0x0020U /* the temperature moved faster than it can: not used, the drift is held */
#define CAL_INVALID 0x8000U /* an input is a NaN or an infinity: drift and state are held */

typedef struct {
    float temp_case_degc; /* [degC] temperature of the sensor case, mean of the interval; -115 to 155 */
} cal_in;

typedef struct {
    float drift_dph; /* [deg/h] drift, to be subtracted from the indication */
} cal_out;

typedef struct { /* call cal_reset before the first update */
    float x;
    float lag;
    float fall;
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
/* sha256 of all lines above: 68905cc2feef461fc24fd885bf8f507cba9f51014ce723527714403fc63595b2 */
