/*
 * cal: loader of blobs, correction chain as firmware; C99, no library
 *
 * layout        8f085b1a95605754: a blob of any other is refused
 * forms         gyro-scale/1
 * number        f32: IEEE 754 single precision
 * formula       rate = (indication - F0(T)) / K(T), in deg/s, zero at rest on the laboratory's table
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
#define CAL_RATE_CLAMPED 0x0001U /* rate outside its range: the end of the range was used */
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
#define CAL_LOAD_VALUES 8U /* a number that is not finite, or a range without a width */
#define CAL_LOAD_VECTORS 9U /* its numbers do not give the results that it states */

typedef struct {
    float temp_case_degc; /* [degC] temperature of the sensor case */
    float gyro_x_lsb; /* [1/s] indication of gyro x, counts per second */
} cal_in;

typedef struct {
    float gyro_x_dps; /* [deg/s] rate about the axis of gyro x */
} cal_out;

/* takes the numbers of a blob, which must stay where it is for cal_selftest; 0 = loaded; until then, and after a
   rejection, nothing is corrected */
uint32_t cal_load(const uint8_t blob[], uint32_t size);

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
/* sha256 of all lines above: 486576174171e9e7463c849862c8b13bc3af8843d1c4b8c4f57ab5bdaaa5c3de */
