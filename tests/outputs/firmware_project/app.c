/* What a product does with a correction: find the newest good numbers among two slots of flash, fall back to the other, prove
   them, then correct readings by the clock, keep to the status, and take new numbers without ever being without good ones. */

#include <stddef.h>

#include "console.h"
#include "drift.h"
#include "gyro.h"

extern const uint8_t slot_a[], slot_a_end[], slot_b[], slot_b_end[];

static gyro_unit gyro;         /* instance struct of the scale factor, loaded from a slot */
static drift_state warm;       /* state of the drift, whose numbers are compiled in */

static uint32_t load(const char *name, const uint8_t *slot, const uint8_t *end, uint32_t least_revision)
{
    const uint32_t reason = gyro_load(&gyro, slot, (uint32_t)(end - slot), "GYRO-0001", least_revision);

    print_text(name);
    print_hex(" load ", reason);
    return reason;
}

static void print_rate(float indication, float temperature)
{
    gyro_in in;
    gyro_out out;
    uint32_t status;
    union { float value; uint32_t bits; } rate;

    in.gyro_x_lsb = indication;
    in.temp_case_degc = temperature;
    status = gyro_correct(&gyro, &in, &out);
    rate.value = out.gyro_x_dps;
    print_hex("rate bits ", rate.bits);
    print_hex("   status ", status);
}

static void print_drift(uint32_t elapsed_ms, float temperature)
{
    drift_in in;
    drift_out out;
    uint32_t status;
    union { float value; uint32_t bits; } drift;

    in.temp_case_degc = temperature;
    status = drift_update(&warm, elapsed_ms, &in, &out);
    drift_between(&warm, DRIFT_INTERVAL_MS / 2U, &out);
    drift.value = out.drift_dph;
    print_hex("drift bits ", drift.bits);
    print_hex("    status ", status);
}

int main(void)
{
    const float nothing = 0.0F;

    gyro_init(&gyro);
    drift_reset(&warm);
    /* slot b is newer; where it is not good, slot a is what the product had before */
    if ((load("slot b", slot_b, slot_b_end, 2U) != GYRO_LOADED) && (load("slot a", slot_a, slot_a_end, 1U) != GYRO_LOADED)) {
        print_text("no good numbers: nothing is corrected\n");
        return 1;
    }
    print_text(gyro_serial(&gyro));
    print_hex(" revision ", gyro_revision(&gyro));
    if ((gyro_selftest(&gyro) != 0) || (drift_selftest() != 0)) {
        print_text("self-test failed: nothing is corrected\n");
        return 1;
    }
    print_text("self-test passed\n");
    print_rate(0.0F, 25.0F);
    print_rate(123456.0F, 25.0F);
    print_rate(-987654.0F, -20.0F);
    print_rate(50000.0F, 200.0F);
    print_drift(0U, 25.0F);
    print_drift(DRIFT_INTERVAL_MS, 25.5F);
    print_drift(3U * DRIFT_INTERVAL_MS, 26.5F);      /* two updates were missed: bridged */
    print_drift(DRIFT_INTERVAL_MS, nothing / nothing); /* no thermometer: the drift is held */
    print_drift(DRIFT_INTERVAL_MS, 85.0F);           /* a glitch: not used */
    print_drift(DRIFT_INTERVAL_MS, 27.5F);
    /* an update over the air that is not good is refused; what was good stays in use */
    (void)load("wrong slot", slot_b + 4, slot_b_end, 0U);
    print_hex("still revision ", gyro_revision(&gyro));
    print_rate(123456.0F, 25.0F);
    return 0;
}
