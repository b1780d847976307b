// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * A kart on a board with a network, around evgp_kart.h: it joins the network, connects, connects
 * again with a growing wait, brakes, and acknowledges. C99 or C++; no clock, pin or socket of its
 * own: your program gives them as an evgp_hardware. examples/ has two such programs.
 *
 *     evgp_board_begin(&board, &hardware, settings);           once, with the motors stopped
 *
 *     evgp_kart_team_stop(&board.kart, ...);                   in each turn of the loop
 *     evgp_verdict verdict = evgp_board_turn(&board);
 *     ... feed the watchdog: here, and nowhere else
 *
 * The kart is stopped before anything is asked or waited for: a loop that waits cannot brake. What
 * your functions return is believed only where it is what they may return.
 *
 * A kart that was told to drive just before a stop may begin to move after it: its dead time. So it
 * counts as standing only once it has neither moved nor been told to drive for EVGP_STANDSTILL_MS.
 */
#ifndef EVGP_BOARD_H
#define EVGP_BOARD_H

#include "evgp_kart.h"

#ifdef __cplusplus
extern "C" {
#endif

#define EVGP_CONNECT_FIRST_MS 500U /* from one attempt to the next; doubled after each, */
#define EVGP_CONNECT_LAST_MS 2000U /* up to this */
#define EVGP_JOIN_FIRST_MS 5000U   /* the same for the network, which takes seconds to join */
#define EVGP_JOIN_LAST_MS 20000U

#ifndef EVGP_STANDSTILL_MS
#define EVGP_STANDSTILL_MS 500U /* longer than your kart's dead time, and than two signs of a wheel */
#endif

/* What brake and motors do. All zeros is a kart that brakes. */
typedef enum {
    EVGP_BRAKE = 0,
    EVGP_SLOW_DOWN = 1, /* RED_FLAG: without power, gently, still steering */
    EVGP_DRIVE = 2,     /* GREEN_GREEN, and nothing else */
    EVGP_RELEASE = 3    /* IN_GARAGE with drive_in_garage: brake released, no power: to be pushed */
} evgp_action;

/* What your program gives. Only join, connect and close may wait, for less than the watchdog. */
typedef struct {
    uint32_t (*now)(void);                /* milliseconds; see evgp_kart.h */
    void (*act)(evgp_action what);        /* do this, and remember it until the next call */
    int (*moves)(void);                   /* measured: 1: it moves; 0: it stands; below: unknown */
    int (*ready)(void);                   /* 1: it is ready to race */
    int (*joined)(void);                  /* 1: the network is there: WLAN, or cable */
    void (*join)(void);                   /* begin to join it, once more */
    int (*connect)(void);                 /* connect to race control; 1: that is done */
    int (*read)(uint8_t *to, size_t size); /* bytes read; 0: none has come; below: broken */
    int (*write)(const char *from, size_t size); /* 1: it took all of them */
    void (*close)(void);                  /* close the connection */
} evgp_hardware;

/* A board. Call evgp_kart_team_stop with its kart; the rest is nobody's but the functions'. */
typedef struct {
    evgp_kart kart;
    const evgp_hardware *hardware;
    uint32_t since; /* the last attempt ended, or the connection */
    uint32_t wait;  /* from then to the next attempt */
    uint32_t moved_at; /* it moved, or was told to drive, or nobody knew */
    uint8_t joined;
    uint8_t connected;
} evgp_board;

/* Begin. Your program has begun to join the network, and stopped the kart. */
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

/* Take all that has come; return whether the connection holds. */
static inline int evgp_p_listen(evgp_board *board)
{
    uint8_t bytes[256];
    int reads;
    for (reads = 0; reads < 16; reads++) { /* no flood holds the brake up */
        const int count = board->hardware->read(bytes, sizeof bytes);
        if (count <= 0) {
            return count == 0 && evgp_kart_verdict(&board->kart).open;
        }
        if ((size_t)count > sizeof bytes) {
            return 0; /* nobody knows what was read */
        }
        evgp_kart_received(&board->kart, bytes, (size_t)count, board->hardware->now());
    }
    return 0; /* race control does not send that much */
}

/* Try once to get nearer to race control. Without a connection the kart is stopped already. */
static inline void evgp_p_try(evgp_board *board)
{
    const uint32_t first = board->joined ? EVGP_CONNECT_FIRST_MS : EVGP_JOIN_FIRST_MS;
    const uint32_t last = board->joined ? EVGP_CONNECT_LAST_MS : EVGP_JOIN_LAST_MS;
    if (!board->joined) {
        board->hardware->join();
    } else if (board->hardware->connect() > 0) {
        board->connected = 1;
        board->moved_at = board->hardware->now(); /* also if the clock has gone back */
        evgp_kart_connected(&board->kart, board->hardware->now());
    }
    board->since = board->hardware->now();
    board->wait = 2U * board->wait < first ? first : 2U * board->wait;
    board->wait = board->wait > last ? last : board->wait;
}

/* Drive or brake; return whether the kart has reached what it obeys, as it is measured. */
static inline int evgp_p_act(evgp_board *board, evgp_verdict verdict)
{
    const evgp_hardware *hardware = board->hardware;
    const evgp_action action = !verdict.may_drive                 ? EVGP_BRAKE
                               : verdict.obey == EVGP_RED_FLAG    ? EVGP_SLOW_DOWN
                               : verdict.obey == EVGP_GREEN_GREEN ? EVGP_DRIVE
                                                                  : EVGP_RELEASE;
    int moves;
    uint32_t now;
    hardware->act(action); /* first: a sensor may hang */
    moves = hardware->moves();
    now = hardware->now();
    if (moves != 0 || action == EVGP_DRIVE) {
        board->moved_at = now;
    }
    switch (verdict.obey) {
    case EVGP_GREEN_GREEN: return moves > 0;
    case EVGP_IN_GARAGE: return 1;
    default:
        return (uint32_t)(now - board->moved_at) >= EVGP_STANDSTILL_MS &&
               (verdict.obey != EVGP_GRID_ACTIVE || hardware->ready() > 0);
    }
}

/* Do one turn: listen, brake or release, acknowledge. Return what holds after it. */
static inline evgp_verdict evgp_board_turn(evgp_board *board)
{
    const evgp_hardware *hardware = board->hardware;
    uint8_t joined;
    evgp_verdict verdict;
    const char *say;
    evgp_kart_tick(&board->kart, hardware->now());
    if (!evgp_kart_verdict(&board->kart).may_drive) {
        hardware->act(EVGP_BRAKE); /* a stop that is known waits for no network */
    }
    joined = hardware->joined() > 0;
    if (joined != board->joined) {
        board->joined = joined;
        board->wait = EVGP_CONNECT_FIRST_MS; /* something is new: try soon */
    }
    if (board->connected && (!joined || !evgp_p_listen(board))) {
        evgp_p_hang_up(board); /* a network that is lost is not waited for */
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
            evgp_p_hang_up(board); /* half a frame may be out: begin again */
        }
    }
    return evgp_kart_verdict(&board->kart);
}

#ifdef __cplusplus
}
#endif

#endif /* EVGP_BOARD_H */
