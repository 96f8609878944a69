/*
 * cal: loader of blobs, correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * layout        29a79178ce5945d6: a blob of any other is refused
 * forms         fog-drift-lagged/1
 * number        f32: IEEE 754 single precision
 * formula       corrected = indication - drift, both in deg/h; the drift is 0 at rest at 25 degC, or
 *               at the end of the fitted range nearest to it
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
    state->x = 0.0F;
    state->lag = 0.0F;
    state->fall = 0.0F;
    state->last.drift_dph = 0.0F;
    state->before.drift_dph = 0.0F;
    state->in.temp_case_degc = 0.0F;
    state->updates = 0U;
    state->waited_ms = 0U;
}

/* one interval, for inputs that are numbers */
static uint32_t cal_step(const cal_numbers *n, cal_state *state, const cal_in *in)
{
    uint32_t status = CAL_OK;
    const float temp_case_degc = cal_limited(in->temp_case_degc, n->t_temp_case_degc_range, 0U, &status);
    const float x = cal_mapped(temp_case_degc, &n->t_x_map, CAL_TEMP_CLAMPED, &status);
    const float x_before = (state->updates == 0U) ? x : state->x;
    const float move = x - x_before;
    const float lag_before = state->lag;
    const float lag = -(n->t_lag_decay * lag_before) + (n->t_lag_move * move) + lag_before;
    const float fall_before = state->fall;
    const float fall = (n->t_fall_move * move)
        + (n->t_fall_lag * lag_before)
        - (n->t_fall_decay * fall_before)
        + fall_before;
    const float coil_gradient = n->t_gradient_of_fall * fall;
    const float gradient = cal_limited(coil_gradient, n->t_gradient_limits, CAL_GRADIENT_CLAMPED, &status);
    const float coil_gradient_rate = -(n->t_gradient_rate_of_fall * fall)
        + (n->t_gradient_rate_of_lag * lag);
    const float gradient_rate = cal_limited(coil_gradient_rate, n->t_gradient_rate_limits, CAL_RATE_CLAMPED, &status);
    const float coil = x - lag;
    const float u = cal_limited(coil, n->t_u_limits, CAL_TEMP_CLAMPED, &status);
    const float coil_rate = n->t_rate_of_lag * lag;
    const float rate = cal_limited(coil_rate, n->t_rate_limits, CAL_RATE_CLAMPED, &status);
    const float drift = (n->t_by_gradient_rate * gradient_rate)
        + ((n->t_by_gradient_squared * gradient) * gradient)
        + (n->t_by_gradient * gradient)
        + (cal_polynomial(n->t_by_rate, 2U, u) * rate)
        + cal_polynomial(n->t_static, 4U, u);

    state->x = x;
    state->lag = lag;
    state->fall = fall;
    if (state->updates < UINT32_MAX) {
        state->updates++;
    }
    state->last.drift_dph = drift;
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
        state->before.drift_dph = state->last.drift_dph;
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
            state->lag = 0.0F;
            state->fall = 0.0F;
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
            state->before.drift_dph = state->last.drift_dph;
        }
        state->in.temp_case_degc = in->temp_case_degc;
        state->waited_ms %= CAL_INTERVAL_MS;
    }
    out->drift_dph = state->last.drift_dph;
    return status;
}

void cal_between(const cal_state *state, uint32_t elapsed_ms, cal_out *out)
{
    const uint32_t passed = (elapsed_ms < CAL_INTERVAL_MS) ? elapsed_ms : CAL_INTERVAL_MS;
    const float share = (float)passed / (float)CAL_INTERVAL_MS;
    out->drift_dph = state->before.drift_dph + ((state->last.drift_dph - state->before.drift_dph) * share);
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
        out->drift_dph = cal_none();
    }
    return status;
}

#define CAL_NUMBERS 34U
#define CAL_TESTS_AT 248U /* tolerances, vectors */
#define CAL_ROW 20U /* bytes of a vector */
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
    n->t_x_map.middle = cal_number(&at[16]);
    n->t_x_map.reciprocal = cal_number(&at[20]);
    n->t_x_map.range[0] = cal_number(&at[24]);
    n->t_x_map.range[1] = cal_number(&at[28]);
    n->t_lag_decay = cal_number(&at[32]);
    n->t_lag_move = cal_number(&at[36]);
    n->t_fall_move = cal_number(&at[40]);
    n->t_fall_lag = cal_number(&at[44]);
    n->t_fall_decay = cal_number(&at[48]);
    n->t_gradient_of_fall = cal_number(&at[52]);
    n->t_gradient_limits[0] = cal_number(&at[56]);
    n->t_gradient_limits[1] = cal_number(&at[60]);
    n->t_gradient_rate_of_fall = cal_number(&at[64]);
    n->t_gradient_rate_of_lag = cal_number(&at[68]);
    n->t_gradient_rate_limits[0] = cal_number(&at[72]);
    n->t_gradient_rate_limits[1] = cal_number(&at[76]);
    n->t_u_limits[0] = cal_number(&at[80]);
    n->t_u_limits[1] = cal_number(&at[84]);
    n->t_rate_of_lag = cal_number(&at[88]);
    n->t_rate_limits[0] = cal_number(&at[92]);
    n->t_rate_limits[1] = cal_number(&at[96]);
    n->t_by_gradient_rate = cal_number(&at[100]);
    n->t_by_gradient_squared = cal_number(&at[104]);
    n->t_by_gradient = cal_number(&at[108]);
    n->t_by_rate[0] = cal_number(&at[112]);
    n->t_by_rate[1] = cal_number(&at[116]);
    n->t_static[0] = cal_number(&at[120]);
    n->t_static[1] = cal_number(&at[124]);
    n->t_static[2] = cal_number(&at[128]);
    n->t_static[3] = cal_number(&at[132]);
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

    for (k = 0U; k < 1U; k++) {
        const float tolerance = cal_number(&n->tests[k * 4U]);

        sane &= ((tolerance >= 0.0F) && (cal_finite(tolerance) != 0U)) ? 1U : 0U;
    }
    for (k = 0U; k < n->rows; k++) {
        const uint8_t *row = &n->tests[4U + (k * CAL_ROW)];
        const uint32_t count = cal_count(cal_number(&row[8]), CAL_MOST_UPDATES);

        sane &= (cal_count(cal_number(&row[16]), 0x10000U) < 0x10000U) ? 1U : 0U;
        sane &= (cal_count(cal_number(&row[12]), CAL_MOST_COUNT) < CAL_MOST_COUNT) ? 1U : 0U;
        sane &= (count > 0U) ? 1U : 0U;
        updates += count;
    }
    return ((sane != 0U) && (updates < CAL_MOST_UPDATES)) ? 1U : 0U;
}

static uint32_t cal_sane(const cal_numbers *n)
{
    uint32_t sane = 0U;

    if ((n->t_temp_case_degc_range[0] < n->t_temp_case_degc_range[1])
        && (n->t_gradient_limits[0] < n->t_gradient_limits[1])
        && (n->t_gradient_rate_limits[0] < n->t_gradient_rate_limits[1])
        && (n->t_u_limits[0] < n->t_u_limits[1])
        && (n->t_rate_limits[0] < n->t_rate_limits[1])
        && (n->t_x_map.range[0] < n->t_x_map.range[1])
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
        const uint8_t *row = &n->tests[4U + (k * CAL_ROW)];
        const float calls = cal_number(&row[8]);
        const float later = cal_number(&row[12]);
        const uint32_t updates = cal_count(calls, CAL_MOST_UPDATES);
        const uint32_t elapsed = cal_count(later, CAL_MOST_COUNT);
        uint32_t i;
        uint32_t status = CAL_OK;
        cal_in in;
        cal_out out;

        in.temp_case_degc = cal_number(&row[0]);
        out.drift_dph = 0.0F;
        for (i = 0U; i < updates; i++) {
            if (elapsed == 0U) {
                status = cal_step(n, &state, &in);
                out.drift_dph = state.last.drift_dph;
            } else {
                status = cal_updated(n, &state, elapsed, &in, &out);
            }
        }
        if ((status != cal_count(cal_number(&row[16]), 0x10000U))
            || (cal_near(out.drift_dph, cal_number(&row[4]), cal_number(&n->tests[0])) == 0U)) {
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
    static const uint8_t layout[8] = {0x29U, 0xa7U, 0x91U, 0x78U, 0xceU, 0x59U, 0x45U, 0xd6U};
    const uint32_t rows = cal_u32(&blob[108]);
    uint32_t same = 1U;
    uint32_t k;

    for (k = 0U; k < 8U; k++) {
        same &= (blob[16U + k] == layout[k]) ? 1U : 0U;
    }
    if ((((uint32_t)blob[12] | ((uint32_t)blob[13] << 8U)) != 32U) || (cal_u32(&blob[104]) != CAL_NUMBERS)
        || (rows == 0U) || (rows > CAL_MOST_ROWS)) {
        same = 0U;
    } else if (cal_u32(&blob[8]) < (CAL_TESTS_AT + 4U + (rows * CAL_ROW) + 4U)) {
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
 * {"program":{"forms":["fog-drift-lagged/1"],"formula":"corrected = indication - drift, both in deg/h; the drift is 0 at rest at 25 degC, or at the end of the fitted range nearest to it","interval_s":10.0,"number":"f32","pace":{"flags":["STARTING","INTERVAL","JUMPED"],"followed":"temp_case_degc","lags":["lag","fall"],"longest":6,"table":"pace"},"scales":{}}}
 * {"input":{"flag":"","meaning":"temperature of the sensor case, mean of the interval","name":"temp_case_degc","table":"temp_case_degc_range","unit":"degC"}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"x","source":"temp_case_degc","table":"x_map"}}
 * {"memory":{"name":"x_before","source":"x","start":"same"}}
 * {"sum":{"name":"move","terms":[{"factors":["x"],"over":"","sign":1,"table":""},{"factors":["x_before"],"over":"","sign":-1,"table":""}]}}
 * {"memory":{"name":"lag_before","source":"lag","start":"zero"}}
 * {"sum":{"name":"lag","terms":[{"factors":["lag_before"],"over":"","sign":-1,"table":"lag_decay"},{"factors":["move"],"over":"","sign":1,"table":"lag_move"},{"factors":["lag_before"],"over":"","sign":1,"table":""}]}}
 * {"memory":{"name":"fall_before","source":"fall","start":"zero"}}
 * {"sum":{"name":"fall","terms":[{"factors":["move"],"over":"","sign":1,"table":"fall_move"},{"factors":["lag_before"],"over":"","sign":1,"table":"fall_lag"},{"factors":["fall_before"],"over":"","sign":-1,"table":"fall_decay"},{"factors":["fall_before"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"coil_gradient","terms":[{"factors":["fall"],"over":"","sign":1,"table":"gradient_of_fall"}]}}
 * {"limit":{"flag":"GRADIENT_CLAMPED","name":"gradient","source":"coil_gradient","table":"gradient_limits"}}
 * {"sum":{"name":"coil_gradient_rate","terms":[{"factors":["fall"],"over":"","sign":-1,"table":"gradient_rate_of_fall"},{"factors":["lag"],"over":"","sign":1,"table":"gradient_rate_of_lag"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"gradient_rate","source":"coil_gradient_rate","table":"gradient_rate_limits"}}
 * {"sum":{"name":"coil","terms":[{"factors":["x"],"over":"","sign":1,"table":""},{"factors":["lag"],"over":"","sign":-1,"table":""}]}}
 * {"limit":{"flag":"TEMP_CLAMPED","name":"u","source":"coil","table":"u_limits"}}
 * {"sum":{"name":"coil_rate","terms":[{"factors":["lag"],"over":"","sign":1,"table":"rate_of_lag"}]}}
 * {"limit":{"flag":"RATE_CLAMPED","name":"rate","source":"coil_rate","table":"rate_limits"}}
 * {"sum":{"name":"drift","terms":[{"factors":["gradient_rate"],"over":"","sign":1,"table":"by_gradient_rate"},{"factors":["gradient","gradient"],"over":"","sign":1,"table":"by_gradient_squared"},{"factors":["gradient"],"over":"","sign":1,"table":"by_gradient"},{"factors":["rate"],"over":"u","sign":1,"table":"by_rate"},{"factors":[],"over":"u","sign":1,"table":"static"}]}}
 * {"output":{"meaning":"drift, to be subtracted from the indication","name":"drift_dph","source":"drift","unit":"deg/h"}}
 * {"tables":[["temp_case_degc_range",2],["pace",2],["x_map",4],["lag_decay",1],["lag_move",1],["fall_move",1],["fall_lag",1],["fall_decay",1],["gradient_of_fall",1],["gradient_limits",2],["gradient_rate_of_fall",1],["gradient_rate_of_lag",1],["gradient_rate_limits",2],["u_limits",2],["rate_of_lag",1],["rate_limits",2],["by_gradient_rate",1],["by_gradient_squared",1],["by_gradient",1],["by_rate",2],["static",4]]}
 */
/* sha256 of all lines above: c894f97d80e09993af05273da9a62345cffa47f1f433a79c86966a39061d486d */
