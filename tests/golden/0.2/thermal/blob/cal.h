/*
 * cal: loader of blobs, correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * layout        daf39c28b4a9f0e3: a blob of any other is refused
 * forms         bias-lagged/1
 * number        f32: IEEE 754 single precision
 * formula       corrected = indication - bias, each channel in its unit; the bias is 0 at rest at 25
 *               degC, or at the end of the fitted range nearest to it
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
#define CAL_TEMP_CLAMPED 0x0001U /* temperature outside the fitted range: the correction at its end was used */
#define CAL_RATE_CLAMPED 0x0002U /* temperature rate outside the fitted range: the end of the range was used */
#define CAL_GRADIENT_CLAMPED 0x0004U /* temperature gradient outside the fitted range: the correction at its end was used */
#define CAL_STARTING 0x0008U /* the lags have not settled since the reset or since a gap too long to bridge: the header states by how much the result may be wrong */
#define CAL_INTERVAL 0x0010U /* not one interval after the inputs that were used last: a gap was bridged in a straight line, or the call came too early and nothing changed */
#define CAL_JUMPED 0x0020U /* the temperature moved faster than it can: not used, the drift is held */
#define CAL_INVALID 0x8000U /* an input is a NaN or an infinity: drift and state are held */
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
    float temp_case_degc; /* [degC] temperature of the sensor case, mean of the interval */
} cal_in;

typedef struct {
    float bias_gyro_x_dph; /* [deg/h] bias of gyro_x_dph, to be subtracted from it */
    float bias_gyro_y_dph; /* [deg/h] bias of gyro_y_dph, to be subtracted from it */
    float bias_gyro_z_dph; /* [deg/h] bias of gyro_z_dph, to be subtracted from it */
    float bias_accel_x_g; /* [g] bias of accel_x_g, to be subtracted from it */
    float bias_accel_y_g; /* [g] bias of accel_y_g, to be subtracted from it */
    float bias_accel_z_g; /* [g] bias of accel_z_g, to be subtracted from it */
} cal_out;

typedef struct { /* call cal_reset before the first update */
    float x_gyro_x_dph;
    float lag_gyro_x_dph;
    float x_gyro_y_dph;
    float lag_gyro_y_dph;
    float x_gyro_z_dph;
    float lag_gyro_z_dph;
    float x_accel_x_g;
    float lag_accel_x_g;
    float x_accel_y_g;
    float lag_accel_y_g;
    float fall_accel_y_g;
    float x_accel_z_g;
    float lag_accel_z_g;
    float fall_accel_z_g;
    cal_out last;
    cal_out before; /* the update before */
    cal_in in; /* the last that was used */
    uint32_t updates;
    uint32_t waited_ms;
} cal_state;

typedef struct {
    float middle;
    float reciprocal;
    float range[2];
} cal_map;

typedef struct { /* the numbers of one blob, which cal_load writes */
    float t_temp_case_degc_range[2];
    float t_pace[2];
    cal_map t_x_map_gyro_x_dph;
    float t_lag_decay_gyro_x_dph;
    float t_lag_move_gyro_x_dph;
    float t_u_limits_gyro_x_dph[2];
    float t_rate_of_lag_gyro_x_dph;
    float t_rate_limits_gyro_x_dph[2];
    float t_by_rate_gyro_x_dph[2];
    float t_static_gyro_x_dph[4];
    cal_map t_x_map_gyro_y_dph;
    float t_lag_decay_gyro_y_dph;
    float t_lag_move_gyro_y_dph;
    float t_u_limits_gyro_y_dph[2];
    float t_rate_of_lag_gyro_y_dph;
    float t_rate_limits_gyro_y_dph[2];
    float t_by_rate_gyro_y_dph[2];
    float t_static_gyro_y_dph[4];
    cal_map t_x_map_gyro_z_dph;
    float t_lag_decay_gyro_z_dph;
    float t_lag_move_gyro_z_dph;
    float t_u_limits_gyro_z_dph[2];
    float t_rate_of_lag_gyro_z_dph;
    float t_rate_limits_gyro_z_dph[2];
    float t_by_rate_gyro_z_dph[2];
    float t_static_gyro_z_dph[4];
    cal_map t_x_map_accel_x_g;
    float t_lag_decay_accel_x_g;
    float t_lag_move_accel_x_g;
    float t_u_limits_accel_x_g[2];
    float t_rate_of_lag_accel_x_g;
    float t_rate_limits_accel_x_g[2];
    float t_by_rate_accel_x_g[2];
    float t_static_accel_x_g[4];
    cal_map t_x_map_accel_y_g;
    float t_lag_decay_accel_y_g;
    float t_lag_move_accel_y_g;
    float t_fall_move_accel_y_g;
    float t_fall_lag_accel_y_g;
    float t_fall_decay_accel_y_g;
    float t_gradient_of_fall_accel_y_g;
    float t_gradient_limits_accel_y_g[2];
    float t_u_limits_accel_y_g[2];
    float t_rate_of_lag_accel_y_g;
    float t_rate_limits_accel_y_g[2];
    float t_by_gradient_accel_y_g;
    float t_by_rate_accel_y_g[2];
    float t_static_accel_y_g[4];
    cal_map t_x_map_accel_z_g;
    float t_lag_decay_accel_z_g;
    float t_lag_move_accel_z_g;
    float t_fall_move_accel_z_g;
    float t_fall_lag_accel_z_g;
    float t_fall_decay_accel_z_g;
    float t_gradient_of_fall_accel_z_g;
    float t_gradient_limits_accel_z_g[2];
    float t_u_limits_accel_z_g[2];
    float t_rate_of_lag_accel_z_g;
    float t_rate_limits_accel_z_g[2];
    float t_by_gradient_accel_z_g;
    float t_by_rate_accel_z_g[2];
    float t_static_accel_z_g[4];
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

#define CAL_INTERVAL_MS 10000U /* from update to update */

/** Forgets the past: the next update starts at rest, in equilibrium. */
void cal_reset(cal_state *state);
/** Call it every CAL_INTERVAL_MS with means over them; elapsed_ms is the time since the
    call before by a clock. Returns a status, of which 0 is all right. */
uint32_t cal_update(const cal_unit *unit, cal_state *state, uint32_t elapsed_ms, const cal_in *in,
    cal_out *out);
/** Output elapsed_ms after the last update, in a straight line from the output of the
    update before to that of the last: one interval late, and without steps. */
void cal_between(const cal_state *state, uint32_t elapsed_ms, cal_out *out);

#ifndef CAL_NO_SELFTEST
/** 0 = pass; run it once after every start. */
int32_t cal_selftest(const cal_unit *unit);
#endif

#ifdef __cplusplus
}
#endif

#endif /* CAL_H */
/* sha256 of all lines above: 52d5c97fa51ab179369cfcad84ab443e602514187023b39ba7607ec83535e8ee */
