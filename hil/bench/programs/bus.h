/* SPDX-License-Identifier: MIT */
/* A CAN bus for the programs beside this file: the kernel's own, or the local bus of firmware_io/links/local_bus.py. */
#ifndef BUS_H
#define BUS_H

#include <netinet/in.h>
#include <stdint.h>

typedef struct {
    uint32_t id;
    uint8_t length;
    uint8_t data[8];
} frame;

typedef struct {
    int socket;
    int is_local;
    uint64_t sender;
    struct sockaddr_in address;
} bus;

/* Opens "socketcan" on an interface, or "local" on a multicast group; 0, or -1 with errno. */
int bus_open(bus *b, const char *interface, const char *channel);

/* Takes a frame that has arrived; 1, 0 where there is none, or -1 with errno. */
int bus_receive(bus *b, frame *f);

/* Sends a frame; 0, or -1 with errno. */
int bus_send(bus *b, const frame *f);

/* Puts counter and CRC into the last two bytes, as wheel_board.dbc describes them. */
void protect(frame *f, unsigned counter);

/* Whether length and CRC are right. */
int is_intact(const frame *f);

int64_t now_ns(void);
void sleep_until_ns(int64_t deadline_ns);

/* SCHED_FIFO at this priority where it is above 0, and memory locked; says on standard error what could not be had. */
void be_real_time(int priority);

#endif
