/* What a product would do: prove the correction once after the start, then correct every reading and heed its status. */

#include "console.h"
#include "gyro.h"

#ifdef FROM_BLOB
extern const uint8_t gyro_blob[];
extern const uint8_t gyro_blob_end[];
#endif

static void print_rate(float indication, float temperature)
{
    gyro_in in;
    gyro_out out;
    uint32_t status;
    union { float value; uint32_t bits; } rate;

    in.gyro_x_lsb = indication;
    in.temp_case_degc = temperature;
    status = gyro_correct(&in, &out);
    rate.value = out.gyro_x_dps;
    print_hex("rate bits ", rate.bits);
    print_hex("   status ", status);
}

int main(void)
{
    int failed = 0;

#ifdef FROM_BLOB
    const uint32_t reason = gyro_load(gyro_blob, (uint32_t)(gyro_blob_end - gyro_blob));

    if (reason != GYRO_LOADED) {
        print_hex("blob refused: reason ", reason);
        return 1;
    }
#endif
    if (gyro_selftest() != 0) {
        print_text("self-test failed: the rate is not corrected\n");
        failed = 1;
    } else {
        print_text("self-test passed\n");
        print_rate(0.0F, 25.0F);
        print_rate(123456.0F, 25.0F);
        print_rate(-987654.0F, -20.0F);
        print_rate(50000.0F, 200.0F);
    }
    return failed;
}
