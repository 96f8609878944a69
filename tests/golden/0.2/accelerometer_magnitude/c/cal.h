/*
 * cal: correction chain as firmware
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 2, effective from 2025-11-24
 * forms         accel-affine/1
 * coefficients  accel_affine.json content digest (field sha256)
 *               05e60c87d996b0b18a603d3122ffde4c9e5dbe8d49fb549d2f58959266c19220
 * run           run.json content digest (field sha256)
 *               4f5d827e41ef674703874ffe3347ecdb0c3eeb4710c170d44c102aa2c30f19a8
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       corrected = M(T) (indication - b(T)), in local g
 * input         accel_x_g [g] = column 'accel_x_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * input         accel_y_g [g] = column 'accel_y_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * input         accel_z_g [g] = column 'accel_z_g', in g, or in the unit that its header states
 *               (recipe: sign = +1)
 * convention    accelerometers in and out: positive along gravity
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * error bound   accel_x_g: 1.8e-07 g; up to the full scale 2.4e-06 g
 * error bound   accel_y_g: 3.0e-07 g; up to the full scale 3.9e-06 g
 * error bound   accel_z_g: 2.6e-07 g; up to the full scale 3.4e-06 g
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
/* content digest (field sha256) of accel_affine.json */
#define CAL_COEFFICIENTS_SHA256 "05e60c87d996b0b18a603d3122ffde4c9e5dbe8d49fb549d2f58959266c19220"
/* 0 rejected, 1 accepted, 2 no verdict */
#define CAL_VERDICT 1
#define CAL_ACCEPTED 1

/* status: 0, or the sum of */
#define CAL_OK 0x0000U
#define CAL_ACCEL_BEYOND 0x0001U /* indication outside the fitted range: corrected as it is */
#define CAL_INVALID 0x8000U /* an input is a NaN or an infinity: no number in, no number out */

typedef struct {
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
/* sha256 of all lines above: d57a8fccce7eeb8bb59ec6f8e769207f27af2be06aaca19daea62251fce305cc */
