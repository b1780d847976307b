// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * The loop of a kart on a board with a network, around evgp_kart.h: it joins the network, connects,
 * reconnects with a growing delay, brakes, and acknowledges. C99 or C++. Your program provides clock,
 * pins and socket as an evgp_hardware. examples/ has two such programs.
 *
 *     evgp_board_begin(&board, &hardware, settings);           once, with the motors stopped
 *
 *     evgp_kart_team_stop(&board.kart, ...);                   in each turn of the loop
 *     evgp_verdict verdict = evgp_board_turn(&board);
 *     ... feed the watchdog here, and nowhere else
 *
 * The loop stops the kart before it calls anything that may wait, because a loop that waits cannot
 * brake. It takes an unexpected return value of your functions as the worst.
 *
 * A kart that was commanded to drive just before a stop may begin to move after it: its dead time. So
 * it counts as standing still only once it has neither moved nor been commanded to drive for
 * EVGP_STANDSTILL_MS.
 */
#ifndef EVGP_BOARD_H
#define EVGP_BOARD_H

#include "evgp_kart.h"

#ifdef __cplusplus
extern "C" {
#endif

#define EVGP_CONNECT_FIRST_MS 500U /* delay between two attempts to connect; doubled after each */
#define EVGP_CONNECT_LAST_MS 2000U /* maximum of that delay */
#define EVGP_JOIN_FIRST_MS 5000U   /* the same for joining the network, which takes seconds */
#define EVGP_JOIN_LAST_MS 20000U

#ifndef EVGP_STANDSTILL_MS
#define EVGP_STANDSTILL_MS 500U /* longer than your kart's dead time, and than two wheel pulses */
#endif

/* What brake and motors do. All zeros is a kart that brakes. */
typedef enum {
    EVGP_BRAKE = 0,
    EVGP_SLOW_DOWN = 1, /* RED_FLAG: without power, gently, still steering */
    EVGP_DRIVE = 2,     /* GREEN_GREEN only */
    EVGP_RELEASE = 3    /* IN_GARAGE with drive_in_garage: brake released, no power, for pushing */
} evgp_action;

/* Your program's functions. Only join, connect and close may wait, for less than the watchdog. */
typedef struct {
    uint32_t (*now)(void);                /* milliseconds; see evgp_kart.h */
    void (*act)(evgp_action what);        /* do this until the next call */
    int (*moves)(void);                   /* measured: 1: moves; 0: stands still; below: unknown */
    int (*ready)(void);                   /* 1: ready to race */
    int (*joined)(void);                  /* 1: the network is up: WLAN, or cable */
    void (*join)(void);                   /* begin to join the network again */
    int (*connect)(void);                 /* connect to race control; 1: connected */
    int (*read)(uint8_t *to, size_t size); /* number of bytes read; 0: none; below: broken */
    int (*write)(const char *from, size_t size); /* 1: all bytes were accepted */
    void (*close)(void);                  /* close the connection */
} evgp_hardware;

/* A board. Call evgp_kart_team_stop with its kart; only the functions below use the rest. */
typedef struct {
    evgp_kart kart;
    const evgp_hardware *hardware;
    uint32_t since; /* end of the last attempt, or of the connection */
    uint32_t wait;  /* from then to the next attempt */
    uint32_t moved_at; /* it moved, was commanded to drive, or its motion was unknown */
    uint8_t drives; /* it has been commanded to drive since the last turn */
    uint8_t joined;
    uint8_t connected;
} evgp_board;

/* Initialize. Before, your program must stop the kart and begin to join the network. */
static inline void evgp_board_begin(evgp_board *board, const evgp_hardware *hardware,
                                    evgp_settings settings)
{
    memset(board, 0, sizeof *board);
    board->hardware = hardware;
    board->since = hardware->now();
    board->moved_at = board->since;
    board->wait = EVGP_JOIN_FIRST_MS;
    evgp_kart_init(&board->kart, settings, board->since);
}

static inline void evgp_p_hang_up(evgp_board *board)
{
    board->hardware->act(EVGP_BRAKE);
    evgp_kart_closed(&board->kart, board->hardware->now());
    board->hardware->close();
    board->connected = 0;
    board->since = board->hardware->now();
}

/* Read everything that has arrived; return whether the connection is still good. */
static inline int evgp_p_listen(evgp_board *board)
{
    uint8_t bytes[256];
    int reads;
    for (reads = 0; reads < 16; reads++) { /* a flood must not delay the brake */
        const int count = board->hardware->read(bytes, sizeof bytes);
        if ((size_t)count > sizeof bytes) {
            return 0; /* below 0: broken; more than it may be: it is unknown what was read */
        }
        /* Also without bytes, because the network may have taken time. */
        evgp_kart_received(&board->kart, bytes, (size_t)count, board->hardware->now());
        if (count == 0) {
            return evgp_kart_verdict(&board->kart).open;
        }
    }
    return 0; /* race control never sends that much */
}

/* Try once to join or connect. Without a connection the kart is already stopped. */
static inline void evgp_p_try(evgp_board *board)
{
    const uint32_t first = board->joined ? EVGP_CONNECT_FIRST_MS : EVGP_JOIN_FIRST_MS;
    const uint32_t last = board->joined ? EVGP_CONNECT_LAST_MS : EVGP_JOIN_LAST_MS;
    if (!board->joined) {
        board->hardware->join();
    } else if (board->hardware->connect() > 0) {
        board->connected = 1;
        board->moved_at = board->hardware->now(); /* valid even after the clock went back */
        evgp_kart_connected(&board->kart, board->hardware->now());
    }
    board->since = board->hardware->now();
    board->wait = 2U * board->wait < first ? first : 2U * board->wait;
    board->wait = board->wait > last ? last : board->wait;
}

/* Drive or brake; return whether, as measured, the kart has reached what it obeys. */
static inline int evgp_p_act(evgp_board *board, evgp_verdict verdict)
{
    const evgp_hardware *hardware = board->hardware;
    const evgp_action action = !verdict.may_drive                 ? EVGP_BRAKE
                               : verdict.obey == EVGP_RED_FLAG    ? EVGP_SLOW_DOWN
                               : verdict.obey == EVGP_GREEN_GREEN ? EVGP_DRIVE
                                                                  : EVGP_RELEASE;
    int moves;
    uint32_t now;
    hardware->act(action); /* first, because a sensor may hang */
    moves = hardware->moves();
    now = hardware->now();
    if (moves != 0 || board->drives) { /* until now, however long that turn took */
        board->moved_at = now;
    }
    board->drives = action == EVGP_DRIVE;
    switch (verdict.obey) {
    case EVGP_GREEN_GREEN: return moves > 0;
    case EVGP_IN_GARAGE: return 1;
    default:
        return (uint32_t)(now - board->moved_at) >= EVGP_STANDSTILL_MS &&
               (verdict.obey != EVGP_GRID_ACTIVE || hardware->ready() > 0);
    }
}

/* Do one turn: listen, brake or release, acknowledge. Return what the kart must do now. */
static inline evgp_verdict evgp_board_turn(evgp_board *board)
{
    const evgp_hardware *hardware = board->hardware;
    uint8_t joined;
    evgp_verdict verdict;
    const char *say;
    evgp_kart_tick(&board->kart, hardware->now());
    if (!evgp_kart_verdict(&board->kart).may_drive) {
        hardware->act(EVGP_BRAKE); /* a known stop never waits for the network */
    }
    joined = hardware->joined() > 0;
    if (joined != board->joined) {
        board->joined = joined;
        board->wait = EVGP_CONNECT_FIRST_MS; /* the network changed: try soon */
    }
    if (board->connected && (!joined || !evgp_p_listen(board))) {
        evgp_p_hang_up(board); /* do not wait for a lost network */
    } else if (!board->connected && (uint32_t)(hardware->now() - board->since) >= board->wait) {
        evgp_p_try(board);
    }
    verdict = evgp_kart_verdict(&board->kart);
    if (verdict.commanded != EVGP_NONE) {
        board->wait = EVGP_CONNECT_FIRST_MS;
    }
    if (evgp_p_act(board, verdict)) {
        say = evgp_kart_acknowledge(&board->kart, verdict.order, hardware->now());
        if (say != NULL && hardware->write(say, strlen(say)) <= 0) {
            evgp_p_hang_up(board); /* half a frame may have been sent: start over */
        }
    }
    return evgp_kart_verdict(&board->kart);
}

#ifdef __cplusplus
}
#endif

#endif /* EVGP_BOARD_H */
