/* Reset of a Cortex-M4F: hardware floating point on, variables to zero, then main, then the emulator is told the result. */

#include <stdint.h>

extern uint32_t stack_top[], bss_start[], bss_end[], data_start[], data_end[], data_image[];
int main(void);
void reset(void);

static void ended(uint32_t failed)
{
    register uint32_t operation __asm__("r0") = 0x18U; /* semihosting SYS_EXIT */
    register uint32_t reason __asm__("r1") = (failed == 0U) ? 0x20026U : 0x20023U;

    __asm__ volatile("bkpt 0xAB" : : "r"(operation), "r"(reason) : "memory");
}

void reset(void)
{
    uint32_t *from = data_image;
    uint32_t *to;

    *(volatile uint32_t *)0xE000ED88U |= 0xFU << 20U;
    for (to = data_start; to < data_end; to++) {
        *to = *from;
        from++;
    }
    for (to = bss_start; to < bss_end; to++) {
        *to = 0U;
    }
    ended((uint32_t)main());
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static const uintptr_t vectors[2] = {
    (uintptr_t)stack_top, (uintptr_t)reset
};
