/*
 * cal: correction chain as firmware
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
 */

#ifndef CAL_H
#define CAL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CAL_SERIAL "G-1"
#define CAL_REVISION 1
/* content digest (field sha256) of accel_affine.json */
#define CAL_COEFFICIENTS_SHA256 "8bfe27b3a2f302cd2a40fe5e2070312c912b6bd6f529333b510da482cc064fb1"
/* 0 rejected, 1 accepted, 2 no verdict */
#define CAL_VERDICT 1
#define CAL_ACCEPTED 1

/* status: 0, or the sum of */
#define CAL_OK 0x0000U
#define CAL_ACCEL_BEYOND 0x0001U /* indication outside the fitted range: corrected as it is */
#define CAL_TEMP_CLAMPED 0x0002U /* temperature outside the fitted range: the correction at its end was used */
#define CAL_INVALID 0x8000U /* an input is a NaN or an infinity: no number in, no number out */

typedef struct {
    float temp_case_degc; /* [degC] temperature of the sensor case; -38.75 to 143.75 */
    float accel_x_g; /* [g] indication of the x accelerometer, positive along gravity; -1.25 to 1.25, full scale -16 to 16 */
    float accel_y_g; /* [g] indication of the y accelerometer, positive along gravity; -1.25 to 1.25, full scale -16 to 16 */
    float accel_z_g; /* [g] indication of the z accelerometer, positive along gravity; -1.25 to 1.25, full scale -16 to 16 */
} cal_in;

typedef struct {
    float accel_x_g; /* [g] corrected component along x, positive along gravity */
    float accel_y_g; /* [g] corrected component along y, positive along gravity */
    float accel_z_g; /* [g] corrected component along z, positive along gravity */
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
/* sha256 of all lines above: 9459a33ad71a7f09b006a4da88a381d1a900c8753275b860414787b15648157f */
