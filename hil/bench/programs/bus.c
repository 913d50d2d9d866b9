/* SPDX-License-Identifier: MIT */
#define _GNU_SOURCE
#include "bus.h"

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <linux/can.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <sched.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/random.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define PORT 48463
#define RECEIVE_BUFFER_BYTES (1 << 20)

typedef struct __attribute__((packed)) {
    char magic[4];
    uint64_t sender;
    uint64_t stamp_ns;
    uint32_t id;
    uint8_t length;
    uint8_t unused;
    uint8_t data[8];
} datagram;

static int open_socketcan(bus *b, const char *channel)
{
    struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = (int) if_nametoindex(channel)};
    b->socket = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    if (b->socket < 0 || !address.can_ifindex)
        return -1;
    return bind(b->socket, (struct sockaddr *) &address, sizeof address);
}

static int open_local(bus *b, const char *group)
{
    int yes = 1, room = RECEIVE_BUFFER_BYTES;
    unsigned char stays_here = 0;
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_port = htons(PORT)};
    struct ip_mreq member = {.imr_interface.s_addr = htonl(INADDR_LOOPBACK)};
    if (inet_pton(AF_INET, group, &address.sin_addr) != 1 ||
        getrandom(&b->sender, sizeof b->sender, 0) != sizeof b->sender)
        return -1;
    member.imr_multiaddr = address.sin_addr;
    b->socket = socket(AF_INET, SOCK_DGRAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (b->socket < 0 || setsockopt(b->socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) ||
        setsockopt(b->socket, SOL_SOCKET, SO_RCVBUF, &room, sizeof room) ||
        bind(b->socket, (struct sockaddr *) &address, sizeof address) ||
        setsockopt(b->socket, IPPROTO_IP, IP_ADD_MEMBERSHIP, &member, sizeof member) ||
        setsockopt(b->socket, IPPROTO_IP, IP_MULTICAST_IF, &member.imr_interface, sizeof member.imr_interface) ||
        setsockopt(b->socket, IPPROTO_IP, IP_MULTICAST_TTL, &stays_here, sizeof stays_here))
        return -1;
    b->address = address;
    return 0;
}

int bus_open(bus *b, const char *interface, const char *channel)
{
    b->is_local = strcmp(interface, "local") == 0;
    return b->is_local ? open_local(b, channel) : open_socketcan(b, channel);
}

static int receive_local(bus *b, frame *f)
{
    datagram d;
    for (;;) {
        ssize_t length = recv(b->socket, &d, sizeof d, 0);
        if (length < 0)
            return errno == EAGAIN ? 0 : -1;
        if (length != sizeof d || memcmp(d.magic, "ECC1", 4) || d.sender == b->sender || d.length > 8)
            continue;
        f->id = d.id;
        f->length = d.length;
        memcpy(f->data, d.data, 8);
        return 1;
    }
}

int bus_receive(bus *b, frame *f)
{
    struct can_frame c;
    ssize_t length;
    if (b->is_local)
        return receive_local(b, f);
    length = read(b->socket, &c, sizeof c);
    if (length != sizeof c)
        return errno == EAGAIN ? 0 : -1;
    f->id = c.can_id;
    f->length = c.can_dlc;
    memcpy(f->data, c.data, 8);
    return 1;
}

static int send_local(bus *b, const frame *f)
{
    struct timespec wall;
    datagram d = {.magic = {'E', 'C', 'C', '1'}, .sender = b->sender, .id = f->id, .length = f->length};
    clock_gettime(CLOCK_REALTIME, &wall);
    d.stamp_ns = (uint64_t) wall.tv_sec * 1000000000u + (uint64_t) wall.tv_nsec;
    memcpy(d.data, f->data, 8);
    return sendto(b->socket, &d, sizeof d, 0, (struct sockaddr *) &b->address, sizeof b->address) == sizeof d ? 0 : -1;
}

int bus_send(bus *b, const frame *f)
{
    struct can_frame c = {.can_id = f->id, .can_dlc = f->length};
    if (b->is_local)
        return send_local(b, f);
    memcpy(c.data, f->data, 8);
    return write(b->socket, &c, sizeof c) == sizeof c ? 0 : -1;
}

/* CRC-8H2F (AUTOSAR) over the data without its last byte and the identifier, low byte first. */
static uint8_t crc(const frame *f)
{
    static uint8_t table[256];
    uint8_t sum = 0xFF;
    if (!table[1])
        for (int value = 0; value < 256; value++) {
            uint8_t entry = (uint8_t) value;
            for (int bit = 0; bit < 8; bit++)
                entry = (uint8_t) (entry << 1 ^ (entry & 0x80 ? 0x2F : 0));
            table[value] = entry;
        }
    for (int i = 0; i < 7; i++)
        sum = table[sum ^ f->data[i]];
    sum = table[sum ^ (f->id & 0xFF)];
    return table[sum ^ (f->id >> 8 & 0xFF)] ^ 0xFF;
}

void protect(frame *f, unsigned counter)
{
    f->data[6] = counter & 0x0F;
    f->data[7] = crc(f);
}

int is_intact(const frame *f)
{
    return f->length == 8 && f->data[7] == crc(f);
}

int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t) now.tv_sec * 1000000000 + now.tv_nsec;
}

void sleep_until_ns(int64_t deadline_ns)
{
    struct timespec until = {.tv_sec = deadline_ns / 1000000000, .tv_nsec = deadline_ns % 1000000000};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &until, NULL) == EINTR)
        ;
}

void be_real_time(int priority)
{
    struct sched_param wanted = {.sched_priority = priority};
    struct rlimit room;
    if (priority > 0 && sched_setscheduler(0, SCHED_FIFO, &wanted))
        perror("no real-time priority");
    /* Where its amount is limited, nothing is locked, as in the other programs. */
    if (getrlimit(RLIMIT_MEMLOCK, &room) || room.rlim_cur != RLIM_INFINITY || mlockall(MCL_CURRENT | MCL_FUTURE))
        perror("memory is not locked");
}
