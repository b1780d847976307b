// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * A kart on Linux or another POSIX system, with evgp_kart.h: one thread, poll, no other library.
 *
 *     cc -std=c99 -Wall -I.. posix.c -o kart && ./kart 10.0.0.1 [12017 [this kart's address]]
 *
 * Replace drive() with your kart. Here it simulates a speed. Your motors must stop by themselves when
 * no commands come: nothing in this program brakes once it has crashed or hangs.
 */
#define _DEFAULT_SOURCE /* for clock_gettime and its kin under -std=c99 */

#include <arpa/inet.h>
#include <errno.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#include "evgp_kart.h"

#define TURN_MS 20           /* one turn of the loop; at most 50 */
#define CONNECT_MS 2000U     /* how long an attempt to connect may take */
#define FIRST_WAIT_MS 500U   /* between two attempts; doubled up to LAST_WAIT_MS */
#define LAST_WAIT_MS 2000U

#ifdef CLOCK_BOOTTIME
#define KART_CLOCK CLOCK_BOOTTIME /* counts on while the computer is suspended */
#else
#define KART_CLOCK CLOCK_MONOTONIC
#endif

static volatile sig_atomic_t ending = 0;

static void end(int number)
{
    (void)number;
    ending = 1;
}

static uint32_t now_ms(void)
{
    struct timespec now;
    if (clock_gettime(KART_CLOCK, &now) != 0) {
        abort(); /* without a clock nothing may move */
    }
    return (uint32_t)((uint64_t)now.tv_sec * 1000U + (uint64_t)now.tv_nsec / 1000000U);
}

/* ----- the kart: replace this ---------------------------------------------------------------- */

static double speed = 0.0; /* m/s; measure yours */

/* Do what the state says for one turn, without waiting; return whether the kart has reached it. */
static int drive(evgp_state state, int may_drive)
{
    const double brake = state == EVGP_RED_RED ? 0.16 : 0.04; /* m/s in a turn */
    if (state == EVGP_GREEN_GREEN && may_drive) {
        speed = speed + 0.05 < 6.0 ? speed + 0.05 : 6.0;
        return speed > 0.5;
    }
    if (state == EVGP_IN_GARAGE && may_drive) {
        return 1; /* your team has it */
    }
    speed = speed > brake ? speed - brake : 0.0;
    return speed <= 0.0; /* GRID_ACTIVE: ready to race, here at once */
}

/* Wait for the next turn. What comes meanwhile is read in it, TURN_MS later at most. */
static void wait_for_turn(void)
{
    (void)poll(NULL, 0, TURN_MS);
}

/* ----- the connection ------------------------------------------------------------------------ */

typedef struct {
    struct sockaddr_in race_control, own;
    int has_own;
    int socket; /* -1: there is none */
    int connecting;
    uint32_t since; /* began to connect, or lost the connection */
    uint32_t wait;
} connection;

static void give_up(connection *link, evgp_kart *kart, uint32_t now)
{
    if (link->socket >= 0) {
        close(link->socket);
    }
    link->socket = -1;
    link->connecting = 0;
    link->since = now;
    evgp_kart_closed(kart, now);
}

static void begin(connection *link, evgp_kart *kart, uint32_t now)
{
    const int yes = 1;
    int flags;
    link->socket = socket(AF_INET, SOCK_STREAM, 0);
    link->since = now;
    if (link->socket < 0) {
        return; /* again after the wait */
    }
    flags = fcntl(link->socket, F_GETFL);
    if (flags < 0 || fcntl(link->socket, F_SETFL, flags | O_NONBLOCK) != 0 ||
        setsockopt(link->socket, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes) != 0 ||
        (link->has_own &&
         bind(link->socket, (struct sockaddr *)&link->own, sizeof link->own) != 0) ||
        (connect(link->socket, (struct sockaddr *)&link->race_control,
                 sizeof link->race_control) != 0 &&
         errno != EINPROGRESS)) {
        perror("connecting");
        give_up(link, kart, now);
        return;
    }
    link->connecting = 1;
}

/* Send a frame; return whether the kernel took all of it: half a frame is no connection. */
static int say_to(const connection *link, const char *frame)
{
    return send(link->socket, frame, strlen(frame), MSG_NOSIGNAL) == (ssize_t)strlen(frame);
}

/* Take all that has come; return whether the connection still holds. */
static int receive(connection *link, evgp_kart *kart)
{
    char bytes[1024];
    int reads;
    for (reads = 0; reads < 64; reads++) { /* no flood holds the brake up */
        const ssize_t count = recv(link->socket, bytes, sizeof bytes, 0);
        if (count == 0) {
            return 0;
        }
        if (count < 0) {
            return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
        }
        evgp_kart_received(kart, bytes, (size_t)count, now_ms());
    }
    return 0; /* race control does not send that much */
}

/* Let the connection do what it can without waiting. */
static void serve(connection *link, evgp_kart *kart, short events, uint32_t now)
{
    if (link->socket < 0) {
        if ((uint32_t)(now - link->since) >= link->wait) {
            link->wait = 2 * link->wait < LAST_WAIT_MS ? 2 * link->wait : LAST_WAIT_MS;
            begin(link, kart, now);
        }
    } else if (link->connecting) {
        int error = 0;
        socklen_t size = sizeof error;
        if (events != 0 &&
            getsockopt(link->socket, SOL_SOCKET, SO_ERROR, &error, &size) == 0 && error == 0) {
            link->connecting = 0;
            evgp_kart_connected(kart, now);
        } else if (events != 0 || (uint32_t)(now - link->since) >= CONNECT_MS) {
            give_up(link, kart, now);
        }
    } else if (!receive(link, kart) || !evgp_kart_verdict(kart).open) {
        give_up(link, kart, now);
    } else if (evgp_kart_verdict(kart).commanded != EVGP_NONE) {
        link->wait = FIRST_WAIT_MS;
    }
}

static int read_address(const char *address, const char *port, struct sockaddr_in *result)
{
    char *rest;
    const unsigned long number = strtoul(port, &rest, 10);
    memset(result, 0, sizeof *result);
    result->sin_family = AF_INET;
    result->sin_port = htons((uint16_t)number);
    return *rest == 0 && number <= 65535 && inet_pton(AF_INET, address, &result->sin_addr) == 1;
}

int main(int argc, char **argv)
{
    connection link;
    evgp_kart kart;
    evgp_verdict told;
    memset(&link, 0, sizeof link);
    link.socket = -1;
    link.wait = FIRST_WAIT_MS;
    link.has_own = argc > 3;
    if (argc < 2 || argc > 4 ||
        !read_address(argv[1], argc > 2 ? argv[2] : "12017", &link.race_control) ||
        (link.has_own && !read_address(argv[3], "0", &link.own))) {
        fprintf(stderr, "usage: %s RACE_CONTROL [PORT [OWN_ADDRESS]], IPv4 addresses\n", argv[0]);
        return 2;
    }
    signal(SIGINT, end);
    signal(SIGTERM, end);
    evgp_kart_init(&kart, evgp_default_settings(), now_ms());
    link.since = now_ms() - link.wait; /* the first attempt at once */
    memset(&told, 0, sizeof told);

    while (!ending || speed > 0.0) {
        struct pollfd look;
        evgp_verdict verdict;
        uint32_t now;
        int reached;
        wait_for_turn();
        look.fd = link.socket; /* poll passes over -1 */
        look.events = POLLOUT; /* a connection that is being made is made, or has failed */
        look.revents = 0;
        (void)poll(&look, 1, 0);
        now = now_ms();
        evgp_kart_tick(&kart, now); /* before anything that came is believed */
        serve(&link, &kart, look.revents, now);

        verdict = evgp_kart_verdict(&kart);
        if (verdict.obey != told.obey || verdict.order != told.order) {
            printf("obey %s %s\n", evgp_name(verdict.obey), evgp_kart_reason(&kart));
            fflush(stdout);
            told = verdict;
        }
        reached = drive(ending ? EVGP_RED_RED : verdict.obey, !ending && verdict.may_drive);
        if (reached && !ending) {
            const char *say = evgp_kart_acknowledge(&kart, verdict.order, now_ms());
            if (say != NULL && !say_to(&link, say)) {
                give_up(&link, &kart, now_ms());
            }
        }
    }
    return 0;
}
