/*
 * cal: correction chain as firmware
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 2, effective from 2025-11-24
 * forms         gyro-scale/1
 * coefficients  gyro_scale.json content digest (field sha256)
 *               dee297ada29192e25d2b4bd44c83beafc1c57e58dc449477a84203ddc81467f5
 * run           run.json content digest (field sha256)
 *               6fbe2cceb8990492b941ab0e0175720979ee7e313716f5c3dd9b14cd8c9abd8e
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       rate = (indication - F0(T)) / K(T), in deg/s, zero at rest on the laboratory's table
 * input         temp_case_degc [degC] = column 'temp_case_degc', in degC, or in the unit that its
 *               header states (recipe: sign = +1)
 * input         gyro_x_lsb [1/s] = column 'gyro_x_lsb', in 1/s, or in the unit that its header states
 *               (recipe: sign = +1)
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * fitted over   temp_case_degc -40.04 to 60.18 degC
 * fitted over   rate of gyro x -100 to 100 deg/s
 * error bound   gyro_x_dps: 2.2e-05 deg/s; up to the full scale 4.3e-04 deg/s
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
/* content digest (field sha256) of gyro_scale.json */
#define CAL_COEFFICIENTS_SHA256 "dee297ada29192e25d2b4bd44c83beafc1c57e58dc449477a84203ddc81467f5"
/* 0 rejected, 1 accepted, 2 no verdict */
#define CAL_VERDICT 1
#define CAL_ACCEPTED 1

/* status: 0, or the sum of */
#define CAL_OK 0x0000U
#define CAL_RATE_BEYOND 0x0001U /* indication outside the fitted rates: corrected as it is */
#define CAL_TEMP_CLAMPED 0x0002U /* temperature outside the fitted range: the correction at its end was used */
#define CAL_INVALID 0x8000U /* an input is a NaN or an infinity: no number in, no number out */

typedef struct {
    float temp_case_degc; /* [degC] temperature of the sensor case; -52.6875 to 72.9375 */
    float gyro_x_lsb; /* [1/s] indication of gyro x, counts per second; -1.04736e+06 to 1.04736e+06, full scale -1.99491e+07 to 1.99491e+07 */
} cal_in;

typedef struct {
    float gyro_x_dps; /* [deg/s] rate about the axis of gyro x */
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
/* sha256 of all lines above: c4f2225fc87bee55009bc75381aad0e0b745fe1f681baaaea9df4886c696a921 */
