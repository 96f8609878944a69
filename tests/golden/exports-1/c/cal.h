/*
 * cal: correction chain as firmware
 *
 * device        U2 revision 1, effective from 2026-11-21
 * forms         polynomial/1
 * coefficients  bias.json content digest (field sha256)
 *               4f630ef5fa77f8d03082fd474869ccbe47cf1ccdc2393fd30ba89dd8ffeb0ade
 * run           run.json content digest (field sha256)
 *               b0e24ee6a0345f0b9773fc4dfa0b42b8beddb42c65c02516f75ffd9fbce95c5e
 * schema        calibkit-firmware/1, made by calibkit 0.1.0
 * number        f32: IEEE 754 single precision
 * formula       corrected = indication - bias, each channel in its unit
 * fitted over   temp_case_degc 20 to 49.9 degC
 * error bound   bias_gyro_dph: 7.4e-07 deg/h
 *               (worst case of evaluation against the exact chain, over all inputs in range)
 */

#ifndef CAL_H
#define CAL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define CAL_SERIAL "U2"
#define CAL_REVISION 1
/* content digest (field sha256) of bias.json */
#define CAL_COEFFICIENTS_SHA256 "4f630ef5fa77f8d03082fd474869ccbe47cf1ccdc2393fd30ba89dd8ffeb0ade"
#define CAL_ACCEPTED 1

/* status: 0, or the sum of */
#define CAL_OK 0x0000U
#define CAL_TEMP_CLAMPED 0x0001U /* temperature outside the fitted range: the correction at its end was used */
#define CAL_INVALID 0x8000U /* an input is a NaN or an infinity: no number in, no number out */

typedef struct {
    float temp_case_degc; /* [degC] abscissa of the bias; 16.2266 to 53.6484 */
} cal_in;

typedef struct {
    float bias_gyro_dph; /* [deg/h] bias of gyro_dph, to be subtracted from it */
} cal_out;

/* corrects one set of indications; returns a status, of which 0 is all right */
uint32_t cal_correct(const cal_in *in, cal_out *out);

#ifndef CAL_NO_SELFTEST
/* 0 = pass; run it once after every start */
int32_t cal_selftest(void);
#endif

#ifdef __cplusplus
}
#endif

#endif /* CAL_H */
/* sha256 of all lines above: 51a5b287e3a25b6f6dba031cf6acfd955bc6b2f39a8e6914dc5fb7c529ff157f */
