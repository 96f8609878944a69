/*
 * cal: correction chain as firmware
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
 */

#ifndef CAL_H
#define CAL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CAL_SERIAL "G-1"
#define CAL_REVISION 2
/* content digest (field sha256) of bias.json */
#define CAL_COEFFICIENTS_SHA256 "752e38b46ef6bacdbff3b31b61d75c283a4dae06054db986b85215571d4f053d"
/* 0 rejected, 1 accepted, 2 no verdict */
#define CAL_VERDICT 1
#define CAL_ACCEPTED 1

/* status: 0, or the sum of */
#define CAL_OK 0x0000U
#define CAL_TEMP_CLAMPED 0x0001U /* temperature outside the fitted range: the correction at its end was used */
#define CAL_INVALID 0x8000U /* an input is a NaN or an infinity: no number in, no number out */

typedef struct {
    float temp_case_degc; /* [degC] abscissa of the bias; 16.3671 to 52.6954 */
} cal_in;

typedef struct {
    float bias_gyro_x_dph; /* [deg/h] bias of gyro_x_dph, to be subtracted from it */
    float bias_accel_x_g; /* [g] bias of accel_x_g, to be subtracted from it */
} cal_out;

/** Corrects one set of indications; returns a status, of which 0 is all right. */
uint32_t cal_correct(const cal_in *in, cal_out *out);

#ifndef CAL_NO_SELFTEST
/** 0 = pass; run it once after every start. */
int32_t cal_selftest(void);
#endif

#ifdef __cplusplus
}
#endif

#endif /* CAL_H */
/* sha256 of all lines above: 13fa24ec9284dd8beb1409abdd01fc5b4cc1c050c028a47593e3d7019ad24c5e */
