/* the blob of one unit, as it would lie in flash */
    .section .rodata
    .global gyro_blob
    .global gyro_blob_end
    .balign 8
gyro_blob:
    .incbin "gyro.bin"
gyro_blob_end:
#ifndef __ARM_EABI__
    .section .note.GNU-stack,"",%progbits
#endif
