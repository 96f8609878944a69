/*
 * cal: correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * accepted      this run met its acceptance limits
 * device        G-1 revision 1, effective from 2024-11-24
 * forms         fog-drift-lagged/1
 * coefficients  drift_rate.json content digest (field sha256)
 *               76331a143aa53776035513d727a51270bca857bb273cc8d2bd425e7e99faef04
 * run           run.json content digest (field sha256)
 *               a5f09a77837f09179f586922b963a6261eff2c1ead49c4c3e3391dec5b1689aa
 * schema        calibkit-firmware/1, made by calibkit 0.2.0
 * number        f32: IEEE 754 single precision
 * formula       corrected = indication - drift, both in deg/h; the drift is 0 at rest at 25 degC, or
 *               at the end of the fitted range nearest to it
 * input         temp_case_degc [degC] = column 'temp_case_degc', in degC, or in the unit that its
 *               header states (recipe: sign = +1)
 * indication    gyro_dph [deg/h] = column 'gyro_dph', in deg/h, or in the unit that its header states
 *               (recipe: sign = +1)
 * sign          feed and correct what the right-hand sides give, not the columns as they were logged
 * fitted over   temp_case_degc of the coil -36.69 to 63.36 degC
 * fitted over   temp_rate_degc_min of the coil -6.652 to 6.583 degC/min
 * fitted over   gradient_degc of the coil -6.364 to 6.301 degC
 * fitted over   gradient_rate_degc_min of the coil -0.7678 to 0.7574 degC/min
 * fitted over   these; the case is followed from -70 to 110 degC, as by apply
 * interval      update every 10 s, with means over it
 * jump          a temp_case_degc more than 2.22 degC an interval from the last is not used
 * gap           up to 60 s is bridged in a straight line, wrong by up to 1.8 deg/h while the case
 *               moves by no more than 6.65 degC/min; a longer one is a start
 * start         STARTING for 1620 s after a reset, which, while the case moves by no more than 6.65
 *               degC/min, is wrong by up to 10 deg/h at first, 0.099 deg/h then
 * error bound   drift_dph: 8.4e-05 deg/h
 *               (worst case of evaluation, while the case moves by no more than 13.3 degC/min)
 *
 * Results are bit for bit those of calibkit's twin with -ffp-contract=off; else within twice the error
 *               bound.
 */

#include "cal.h"

#include <float.h>

#if defined(__FINITE_MATH_ONLY__) && (__FINITE_MATH_ONLY__ > 0)
#error -ffast-math and -ffinite-math-only delete the guard against NaN
#endif

#define CAL_EARLIEST_MS 8750U
#define CAL_LATEST_MS 11250U
#define CAL_LONGEST 6U /* intervals that are bridged */

typedef struct {
    float middle;
    float reciprocal;
    float range[2];
} cal_map;

static const float cal_temp_case_degc_range[2] = {-115.0F, 155.0F}; /* least and greatest temp_case_degc [degC] */
static const float cal_pace[2] = {162.0F, 2.21717978F}; /* updates until the lags have settled; farthest move of temp_case_degc an interval */
static const cal_map cal_x_map = {13.375F, 0.0199501254F, {-1.66334164F, 1.92768085F}};
static const float cal_lag_decay = 0.0285281595F;
static const float cal_lag_move = 0.985667109F;
static const float cal_fall_move = 0.0135527588F;
static const float cal_fall_lag = 0.0262257904F;
static const float cal_fall_decay = 0.156235546F;
static const float cal_gradient_of_fall = 7.87698698F;
static const float cal_gradient_limits[2] = {-1.0F, 0.990127385F}; /* least and greatest gradient */
static const float cal_gradient_rate_of_fall = 66.5499649F;
static const float cal_gradient_rate_of_lag = 11.3382025F;
static const float cal_gradient_rate_limits[2] = {-1048576.0F, 1048576.0F}; /* least and greatest gradient_rate */
static const float cal_u_limits[2] = {-0.998628438F, 0.997132182F}; /* least and greatest u */
static const float cal_rate_of_lag = 1.30866027F;
static const float cal_rate_limits[2] = {-1.0F, 0.989590764F}; /* least and greatest rate */
static const float cal_by_gradient_rate = 0.0F;
static const float cal_by_gradient_squared = 0.0F;
static const float cal_by_gradient = -4.08115387F;
static const float cal_by_rate[2] = {4.95471334F, 0.143898875F};
static const float cal_static[4] = {-0.142045289F, 0.566831052F, 0.195308596F, 0.00646605343F};

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
static uint32_t cal_step(cal_state *state, const cal_in *in)
{
    uint32_t status = CAL_OK;
    const float temp_case_degc = cal_limited(in->temp_case_degc, cal_temp_case_degc_range, 0U, &status);
    const float x = cal_mapped(temp_case_degc, &cal_x_map, CAL_TEMP_CLAMPED, &status);
    const float x_before = (state->updates == 0U) ? x : state->x;
    const float move = x - x_before;
    const float lag_before = state->lag;
    const float lag = -(cal_lag_decay * lag_before) + (cal_lag_move * move) + lag_before;
    const float fall_before = state->fall;
    const float fall = (cal_fall_move * move)
        + (cal_fall_lag * lag_before)
        - (cal_fall_decay * fall_before)
        + fall_before;
    const float coil_gradient = cal_gradient_of_fall * fall;
    const float gradient = cal_limited(coil_gradient, cal_gradient_limits, CAL_GRADIENT_CLAMPED, &status);
    const float coil_gradient_rate = -(cal_gradient_rate_of_fall * fall) + (cal_gradient_rate_of_lag * lag);
    const float gradient_rate = cal_limited(coil_gradient_rate, cal_gradient_rate_limits, CAL_RATE_CLAMPED, &status);
    const float coil = x - lag;
    const float u = cal_limited(coil, cal_u_limits, CAL_TEMP_CLAMPED, &status);
    const float coil_rate = cal_rate_of_lag * lag;
    const float rate = cal_limited(coil_rate, cal_rate_limits, CAL_RATE_CLAMPED, &status);
    const float drift = (cal_by_gradient_rate * gradient_rate)
        + ((cal_by_gradient_squared * gradient) * gradient)
        + (cal_by_gradient * gradient)
        + (cal_polynomial(cal_by_rate, 2U, u) * rate)
        + cal_polynomial(cal_static, 4U, u);

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
static uint32_t cal_jumped(const cal_state *state, const cal_in *in, uint32_t count)
{
    const float away = in->temp_case_degc - state->in.temp_case_degc;
    const float most = cal_pace[1] * (float)count;

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

uint32_t cal_update(cal_state *state, uint32_t elapsed_ms, const cal_in *in, cal_out *out)
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
    } else if ((first == 0U) && (count <= CAL_LONGEST) && (cal_jumped(state, in, count) != 0U)) {
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
            status = cal_step(state, &at);
        }
        if ((first == 0U) && ((count != 1U) || (elapsed_ms < CAL_EARLIEST_MS) || (elapsed_ms > CAL_LATEST_MS))) {
            status |= CAL_INTERVAL;
        }
        if (state->updates <= (uint32_t)cal_pace[0]) {
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

#ifndef CAL_NO_SELFTEST
#define CAL_TESTS 65U

/* whether a computed value is within the tolerance of the expected one; never for a NaN */
static uint32_t cal_near(float found, float expected, float tolerance)
{
    const float difference = found - expected;

    return ((difference >= -tolerance) && (difference <= tolerance)) ? 1U : 0U;
}

static const cal_in cal_test_in[CAL_TESTS] = {
    {13.375F},
    {15.25F},
    {16.5F},
    {15.875F},
    {17.75F},
    {17.125F},
    {19.625F},
    {18.375F},
    {14.625F},
    {19.0F},
    {16.8125F},
    {14.0F},
    {19.625F},
    {44.6875F},
    {111.25F},
    {73.5F},
    {73.5F},
    {73.5F},
    {73.5F},
    {73.5F},
    {73.5F},
    {73.5F},
    {73.5F},
    {25.875F},
    {-17.9375F},
    {-71.25F},
    {-46.75F},
    {-46.75F},
    {-46.75F},
    {-46.75F},
    {-46.75F},
    {-46.75F},
    {-46.75F},
    {-46.75F},
    {74.75F},
    {0.875F},
    {19.625F},
    {-71.25F},
    {111.25F},
    {111.25F},
    {111.25F},
    {111.25F},
    {111.25F},
    {111.25F},
    {-71.25F},
    {-71.25F},
    {-71.25F},
    {-71.25F},
    {-71.25F},
    {20.0F},
    {20.875F},
    {22.0F},
    {22.21875F},
    {24.4375F},
    {153.03125F},
    {24.875F},
    {24.4375F},
    {24.4375F},
    {24.4375F},
    {27.75F},
    {108.6875F},
    {108.6875F},
    {109.34375F},
    {109.34375F},
    {109.34375F}
};
static const cal_out cal_test_out[CAL_TESTS] = {
    {-0.142045289F},
    {0.0810336471F},
    {0.195006907F},
    {0.0682439506F},
    {0.258887053F},
    {0.122488081F},
    {0.379483283F},
    {0.150359377F},
    {-0.340358287F},
    {0.212707534F},
    {-0.101494893F},
    {-0.440933228F},
    {0.160401553F},
    {2.18059397F},
    {2.68112636F},
    {0.983033597F},
    {1.00945902F},
    {0.414255768F},
    {0.552960157F},
    {0.630262673F},
    {0.625802934F},
    {0.624030113F},
    {0.623761654F},
    {-2.74657106F},
    {-0.393284678F},
    {-0.500753164F},
    {-0.796182394F},
    {-0.917196989F},
    {-1.03505754F},
    {-0.296568602F},
    {-0.466075122F},
    {-0.50289464F},
    {-0.517540634F},
    {-0.519758403F},
    {0.21152389F},
    {-0.82649684F},
    {-0.094420135F},
    {-0.519765019F},
    {0.200305641F},
    {0.759990513F},
    {0.665591121F},
    {0.631025791F},
    {0.624297798F},
    {0.623760939F},
    {-0.393284678F},
    {-0.918560982F},
    {-0.340482533F},
    {-0.488087356F},
    {-0.517423809F},
    {-0.0637007356F},
    {0.0408431366F},
    {0.12458916F},
    {0.12458916F},
    {0.299357027F},
    {0.299357027F},
    {0.202795774F},
    {0.202795774F},
    {0.0816188082F},
    {0.0300280675F},
    {0.0300280675F},
    {0.623760819F},
    {0.623760819F},
    {0.692356169F},
    {0.623768926F},
    {0.623768687F}
};
static const uint32_t cal_test_updates[CAL_TESTS] = {
    1U, 1U, 1U, 1U, 1U, 1U, 1U, 1U, 1U, 1U, 1U, 1U,
    3U, 3U, 1U, 8U, 5U, 7U, 25U, 40U, 40U, 70U, 200U, 3U,
    3U, 2U, 8U, 5U, 7U, 25U, 40U, 40U, 70U, 200U, 4U, 6U,
    12U, 500U, 3U, 20U, 40U, 60U, 90U, 300U, 3U, 20U, 40U, 60U,
    90U, 1U, 1U, 2U, 1U, 1U, 2U, 1U, 1U, 1U, 3U, 1U,
    1U, 2U, 1U, 162U, 1U
};
static const uint32_t cal_test_elapsed[CAL_TESTS] = {
    0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U,
    0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U,
    0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U,
    0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U, 0U,
    0U, 10000000U, 10000U, 10000U, 2500U, 27500U, 10000U, 10000U, 7000U, 13000U, 10000U, 10000U,
    10000000U, 10000U, 30000U, 0U, 10000U
};
static const uint32_t cal_test_status[CAL_TESTS] = {
    0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U, 0x0U,
    0x0U, 0x0U, 0x5U, 0x6U, 0x2U, 0x0U, 0x0U, 0x1U, 0x1U, 0x1U, 0x1U, 0x5U,
    0x7U, 0x7U, 0x6U, 0x6U, 0x6U, 0x0U, 0x1U, 0x1U, 0x1U, 0x1U, 0x6U, 0x2U,
    0x2U, 0x1U, 0x7U, 0x7U, 0x1U, 0x1U, 0x1U, 0x1U, 0x7U, 0x7U, 0x1U, 0x1U,
    0x1U, 0x18U, 0x8U, 0x8U, 0x10U, 0x18U, 0x20U, 0x18U, 0x10U, 0x18U, 0x8U, 0x20U,
    0x19U, 0x9U, 0x19U, 0x1U, 0x1U
};

int32_t cal_selftest(void)
{
    int32_t failed = 0;
    uint32_t k;
    cal_state state;

    cal_reset(&state);
    for (k = 0U; k < CAL_TESTS; k++) {
        cal_out out = {0.0F};
        uint32_t status = CAL_OK;
        uint32_t i;

        for (i = 0U; i < cal_test_updates[k]; i++) {
            if (cal_test_elapsed[k] == 0U) {
                status = cal_step(&state, &cal_test_in[k]);
                out.drift_dph = state.last.drift_dph;
            } else {
                status = cal_update(&state, cal_test_elapsed[k], &cal_test_in[k], &out);
            }
        }

        if ((status != cal_test_status[k])
            || (cal_near(out.drift_dph, cal_test_out[k].drift_dph, 0.00034F) == 0U)) {
            failed = 1;
        }
    }
    return failed;
}
#endif

/*
 * The steps above as `calibkit verify` reads them again:
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
 */
/* sha256 of all lines above: 51c8b4687ecb4bb2bf1a14793da30e05c9e4ec17bb17884d6c6915d26c7f4dd1 */
