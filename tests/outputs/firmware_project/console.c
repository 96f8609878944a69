#include "console.h"

#if defined(__ARM_EABI__)
void print_text(const char *text)
{
    register uint32_t operation __asm__("r0") = 4U; /* semihosting SYS_WRITE0 */
    register const char *argument __asm__("r1") = text;

    __asm__ volatile("bkpt 0xAB" : "+r"(operation) : "r"(argument) : "memory");
}
#elif defined(__riscv)
void print_text(const char *text)
{
    register uint32_t operation __asm__("a0") = 4U; /* semihosting SYS_WRITE0 */
    register const char *argument __asm__("a1") = text;

    __asm__ volatile(".balign 16\n.option push\n.option norvc\nslli x0, x0, 0x1f\nebreak\nsrai x0, x0, 7\n.option pop"
                     : "+r"(operation) : "r"(argument) : "memory");
}
#else
#include <stdio.h>

void print_text(const char *text)
{
    (void)fputs(text, stdout);
}
#endif

void print_hex(const char *label, uint32_t word)
{
    char digits[10];
    uint32_t k;

    for (k = 0U; k < 8U; k++) {
        digits[k] = "0123456789abcdef"[(word >> (28U - (4U * k))) & 15U];
    }
    digits[8] = '\n';
    digits[9] = '\0';
    print_text(label);
    print_text(digits);
}
