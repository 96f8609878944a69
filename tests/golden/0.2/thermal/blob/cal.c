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
 *
 * Results are bit for bit those of calibkit's twin with -ffp-contract=off; else within twice the error
 *               bound.
 */

#include <stddef.h>

#include "cal.h"

/* what a slot holds is in memory before it is in use; define it for other compilers and several cores */
#ifndef CAL_BARRIER
#ifdef __GNUC__
#define CAL_BARRIER() __sync_synchronize()
#else
#define CAL_BARRIER() ((void)0)
#endif
#endif

#include <float.h>

#if defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0)
#error -ffast-math and -ffinite-math-only delete the guard against NaN
#endif

#define CAL_EARLIEST_MS 8750U
#define CAL_LATEST_MS 11250U
#define CAL_LONGEST 6U /* intervals that are bridged */

/* x brought into [range[0], range[1]] */
static float cal_limited(float x, const float range[], uint32_t flag, uint32_t *status)
{
    float y = x;

    if (x < range[0]) {
        y = range[0];
        *status |= flag;
    } else if (x > range[1]) {
        y = range[1];
        *status |= flag;
    } else {
        /* inside */
    }
    return y;
}

/* u = (x - middle) / half, brought into its range */
static float cal_mapped(float x, const cal_map *map, uint32_t flag, uint32_t *status)
{
    const float u = (x - map->middle) * map->reciprocal;

    return cal_limited(u, map->range, flag, status);
}

/* c[0] + c[1] x + ... + c[count - 1] x^(count - 1) by Horner's scheme: ascending, index = power */
static float cal_polynomial(const float c[], uint32_t count, float x)
{
    float y = c[count - 1U];
    uint32_t k;

    for (k = count - 1U; k > 0U; k--) {
        y = (y * x) + c[k - 1U];
    }
    return y;
}

/* 0 for a NaN or an infinity */
static uint32_t cal_finite(float x)
{
    return ((x >= -FLT_MAX) && (x <= FLT_MAX)) ? 1U : 0U;
}

/* one byte after the other, whatever the core's own order */
static uint32_t cal_u32(const uint8_t bytes[])
{
    return (uint32_t)bytes[0] | ((uint32_t)bytes[1] << 8U) | ((uint32_t)bytes[2] << 16U)
        | ((uint32_t)bytes[3] << 24U);
}

/* CRC-32 of IEEE 802.3 */
static uint32_t cal_crc(const uint8_t bytes[], uint32_t count)
{
    uint32_t crc = 0xFFFFFFFFU;
    uint32_t i;

    for (i = 0U; i < count; i++) {
        uint32_t k;

        crc ^= (uint32_t)bytes[i];
        for (k = 0U; k < 8U; k++) {
            crc = ((crc & 1U) != 0U) ? ((crc >> 1U) ^ 0xEDB88320U) : (crc >> 1U);
        }
    }
    return crc ^ 0xFFFFFFFFU;
}

/* MISRA C:2012 rule 19.2, deviation: a union turns the bits of a number into the number */
typedef union {
    uint32_t bits;
    float value;
} cal_bits;

static float cal_number(const uint8_t bytes[])
{
    cal_bits number;

    number.bits = cal_u32(bytes);
    return number.value;
}

static float cal_none(void)
{
    cal_bits number;

    number.bits = 0x7FC00000U;
    return number.value;
}

/* a number as a count below most, or most where it is none */
static uint32_t cal_count(float x, uint32_t most)
{
    uint32_t count = most;

    if ((x >= 0.0F) && (x < (float)most)) {
        count = (uint32_t)x;
    }
    return count;
}

void cal_reset(cal_state *state)
{
    state->x_gyro_x_dph = 0.0F;
    state->lag_gyro_x_dph = 0.0F;
    state->x_gyro_y_dph = 0.0F;
    state->lag_gyro_y_dph = 0.0F;
    state->x_gyro_z_dph = 0.0F;
    state->lag_gyro_z_dph = 0.0F;
    state->x_accel_x_g = 0.0F;
    state->lag_accel_x_g = 0.0F;
    state->x_accel_y_g = 0.0F;
    state->lag_accel_y_g = 0.0F;
    state->fall_accel_y_g = 0.0F;
    state->x_accel_z_g = 0.0F;
    state->lag_accel_z_g = 0.0F;
    state->fall_accel_z_g = 0.0F;
    state->last.bias_gyro_x_dph = 0.0F;
    state->last.bias_gyro_y_dph = 0.0F;
    state->last.bias_gyro_z_dph = 0.0F;
    state->last.bias_accel_x_g = 0.0F;
    state->last.bias_accel_y_g = 0.0F;
    state->last.bias_accel_z_g = 0.0F;
    state->before.bias_gyro_x_dph = 0.0F;
    state->before.bias_gyro_y_dph = 0.0F;
    state->before.bias_gyro_z_dph = 0.0F;
    state->before.bias_accel_x_g = 0.0F;
    state->before.bias_accel_y_g = 0.0F;
    state->before.bias_accel_z_g = 0.0F;
    state->in.temp_case_degc = 0.0F;
    state->updates = 0U;
    state->waited_ms = 0U;
}

/* one interval, for inputs that are numbers */
static uint32_t cal_step(const cal_numbers *n, cal_state *state, const cal_in *in)
{
    uint32_t status = CAL_OK;
    const float temp_case_degc = cal_limited(in->temp_case_degc, n->t_temp_case_degc_range, 0U, &status);
    const float x_gyro_x_dph = cal_mapped(temp_case_degc, &n->t_x_map_gyro_x_dph, CAL_TEMP_CLAMPED, &status);
    const float x_before_gyro_x_dph = (state->updates == 0U) ? x_gyro_x_dph : state->x_gyro_x_dph;
    const float move_gyro_x_dph = x_gyro_x_dph - x_before_gyro_x_dph;
    const float lag_before_gyro_x_dph = state->lag_gyro_x_dph;
    const float lag_gyro_x_dph = -(n->t_lag_decay_gyro_x_dph * lag_before_gyro_x_dph)
        + (n->t_lag_move_gyro_x_dph * move_gyro_x_dph)
        + lag_before_gyro_x_dph;
    const float coil_gyro_x_dph = x_gyro_x_dph - lag_gyro_x_dph;
    const float u_gyro_x_dph = cal_limited(coil_gyro_x_dph, n->t_u_limits_gyro_x_dph, CAL_TEMP_CLAMPED, &status);
    const float coil_rate_gyro_x_dph = n->t_rate_of_lag_gyro_x_dph * lag_gyro_x_dph;
    const float rate_gyro_x_dph = cal_limited(coil_rate_gyro_x_dph, n->t_rate_limits_gyro_x_dph, CAL_RATE_CLAMPED, &status);
    const float drift_gyro_x_dph = (cal_polynomial(n->t_by_rate_gyro_x_dph, 2U, u_gyro_x_dph) * rate_gyro_x_dph)
        + cal_polynomial(n->t_static_gyro_x_dph, 4U, u_gyro_x_dph);
    const float x_gyro_y_dph = cal_mapped(temp_case_degc, &n->t_x_map_gyro_y_dph, CAL_TEMP_CLAMPED, &status);
    const float x_before_gyro_y_dph = (state->updates == 0U) ? x_gyro_y_dph : state->x_gyro_y_dph;
    const float move_gyro_y_dph = x_gyro_y_dph - x_before_gyro_y_dph;
    const float lag_before_gyro_y_dph = state->lag_gyro_y_dph;
    const float lag_gyro_y_dph = -(n->t_lag_decay_gyro_y_dph * lag_before_gyro_y_dph)
        + (n->t_lag_move_gyro_y_dph * move_gyro_y_dph)
        + lag_before_gyro_y_dph;
    const float coil_gyro_y_dph = x_gyro_y_dph - lag_gyro_y_dph;
    const float u_gyro_y_dph = cal_limited(coil_gyro_y_dph, n->t_u_limits_gyro_y_dph, CAL_TEMP_CLAMPED, &status);
    const float coil_rate_gyro_y_dph = n->t_rate_of_lag_gyro_y_dph * lag_gyro_y_dph;
    const float rate_gyro_y_dph = cal_limited(coil_rate_gyro_y_dph, n->t_rate_limits_gyro_y_dph, CAL_RATE_CLAMPED, &status);
    const float drift_gyro_y_dph = (cal_polynomial(n->t_by_rate_gyro_y_dph, 2U, u_gyro_y_dph) * rate_gyro_y_dph)
        + cal_polynomial(n->t_static_gyro_y_dph, 4U, u_gyro_y_dph);
    const float x_gyro_z_dph = cal_mapped(temp_case_degc, &n->t_x_map_gyro_z_dph, CAL_TEMP_CLAMPED, &status);
    const float x_before_gyro_z_dph = (state->updates == 0U) ? x_gyro_z_dph : state->x_gyro_z_dph;
    const float move_gyro_z_dph = x_gyro_z_dph - x_before_gyro_z_dph;
    const float lag_before_gyro_z_dph = state->lag_gyro_z_dph;
    const float lag_gyro_z_dph = -(n->t_lag_decay_gyro_z_dph * lag_before_gyro_z_dph)
        + (n->t_lag_move_gyro_z_dph * move_gyro_z_dph)
        + lag_before_gyro_z_dph;
    const float coil_gyro_z_dph = x_gyro_z_dph - lag_gyro_z_dph;
    const float u_gyro_z_dph = cal_limited(coil_gyro_z_dph, n->t_u_limits_gyro_z_dph, CAL_TEMP_CLAMPED, &status);
    const float coil_rate_gyro_z_dph = n->t_rate_of_lag_gyro_z_dph * lag_gyro_z_dph;
    const float rate_gyro_z_dph = cal_limited(coil_rate_gyro_z_dph, n->t_rate_limits_gyro_z_dph, CAL_RATE_CLAMPED, &status);
    const float drift_gyro_z_dph = (cal_polynomial(n->t_by_rate_gyro_z_dph, 2U, u_gyro_z_dph) * rate_gyro_z_dph)
        + cal_polynomial(n->t_static_gyro_z_dph, 4U, u_gyro_z_dph);
    const float x_accel_x_g = cal_mapped(temp_case_degc, &n->t_x_map_accel_x_g, CAL_TEMP_CLAMPED, &status);
    const float x_before_accel_x_g = (state->updates == 0U) ? x_accel_x_g : state->x_accel_x_g;
    const float move_accel_x_g = x_accel_x_g - x_before_accel_x_g;
    const float lag_before_accel_x_g = state->lag_accel_x_g;
    const float lag_accel_x_g = -(n->t_lag_decay_accel_x_g * lag_before_accel_x_g)
        + (n->t_lag_move_accel_x_g * move_accel_x_g)
        + lag_before_accel_x_g;
    const float coil_accel_x_g = x_accel_x_g - lag_accel_x_g;
    const float u_accel_x_g = cal_limited(coil_accel_x_g, n->t_u_limits_accel_x_g, CAL_TEMP_CLAMPED, &status);
    const float coil_rate_accel_x_g = n->t_rate_of_lag_accel_x_g * lag_accel_x_g;
    const float rate_accel_x_g = cal_limited(coil_rate_accel_x_g, n->t_rate_limits_accel_x_g, CAL_RATE_CLAMPED, &status);
    const float drift_accel_x_g = (cal_polynomial(n->t_by_rate_accel_x_g, 2U, u_accel_x_g) * rate_accel_x_g)
        + cal_polynomial(n->t_static_accel_x_g, 4U, u_accel_x_g);
    const float x_accel_y_g = cal_mapped(temp_case_degc, &n->t_x_map_accel_y_g, CAL_TEMP_CLAMPED, &status);
    const float x_before_accel_y_g = (state->updates == 0U) ? x_accel_y_g : state->x_accel_y_g;
    const float move_accel_y_g = x_accel_y_g - x_before_accel_y_g;
    const float lag_before_accel_y_g = state->lag_accel_y_g;
    const float lag_accel_y_g = -(n->t_lag_decay_accel_y_g * lag_before_accel_y_g)
        + (n->t_lag_move_accel_y_g * move_accel_y_g)
        + lag_before_accel_y_g;
    const float fall_before_accel_y_g = state->fall_accel_y_g;
    const float fall_accel_y_g = (n->t_fall_move_accel_y_g * move_accel_y_g)
        + (n->t_fall_lag_accel_y_g * lag_before_accel_y_g)
        - (n->t_fall_decay_accel_y_g * fall_before_accel_y_g)
        + fall_before_accel_y_g;
    const float coil_gradient_accel_y_g = n->t_gradient_of_fall_accel_y_g * fall_accel_y_g;
    const float gradient_accel_y_g = cal_limited(coil_gradient_accel_y_g, n->t_gradient_limits_accel_y_g, CAL_GRADIENT_CLAMPED, &status);
    const float coil_accel_y_g = x_accel_y_g - lag_accel_y_g;
    const float u_accel_y_g = cal_limited(coil_accel_y_g, n->t_u_limits_accel_y_g, CAL_TEMP_CLAMPED, &status);
    const float coil_rate_accel_y_g = n->t_rate_of_lag_accel_y_g * lag_accel_y_g;
    const float rate_accel_y_g = cal_limited(coil_rate_accel_y_g, n->t_rate_limits_accel_y_g, CAL_RATE_CLAMPED, &status);
    const float drift_accel_y_g = (n->t_by_gradient_accel_y_g * gradient_accel_y_g)
        + (cal_polynomial(n->t_by_rate_accel_y_g, 2U, u_accel_y_g) * rate_accel_y_g)
        + cal_polynomial(n->t_static_accel_y_g, 4U, u_accel_y_g);
    const float x_accel_z_g = cal_mapped(temp_case_degc, &n->t_x_map_accel_z_g, CAL_TEMP_CLAMPED, &status);
    const float x_before_accel_z_g = (state->updates == 0U) ? x_accel_z_g : state->x_accel_z_g;
    const float move_accel_z_g = x_accel_z_g - x_before_accel_z_g;
    const float lag_before_accel_z_g = state->lag_accel_z_g;
    const float lag_accel_z_g = -(n->t_lag_decay_accel_z_g * lag_before_accel_z_g)
        + (n->t_lag_move_accel_z_g * move_accel_z_g)
        + lag_before_accel_z_g;
    const float fall_before_accel_z_g = state->fall_accel_z_g;
    const float fall_accel_z_g = (n->t_fall_move_accel_z_g * move_accel_z_g)
        + (n->t_fall_lag_accel_z_g * lag_before_accel_z_g)
        - (n->t_fall_decay_accel_z_g * fall_before_accel_z_g)
        + fall_before_accel_z_g;
    const float coil_gradient_accel_z_g = n->t_gradient_of_fall_accel_z_g * fall_accel_z_g;
    const float gradient_accel_z_g = cal_limited(coil_gradient_accel_z_g, n->t_gradient_limits_accel_z_g, CAL_GRADIENT_CLAMPED, &status);
    const float coil_accel_z_g = x_accel_z_g - lag_accel_z_g;
    const float u_accel_z_g = cal_limited(coil_accel_z_g, n->t_u_limits_accel_z_g, CAL_TEMP_CLAMPED, &status);
    const float coil_rate_accel_z_g = n->t_rate_of_lag_accel_z_g * lag_accel_z_g;
    const float rate_accel_z_g = cal_limited(coil_rate_accel_z_g, n->t_rate_limits_accel_z_g, CAL_RATE_CLAMPED, &status);
    const float drift_accel_z_g = (n->t_by_gradient_accel_z_g * gradient_accel_z_g)
        + (cal_polynomial(n->t_by_rate_accel_z_g, 2U, u_accel_z_g) * rate_accel_z_g)
        + cal_polynomial(n->t_static_accel_z_g, 4U, u_accel_z_g);

    state->x_gyro_x_dph = x_gyro_x_dph;
    state->lag_gyro_x_dph = lag_gyro_x_dph;
    state->x_gyro_y_dph = x_gyro_y_dph;
    state->lag_gyro_y_dph = lag_gyro_y_dph;
    state->x_gyro_z_dph = x_gyro_z_dph;
    state->lag_gyro_z_dph = lag_gyro_z_dph;
    state->x_accel_x_g = x_accel_x_g;
    state->lag_accel_x_g = lag_accel_x_g;
    state->x_accel_y_g = x_accel_y_g;
    state->lag_accel_y_g = lag_accel_y_g;
    state->fall_accel_y_g = fall_accel_y_g;
    state->x_accel_z_g = x_accel_z_g;
    state->lag_accel_z_g = lag_accel_z_g;
    state->fall_accel_z_g = fall_accel_z_g;
    if (state->updates < UINT32_MAX) {
        state->updates++;
    }
    state->last.bias_gyro_x_dph = drift_gyro_x_dph;
    state->last.bias_gyro_y_dph = drift_gyro_y_dph;
    state->last.bias_gyro_z_dph = drift_gyro_z_dph;
    state->last.bias_accel_x_g = drift_accel_x_g;
    state->last.bias_accel_y_g = drift_accel_y_g;
    state->last.bias_accel_z_g = drift_accel_z_g;
    return status;
}

/* whether the input moved further than so many intervals allow */
static uint32_t cal_jumped(const cal_numbers *n, const cal_state *state, const cal_in *in, uint32_t count)
{
    const float away = in->temp_case_degc - state->in.temp_case_degc;
    const float most = n->t_pace[1] * (float)count;

    return ((away < -most) || (away > most)) ? 1U : 0U;
}

/* inputs of the k-th of count intervals, in a straight line */
static void cal_bridge(const cal_in *from, const cal_in *to, uint32_t k, uint32_t count, cal_in *in)
{
    if (k < count) {
        const float share = (float)k / (float)count;

        in->temp_case_degc = from->temp_case_degc + ((to->temp_case_degc - from->temp_case_degc) * share);
    } else {
        in->temp_case_degc = to->temp_case_degc;
    }
}

static uint32_t cal_updated(const cal_numbers *n, cal_state *state, uint32_t elapsed_ms, const cal_in *in, cal_out *out)
{
    uint32_t first = 0U;
    uint32_t status = CAL_OK;
    uint32_t count;

    if (state->updates == 0U) {
        first = 1U;
        state->waited_ms = CAL_INTERVAL_MS + (CAL_INTERVAL_MS / 2U);
    } else if (elapsed_ms > (UINT32_MAX - state->waited_ms)) {
        state->waited_ms = UINT32_MAX;
    } else {
        state->waited_ms += elapsed_ms;
    }
    count = state->waited_ms / CAL_INTERVAL_MS;
    if (count != 0U) {
        state->before.bias_gyro_x_dph = state->last.bias_gyro_x_dph;
        state->before.bias_gyro_y_dph = state->last.bias_gyro_y_dph;
        state->before.bias_gyro_z_dph = state->last.bias_gyro_z_dph;
        state->before.bias_accel_x_g = state->last.bias_accel_x_g;
        state->before.bias_accel_y_g = state->last.bias_accel_y_g;
        state->before.bias_accel_z_g = state->last.bias_accel_z_g;
    }
    if (cal_finite(in->temp_case_degc) == 0U) {
        status = CAL_INVALID;
    } else if (count == 0U) {
        status = CAL_INTERVAL;
    } else if ((first == 0U) && (count <= CAL_LONGEST) && (cal_jumped(n, state, in, count) != 0U)) {
        status = CAL_JUMPED;
    } else {
        const uint32_t steps = (count > CAL_LONGEST) ? 1U : count;
        uint32_t k;

        if (count > CAL_LONGEST) {
            state->updates = 0U;
            state->lag_gyro_x_dph = 0.0F;
            state->lag_gyro_y_dph = 0.0F;
            state->lag_gyro_z_dph = 0.0F;
            state->lag_accel_x_g = 0.0F;
            state->lag_accel_y_g = 0.0F;
            state->fall_accel_y_g = 0.0F;
            state->lag_accel_z_g = 0.0F;
            state->fall_accel_z_g = 0.0F;
        }
        for (k = 1U; k <= steps; k++) {
            cal_in at;

            cal_bridge(&state->in, in, k, steps, &at);
            status = cal_step(n, state, &at);
        }
        if ((first == 0U) && ((count != 1U) || (elapsed_ms < CAL_EARLIEST_MS) || (elapsed_ms > CAL_LATEST_MS))) {
            status |= CAL_INTERVAL;
        }
        if (state->updates <= (uint32_t)n->t_pace[0]) {
            status |= CAL_STARTING;
        }
        if (first != 0U) {
            state->before.bias_gyro_x_dph = state->last.bias_gyro_x_dph;
            state->before.bias_gyro_y_dph = state->last.bias_gyro_y_dph;
            state->before.bias_gyro_z_dph = state->last.bias_gyro_z_dph;
            state->before.bias_accel_x_g = state->last.bias_accel_x_g;
            state->before.bias_accel_y_g = state->last.bias_accel_y_g;
            state->before.bias_accel_z_g = state->last.bias_accel_z_g;
        }
        state->in.temp_case_degc = in->temp_case_degc;
        state->waited_ms %= CAL_INTERVAL_MS;
    }
    out->bias_gyro_x_dph = state->last.bias_gyro_x_dph;
    out->bias_gyro_y_dph = state->last.bias_gyro_y_dph;
    out->bias_gyro_z_dph = state->last.bias_gyro_z_dph;
    out->bias_accel_x_g = state->last.bias_accel_x_g;
    out->bias_accel_y_g = state->last.bias_accel_y_g;
    out->bias_accel_z_g = state->last.bias_accel_z_g;
    return status;
}

void cal_between(const cal_state *state, uint32_t elapsed_ms, cal_out *out)
{
    const uint32_t passed = (elapsed_ms < CAL_INTERVAL_MS) ? elapsed_ms : CAL_INTERVAL_MS;
    const float share = (float)passed / (float)CAL_INTERVAL_MS;
    out->bias_gyro_x_dph = state->before.bias_gyro_x_dph + ((state->last.bias_gyro_x_dph - state->before.bias_gyro_x_dph) * share);
    out->bias_gyro_y_dph = state->before.bias_gyro_y_dph + ((state->last.bias_gyro_y_dph - state->before.bias_gyro_y_dph) * share);
    out->bias_gyro_z_dph = state->before.bias_gyro_z_dph + ((state->last.bias_gyro_z_dph - state->before.bias_gyro_z_dph) * share);
    out->bias_accel_x_g = state->before.bias_accel_x_g + ((state->last.bias_accel_x_g - state->before.bias_accel_x_g) * share);
    out->bias_accel_y_g = state->before.bias_accel_y_g + ((state->last.bias_accel_y_g - state->before.bias_accel_y_g) * share);
    out->bias_accel_z_g = state->before.bias_accel_z_g + ((state->last.bias_accel_z_g - state->before.bias_accel_z_g) * share);
}

/* whether a computed value is within the tolerance of the expected one; never for a NaN */
static uint32_t cal_near(float found, float expected, float tolerance)
{
    const float difference = found - expected;

    return ((difference >= -tolerance) && (difference <= tolerance)) ? 1U : 0U;
}

static const cal_numbers *cal_in_use(const cal_unit *unit)
{
    const uint32_t active = unit->active;

    return ((active == 1U) || (active == 2U)) ? &unit->slots[active - 1U] : NULL;
}

void cal_init(cal_unit *unit)
{
    unit->active = 0U;
}

const char *cal_serial(const cal_unit *unit)
{
    const cal_numbers *n = cal_in_use(unit);

    return (n != NULL) ? n->serial : "";
}

uint32_t cal_revision(const cal_unit *unit)
{
    const cal_numbers *n = cal_in_use(unit);

    return (n != NULL) ? n->revision : 0U;
}

const char *cal_date(const cal_unit *unit)
{
    const cal_numbers *n = cal_in_use(unit);

    return (n != NULL) ? n->date : "";
}

const uint8_t *cal_digest(const cal_unit *unit)
{
    const cal_numbers *n = cal_in_use(unit);

    return (n != NULL) ? n->digest : NULL;
}

uint32_t cal_update(const cal_unit *unit, cal_state *state, uint32_t elapsed_ms, const cal_in *in, cal_out *out)
{
    const cal_numbers *n = cal_in_use(unit);
    uint32_t status = 0xc000U;

    if (n != NULL) {
        status = cal_updated(n, state, elapsed_ms, in, out);
    } else {
        out->bias_gyro_x_dph = cal_none();
        out->bias_gyro_y_dph = cal_none();
        out->bias_gyro_z_dph = cal_none();
        out->bias_accel_x_g = cal_none();
        out->bias_accel_y_g = cal_none();
        out->bias_accel_z_g = cal_none();
    }
    return status;
}

#define CAL_NUMBERS 120U
#define CAL_TESTS_AT 592U /* tolerances, vectors */
#define CAL_ROW 40U /* bytes of a vector */
#define CAL_MOST_ROWS 1024U
#define CAL_MOST_UPDATES 8192U
#define CAL_MOST_COUNT 16777216U

static uint32_t cal_fill(cal_numbers *n, const uint8_t at[])
{
    uint32_t finite = 1U;
    uint32_t k;

    n->t_temp_case_degc_range[0] = cal_number(&at[0]);
    n->t_temp_case_degc_range[1] = cal_number(&at[4]);
    n->t_pace[0] = cal_number(&at[8]);
    n->t_pace[1] = cal_number(&at[12]);
    n->t_x_map_gyro_x_dph.middle = cal_number(&at[16]);
    n->t_x_map_gyro_x_dph.reciprocal = cal_number(&at[20]);
    n->t_x_map_gyro_x_dph.range[0] = cal_number(&at[24]);
    n->t_x_map_gyro_x_dph.range[1] = cal_number(&at[28]);
    n->t_lag_decay_gyro_x_dph = cal_number(&at[32]);
    n->t_lag_move_gyro_x_dph = cal_number(&at[36]);
    n->t_u_limits_gyro_x_dph[0] = cal_number(&at[40]);
    n->t_u_limits_gyro_x_dph[1] = cal_number(&at[44]);
    n->t_rate_of_lag_gyro_x_dph = cal_number(&at[48]);
    n->t_rate_limits_gyro_x_dph[0] = cal_number(&at[52]);
    n->t_rate_limits_gyro_x_dph[1] = cal_number(&at[56]);
    n->t_by_rate_gyro_x_dph[0] = cal_number(&at[60]);
    n->t_by_rate_gyro_x_dph[1] = cal_number(&at[64]);
    n->t_static_gyro_x_dph[0] = cal_number(&at[68]);
    n->t_static_gyro_x_dph[1] = cal_number(&at[72]);
    n->t_static_gyro_x_dph[2] = cal_number(&at[76]);
    n->t_static_gyro_x_dph[3] = cal_number(&at[80]);
    n->t_x_map_gyro_y_dph.middle = cal_number(&at[84]);
    n->t_x_map_gyro_y_dph.reciprocal = cal_number(&at[88]);
    n->t_x_map_gyro_y_dph.range[0] = cal_number(&at[92]);
    n->t_x_map_gyro_y_dph.range[1] = cal_number(&at[96]);
    n->t_lag_decay_gyro_y_dph = cal_number(&at[100]);
    n->t_lag_move_gyro_y_dph = cal_number(&at[104]);
    n->t_u_limits_gyro_y_dph[0] = cal_number(&at[108]);
    n->t_u_limits_gyro_y_dph[1] = cal_number(&at[112]);
    n->t_rate_of_lag_gyro_y_dph = cal_number(&at[116]);
    n->t_rate_limits_gyro_y_dph[0] = cal_number(&at[120]);
    n->t_rate_limits_gyro_y_dph[1] = cal_number(&at[124]);
    n->t_by_rate_gyro_y_dph[0] = cal_number(&at[128]);
    n->t_by_rate_gyro_y_dph[1] = cal_number(&at[132]);
    n->t_static_gyro_y_dph[0] = cal_number(&at[136]);
    n->t_static_gyro_y_dph[1] = cal_number(&at[140]);
    n->t_static_gyro_y_dph[2] = cal_number(&at[144]);
    n->t_static_gyro_y_dph[3] = cal_number(&at[148]);
    n->t_x_map_gyro_z_dph.middle = cal_number(&at[152]);
    n->t_x_map_gyro_z_dph.reciprocal = cal_number(&at[156]);
    n->t_x_map_gyro_z_dph.range[0] = cal_number(&at[160]);
    n->t_x_map_gyro_z_dph.range[1] = cal_number(&at[164]);
    n->t_lag_decay_gyro_z_dph = cal_number(&at[168]);
    n->t_lag_move_gyro_z_dph = cal_number(&at[172]);
    n->t_u_limits_gyro_z_dph[0] = cal_number(&at[176]);
    n->t_u_limits_gyro_z_dph[1] = cal_number(&at[180]);
    n->t_rate_of_lag_gyro_z_dph = cal_number(&at[184]);
    n->t_rate_limits_gyro_z_dph[0] = cal_number(&at[188]);
    n->t_rate_limits_gyro_z_dph[1] = cal_number(&at[192]);
    n->t_by_rate_gyro_z_dph[0] = cal_number(&at[196]);
    n->t_by_rate_gyro_z_dph[1] = cal_number(&at[200]);
    n->t_static_gyro_z_dph[0] = cal_number(&at[204]);
    n->t_static_gyro_z_dph[1] = cal_number(&at[208]);
    n->t_static_gyro_z_dph[2] = cal_number(&at[212]);
    n->t_static_gyro_z_dph[3] = cal_number(&at[216]);
    n->t_x_map_accel_x_g.middle = cal_number(&at[220]);
    n->t_x_map_accel_x_g.reciprocal = cal_number(&at[224]);
    n->t_x_map_accel_x_g.range[0] = cal_number(&at[228]);
    n->t_x_map_accel_x_g.range[1] = cal_number(&at[232]);
    n->t_lag_decay_accel_x_g = cal_number(&at[236]);
    n->t_lag_move_accel_x_g = cal_number(&at[240]);
    n->t_u_limits_accel_x_g[0] = cal_number(&at[244]);
    n->t_u_limits_accel_x_g[1] = cal_number(&at[248]);
    n->t_rate_of_lag_accel_x_g = cal_number(&at[252]);
    n->t_rate_limits_accel_x_g[0] = cal_number(&at[256]);
    n->t_rate_limits_accel_x_g[1] = cal_number(&at[260]);
    n->t_by_rate_accel_x_g[0] = cal_number(&at[264]);
    n->t_by_rate_accel_x_g[1] = cal_number(&at[268]);
    n->t_static_accel_x_g[0] = cal_number(&at[272]);
    n->t_static_accel_x_g[1] = cal_number(&at[276]);
    n->t_static_accel_x_g[2] = cal_number(&at[280]);
    n->t_static_accel_x_g[3] = cal_number(&at[284]);
    n->t_x_map_accel_y_g.middle = cal_number(&at[288]);
    n->t_x_map_accel_y_g.reciprocal = cal_number(&at[292]);
    n->t_x_map_accel_y_g.range[0] = cal_number(&at[296]);
    n->t_x_map_accel_y_g.range[1] = cal_number(&at[300]);
    n->t_lag_decay_accel_y_g = cal_number(&at[304]);
    n->t_lag_move_accel_y_g = cal_number(&at[308]);
    n->t_fall_move_accel_y_g = cal_number(&at[312]);
    n->t_fall_lag_accel_y_g = cal_number(&at[316]);
    n->t_fall_decay_accel_y_g = cal_number(&at[320]);
    n->t_gradient_of_fall_accel_y_g = cal_number(&at[324]);
    n->t_gradient_limits_accel_y_g[0] = cal_number(&at[328]);
    n->t_gradient_limits_accel_y_g[1] = cal_number(&at[332]);
    n->t_u_limits_accel_y_g[0] = cal_number(&at[336]);
    n->t_u_limits_accel_y_g[1] = cal_number(&at[340]);
    n->t_rate_of_lag_accel_y_g = cal_number(&at[344]);
    n->t_rate_limits_accel_y_g[0] = cal_number(&at[348]);
    n->t_rate_limits_accel_y_g[1] = cal_number(&at[352]);
    n->t_by_gradient_accel_y_g = cal_number(&at[356]);
    n->t_by_rate_accel_y_g[0] = cal_number(&at[360]);
    n->t_by_rate_accel_y_g[1] = cal_number(&at[364]);
    n->t_static_accel_y_g[0] = cal_number(&at[368]);
    n->t_static_accel_y_g[1] = cal_number(&at[372]);
    n->t_static_accel_y_g[2] = cal_number(&at[376]);
    n->t_static_accel_y_g[3] = cal_number(&at[380]);
    n->t_x_map_accel_z_g.middle = cal_number(&at[384]);
    n->t_x_map_accel_z_g.reciprocal = cal_number(&at[388]);
    n->t_x_map_accel_z_g.range[0] = cal_number(&at[392]);
    n->t_x_map_accel_z_g.range[1] = cal_number(&at[396]);
    n->t_lag_decay_accel_z_g = cal_number(&at[400]);
    n->t_lag_move_accel_z_g = cal_number(&at[404]);
    n->t_fall_move_accel_z_g = cal_number(&at[408]);
    n->t_fall_lag_accel_z_g = cal_number(&at[412]);
    n->t_fall_decay_accel_z_g = cal_number(&at[416]);
    n->t_gradient_of_fall_accel_z_g = cal_number(&at[420]);
    n->t_gradient_limits_accel_z_g[0] = cal_number(&at[424]);
    n->t_gradient_limits_accel_z_g[1] = cal_number(&at[428]);
    n->t_u_limits_accel_z_g[0] = cal_number(&at[432]);
    n->t_u_limits_accel_z_g[1] = cal_number(&at[436]);
    n->t_rate_of_lag_accel_z_g = cal_number(&at[440]);
    n->t_rate_limits_accel_z_g[0] = cal_number(&at[444]);
    n->t_rate_limits_accel_z_g[1] = cal_number(&at[448]);
    n->t_by_gradient_accel_z_g = cal_number(&at[452]);
    n->t_by_rate_accel_z_g[0] = cal_number(&at[456]);
    n->t_by_rate_accel_z_g[1] = cal_number(&at[460]);
    n->t_static_accel_z_g[0] = cal_number(&at[464]);
    n->t_static_accel_z_g[1] = cal_number(&at[468]);
    n->t_static_accel_z_g[2] = cal_number(&at[472]);
    n->t_static_accel_z_g[3] = cal_number(&at[476]);
    for (k = 0U; k < CAL_NUMBERS; k++) {
        finite &= cal_finite(cal_number(&at[k * 4U]));
    }
    return finite;
}

static uint32_t cal_testable(const cal_numbers *n)
{
    uint32_t sane = 1U;
    uint32_t updates = 0U;
    uint32_t k;

    for (k = 0U; k < 6U; k++) {
        const float tolerance = cal_number(&n->tests[k * 4U]);

        sane &= ((tolerance >= 0.0F) && (cal_finite(tolerance) != 0U)) ? 1U : 0U;
    }
    for (k = 0U; k < n->rows; k++) {
        const uint8_t *row = &n->tests[24U + (k * CAL_ROW)];
        const uint32_t count = cal_count(cal_number(&row[28]), CAL_MOST_UPDATES);

        sane &= (cal_count(cal_number(&row[36]), 0x10000U) < 0x10000U) ? 1U : 0U;
        sane &= (cal_count(cal_number(&row[32]), CAL_MOST_COUNT) < CAL_MOST_COUNT) ? 1U : 0U;
        sane &= (count > 0U) ? 1U : 0U;
        updates += count;
    }
    return ((sane != 0U) && (updates < CAL_MOST_UPDATES)) ? 1U : 0U;
}

static uint32_t cal_sane(const cal_numbers *n)
{
    uint32_t sane = 0U;

    if ((n->t_temp_case_degc_range[0] < n->t_temp_case_degc_range[1])
        && (n->t_u_limits_gyro_x_dph[0] < n->t_u_limits_gyro_x_dph[1])
        && (n->t_rate_limits_gyro_x_dph[0] < n->t_rate_limits_gyro_x_dph[1])
        && (n->t_u_limits_gyro_y_dph[0] < n->t_u_limits_gyro_y_dph[1])
        && (n->t_rate_limits_gyro_y_dph[0] < n->t_rate_limits_gyro_y_dph[1])
        && (n->t_u_limits_gyro_z_dph[0] < n->t_u_limits_gyro_z_dph[1])
        && (n->t_rate_limits_gyro_z_dph[0] < n->t_rate_limits_gyro_z_dph[1])
        && (n->t_u_limits_accel_x_g[0] < n->t_u_limits_accel_x_g[1])
        && (n->t_rate_limits_accel_x_g[0] < n->t_rate_limits_accel_x_g[1])
        && (n->t_gradient_limits_accel_y_g[0] < n->t_gradient_limits_accel_y_g[1])
        && (n->t_u_limits_accel_y_g[0] < n->t_u_limits_accel_y_g[1])
        && (n->t_rate_limits_accel_y_g[0] < n->t_rate_limits_accel_y_g[1])
        && (n->t_gradient_limits_accel_z_g[0] < n->t_gradient_limits_accel_z_g[1])
        && (n->t_u_limits_accel_z_g[0] < n->t_u_limits_accel_z_g[1])
        && (n->t_rate_limits_accel_z_g[0] < n->t_rate_limits_accel_z_g[1])
        && (n->t_x_map_gyro_x_dph.range[0] < n->t_x_map_gyro_x_dph.range[1])
        && (n->t_x_map_gyro_y_dph.range[0] < n->t_x_map_gyro_y_dph.range[1])
        && (n->t_x_map_gyro_z_dph.range[0] < n->t_x_map_gyro_z_dph.range[1])
        && (n->t_x_map_accel_x_g.range[0] < n->t_x_map_accel_x_g.range[1])
        && (n->t_x_map_accel_y_g.range[0] < n->t_x_map_accel_y_g.range[1])
        && (n->t_x_map_accel_z_g.range[0] < n->t_x_map_accel_z_g.range[1])
        && (cal_count(n->t_pace[0], CAL_MOST_COUNT) < CAL_MOST_COUNT)
        && (n->t_pace[1] > 0.0F)) {
        sane = cal_testable(n);
    }
    return sane;
}

/* whether the chain gives what the blob says it gives */
static uint32_t cal_hold(const cal_numbers *n)
{
    uint32_t holds = 1U;
    uint32_t k;
    cal_state state;

    cal_reset(&state);
    for (k = 0U; k < n->rows; k++) {
        const uint8_t *row = &n->tests[24U + (k * CAL_ROW)];
        const float calls = cal_number(&row[28]);
        const float later = cal_number(&row[32]);
        const uint32_t updates = cal_count(calls, CAL_MOST_UPDATES);
        const uint32_t elapsed = cal_count(later, CAL_MOST_COUNT);
        uint32_t i;
        uint32_t status = CAL_OK;
        cal_in in;
        cal_out out;

        in.temp_case_degc = cal_number(&row[0]);
        out.bias_gyro_x_dph = 0.0F;
        out.bias_gyro_y_dph = 0.0F;
        out.bias_gyro_z_dph = 0.0F;
        out.bias_accel_x_g = 0.0F;
        out.bias_accel_y_g = 0.0F;
        out.bias_accel_z_g = 0.0F;
        for (i = 0U; i < updates; i++) {
            if (elapsed == 0U) {
                status = cal_step(n, &state, &in);
                out.bias_gyro_x_dph = state.last.bias_gyro_x_dph;
                out.bias_gyro_y_dph = state.last.bias_gyro_y_dph;
                out.bias_gyro_z_dph = state.last.bias_gyro_z_dph;
                out.bias_accel_x_g = state.last.bias_accel_x_g;
                out.bias_accel_y_g = state.last.bias_accel_y_g;
                out.bias_accel_z_g = state.last.bias_accel_z_g;
            } else {
                status = cal_updated(n, &state, elapsed, &in, &out);
            }
        }
        if ((status != cal_count(cal_number(&row[36]), 0x10000U))
            || (cal_near(out.bias_gyro_x_dph, cal_number(&row[4]), cal_number(&n->tests[0])) == 0U)
            || (cal_near(out.bias_gyro_y_dph, cal_number(&row[8]), cal_number(&n->tests[4])) == 0U)
            || (cal_near(out.bias_gyro_z_dph, cal_number(&row[12]), cal_number(&n->tests[8])) == 0U)
            || (cal_near(out.bias_accel_x_g, cal_number(&row[16]), cal_number(&n->tests[12])) == 0U)
            || (cal_near(out.bias_accel_y_g, cal_number(&row[20]), cal_number(&n->tests[16])) == 0U)
            || (cal_near(out.bias_accel_z_g, cal_number(&row[24]), cal_number(&n->tests[20])) == 0U)) {
            holds = 0U;
        }
    }
    return holds;
}

/* why the frame of a blob is not taken; CAL_LOADED where it is right */
static uint32_t cal_frame(const uint8_t blob[], uint32_t size)
{
    static const uint8_t digits[9] = {0x31U, 0x32U, 0x33U, 0x34U, 0x35U, 0x36U, 0x37U, 0x38U, 0x39U};
    const uint32_t length = (size >= 112U) ? cal_u32(&blob[8]) : 0U;
    uint32_t reason = CAL_LOADED;

    if (cal_crc(digits, 9U) != 0xCBF43926U) {
        reason = CAL_LOAD_CRC_ENGINE;
    } else if ((length < 116U) || (length > size)) {
        reason = CAL_LOAD_LENGTH;
    } else if (cal_u32(blob) != 0x424C4143U) {
        reason = CAL_LOAD_MAGIC;
    } else if (((uint32_t)blob[4] | ((uint32_t)blob[5] << 8U)) != 1U) {
        reason = CAL_LOAD_SCHEMA;
    } else if (cal_crc(blob, length - 4U) != cal_u32(&blob[length - 4U])) {
        reason = CAL_LOAD_CRC;
    } else {
        /* whole */
    }
    return reason;
}

/* whether a blob with a right frame is laid out for this loader, and holds all that it counts */
static uint32_t cal_laid_out(const uint8_t blob[])
{
    static const uint8_t layout[8] = {0xdaU, 0xf3U, 0x9cU, 0x28U, 0xb4U, 0xa9U, 0xf0U, 0xe3U};
    const uint32_t rows = cal_u32(&blob[108]);
    uint32_t same = 1U;
    uint32_t k;

    for (k = 0U; k < 8U; k++) {
        same &= (blob[16U + k] == layout[k]) ? 1U : 0U;
    }
    if ((((uint32_t)blob[12] | ((uint32_t)blob[13] << 8U)) != 32U) || (cal_u32(&blob[104]) != CAL_NUMBERS)
        || (rows == 0U) || (rows > CAL_MOST_ROWS)) {
        same = 0U;
    } else if (cal_u32(&blob[8]) < (CAL_TESTS_AT + 24U + (rows * CAL_ROW) + 4U)) {
        same = 0U;
    } else {
        /* all there */
    }
    return same;
}

/* whether a blob is for the device that is expected */
static uint32_t cal_is_for(const uint8_t blob[], const char *serial)
{
    uint32_t same = 1U;
    uint32_t ended = 0U;
    uint32_t k;

    for (k = 0U; k < 32U; k++) {
        const uint32_t wanted = (ended != 0U) ? 0U : (uint32_t)(uint8_t)serial[k];

        ended |= (wanted == 0U) ? 1U : 0U;
        same &= (wanted == (uint32_t)blob[28U + k]) ? 1U : 0U;
    }
    return (ended != 0U) ? same : (same & ((serial[32] == '\0') ? 1U : 0U));
}

/* whom the numbers are of */
static void cal_name(const uint8_t blob[], cal_numbers *n)
{
    uint32_t k;

    for (k = 0U; k < 32U; k++) {
        n->serial[k] = (char)blob[28U + k];
    }
    n->serial[32] = '\0';
    for (k = 0U; k < 32U; k++) {
        n->digest[k] = blob[60U + k];
    }
    for (k = 0U; k < 12U; k++) {
        n->date[k] = (char)blob[92U + k];
    }
    n->date[12] = '\0';
    n->revision = cal_u32(&blob[24]);
    n->tests = &blob[CAL_TESTS_AT];
    n->rows = cal_u32(&blob[108]);
}

uint32_t cal_load(cal_unit *unit, const uint8_t blob[], uint32_t size, const char *serial,
    uint32_t least_revision)
{
    uint32_t next = 1U;
    cal_numbers *n = &unit->slots[0];
    uint32_t reason = cal_frame(blob, size);

    if (unit->active == 1U) {
        next = 2U;
        n = &unit->slots[1];
    }
    if (reason == CAL_LOADED) {
        if (cal_laid_out(blob) == 0U) {
            reason = CAL_LOAD_LAYOUT;
#ifndef CAL_ALLOW_REJECTED
        } else if ((blob[14] & 1U) == 0U) {
            reason = CAL_LOAD_REJECTED;
#endif
        } else if ((serial != NULL) && (cal_is_for(blob, serial) == 0U)) {
            reason = CAL_LOAD_SERIAL;
        } else if (cal_u32(&blob[24]) < least_revision) {
            reason = CAL_LOAD_REVISION;
        } else {
            cal_name(blob, n);
            if ((cal_fill(n, &blob[112]) == 0U) || (cal_sane(n) == 0U)) {
                reason = CAL_LOAD_VALUES;
            } else if (cal_hold(n) == 0U) {
                reason = CAL_LOAD_VECTORS;
            } else {
                CAL_BARRIER();
                unit->active = next;
            }
        }
    }
    return reason;
}

#ifndef CAL_NO_SELFTEST
int32_t cal_selftest(const cal_unit *unit)
{
    const cal_numbers *n = cal_in_use(unit);
    int32_t failed = 1;

    if ((n != NULL) && (cal_hold(n) != 0U)) {
        failed = 0;
    }
    return failed;
}
#endif

/*
 * The steps above:
 * {"program":{"forms":["bias-lagged/1"],"formula":"corrected = indication - bias, each channel in its unit; the bias is 0 at rest at 25 degC, or at the end of the fitted range nearest to it","interval_s":10.0,"number":"f32","pace":{"flags":["STARTING","INTERVAL","JUMPED"],"followed":"temp_case_degc","lags":["lag_gyro_x_dph","lag_gyro_y_dph","lag_gyro_z_dph","lag_accel_x_g","lag_accel_y_g","fall_accel_y_g","lag_accel_z_g","fall_accel_z_g"],"longest":6,"table":"pace"},"scales":{}}}
 * {"input":{"flag":"","meaning":"temperature of the sensor case, mean of the interval","name":"temp_case_degc","table":"temp_case_degc_range","unit":"degC"}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x_gyro_x_dph","source":"temp_case_degc","table":"x_map_gyro_x_dph"}}
 * {"memory":{"name":"x_before_gyro_x_dph","source":"x_gyro_x_dph","start":"same"}}
 * {"sum":{"name":"move_gyro_x_dph","terms":[{"factors":["x_gyro_x_dph"],"over":"","sign":1,"table":""},{"factors":["x_before_gyro_x_dph"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before_gyro_x_dph","source":"lag_gyro_x_dph","start":"zero"}}
 * {"sum":{"name":"lag_gyro_x_dph","terms":[{"factors":["lag_before_gyro_x_dph"],"over":"","sign":-1,"table":"lag_decay_gyro_x_dph"},{"factors":["move_gyro_x_dph"],"over":"","sign":1,"table":"lag_move_gyro_x_dph"},{"factors":["lag_before_gyro_x_dph"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_gyro_x_dph","terms":[{"factors":["x_gyro_x_dph"],"over":"","sign":1,"table":""},{"factors":["lag_gyro_x_dph"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u_gyro_x_dph","source":"coil_gyro_x_dph","table":"u_limits_gyro_x_dph"}}
 * {"sum":{"name":"coil_rate_gyro_x_dph","terms":[{"factors":["lag_gyro_x_dph"],"over":"","sign":1,"table":"rate_of_lag_gyro_x_dph"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate_gyro_x_dph","source":"coil_rate_gyro_x_dph","table":"rate_limits_gyro_x_dph"}}
 * {"sum":{"name":"drift_gyro_x_dph","terms":[{"factors":["rate_gyro_x_dph"],"over":"u_gyro_x_dph","sign":1,"table":"by_rate_gyro_x_dph"},{"factors":[],"over":"u_gyro_x_dph","sign":1,"table":"static_gyro_x_dph"}]}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x_gyro_y_dph","source":"temp_case_degc","table":"x_map_gyro_y_dph"}}
 * {"memory":{"name":"x_before_gyro_y_dph","source":"x_gyro_y_dph","start":"same"}}
 * {"sum":{"name":"move_gyro_y_dph","terms":[{"factors":["x_gyro_y_dph"],"over":"","sign":1,"table":""},{"factors":["x_before_gyro_y_dph"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before_gyro_y_dph","source":"lag_gyro_y_dph","start":"zero"}}
 * {"sum":{"name":"lag_gyro_y_dph","terms":[{"factors":["lag_before_gyro_y_dph"],"over":"","sign":-1,"table":"lag_decay_gyro_y_dph"},{"factors":["move_gyro_y_dph"],"over":"","sign":1,"table":"lag_move_gyro_y_dph"},{"factors":["lag_before_gyro_y_dph"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_gyro_y_dph","terms":[{"factors":["x_gyro_y_dph"],"over":"","sign":1,"table":""},{"factors":["lag_gyro_y_dph"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u_gyro_y_dph","source":"coil_gyro_y_dph","table":"u_limits_gyro_y_dph"}}
 * {"sum":{"name":"coil_rate_gyro_y_dph","terms":[{"factors":["lag_gyro_y_dph"],"over":"","sign":1,"table":"rate_of_lag_gyro_y_dph"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate_gyro_y_dph","source":"coil_rate_gyro_y_dph","table":"rate_limits_gyro_y_dph"}}
 * {"sum":{"name":"drift_gyro_y_dph","terms":[{"factors":["rate_gyro_y_dph"],"over":"u_gyro_y_dph","sign":1,"table":"by_rate_gyro_y_dph"},{"factors":[],"over":"u_gyro_y_dph","sign":1,"table":"static_gyro_y_dph"}]}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x_gyro_z_dph","source":"temp_case_degc","table":"x_map_gyro_z_dph"}}
 * {"memory":{"name":"x_before_gyro_z_dph","source":"x_gyro_z_dph","start":"same"}}
 * {"sum":{"name":"move_gyro_z_dph","terms":[{"factors":["x_gyro_z_dph"],"over":"","sign":1,"table":""},{"factors":["x_before_gyro_z_dph"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before_gyro_z_dph","source":"lag_gyro_z_dph","start":"zero"}}
 * {"sum":{"name":"lag_gyro_z_dph","terms":[{"factors":["lag_before_gyro_z_dph"],"over":"","sign":-1,"table":"lag_decay_gyro_z_dph"},{"factors":["move_gyro_z_dph"],"over":"","sign":1,"table":"lag_move_gyro_z_dph"},{"factors":["lag_before_gyro_z_dph"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_gyro_z_dph","terms":[{"factors":["x_gyro_z_dph"],"over":"","sign":1,"table":""},{"factors":["lag_gyro_z_dph"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u_gyro_z_dph","source":"coil_gyro_z_dph","table":"u_limits_gyro_z_dph"}}
 * {"sum":{"name":"coil_rate_gyro_z_dph","terms":[{"factors":["lag_gyro_z_dph"],"over":"","sign":1,"table":"rate_of_lag_gyro_z_dph"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate_gyro_z_dph","source":"coil_rate_gyro_z_dph","table":"rate_limits_gyro_z_dph"}}
 * {"sum":{"name":"drift_gyro_z_dph","terms":[{"factors":["rate_gyro_z_dph"],"over":"u_gyro_z_dph","sign":1,"table":"by_rate_gyro_z_dph"},{"factors":[],"over":"u_gyro_z_dph","sign":1,"table":"static_gyro_z_dph"}]}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x_accel_x_g","source":"temp_case_degc","table":"x_map_accel_x_g"}}
 * {"memory":{"name":"x_before_accel_x_g","source":"x_accel_x_g","start":"same"}}
 * {"sum":{"name":"move_accel_x_g","terms":[{"factors":["x_accel_x_g"],"over":"","sign":1,"table":""},{"factors":["x_before_accel_x_g"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before_accel_x_g","source":"lag_accel_x_g","start":"zero"}}
 * {"sum":{"name":"lag_accel_x_g","terms":[{"factors":["lag_before_accel_x_g"],"over":"","sign":-1,"table":"lag_decay_accel_x_g"},{"factors":["move_accel_x_g"],"over":"","sign":1,"table":"lag_move_accel_x_g"},{"factors":["lag_before_accel_x_g"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_accel_x_g","terms":[{"factors":["x_accel_x_g"],"over":"","sign":1,"table":""},{"factors":["lag_accel_x_g"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u_accel_x_g","source":"coil_accel_x_g","table":"u_limits_accel_x_g"}}
 * {"sum":{"name":"coil_rate_accel_x_g","terms":[{"factors":["lag_accel_x_g"],"over":"","sign":1,"table":"rate_of_lag_accel_x_g"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate_accel_x_g","source":"coil_rate_accel_x_g","table":"rate_limits_accel_x_g"}}
 * {"sum":{"name":"drift_accel_x_g","terms":[{"factors":["rate_accel_x_g"],"over":"u_accel_x_g","sign":1,"table":"by_rate_accel_x_g"},{"factors":[],"over":"u_accel_x_g","sign":1,"table":"static_accel_x_g"}]}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x_accel_y_g","source":"temp_case_degc","table":"x_map_accel_y_g"}}
 * {"memory":{"name":"x_before_accel_y_g","source":"x_accel_y_g","start":"same"}}
 * {"sum":{"name":"move_accel_y_g","terms":[{"factors":["x_accel_y_g"],"over":"","sign":1,"table":""},{"factors":["x_before_accel_y_g"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before_accel_y_g","source":"lag_accel_y_g","start":"zero"}}
 * {"sum":{"name":"lag_accel_y_g","terms":[{"factors":["lag_before_accel_y_g"],"over":"","sign":-1,"table":"lag_decay_accel_y_g"},{"factors":["move_accel_y_g"],"over":"","sign":1,"table":"lag_move_accel_y_g"},{"factors":["lag_before_accel_y_g"],"over":"","sign":1,"table":""}]}}
 * {"memory":{"name":"fall_before_accel_y_g","source":"fall_accel_y_g","start":"zero"}}
 * {"sum":{"name":"fall_accel_y_g","terms":[{"factors":["move_accel_y_g"],"over":"","sign":1,"table":"fall_move_accel_y_g"},{"factors":["lag_before_accel_y_g"],"over":"","sign":1,"table":"fall_lag_accel_y_g"},{"factors":["fall_before_accel_y_g"],"over":"","sign":-1,"table":"fall_decay_accel_y_g"},{"factors":["fall_before_accel_y_g"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_gradient_accel_y_g","terms":[{"factors":["fall_accel_y_g"],"over":"","sign":1,"table":"gradient_of_fall_accel_y_g"}]}}
 * {"limit":{"flag":"GRADIENT_CLAMPED","name":"gradient_accel_y_g","source":"coil_gradient_accel_y_g","table":"gradient_limits_accel_y_g"}}
 * {"sum":{"name":"coil_accel_y_g","terms":[{"factors":["x_accel_y_g"],"over":"","sign":1,"table":""},{"factors":["lag_accel_y_g"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u_accel_y_g","source":"coil_accel_y_g","table":"u_limits_accel_y_g"}}
 * {"sum":{"name":"coil_rate_accel_y_g","terms":[{"factors":["lag_accel_y_g"],"over":"","sign":1,"table":"rate_of_lag_accel_y_g"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate_accel_y_g","source":"coil_rate_accel_y_g","table":"rate_limits_accel_y_g"}}
 * {"sum":{"name":"drift_accel_y_g","terms":[{"factors":["gradient_accel_y_g"],"over":"","sign":1,"table":"by_gradient_accel_y_g"},{"factors":["rate_accel_y_g"],"over":"u_accel_y_g","sign":1,"table":"by_rate_accel_y_g"},{"factors":[],"over":"u_accel_y_g","sign":1,"table":"static_accel_y_g"}]}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x_accel_z_g","source":"temp_case_degc","table":"x_map_accel_z_g"}}
 * {"memory":{"name":"x_before_accel_z_g","source":"x_accel_z_g","start":"same"}}
 * {"sum":{"name":"move_accel_z_g","terms":[{"factors":["x_accel_z_g"],"over":"","sign":1,"table":""},{"factors":["x_before_accel_z_g"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before_accel_z_g","source":"lag_accel_z_g","start":"zero"}}
 * {"sum":{"name":"lag_accel_z_g","terms":[{"factors":["lag_before_accel_z_g"],"over":"","sign":-1,"table":"lag_decay_accel_z_g"},{"factors":["move_accel_z_g"],"over":"","sign":1,"table":"lag_move_accel_z_g"},{"factors":["lag_before_accel_z_g"],"over":"","sign":1,"table":""}]}}
 * {"memory":{"name":"fall_before_accel_z_g","source":"fall_accel_z_g","start":"zero"}}
 * {"sum":{"name":"fall_accel_z_g","terms":[{"factors":["move_accel_z_g"],"over":"","sign":1,"table":"fall_move_accel_z_g"},{"factors":["lag_before_accel_z_g"],"over":"","sign":1,"table":"fall_lag_accel_z_g"},{"factors":["fall_before_accel_z_g"],"over":"","sign":-1,"table":"fall_decay_accel_z_g"},{"factors":["fall_before_accel_z_g"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_gradient_accel_z_g","terms":[{"factors":["fall_accel_z_g"],"over":"","sign":1,"table":"gradient_of_fall_accel_z_g"}]}}
 * {"limit":{"flag":"GRADIENT_CLAMPED","name":"gradient_accel_z_g","source":"coil_gradient_accel_z_g","table":"gradient_limits_accel_z_g"}}
 * {"sum":{"name":"coil_accel_z_g","terms":[{"factors":["x_accel_z_g"],"over":"","sign":1,"table":""},{"factors":["lag_accel_z_g"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u_accel_z_g","source":"coil_accel_z_g","table":"u_limits_accel_z_g"}}
 * {"sum":{"name":"coil_rate_accel_z_g","terms":[{"factors":["lag_accel_z_g"],"over":"","sign":1,"table":"rate_of_lag_accel_z_g"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate_accel_z_g","source":"coil_rate_accel_z_g","table":"rate_limits_accel_z_g"}}
 * {"sum":{"name":"drift_accel_z_g","terms":[{"factors":["gradient_accel_z_g"],"over":"","sign":1,"table":"by_gradient_accel_z_g"},{"factors":["rate_accel_z_g"],"over":"u_accel_z_g","sign":1,"table":"by_rate_accel_z_g"},{"factors":[],"over":"u_accel_z_g","sign":1,"table":"static_accel_z_g"}]}}
 * {"output":{"meaning":"bias of gyro_x_dph, to be subtracted from it","name":"bias_gyro_x_dph","source":"drift_gyro_x_dph","unit":"deg/h"}}
 * {"output":{"meaning":"bias of gyro_y_dph, to be subtracted from it","name":"bias_gyro_y_dph","source":"drift_gyro_y_dph","unit":"deg/h"}}
 * {"output":{"meaning":"bias of gyro_z_dph, to be subtracted from it","name":"bias_gyro_z_dph","source":"drift_gyro_z_dph","unit":"deg/h"}}
 * {"output":{"meaning":"bias of accel_x_g, to be subtracted from it","name":"bias_accel_x_g","source":"drift_accel_x_g","unit":"g"}}
 * {"output":{"meaning":"bias of accel_y_g, to be subtracted from it","name":"bias_accel_y_g","source":"drift_accel_y_g","unit":"g"}}
 * {"output":{"meaning":"bias of accel_z_g, to be subtracted from it","name":"bias_accel_z_g","source":"drift_accel_z_g","unit":"g"}}
 * {"tables":[["temp_case_degc_range",2],["pace",2],["x_map_gyro_x_dph",4],["lag_decay_gyro_x_dph",1],["lag_move_gyro_x_dph",1],["u_limits_gyro_x_dph",2],["rate_of_lag_gyro_x_dph",1],["rate_limits_gyro_x_dph",2],["by_rate_gyro_x_dph",2],["static_gyro_x_dph",4],["x_map_gyro_y_dph",4],["lag_decay_gyro_y_dph",1],["lag_move_gyro_y_dph",1],["u_limits_gyro_y_dph",2],["rate_of_lag_gyro_y_dph",1],["rate_limits_gyro_y_dph",2],["by_rate_gyro_y_dph",2],["static_gyro_y_dph",4],["x_map_gyro_z_dph",4],["lag_decay_gyro_z_dph",1],["lag_move_gyro_z_dph",1],["u_limits_gyro_z_dph",2],["rate_of_lag_gyro_z_dph",1],["rate_limits_gyro_z_dph",2],["by_rate_gyro_z_dph",2],["static_gyro_z_dph",4],["x_map_accel_x_g",4],["lag_decay_accel_x_g",1],["lag_move_accel_x_g",1],["u_limits_accel_x_g",2],["rate_of_lag_accel_x_g",1],["rate_limits_accel_x_g",2],["by_rate_accel_x_g",2],["static_accel_x_g",4],["x_map_accel_y_g",4],["lag_decay_accel_y_g",1],["lag_move_accel_y_g",1],["fall_move_accel_y_g",1],["fall_lag_accel_y_g",1],["fall_decay_accel_y_g",1],["gradient_of_fall_accel_y_g",1],["gradient_limits_accel_y_g",2],["u_limits_accel_y_g",2],["rate_of_lag_accel_y_g",1],["rate_limits_accel_y_g",2],["by_gradient_accel_y_g",1],["by_rate_accel_y_g",2],["static_accel_y_g",4],["x_map_accel_z_g",4],["lag_decay_accel_z_g",1],["lag_move_accel_z_g",1],["fall_move_accel_z_g",1],["fall_lag_accel_z_g",1],["fall_decay_accel_z_g",1],["gradient_of_fall_accel_z_g",1],["gradient_limits_accel_z_g",2],["u_limits_accel_z_g",2],["rate_of_lag_accel_z_g",1],["rate_limits_accel_z_g",2],["by_gradient_accel_z_g",1],["by_rate_accel_z_g",2],["static_accel_z_g",4]]}
 */
/* sha256 of all lines above: 91a7283cda1236ed41fffb335432c19bb399ccf511b21e9b1a42b06c8b87f61d */
