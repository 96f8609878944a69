/*
 * cal: loader of blobs, correction chain as firmware; C99, no library
 *
 * layout        fb4f7a088bc46c93: a blob of any other is refused
 * forms         polynomial/1
 * number        f32: IEEE 754 single precision
 * formula       corrected = indication - bias, each channel in its unit
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
    float temp_case_degc; /* [degC] abscissa of the bias */
} cal_in;

typedef struct {
    float bias_gyro_dph; /* [deg/h] bias of gyro_dph, to be subtracted from it */
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
/* sha256 of all lines above: f4a993884e3c5217e0e4e2861940ed95b27aa9edeb42e67896b35b58160fa36a */
