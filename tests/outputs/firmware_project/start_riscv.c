/* Reset of a RISC-V core of 32 bits on qemu's board `virt`: stack, variables to zero, then main, then the emulator is told the
   result. */

#include <stdint.h>

extern uint32_t bss_start[], bss_end[];
int main(void);
void begun(void);
void reset(void);

static void ended(uint32_t failed)
{
    static uint32_t reason[2];
    register uint32_t operation __asm__("a0") = 0x20U; /* semihosting SYS_EXIT_EXTENDED */
    register uint32_t *argument __asm__("a1") = reason;

    reason[0] = 0x20026U;
    reason[1] = failed;
    __asm__ volatile(".balign 16\n.option push\n.option norvc\nslli x0, x0, 0x1f\nebreak\nsrai x0, x0, 7\n.option pop"
                     : : "r"(operation), "r"(argument) : "memory");
}

void begun(void)
{
    uint32_t *to;

    for (to = bss_start; to < bss_end; to++) {
        *to = 0U;
    }
    ended((uint32_t)main());
    for (;;) {
    }
}

__attribute__((naked, section(".vectors"))) void reset(void)
{
    __asm__ volatile("la sp, stack_top\nj begun");
}
