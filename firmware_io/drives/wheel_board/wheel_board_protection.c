/* SPDX-License-Identifier: MIT */
#include "wheel_board_protection.h"

#define COUNTER_BYTE (6u)
#define CRC_BYTE (7u)
#define COUNTER_MASK (0x0Fu)

static uint8_t shift_in(uint8_t crc, uint8_t byte)
{
    int bit;

    crc ^= byte;
    for (bit = 0; bit < 8; bit++) {
        crc = (uint8_t)((crc & 0x80u) ? ((unsigned)crc << 1) ^ 0x2Fu : (unsigned)crc << 1);
    }
    return crc;
}

uint8_t wheel_board_crc(uint16_t id, const uint8_t *data)
{
    uint8_t crc = 0xFFu;
    size_t place;

    for (place = 0; place < CRC_BYTE; place++) {
        crc = shift_in(crc, data[place]);
    }
    crc = shift_in(crc, (uint8_t)(id & 0xFFu));
    crc = shift_in(crc, (uint8_t)(id >> 8));
    return (uint8_t)(crc ^ 0xFFu);
}

void wheel_board_protect(uint16_t id, uint8_t *counter, uint8_t *data)
{
    data[COUNTER_BYTE] = (uint8_t)((data[COUNTER_BYTE] & ~COUNTER_MASK) | (*counter & COUNTER_MASK));
    data[CRC_BYTE] = wheel_board_crc(id, data);
    *counter = (uint8_t)((*counter + 1u) & COUNTER_MASK);
}

static bool follows(struct wheel_board_sequence_t *sequence, uint8_t counter)
{
    const uint8_t ahead = (uint8_t)((counter - sequence->last) & COUNTER_MASK);
    const bool first = !sequence->started;

    /* A refused count is the new reference too, so that a sender that restarted is followed from its second frame. */
    sequence->started = true;
    sequence->last = counter;
    if (first) {
        return true;
    }
    if (ahead < 1u || ahead > WHEEL_BOARD_MAX_LOST + 1u) {
        return false;
    }
    sequence->lost += ahead - 1u;
    return true;
}

enum wheel_board_verdict wheel_board_check(
    uint16_t id, const uint8_t *data, size_t length, struct wheel_board_sequence_t *sequence)
{
    if (length != WHEEL_BOARD_FRAME_BYTES) {
        return WHEEL_BOARD_REFUSED_LENGTH;
    }
    if (wheel_board_crc(id, data) != data[CRC_BYTE]) {
        return WHEEL_BOARD_REFUSED_CRC;
    }
    if (!follows(sequence, (uint8_t)(data[COUNTER_BYTE] & COUNTER_MASK))) {
        return WHEEL_BOARD_REFUSED_COUNTER;
    }
    return WHEEL_BOARD_TAKEN;
}
