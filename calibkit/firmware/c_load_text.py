"""The C of a loader that is the same for all chains; marks beginning with @ are filled in."""

BARRIER = """/* what a slot holds is in memory before it is in use; define it for other compilers and several cores */
#ifndef CAL_BARRIER
#ifdef __GNUC__
#define CAL_BARRIER() __sync_synchronize()
#else
#define CAL_BARRIER() ((void)0)
#endif
#endif
"""
BYTES = """/* one byte after the other, whatever the core's own order */
static uint32_t @p_u32(const uint8_t bytes[])
{
    return (uint32_t)bytes[0] | ((uint32_t)bytes[1] << 8U) | ((uint32_t)bytes[2] << 16U)
        | ((uint32_t)bytes[3] << 24U);
}

/* CRC-32 of IEEE 802.3 */
static uint32_t @p_crc(const uint8_t bytes[], uint32_t count)
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
    @bits bits;
    @real value;
} @p_bits;

static @real @p_number(const uint8_t bytes[])
{
    @p_bits number;

    number.bits = @take;
    return number.value;
}

static @real @p_none(void)
{
    @p_bits number;

    number.bits = @nan;
    return number.value;
}

/* a number as a count below most, or most where it is none */
static uint32_t @p_count(@real x, uint32_t most)
{
    uint32_t count = most;

    if ((x >= @zero) && (x < (@real)most)) {
        count = (uint32_t)x;
    }
    return count;
}
"""
HEAD = """/* why the frame of a blob is not taken; @P_LOADED where it is right */
static uint32_t @p_frame(const uint8_t blob[], uint32_t size)
{
    static const uint8_t digits[9] = {0x31U, 0x32U, 0x33U, 0x34U, 0x35U, 0x36U, 0x37U, 0x38U, 0x39U};
    const uint32_t length = (size >= @headU) ? @p_u32(&blob[8]) : 0U;
    uint32_t reason = @P_LOADED;

    if (@p_crc(digits, 9U) != 0xCBF43926U) {
        reason = @P_LOAD_CRC_ENGINE;
    } else if ((length < @leastU) || (length > size)) {
        reason = @P_LOAD_LENGTH;
    } else if (@p_u32(blob) != @magic) {
        reason = @P_LOAD_MAGIC;
    } else if (((uint32_t)blob[4] | ((uint32_t)blob[5] << 8U)) != @majorU) {
        reason = @P_LOAD_SCHEMA;
    } else if (@p_crc(blob, length - 4U) != @p_u32(&blob[length - 4U])) {
        reason = @P_LOAD_CRC;
    } else {
        /* whole */
    }
    return reason;
}

/* whether a blob with a right frame is laid out for this loader, and holds all that it counts */
static uint32_t @p_laid_out(const uint8_t blob[])
{
    static const uint8_t layout[8] = {@layout};
    const uint32_t rows = @p_u32(&blob[108]);
    uint32_t same = 1U;
    uint32_t k;

    for (k = 0U; k < 8U; k++) {
        same &= (blob[16U + k] == layout[k]) ? 1U : 0U;
    }
    if ((((uint32_t)blob[12] | ((uint32_t)blob[13] << 8U)) != @widthU) || (@p_u32(&blob[104]) != @P_NUMBERS)
        || (rows == 0U) || (rows > @P_MOST_ROWS)) {
        same = 0U;
    } else if (@p_u32(&blob[8]) < (@P_TESTS_AT + @outsU + (rows * @P_ROW) + 4U)) {
        same = 0U;
    } else {
        /* all there */
    }
    return same;
}

/* whether a blob is for the device that is expected */
static uint32_t @p_is_for(const uint8_t blob[], const char *serial)
{
    uint32_t same = 1U;
    uint32_t ended = 0U;
    uint32_t k;

    for (k = 0U; k < @serialU; k++) {
        const uint32_t wanted = (ended != 0U) ? 0U : (uint32_t)(uint8_t)serial[k];

        ended |= (wanted == 0U) ? 1U : 0U;
        same &= (wanted == (uint32_t)blob[28U + k]) ? 1U : 0U;
    }
    return (ended != 0U) ? same : (same & ((serial[@serial] == '\\0') ? 1U : 0U));
}

/* whom the numbers are of */
static void @p_name(const uint8_t blob[], @p_numbers *n)
{
    uint32_t k;

    for (k = 0U; k < @serialU; k++) {
        n->serial[k] = (char)blob[28U + k];
    }
    n->serial[@serial] = '\\0';
    for (k = 0U; k < 32U; k++) {
        n->digest[k] = blob[60U + k];
    }
    for (k = 0U; k < 12U; k++) {
        n->date[k] = (char)blob[92U + k];
    }
    n->date[12] = '\\0';
    n->revision = @p_u32(&blob[24]);
    n->tests = &blob[@P_TESTS_AT];
    n->rows = @p_u32(&blob[108]);
}

uint32_t @p_load(@p_unit *unit, const uint8_t blob[], uint32_t size, const char *serial,
    uint32_t least_revision)
{
    uint32_t next = 1U;
    @p_numbers *n = &unit->slots[0];
    uint32_t reason = @p_frame(blob, size);

    if (unit->active == 1U) {
        next = 2U;
        n = &unit->slots[1];
    }
    if (reason == @P_LOADED) {
        if (@p_laid_out(blob) == 0U) {
            reason = @P_LOAD_LAYOUT;
#ifndef CAL_ALLOW_REJECTED
        } else if ((blob[14] & 1U) == 0U) {
            reason = @P_LOAD_REJECTED;
#endif
        } else if ((serial != NULL) && (@p_is_for(blob, serial) == 0U)) {
            reason = @P_LOAD_SERIAL;
        } else if (@p_u32(&blob[24]) < least_revision) {
            reason = @P_LOAD_REVISION;
        } else {
            @p_name(blob, n);
            if ((@p_fill(n, &blob[@head]) == 0U) || (@p_sane(n) == 0U)) {
                reason = @P_LOAD_VALUES;
            } else if (@p_hold(n) == 0U) {
                reason = @P_LOAD_VECTORS;
            } else {
                CAL_BARRIER();
                unit->active = next;
            }
        }
    }
    return reason;
}
"""
