/*
 * cal: correction chain as firmware
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
 */

#ifndef CAL_H
#define CAL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CAL_SERIAL "G-1"
#define CAL_REVISION 1
/* content digest (field sha256) of gyro_scale.json */
#define CAL_COEFFICIENTS_SHA256 "05f77938f8b96b8aa1eba506d8bd6d48864833ea5def80a411b0f0d2b1b93ae7"
/* 0 rejected, 1 accepted, 2 no verdict */
#define CAL_VERDICT 1
#define CAL_ACCEPTED 1

/* status: 0, or the sum of */
#define CAL_OK 0x0000U
#define CAL_RATE_BEYOND 0x0001U /* indication outside the fitted rates: corrected as it is */
#define CAL_TEMP_CLAMPED 0x0002U /* temperature outside the fitted range: the correction at its end was used */
#define CAL_INVALID 0x8000U /* an input is a NaN or an infinity: no number in, no number out */

typedef struct {
    float temp_case_degc; /* [degC] temperature of the sensor case; -52.8125 to 72.8125 */
    float gyro_x_lsb; /* [1/s] indication of gyro x, counts per second; -1.05195e+06 to 1.05195e+06, full scale -2.0037e+07 to 2.0037e+07 */
    float gyro_y_lsb; /* [1/s] indication of gyro y, counts per second; -1.07274e+06 to 1.07274e+06, full scale -2.04331e+07 to 2.04331e+07 */
    float gyro_z_lsb; /* [1/s] indication of gyro z, counts per second; -1.05232e+06 to 1.05232e+06, full scale -2.00441e+07 to 2.00441e+07 */
} cal_in;

typedef struct {
    float rate_x_dps; /* [deg/s] rate about axis x of the base */
    float rate_y_dps; /* [deg/s] rate about axis y of the base */
    float rate_z_dps; /* [deg/s] rate about axis z of the base */
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
/* sha256 of all lines above: b2d073c96a990b1299be858b6c75777a526d5a1949125cd988080bf6038a22be */
