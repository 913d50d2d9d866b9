/* SPDX-License-Identifier: MIT */
/* The least that does the work: sleeps to the deadline, takes the frames, steps the model, sends. The limit of the bench.

   Usage: loop INTERFACE CHANNEL GUARD PERIOD_NS CYCLES PRIORITY SAMPLES
   CHANNEL is an interface of the kernel, or the multicast group of a local bus; "-" leaves all work out and only sleeps.
   GUARD is an abstract Unix address that is told each cycle that the loop lives. SAMPLES is where `sample`s are written.
   The model is linked in: any C submodel of 20-sim with these ports. */
#define _GNU_SOURCE
#include "bus.h"

#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "xxsubmod.h"

enum { COMMAND = 0x110, SETUP = 0x111, LEFT = 0x120, RIGHT = 0x121, GYRO = 0x122, ACCELERATION = 0x123, STATUS = 0x130 };
enum { OFF_CYCLES = 20 }; /* a board whose watchdog switched it off is left off by commands that do not enable */

typedef struct {
    int64_t deadline_ns, start_ns, cpu_ns, bus_ns, model_ns, ros_ns, cycle_ns;
} sample;

static struct {
    double left_angle, left_velocity, right_angle, right_velocity, gyro[3], acceleration[3];
    int state;
} measured;

static int64_t cpu_ns(void)
{
    struct timespec used;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &used);
    return (int64_t) used.tv_sec * 1000000000 + used.tv_nsec;
}

static int16_t word(const uint8_t *at)
{
    return (int16_t) (at[0] | at[1] << 8);
}

static int32_t long_word(const uint8_t *at)
{
    return (int32_t) (at[0] | at[1] << 8 | at[2] << 16 | (uint32_t) at[3] << 24);
}

static void axes(const frame *f, double *to, double unit)
{
    for (int axis = 0; axis < 3; axis++)
        to[axis] = word(f->data + 2 * axis) * unit;
}

static void take(const frame *f)
{
    if (!is_intact(f))
        return;
    switch (f->id) {
    case LEFT:
        measured.left_angle = long_word(f->data) * 1e-4;
        measured.left_velocity = word(f->data + 4) * 1e-2;
        break;
    case RIGHT:
        measured.right_angle = long_word(f->data) * 1e-4;
        measured.right_velocity = word(f->data + 4) * 1e-2;
        break;
    case GYRO:
        axes(f, measured.gyro, 1e-3);
        break;
    case ACCELERATION:
        axes(f, measured.acceleration, 5e-3);
        break;
    case STATUS:
        measured.state = f->data[0] & 7;
        break;
    }
}

static void put_voltage(uint8_t *at, double volts)
{
    double within = volts > 30.0 ? 30.0 : volts < -30.0 ? -30.0 : volts;
    int16_t millivolts = (int16_t) (within * 1000.0 + (within < 0.0 ? -0.5 : 0.5));
    at[0] = (uint8_t) millivolts;
    at[1] = (uint8_t) (millivolts >> 8);
}

static void command(bus *b, int64_t cycle, const double *y)
{
    frame f = {.id = COMMAND, .length = 8};
    if (cycle >= OFF_CYCLES) {
        put_voltage(f.data, y[5]);
        put_voltage(f.data + 2, y[6]);
        f.data[4] = 1;
    }
    protect(&f, (unsigned) cycle);
    bus_send(b, &f);
}

static int guard_socket(const char *name, struct sockaddr_un *address, socklen_t *length)
{
    memset(address, 0, sizeof *address);
    address->sun_family = AF_UNIX;
    strncpy(address->sun_path + 1, name, sizeof address->sun_path - 2);
    *length = (socklen_t) (offsetof(struct sockaddr_un, sun_path) + 1 + strlen(name));
    return socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
}

/* Runs for the time of so many cycles, and returns how many there were. */
static int64_t run(bus *b, const char *guard, int64_t period_ns, int64_t cycles, sample *samples)
{
    struct sockaddr_un address;
    socklen_t length;
    int heartbeat = guard_socket(guard, &address, &length);
    double u[4] = {0.0, 0.0, 0.0, 0.0}, y[7];
    int64_t deadline_ns = now_ns() + period_ns, end_ns = deadline_ns + cycles * period_ns, cycle;
    XXInitializeSubmodel(u, y, 0.0);
    for (cycle = 0; cycle < cycles && deadline_ns < end_ns; cycle++) {
        sample *s = samples + cycle;
        frame f;
        sleep_until_ns(deadline_ns);
        s->deadline_ns = deadline_ns;
        s->start_ns = now_ns();
        s->cpu_ns = cpu_ns();
        if (b) {
            int64_t received_ns, stepped_ns, end_ns;
            while (bus_receive(b, &f) > 0)
                take(&f);
            received_ns = now_ns();
            u[2] = measured.left_velocity;
            u[3] = measured.right_velocity;
            XXCalculateSubmodel(u, y, (double) cycle * 1e-9 * (double) period_ns);
            stepped_ns = now_ns();
            command(b, cycle, y);
            sendto(heartbeat, "\1", 1, 0, (struct sockaddr *) &address, length);
            end_ns = now_ns();
            s->bus_ns = received_ns - s->start_ns + end_ns - stepped_ns;
            s->model_ns = stepped_ns - received_ns;
            s->cycle_ns = end_ns - s->start_ns;
        }
        deadline_ns += period_ns;
        if (now_ns() > deadline_ns) /* whole periods that were lost are skipped, as in the other programs */
            deadline_ns += (now_ns() - deadline_ns) / period_ns * period_ns;
    }
    return cycle;
}

int main(int argc, char **argv)
{
    bus b;
    int64_t cycles;
    sample *samples;
    FILE *file;
    if (argc != 8)
        return 2;
    cycles = atoll(argv[5]);
    samples = calloc((size_t) cycles, sizeof *samples);
    if (!samples)
        return 1;
    if (strcmp(argv[2], "-") && bus_open(&b, argv[1], argv[2])) {
        perror(argv[2]);
        return 1;
    }
    be_real_time(atoi(argv[6]));
    cycles = run(strcmp(argv[2], "-") ? &b : NULL, argv[3], atoll(argv[4]), cycles, samples);
    file = fopen(argv[7], "wb");
    if (!file || fwrite(samples, sizeof *samples, (size_t) cycles, file) != (size_t) cycles || fclose(file)) {
        perror(argv[7]);
        return 1;
    }
    return 0;
}
