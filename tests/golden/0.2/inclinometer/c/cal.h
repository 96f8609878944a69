/*
 * cal: correction chain as firmware
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 2, effective from 2025-11-24
 * forms         inclinometer-scale/1
 * coefficients  inclinometer_scale.json content digest (field sha256)
 *               f418a40d6241b93a0e201b5f122741d33fc25850e355ad61ae4592b9fcc1ffb3
 * run           run.json content digest (field sha256)
 *               95d35bf421fe0b9e2f81bc67caf46f0556007626e370912f310c6cb336189529
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       corrected = scale * indication, for each gyro
 * input         temp_case_degc [degC] = column 'temp_case_degc', in degC, or in the unit that its
 *               header states (recipe: sign = +1)
 * indication    gyro_x_dph [deg/h] = column 'gyro_x_dph', in deg/h, or in the unit that its header
 *               states (recipe: sign = +1)
 * indication    gyro_y_dph [deg/h] = column 'gyro_y_dph', in deg/h, or in the unit that its header
 *               states (recipe: sign = +1)
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * fitted over   temp_case_degc 20.64 to 119.2 degC
 * error bound   scale_x: 8.7e-08
 * error bound   scale_y: 1.2e-07
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
/* content digest (field sha256) of inclinometer_scale.json */
#define CAL_COEFFICIENTS_SHA256 "f418a40d6241b93a0e201b5f122741d33fc25850e355ad61ae4592b9fcc1ffb3"
/* 0 rejected, 1 accepted, 2 no verdict */
#define CAL_VERDICT 1
#define CAL_ACCEPTED 1

/* status: 0, or the sum of */
#define CAL_OK 0x0000U
#define CAL_TEMP_CLAMPED 0x0001U /* temperature outside the fitted range: the correction at its end was used */
#define CAL_INVALID 0x8000U /* an input is a NaN or an infinity: no number in, no number out */

typedef struct {
    float temp_case_degc; /* [degC] temperature of the sensor case; 8.15625 to 131.594 */
} cal_in;

typedef struct {
    float scale_x; /* [1] scale factor of the x gyro, to be multiplied with its indication */
    float scale_y; /* [1] scale factor of the y gyro, to be multiplied with its indication */
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
/* sha256 of all lines above: 13c151e396b5804963abbff5d6ded574d1fa9618c5bf89d2323c61ab631e5654 */
