/* SPDX-License-Identifier: MIT */
#include "wheel_board_protection.h"

#define COUNTER_BYTE (6u)
#define CRC_BYTE (7u)
#define COUNTER_MASK (0x0Fu)
#define CARRIED_MASK (0x7FFFu)
#define ENABLE_BIT (0x8000u)
#define CODED_BYTES (4u)
#define MAX_MV (30000)
#define SETUP_ID (0x112u)
#define LEFT_ID (0x113u)

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

static uint32_t shift_in_32(uint32_t crc, uint32_t value, unsigned bytes)
{
    unsigned byte;
    int bit;

    for (byte = 0; byte < bytes; byte++) {
        crc ^= (value >> (8u * byte)) & 0xFFu;
        for (bit = 0; bit < 8; bit++) {
            crc = (crc & 1u) ? (crc >> 1) ^ 0xEDB88320u : crc >> 1;
        }
    }
    return crc;
}

uint32_t wheel_board_code(uint32_t session, uint32_t counter, uint16_t id, const uint8_t *data)
{
    uint32_t crc = shift_in_32(0xFFFFFFFFu, session, 4u);
    size_t place;

    crc = shift_in_32(crc, counter, 4u);
    crc = shift_in_32(crc, id, 2u);
    for (place = 0; place < CODED_BYTES; place++) {
        crc = shift_in_32(crc, data[place], 1u);
    }
    return crc ^ 0xFFFFFFFFu;
}

static void keep_left(struct wheel_board_line_t *line, uint32_t counter, uint16_t word, int16_t voltage)
{
    unsigned place, chosen = 0;
    bool same = false;

    for (place = 0; place < WHEEL_BOARD_LEFTS; place++) {
        if (line->lefts[place].waits && line->lefts[place].counter == counter) {
            chosen = place;
            same = true;
        }
    }
    for (place = 1; !same && place < WHEEL_BOARD_LEFTS && line->lefts[chosen].waits; place++) {
        if (!line->lefts[place].waits || line->lefts[place].order < line->lefts[chosen].order) {
            chosen = place;
        }
    }
    if (!same) {
        line->lefts[chosen].order = line->order++;
    }
    line->lefts[chosen].waits = true;
    line->lefts[chosen].counter = counter;
    line->lefts[chosen].word = word;
    line->lefts[chosen].voltage = voltage;
}

static bool join(
    struct wheel_board_line_t *line, uint32_t counter, uint16_t word, struct wheel_board_command_t *command)
{
    unsigned place;

    for (place = 0; place < WHEEL_BOARD_LEFTS; place++) {
        if (line->lefts[place].waits && line->lefts[place].counter == counter) {
            line->lefts[place].waits = false;
            command->left_mv = line->lefts[place].voltage;
            return line->lefts[place].word == word;
        }
    }
    return false;
}

enum wheel_board_verdict wheel_board_take(
    uint16_t id, const uint8_t *data, size_t length, struct wheel_board_session_t *session,
    struct wheel_board_line_t *line, struct wheel_board_command_t *command)
{
    uint16_t word;
    uint32_t ahead, code;
    int32_t voltage;

    if (length != WHEEL_BOARD_FRAME_BYTES) {
        return WHEEL_BOARD_REFUSED_LENGTH;
    }
    word = (uint16_t)(data[2] | ((unsigned)data[3] << 8));
    ahead = ((uint32_t)word - session->counter) & CARRIED_MASK;
    if (ahead < 1u || ahead > WHEEL_BOARD_WINDOW) {
        return WHEEL_BOARD_REFUSED_COUNTER;
    }
    code = data[4] | ((uint32_t)data[5] << 8) | ((uint32_t)data[6] << 16) | ((uint32_t)data[7] << 24);
    if (code != wheel_board_code(session->number, session->counter + ahead, id, data)) {
        return WHEEL_BOARD_REFUSED_CRC;
    }
    if (id == SETUP_ID) {
        return WHEEL_BOARD_TAKEN;
    }
    voltage = (int32_t)(data[0] | ((unsigned)data[1] << 8));
    voltage -= voltage > 0x7FFF ? 0x10000 : 0;
    if (voltage < -MAX_MV || voltage > MAX_MV) {
        return WHEEL_BOARD_REFUSED_RANGE;
    }
    if (id == LEFT_ID) {
        keep_left(line, session->counter + ahead, word, (int16_t)voltage);
        return WHEEL_BOARD_HALF;
    }
    if (!join(line, session->counter + ahead, word, command)) {
        return WHEEL_BOARD_REFUSED_COUNTER;
    }
    session->counter += ahead;
    command->right_mv = (int16_t)voltage;
    command->enable = (word & ENABLE_BIT) != 0;
    return WHEEL_BOARD_TAKEN;
}
