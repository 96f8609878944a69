/*
 * cal: loader of blobs, correction chain as firmware; C99, no library
 * SPDX-License-Identifier: MIT
 *
 * layout        1dbc3e2fcca9e5ee: a blob of any other is refused
 * forms         gyro-triad/1
 * number        f32: IEEE 754 single precision
 * formula       rate = S(T)^-1 (indication - B(T)), in deg/s about the axes of the base
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

/* an indication as it is, which may be outside [range[0], range[1]] */
static float cal_indicated(float x, const float range[], uint32_t beyond, uint32_t *status)
{
    if ((x < range[0]) || (x > range[1])) {
        *status |= beyond;
    }
    return x;
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

static uint32_t cal_corrected(const cal_numbers *n, const cal_in *in, cal_out *out)
{
    uint32_t status = CAL_OK;

    if ((cal_finite(in->temp_case_degc) == 0U)
        || (cal_finite(in->gyro_x_lsb) == 0U)
        || (cal_finite(in->gyro_y_lsb) == 0U)
        || (cal_finite(in->gyro_z_lsb) == 0U)) {
        const float none = (in->temp_case_degc - in->temp_case_degc)
            + (in->gyro_x_lsb - in->gyro_x_lsb)
            + (in->gyro_y_lsb - in->gyro_y_lsb)
            + (in->gyro_z_lsb - in->gyro_z_lsb); /* a NaN */

        out->rate_x_dps = none;
        out->rate_y_dps = none;
        out->rate_z_dps = none;
        status = CAL_INVALID;
    } else {
        const float temp_case_degc = cal_limited(in->temp_case_degc, n->t_temp_case_degc_range, 0U, &status);
        const float gyro_x_lsb = cal_indicated(in->gyro_x_lsb, n->t_gyro_x_lsb_range, CAL_RATE_BEYOND, &status);
        const float gyro_y_lsb = cal_indicated(in->gyro_y_lsb, n->t_gyro_y_lsb_range, CAL_RATE_BEYOND, &status);
        const float gyro_z_lsb = cal_indicated(in->gyro_z_lsb, n->t_gyro_z_lsb_range, CAL_RATE_BEYOND, &status);
        const float u = cal_mapped(temp_case_degc, &n->t_u_map, CAL_TEMP_CLAMPED, &status);
        const float above_x = -cal_polynomial(n->t_bias_x, 4U, u) + gyro_x_lsb;
        const float above_y = -cal_polynomial(n->t_bias_y, 4U, u) + gyro_y_lsb;
        const float above_z = -cal_polynomial(n->t_bias_z, 4U, u) + gyro_z_lsb;
        const float determinant = cal_polynomial(n->t_determinant_of_s, 10U, u);
        const float numerator_x = (cal_polynomial(n->t_inverse_xy, 7U, u) * above_y)
            + (cal_polynomial(n->t_inverse_xz, 7U, u) * above_z)
            + (cal_polynomial(n->t_inverse_xx, 7U, u) * above_x);
        const float rate_x = numerator_x / determinant;
        const float numerator_y = (cal_polynomial(n->t_inverse_yx, 7U, u) * above_x)
            + (cal_polynomial(n->t_inverse_yz, 7U, u) * above_z)
            + (cal_polynomial(n->t_inverse_yy, 7U, u) * above_y);
        const float rate_y = numerator_y / determinant;
        const float numerator_z = (cal_polynomial(n->t_inverse_zx, 7U, u) * above_x)
            + (cal_polynomial(n->t_inverse_zy, 7U, u) * above_y)
            + (cal_polynomial(n->t_inverse_zz, 7U, u) * above_z);
        const float rate_z = numerator_z / determinant;

        out->rate_x_dps = rate_x;
        out->rate_y_dps = rate_y;
        out->rate_z_dps = rate_z;
    }
    return status;
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

uint32_t cal_correct(const cal_unit *unit, const cal_in *in, cal_out *out)
{
    const cal_numbers *n = cal_in_use(unit);
    uint32_t status = 0xc000U;

    if (n != NULL) {
        status = cal_corrected(n, in, out);
    } else {
        out->rate_x_dps = cal_none();
        out->rate_y_dps = cal_none();
        out->rate_z_dps = cal_none();
    }
    return status;
}

#define CAL_NUMBERS 97U
#define CAL_TESTS_AT 500U /* tolerances, vectors */
#define CAL_ROW 36U /* bytes of a vector */
#define CAL_MOST_ROWS 1024U
#define CAL_MOST_UPDATES 8192U
#define CAL_MOST_COUNT 16777216U

static uint32_t cal_fill(cal_numbers *n, const uint8_t at[])
{
    uint32_t finite = 1U;
    uint32_t k;

    n->t_temp_case_degc_range[0] = cal_number(&at[0]);
    n->t_temp_case_degc_range[1] = cal_number(&at[4]);
    n->t_gyro_x_lsb_range[0] = cal_number(&at[8]);
    n->t_gyro_x_lsb_range[1] = cal_number(&at[12]);
    n->t_gyro_y_lsb_range[0] = cal_number(&at[16]);
    n->t_gyro_y_lsb_range[1] = cal_number(&at[20]);
    n->t_gyro_z_lsb_range[0] = cal_number(&at[24]);
    n->t_gyro_z_lsb_range[1] = cal_number(&at[28]);
    n->t_u_map.middle = cal_number(&at[32]);
    n->t_u_map.reciprocal = cal_number(&at[36]);
    n->t_u_map.range[0] = cal_number(&at[40]);
    n->t_u_map.range[1] = cal_number(&at[44]);
    n->t_bias_x[0] = cal_number(&at[48]);
    n->t_bias_x[1] = cal_number(&at[52]);
    n->t_bias_x[2] = cal_number(&at[56]);
    n->t_bias_x[3] = cal_number(&at[60]);
    n->t_bias_y[0] = cal_number(&at[64]);
    n->t_bias_y[1] = cal_number(&at[68]);
    n->t_bias_y[2] = cal_number(&at[72]);
    n->t_bias_y[3] = cal_number(&at[76]);
    n->t_bias_z[0] = cal_number(&at[80]);
    n->t_bias_z[1] = cal_number(&at[84]);
    n->t_bias_z[2] = cal_number(&at[88]);
    n->t_bias_z[3] = cal_number(&at[92]);
    n->t_determinant_of_s[0] = cal_number(&at[96]);
    n->t_determinant_of_s[1] = cal_number(&at[100]);
    n->t_determinant_of_s[2] = cal_number(&at[104]);
    n->t_determinant_of_s[3] = cal_number(&at[108]);
    n->t_determinant_of_s[4] = cal_number(&at[112]);
    n->t_determinant_of_s[5] = cal_number(&at[116]);
    n->t_determinant_of_s[6] = cal_number(&at[120]);
    n->t_determinant_of_s[7] = cal_number(&at[124]);
    n->t_determinant_of_s[8] = cal_number(&at[128]);
    n->t_determinant_of_s[9] = cal_number(&at[132]);
    n->t_inverse_xy[0] = cal_number(&at[136]);
    n->t_inverse_xy[1] = cal_number(&at[140]);
    n->t_inverse_xy[2] = cal_number(&at[144]);
    n->t_inverse_xy[3] = cal_number(&at[148]);
    n->t_inverse_xy[4] = cal_number(&at[152]);
    n->t_inverse_xy[5] = cal_number(&at[156]);
    n->t_inverse_xy[6] = cal_number(&at[160]);
    n->t_inverse_xz[0] = cal_number(&at[164]);
    n->t_inverse_xz[1] = cal_number(&at[168]);
    n->t_inverse_xz[2] = cal_number(&at[172]);
    n->t_inverse_xz[3] = cal_number(&at[176]);
    n->t_inverse_xz[4] = cal_number(&at[180]);
    n->t_inverse_xz[5] = cal_number(&at[184]);
    n->t_inverse_xz[6] = cal_number(&at[188]);
    n->t_inverse_xx[0] = cal_number(&at[192]);
    n->t_inverse_xx[1] = cal_number(&at[196]);
    n->t_inverse_xx[2] = cal_number(&at[200]);
    n->t_inverse_xx[3] = cal_number(&at[204]);
    n->t_inverse_xx[4] = cal_number(&at[208]);
    n->t_inverse_xx[5] = cal_number(&at[212]);
    n->t_inverse_xx[6] = cal_number(&at[216]);
    n->t_inverse_yx[0] = cal_number(&at[220]);
    n->t_inverse_yx[1] = cal_number(&at[224]);
    n->t_inverse_yx[2] = cal_number(&at[228]);
    n->t_inverse_yx[3] = cal_number(&at[232]);
    n->t_inverse_yx[4] = cal_number(&at[236]);
    n->t_inverse_yx[5] = cal_number(&at[240]);
    n->t_inverse_yx[6] = cal_number(&at[244]);
    n->t_inverse_yz[0] = cal_number(&at[248]);
    n->t_inverse_yz[1] = cal_number(&at[252]);
    n->t_inverse_yz[2] = cal_number(&at[256]);
    n->t_inverse_yz[3] = cal_number(&at[260]);
    n->t_inverse_yz[4] = cal_number(&at[264]);
    n->t_inverse_yz[5] = cal_number(&at[268]);
    n->t_inverse_yz[6] = cal_number(&at[272]);
    n->t_inverse_yy[0] = cal_number(&at[276]);
    n->t_inverse_yy[1] = cal_number(&at[280]);
    n->t_inverse_yy[2] = cal_number(&at[284]);
    n->t_inverse_yy[3] = cal_number(&at[288]);
    n->t_inverse_yy[4] = cal_number(&at[292]);
    n->t_inverse_yy[5] = cal_number(&at[296]);
    n->t_inverse_yy[6] = cal_number(&at[300]);
    n->t_inverse_zx[0] = cal_number(&at[304]);
    n->t_inverse_zx[1] = cal_number(&at[308]);
    n->t_inverse_zx[2] = cal_number(&at[312]);
    n->t_inverse_zx[3] = cal_number(&at[316]);
    n->t_inverse_zx[4] = cal_number(&at[320]);
    n->t_inverse_zx[5] = cal_number(&at[324]);
    n->t_inverse_zx[6] = cal_number(&at[328]);
    n->t_inverse_zy[0] = cal_number(&at[332]);
    n->t_inverse_zy[1] = cal_number(&at[336]);
    n->t_inverse_zy[2] = cal_number(&at[340]);
    n->t_inverse_zy[3] = cal_number(&at[344]);
    n->t_inverse_zy[4] = cal_number(&at[348]);
    n->t_inverse_zy[5] = cal_number(&at[352]);
    n->t_inverse_zy[6] = cal_number(&at[356]);
    n->t_inverse_zz[0] = cal_number(&at[360]);
    n->t_inverse_zz[1] = cal_number(&at[364]);
    n->t_inverse_zz[2] = cal_number(&at[368]);
    n->t_inverse_zz[3] = cal_number(&at[372]);
    n->t_inverse_zz[4] = cal_number(&at[376]);
    n->t_inverse_zz[5] = cal_number(&at[380]);
    n->t_inverse_zz[6] = cal_number(&at[384]);
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

    for (k = 0U; k < 3U; k++) {
        const float tolerance = cal_number(&n->tests[k * 4U]);

        sane &= ((tolerance >= 0.0F) && (cal_finite(tolerance) != 0U)) ? 1U : 0U;
    }
    for (k = 0U; k < n->rows; k++) {
        const uint8_t *row = &n->tests[12U + (k * CAL_ROW)];
        const uint32_t count = cal_count(cal_number(&row[28]), CAL_MOST_UPDATES);

        sane &= (cal_count(cal_number(&row[32]), 0x10000U) < 0x10000U) ? 1U : 0U;
        sane &= (count > 0U) ? 1U : 0U;
        updates += count;
    }
    return ((sane != 0U) && (updates < CAL_MOST_UPDATES)) ? 1U : 0U;
}

static uint32_t cal_sane(const cal_numbers *n)
{
    uint32_t sane = 0U;

    if ((n->t_temp_case_degc_range[0] < n->t_temp_case_degc_range[1])
        && (n->t_gyro_x_lsb_range[0] < n->t_gyro_x_lsb_range[1])
        && (n->t_gyro_y_lsb_range[0] < n->t_gyro_y_lsb_range[1])
        && (n->t_gyro_z_lsb_range[0] < n->t_gyro_z_lsb_range[1])
        && (n->t_u_map.range[0] < n->t_u_map.range[1])) {
        sane = cal_testable(n);
    }
    return sane;
}

/* whether the chain gives what the blob says it gives */
static uint32_t cal_hold(const cal_numbers *n)
{
    uint32_t holds = 1U;
    uint32_t k;

    for (k = 0U; k < n->rows; k++) {
        const uint8_t *row = &n->tests[12U + (k * CAL_ROW)];
        uint32_t status = CAL_OK;
        cal_in in;
        cal_out out;

        in.temp_case_degc = cal_number(&row[0]);
        in.gyro_x_lsb = cal_number(&row[4]);
        in.gyro_y_lsb = cal_number(&row[8]);
        in.gyro_z_lsb = cal_number(&row[12]);
        out.rate_x_dps = 0.0F;
        out.rate_y_dps = 0.0F;
        out.rate_z_dps = 0.0F;
        status = cal_corrected(n, &in, &out);
        if ((status != cal_count(cal_number(&row[32]), 0x10000U))
            || (cal_near(out.rate_x_dps, cal_number(&row[16]), cal_number(&n->tests[0])) == 0U)
            || (cal_near(out.rate_y_dps, cal_number(&row[20]), cal_number(&n->tests[4])) == 0U)
            || (cal_near(out.rate_z_dps, cal_number(&row[24]), cal_number(&n->tests[8])) == 0U)) {
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
    static const uint8_t layout[8] = {0x1dU, 0xbcU, 0x3eU, 0x2fU, 0xccU, 0xa9U, 0xe5U, 0xeeU};
    const uint32_t rows = cal_u32(&blob[108]);
    uint32_t same = 1U;
    uint32_t k;

    for (k = 0U; k < 8U; k++) {
        same &= (blob[16U + k] == layout[k]) ? 1U : 0U;
    }
    if ((((uint32_t)blob[12] | ((uint32_t)blob[13] << 8U)) != 32U) || (cal_u32(&blob[104]) != CAL_NUMBERS)
        || (rows == 0U) || (rows > CAL_MOST_ROWS)) {
        same = 0U;
    } else if (cal_u32(&blob[8]) < (CAL_TESTS_AT + 12U + (rows * CAL_ROW) + 4U)) {
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
 * {"program":{"forms":["gyro-triad/1"],"formula":"rate = S(T)^-1 (indication - B(T)), in deg/s about the axes of the base","interval_s":null,"number":"f32","scales":{}}}
 * {"input":{"flag":"","meaning":"temperature of the sensor case","name":"temp_case_degc","table":"temp_case_degc_range","unit":"degC"}}
 * {"input":{"beyond":"RATE_BEYOND","flag":"FULL_SCALE","meaning":"indication of gyro x, counts per second","name":"gyro_x_lsb","table":"gyro_x_lsb_range","unit":"1/s"}}
 * {"input":{"beyond":"RATE_BEYOND","flag":"FULL_SCALE","meaning":"indication of gyro y, counts per second","name":"gyro_y_lsb","table":"gyro_y_lsb_range","unit":"1/s"}}
 * {"input":{"beyond":"RATE_BEYOND","flag":"FULL_SCALE","meaning":"indication of gyro z, counts per second","name":"gyro_z_lsb","table":"gyro_z_lsb_range","unit":"1/s"}}
 * {"map":{"flag":"TEMP_CLAMPED","group":"","name":"u","source":"temp_case_degc","table":"u_map"}}
 * {"sum":{"name":"above_x","terms":[{"factors":[],"over":"u","sign":-1,"table":"bias_x"},{"factors":["gyro_x_lsb"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"above_y","terms":[{"factors":[],"over":"u","sign":-1,"table":"bias_y"},{"factors":["gyro_y_lsb"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"above_z","terms":[{"factors":[],"over":"u","sign":-1,"table":"bias_z"},{"factors":["gyro_z_lsb"],"over":"","sign":1,"table":""}]}}
 * {"sum":{"name":"determinant","terms":[{"factors":[],"over":"u","sign":1,"table":"determinant_of_s"}]}}
 * {"sum":{"name":"numerator_x","terms":[{"factors":["above_y"],"over":"u","sign":1,"table":"inverse_xy"},{"factors":["above_z"],"over":"u","sign":1,"table":"inverse_xz"},{"factors":["above_x"],"over":"u","sign":1,"table":"inverse_xx"}]}}
 * {"quotient":{"denominator":"determinant","name":"rate_x","numerator":"numerator_x"}}
 * {"sum":{"name":"numerator_y","terms":[{"factors":["above_x"],"over":"u","sign":1,"table":"inverse_yx"},{"factors":["above_z"],"over":"u","sign":1,"table":"inverse_yz"},{"factors":["above_y"],"over":"u","sign":1,"table":"inverse_yy"}]}}
 * {"quotient":{"denominator":"determinant","name":"rate_y","numerator":"numerator_y"}}
 * {"sum":{"name":"numerator_z","terms":[{"factors":["above_x"],"over":"u","sign":1,"table":"inverse_zx"},{"factors":["above_y"],"over":"u","sign":1,"table":"inverse_zy"},{"factors":["above_z"],"over":"u","sign":1,"table":"inverse_zz"}]}}
 * {"quotient":{"denominator":"determinant","name":"rate_z","numerator":"numerator_z"}}
 * {"output":{"meaning":"rate about axis x of the base","name":"rate_x_dps","source":"rate_x","unit":"deg/s"}}
 * {"output":{"meaning":"rate about axis y of the base","name":"rate_y_dps","source":"rate_y","unit":"deg/s"}}
 * {"output":{"meaning":"rate about axis z of the base","name":"rate_z_dps","source":"rate_z","unit":"deg/s"}}
 * {"tables":[["temp_case_degc_range",2],["gyro_x_lsb_range",2],["gyro_y_lsb_range",2],["gyro_z_lsb_range",2],["u_map",4],["bias_x",4],["bias_y",4],["bias_z",4],["determinant_of_s",10],["inverse_xy",7],["inverse_xz",7],["inverse_xx",7],["inverse_yx",7],["inverse_yz",7],["inverse_yy",7],["inverse_zx",7],["inverse_zy",7],["inverse_zz",7]]}
 */
/* sha256 of all lines above: afe547ffe55e1630cd7222d1444b03ddbc4b30340bd7eae0dba12df4d71787f9 */
