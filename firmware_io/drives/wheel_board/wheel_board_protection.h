/* SPDX-License-Identifier: MIT */
/*
 * End-to-end protection of the wheel board's frames: a message counter and a CRC in their last two bytes.
 *
 * wheel_board.c, which cantools generates, packs and scales the signals and knows nothing of either. To send: encode and
 * pack as wheel_board.h says, then protect. To receive: check, and only then unpack, look that every signal is in range,
 * and use them.
 *
 * The counter is in the low nibble of byte 6. The CRC in byte 7 is AUTOSAR's CRC-8H2F (polynomial 0x2F, initial value
 * 0xFF, final XOR 0xFF) over bytes 0 to 6 and the identifier, low byte first.
 *
 * Commands of version 2 (identifiers 0x112 to 0x114) have a session, a counter of 32 bits, of which the frame carries
 * 15, and a CRC-32 instead: wheel_board_take checks them, and joins the two frames of a command.
 */
#ifndef WHEEL_BOARD_PROTECTION_H
#define WHEEL_BOARD_PROTECTION_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Bytes in every frame. */
#define WHEEL_BOARD_FRAME_BYTES (8u)

/* Frames in a row that may be missing before the sequence counts as broken. */
#define WHEEL_BOARD_MAX_LOST (5u)

enum wheel_board_verdict {
    WHEEL_BOARD_TAKEN = 0,
    WHEEL_BOARD_REFUSED_LENGTH,
    WHEEL_BOARD_REFUSED_CRC,
    WHEEL_BOARD_REFUSED_COUNTER,
    WHEEL_BOARD_REFUSED_RANGE,
    WHEEL_BOARD_HALF /* not refused: the left wheel's frame of a command, which waits for the right one's */
};

/* What is remembered of the frames of one identifier on one line; all zero before the first. */
struct wheel_board_sequence_t {
    bool started;
    uint8_t last;
    uint32_t lost; /* frames missing between those that were taken */
};

/* CRC of a frame from its first seven bytes and its identifier. */
uint8_t wheel_board_crc(uint16_t id, const uint8_t *data);

/* Put the counter (modulo 16, then counted up) and the CRC on a packed frame of eight bytes. Keep one counter for each
 * identifier on each line, and count up also where a frame could not be sent. */
void wheel_board_protect(uint16_t id, uint8_t *counter, uint8_t *data);

/* Whether a received frame may be used; a frame that may not be must change nothing, and be counted. */
enum wheel_board_verdict wheel_board_check(
    uint16_t id, const uint8_t *data, size_t length, struct wheel_board_sequence_t *sequence);

/* How far ahead of the newest command the next may be. */
#define WHEEL_BOARD_WINDOW (64u)

/* Left wheels' frames that wait on a line. */
#define WHEEL_BOARD_LEFTS (4u)

/* A session, which all lines share. To begin one: a number that this board never had before (a count in flash, or a
 * random number), and counter 0. BOARD_SESSION announces number and counter >> 15. */
struct wheel_board_session_t {
    uint32_t number;
    uint32_t counter; /* of the newest command */
};

/* What waits on one line; all zero before the first frame. */
struct wheel_board_line_t {
    struct {
        bool waits;
        uint32_t counter;
        uint32_t order;
        uint16_t word;
        int16_t voltage;
    } lefts[WHEEL_BOARD_LEFTS];
    uint32_t order;
};

/* A whole command of version 2. */
struct wheel_board_command_t {
    int16_t left_mv;
    int16_t right_mv;
    bool enable;
};

/* Code of a frame of version 2 from its first four bytes: CRC-32 (as in zlib) over session, counter, identifier, bytes. */
uint32_t wheel_board_code(uint32_t session, uint32_t counter, uint16_t id, const uint8_t *data);

/* Check a frame with identifier 0x112 to 0x114. TAKEN: of 0x114 the command is whole, and in `command`; of 0x112 unpack
 * the setup, and look that it is in range. Whatever is refused has changed nothing, and must be counted. */
enum wheel_board_verdict wheel_board_take(
    uint16_t id, const uint8_t *data, size_t length, struct wheel_board_session_t *session,
    struct wheel_board_line_t *line, struct wheel_board_command_t *command);

#ifdef __cplusplus
}
#endif

#endif
