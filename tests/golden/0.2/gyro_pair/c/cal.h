/*
 * cal: correction chain as firmware
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
#define CAL_COEFFICIENTS_SHA256 "2706758056717a8d6f6ba73afc95b6bdd8cab416d9a4607e5a95750ea5678c0b"
/* 0 rejected, 1 accepted, 2 no verdict */
#define CAL_VERDICT 1
#define CAL_ACCEPTED 1

/* status: 0, or the sum of */
#define CAL_OK 0x0000U
#define CAL_RATE_BEYOND 0x0001U /* indication outside the fitted rates: corrected as it is */
#define CAL_INVALID 0x8000U /* an input is a NaN or an infinity: no number in, no number out */

typedef struct {
    float gyro_a_lsb; /* [1/s] indication of gyro a, counts per second; -1.05815e+06 to 1.05815e+06, full scale -2.01549e+07 to 2.01549e+07 */
    float gyro_b_lsb; /* [1/s] indication of gyro b, counts per second; -1.04899e+06 to 1.04899e+06, full scale -1.99802e+07 to 1.99802e+07 */
} cal_in;

typedef struct {
    float gyro_a_dps; /* [deg/s] rate about the axis of gyro a */
    float gyro_b_dps; /* [deg/s] rate about the axis of gyro b */
    float gyro_b_orthogonal_dps; /* [deg/s] rate about the axis at right angles to gyro a in the plane of both */
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
/* sha256 of all lines above: b48d3e38502371c9531d443f51eaed28b3665447a472e0e3f0c45f828e90095e */
