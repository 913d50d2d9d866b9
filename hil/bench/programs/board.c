/* SPDX-License-Identifier: MIT */
/* A wheel board with an IMU and the cart it moves, at any rate: the other end of the bus for every program of the bench.

   Usage: board INTERFACE CHANNEL PERIOD_NS PRIORITY
   Sends four frames each period and its status each fourth, and says "ready" on standard output. Ends when its standard
   input does, and then tells what it saw. docs/drives/wheel_board.md says how a board behaves. */
#define _GNU_SOURCE
#include "bus.h"

#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { COMMAND = 0x110, SETUP = 0x111, LEFT = 0x120, RIGHT = 0x121, GYRO = 0x122, ACCELERATION = 0x123, STATUS = 0x130 };
enum { DISABLED, ENABLED, WATCHDOG };

/* The motor, the wheel and the cart of node/models/cart.py; the current follows at once. */
#define RESISTANCE 0.64536
#define MOTOR_CONSTANT 0.1
#define INERTIA 2e-3
#define FRICTION 1e-3
#define RADIUS 0.05
#define TRACK 0.3
#define GRAVITY 9.80665

static struct {
    int state, watchdog_ms;
    unsigned sent[5];
    int last;
    int64_t commanded_ns;
    double volts[2], angle[2], velocity[2];
    long commands, refused, ticks, late;
} board = {.watchdog_ms = 50, .last = -1};

static int16_t word(const uint8_t *at)
{
    return (int16_t) (at[0] | at[1] << 8);
}

static void put(uint8_t *at, int bytes, double value)
{
    int32_t raw = (int32_t) (value + (value < 0.0 ? -0.5 : 0.5));
    for (int i = 0; i < bytes; i++)
        at[i] = (uint8_t) (raw >> 8 * i);
}

static void switch_off(int state)
{
    board.state = state;
    board.volts[0] = board.volts[1] = 0.0;
}

/* The next six counts are taken; a repeated one, or one too far on, becomes the new reference. */
static int is_next(int counter)
{
    int last = board.last, ahead = (counter - last) & 15;
    board.last = counter;
    return last < 0 || (ahead >= 1 && ahead <= 6);
}

static void obey(const frame *f, int64_t at_ns)
{
    if (f->id == SETUP && is_intact(f) && board.state != ENABLED)
        board.watchdog_ms = word(f->data);
    if (f->id != COMMAND)
        return;
    if (!is_intact(f) || !is_next(f->data[6] & 15)) {
        board.refused++;
        return;
    }
    board.commands++;
    board.commanded_ns = at_ns;
    if (!(f->data[4] & 1)) {
        switch_off(DISABLED);
    } else if (board.state != WATCHDOG) {
        board.state = ENABLED;
        board.volts[0] = word(f->data) * 1e-3;
        board.volts[1] = word(f->data + 2) * 1e-3;
    }
}

static void move(double step_s)
{
    for (int side = 0; side < 2; side++) {
        double current = (board.volts[side] - MOTOR_CONSTANT * board.velocity[side]) / RESISTANCE;
        board.velocity[side] += step_s * (MOTOR_CONSTANT * current - FRICTION * board.velocity[side]) / INERTIA;
        board.angle[side] += step_s * board.velocity[side];
    }
}

static void tell(bus *b, uint32_t id, frame f)
{
    f.id = id;
    f.length = 8;
    protect(&f, board.sent[id == STATUS ? 4 : id - LEFT]++);
    bus_send(b, &f);
}

/* What the last digits of a real IMU do; one that never changes is taken for frozen, and rightly. */
static void put_noisy(uint8_t *at, double value)
{
    static uint32_t seed = 1;
    seed = seed * 1664525u + 1013904223u;
    put(at, 2, value + (double) (seed >> 30) - 1.5);
}

static void tell_all(bus *b, int is_changed)
{
    frame empty = {.data = {0}}, f;
    for (int side = 0; side < 2; side++) {
        f = empty;
        put(f.data, 4, board.angle[side] * 1e4);
        put(f.data + 4, 2, board.velocity[side] * 1e2);
        tell(b, side ? RIGHT : LEFT, f);
    }
    put_noisy(f.data, 0.0);
    put_noisy(f.data + 2, 0.0);
    put_noisy(f.data + 4, RADIUS / TRACK * (board.velocity[1] - board.velocity[0]) * 1e3);
    tell(b, GYRO, f);
    put_noisy(f.data + 4, GRAVITY / 5e-3);
    tell(b, ACCELERATION, f);
    if (is_changed || board.ticks % 4 == 0) {
        f = empty;
        f.data[0] = (uint8_t) board.state;
        put(f.data + 1, 2, 24e3);
        put(f.data + 3, 2, board.watchdog_ms);
        f.data[5] = (uint8_t) board.refused;
        tell(b, STATUS, f);
    }
}

static void run(bus *b, int64_t period_ns)
{
    struct pollfd input = {.fd = 0, .events = POLLIN};
    int64_t deadline_ns = (now_ns() / period_ns + 1) * period_ns;
    while (poll(&input, 1, 0) == 0) {
        frame f;
        int state = board.state;
        int64_t start_ns;
        sleep_until_ns(deadline_ns);
        start_ns = now_ns();
        board.late += start_ns - deadline_ns > period_ns;
        while (bus_receive(b, &f) > 0)
            obey(&f, start_ns);
        if (board.state == ENABLED && start_ns - board.commanded_ns > board.watchdog_ms * 1000000LL)
            switch_off(WATCHDOG);
        move(1e-9 * (double) period_ns);
        tell_all(b, board.state != state);
        board.ticks++;
        deadline_ns += period_ns;
    }
}

int main(int argc, char **argv)
{
    bus b;
    if (argc != 5)
        return 2;
    if (bus_open(&b, argv[1], argv[2])) {
        perror(argv[2]);
        return 1;
    }
    be_real_time(atoi(argv[4]));
    puts("ready");
    fflush(stdout);
    run(&b, atoll(argv[3]));
    printf("{\"ticks\": %ld, \"late\": %ld, \"commands\": %ld, \"refused\": %ld, \"state\": %d}\n", board.ticks, board.late,
           board.commands, board.refused, board.state);
    return 0;
}
