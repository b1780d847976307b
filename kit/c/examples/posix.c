// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * A kart on Linux or another POSIX system, with evgp_board.h: one thread, poll, no other library.
 *
 *     cc -std=c99 -Wall -I.. posix.c -o a-kart && ./a-kart 10.0.0.1 [12017 [this kart's address]]
 *
 * Replace the part about the kart, which simulates a speed. Your motors must stop when commands stop
 * coming: nothing in this program brakes after it has crashed, or while it hangs.
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

#include "evgp_board.h"

#define TURN_MS 20     /* one turn of the loop; at most 50 */
#define CONNECT_MS 300 /* maximum time of an attempt to connect */

#ifdef CLOCK_BOOTTIME
#define KART_CLOCK CLOCK_BOOTTIME /* includes suspend */
#else
#define KART_CLOCK CLOCK_MONOTONIC
#endif

static volatile sig_atomic_t ending = 0;

static void end(int number)
{
    (void)number;
    ending = 1;
}

static uint32_t now(void)
{
    struct timespec time;
    if (clock_gettime(KART_CLOCK, &time) != 0) {
        abort(); /* without a clock nothing may move */
    }
    return (uint32_t)((uint64_t)time.tv_sec * 1000U + (uint64_t)time.tv_nsec / 1000000U);
}

/* ----- the kart: replace this ---------------------------------------------------------------- */

#ifdef EVGP_KART
#include EVGP_KART /* another kart, such as that of kit/sim */
#else
static evgp_action action;
static double speed = 0.0; /* m/s; measure yours */

static void act(evgp_action what) { action = what; }
static int moves(void) { return speed > 0.0; }
static int ready(void) { return 1; }

/* Drive for one turn, without waiting. */
static void drive(void)
{
    const double brake = action == EVGP_BRAKE ? 0.16 : 0.04; /* m/s in a turn */
    if (action == EVGP_DRIVE) {
        speed = speed + 0.1 < 6.0 ? speed + 0.1 : 6.0;
    } else {
        speed = speed > brake ? speed - brake : 0.0;
    }
}
#endif

/* Wait for the next turn. Bytes that arrive meanwhile are read at most TURN_MS later. */
static void wait_for_turn(void)
{
    (void)poll(NULL, 0, TURN_MS);
}

/* Return whether a terminal takes text now: a kart that waits for it does not stop. */
static int takes_text(int terminal)
{
    struct pollfd look;
    look.fd = terminal;
    look.events = POLLOUT;
    return poll(&look, 1, 0) == 1;
}

/* ----- the connection ------------------------------------------------------------------------ */

static struct sockaddr_in race_control, own;
static int has_own;
static int link_to = -1;

static int joined(void) { return 1; } /* the system joins networks */
static void join(void) {}

static void hang_up(void)
{
    if (link_to >= 0) {
        close(link_to);
    }
    link_to = -1;
}

static int connect_it(void)
{
    const int yes = 1;
    int flags, error = 0;
    socklen_t size = sizeof error;
    struct pollfd look;
    link_to = socket(AF_INET, SOCK_STREAM, 0);
    flags = fcntl(link_to, F_GETFL);
    look.fd = link_to;
    look.events = POLLOUT;
    if (flags < 0 || fcntl(link_to, F_SETFL, flags | O_NONBLOCK) != 0 ||
        setsockopt(link_to, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes) != 0 ||
        (has_own && bind(link_to, (struct sockaddr *)&own, sizeof own) != 0) ||
        (connect(link_to, (struct sockaddr *)&race_control, sizeof race_control) != 0 &&
         errno != EINPROGRESS)) {
        error = errno;
    } else if (poll(&look, 1, CONNECT_MS) != 1) {
        error = ETIMEDOUT;
    } else if (getsockopt(link_to, SOL_SOCKET, SO_ERROR, &error, &size) != 0) {
        error = errno;
    }
    if (error == 0) {
        return 1;
    }
    if (takes_text(STDERR_FILENO)) {
        fprintf(stderr, "connecting: %s\n", strerror(error));
    }
    hang_up();
    return 0;
}

static int take(uint8_t *to, size_t size)
{
    const ssize_t count = recv(link_to, to, size, 0);
    if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) {
        return 0;
    }
    return count > 0 ? (int)count : -1;
}

/* A partly sent frame ends the connection. */
static int say(const char *from, size_t size)
{
    return send(link_to, from, size, MSG_NOSIGNAL) == (ssize_t)size;
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
    static const evgp_hardware hardware = {now,  act,        moves, ready, joined,
                                           join, connect_it, take,  say,   hang_up};
    evgp_board board;
    evgp_verdict printed;
    int file;
    has_own = argc > 3;
    if (argc < 2 || argc > 4 ||
        !read_address(argv[1], argc > 2 ? argv[2] : "12017", &race_control) ||
        (has_own && !read_address(argv[3], "0", &own))) {
        fprintf(stderr, "usage: %s RACE_CONTROL [PORT [OWN_ADDRESS]], IPv4 addresses\n", argv[0]);
        return 2;
    }
    signal(SIGINT, end);
    signal(SIGTERM, end);
    signal(SIGPIPE, SIG_IGN); /* nobody reads the text any more */
    while ((file = open("/dev/null", O_RDWR)) >= 0 && file <= STDERR_FILENO) {
        /* it takes the place of a standard stream that is closed: the connection must not */
    }
    evgp_board_begin(&board, &hardware, evgp_default_settings());
    memset(&printed, 0, sizeof printed);

    while (!ending || speed > 0.0) {
        evgp_verdict verdict;
        wait_for_turn();
        evgp_kart_team_stop(&board.kart, EVGP_STOP_BUTTON, ending, now());
        verdict = evgp_board_turn(&board);
        drive();
        if ((verdict.obey != printed.obey || verdict.order != printed.order) &&
            takes_text(STDOUT_FILENO)) {
            printf("obey %s %s\n", evgp_name(verdict.obey), evgp_kart_reason(&board.kart));
            fflush(stdout);
            printed = verdict;
        }
    }
    return 0;
}
