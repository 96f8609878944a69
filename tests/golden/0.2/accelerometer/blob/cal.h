/*
 * cal: loader of blobs, correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * layout        9ac50886c89ca24d: a blob of any other is refused
 * forms         accel-affine/1
 * number        f32: IEEE 754 single precision
 * formula       corrected = M(T) (indication - b(T)), in local g
 * units         of every input and output below; ranges and error bounds are each unit's own and stand
 *               in
 *               the text of its blob
 */

#ifndef CAL_H
#define CAL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* status: 0, or the sum of */
#define CAL_OK 0x0000U
#define CAL_ACCEL_BEYOND 0x0001U /* indication outside the fitted range: corrected as it is */
#define CAL_TEMP_CLAMPED 0x0002U /* temperature outside the fitted range: the correction at its end was used */
#define CAL_INVALID 0x8000U /* an input is a NaN or an infinity: no number in, no number out */
#define CAL_NOT_LOADED 0x4000U /* no blob was accepted: no number out (with CAL_INVALID) */

/* what cal_load returns */
#define CAL_LOADED 0U /* ready to correct */
#define CAL_LOAD_CRC_ENGINE 1U /* the CRC of 123456789 is not 0xCBF43926 on this core */
#define CAL_LOAD_LENGTH 2U /* shorter than it says it is */
#define CAL_LOAD_MAGIC 3U /* not a blob */
#define CAL_LOAD_SCHEMA 4U /* a major version that this loader does not know */
#define CAL_LOAD_CRC 5U /* its CRC is wrong */
#define CAL_LOAD_LAYOUT 6U /* made for another loader */
#define CAL_LOAD_REJECTED 7U /* of a run that failed its acceptance limits; -DCAL_ALLOW_REJECTED takes it */
#define CAL_LOAD_VALUES 8U /* a number that is not finite or not possible, or a range without a width */
#define CAL_LOAD_VECTORS 9U /* its numbers do not give the results that it states */
#define CAL_LOAD_SERIAL 10U /* for another device */
#define CAL_LOAD_REVISION 11U /* older than the lowest revision that is taken */

typedef struct {
    float temp_case_degc; /* [degC] temperature of the sensor case */
    float accel_x_g; /* [g] indication of the x accelerometer, positive along gravity */
    float accel_y_g; /* [g] indication of the y accelerometer, positive along gravity */
    float accel_z_g; /* [g] indication of the z accelerometer, positive along gravity */
} cal_in;

typedef struct {
    float accel_x_g; /* [g] corrected component along x, positive along gravity */
    float accel_y_g; /* [g] corrected component along y, positive along gravity */
    float accel_z_g; /* [g] corrected component along z, positive along gravity */
} cal_out;

typedef struct {
    float middle;
    float reciprocal;
    float range[2];
} cal_map;

typedef struct { /* the numbers of one blob, which cal_load writes */
    float t_temp_case_degc_range[2];
    float t_accel_x_g_range[2];
    float t_accel_y_g_range[2];
    float t_accel_z_g_range[2];
    cal_map t_u_map;
    float t_b_x[4];
    float t_b_y[4];
    float t_b_z[4];
    float t_m_xy[4];
    float t_m_xz[4];
    float t_m_xx[4];
    float t_m_yx[4];
    float t_m_yz[4];
    float t_m_yy[4];
    float t_m_zx[4];
    float t_m_zy[4];
    float t_m_zz[4];
    const uint8_t *tests; /* tolerances and vectors, in the blob */
    uint32_t rows;
    uint32_t revision;
    char serial[33];
    char date[13];
    uint8_t digest[32];
} cal_numbers;

typedef struct { /* one sensor; a product has as many as it likes */
    cal_numbers slots[2];
    volatile uint32_t active; /* 0 none, else the number of the slot in use */
} cal_unit;

/** Forgets all numbers: nothing is corrected before the next load. A static unit begins so. */
void cal_init(cal_unit *unit);
/** Takes the numbers of a blob into the slot that is not in use, and changes over to it where all of
    them are right; else the numbers in use stay. The blob must stay where it is for cal_selftest.
    serial: the device that the blob must be for, or a null pointer; least_revision: the lowest
    revision that is taken. Returns CAL_LOADED, or why not. Not to be called again while a call with
    the numbers before is still under way. */
uint32_t cal_load(cal_unit *unit, const uint8_t blob[], uint32_t size, const char *serial,
    uint32_t least_revision);
/** What is loaded: its device, revision, effective date and digest of run.json (32 bytes); of a
    unit without numbers "", 0, "" and a null pointer. */
const char *cal_serial(const cal_unit *unit);
uint32_t cal_revision(const cal_unit *unit);
const char *cal_date(const cal_unit *unit);
const uint8_t *cal_digest(const cal_unit *unit);

/** Corrects one set of indications; returns a status, of which 0 is all right. */
uint32_t cal_correct(const cal_unit *unit, const cal_in *in, cal_out *out);

#ifndef CAL_NO_SELFTEST
/** 0 = pass; run it once after every start. */
int32_t cal_selftest(const cal_unit *unit);
#endif

#ifdef __cplusplus
}
#endif

#endif /* CAL_H */
/* sha256 of all lines above: 73bd34bb7b096d7bc55b4e982a869f797d28930f2e12678f8009b6365915c27d */
