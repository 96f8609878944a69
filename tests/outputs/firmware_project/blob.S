/* two slots of flash, each with the blob of one revision */
    .section .rodata
    .global slot_a
    .global slot_a_end
    .global slot_b
    .global slot_b_end
    .balign 8
slot_a:
    .incbin "slot_a.bin"
slot_a_end:
    .balign 8
slot_b:
    .incbin "slot_b.bin"
slot_b_end:
#if !defined(__ARM_EABI__) && !defined(__riscv)
    .section .note.GNU-stack,"",%progbits
#endif
