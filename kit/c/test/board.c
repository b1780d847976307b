// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * Checks the promises of evgp_board.h on a board whose network, race control and clock do anything.
 * Prints how often each thing happened; exits with 1, and the line here, at the first broken promise.
 */
#include <stdio.h>
#include <stdlib.h>

#include "evgp_board.h"

#define DEAD_MS 400U
#define PROMISE(holds) ((holds) ? (void)0 : broken(__LINE__))

static uint32_t seed = 1, clock_ms = 4294900000U; /* it wraps to 0 soon */
static evgp_board board;
static int up, accepting, silent, flooding, breaking, opened, failed_write, speed, at_rest, blind;
static int broke, is_ready; /* the last reply */
static int garage; /* whether the kart may be pushed in IN_GARAGE */
static evgp_action action;
static evgp_state said = EVGP_RED_RED; /* what race control sends */
static const char *coming = "";        /* the rest of the present frame */
static uint32_t acted_at, came_at, heard_at, ended, needed, reads, tries, driven_since, driven_until;
static unsigned connects, joins, drove, slowed, released, lost, stopped;

static void broken(int line)
{
    printf("broken: line %d\n", line);
    exit(1);
}

static uint32_t chance(uint32_t below)
{
    seed = seed * 1664525U + 1013904223U;
    return (seed >> 8) % below;
}

static uint32_t now(void) { return clock_ms; }
static void act(evgp_action what)
{
    action = what;
    acted_at = clock_ms;
}

/* Any function may hang: by then the kart must brake, if a stop is known. */
static void brakes_first(void)
{
    PROMISE(action == EVGP_BRAKE || evgp_kart_verdict(&board.kart).may_drive);
}

static int moves(void)
{
    const evgp_verdict verdict = evgp_kart_verdict(&board.kart);
    brakes_first();
    PROMISE((action == EVGP_DRIVE) == (verdict.obey == EVGP_GREEN_GREEN));
    PROMISE((action == EVGP_RELEASE) == (verdict.obey == EVGP_IN_GARAGE && garage));
    return blind ? -1 : speed > 0;
}

static int ready(void)
{
    brakes_first();
    is_ready = chance(8) != 0 ? 1 : -(int)chance(2);
    return is_ready;
}

static int joined(void)
{
    brakes_first();
    clock_ms += chance(200) == 0 ? chance(900) : 0U; /* it hangs, and what has come waits */
    return up ? 1 : chance(2) != 0 ? 0 : -1;
}

/* An attempt: the second of a kind waits for `first`, each later one twice as long, up to `last`. */
static void attempt(uint32_t first, uint32_t last)
{
    PROMISE(action == EVGP_BRAKE && !opened);
    PROMISE(clock_ms - ended >= needed);
    needed = tries == 0 ? first : 2U * needed < last ? 2U * needed : last;
    tries++;
    clock_ms += chance(300);
    ended = clock_ms;
}

static void join(void)
{
    attempt(EVGP_JOIN_FIRST_MS, EVGP_JOIN_LAST_MS);
    joins++;
}

static int connect_it(void)
{
    attempt(EVGP_CONNECT_FIRST_MS, EVGP_CONNECT_LAST_MS);
    opened = accepting;
    connects += accepting != 0;
    coming = "";
    said = EVGP_RED_RED;
    return opened ? 1 : chance(2) != 0 ? 0 : -1;
}

static void come(void)
{
    coming = evgp_frame(said);
    came_at = clock_ms;
}

static int take(uint8_t *to, size_t size)
{
    size_t count = 0;
    PROMISE(opened && ++reads <= 20 && !broke);
    if (breaking) {
        broke = 1; /* and nothing more is read */
        return breaking == 1 ? -1 : (int)size + 1; /* more than it was asked for */
    }
    if (*coming == 0 && flooding) {
        come();
    }
    while (*coming != 0 && count < size && (flooding || chance(16) != 0)) {
        to[count++] = (uint8_t)*coming;
        if (*coming++ == ';') {
            heard_at = came_at;
        }
    }
    came_at = *coming != 0 ? clock_ms : came_at; /* the rest has yet to come */
    return (int)count;
}

static int say(const char *from, size_t size)
{
    PROMISE(opened && size == strlen(from));
    if (strcmp(from, "$GREEN_GREEN;") == 0) {
        PROMISE(speed > 0);
    } else if (strcmp(from, "$IN_GARAGE;") != 0) {
        PROMISE(speed == 0);
        PROMISE(driven_until == 0 || clock_ms - driven_until >= EVGP_STANDSTILL_MS);
        PROMISE(strcmp(from, "$GRID_ACTIVE;") != 0 || is_ready == 1);
        at_rest = 1;
        stopped += (said == EVGP_GREEN_GREEN || said == EVGP_GRID_ACTIVE) &&
                   strcmp(from, "$RED_RED;") == 0;
    }
    failed_write = chance(100) == 0;
    if (chance(8) == 0) {
        said = (evgp_state)(said % 5 + 1);
    }
    return failed_write ? -(int)chance(2) : 1;
}

static void hang_up(void)
{
    PROMISE(action == EVGP_BRAKE && opened);
    opened = 0;
    ended = clock_ms;
    lost++;
}

static void world(void)
{
    const uint32_t before = clock_ms;
    clock_ms += 1U + chance(50);
    if (chance(up ? 2000 : 300) == 0) {
        up = !up;
        needed = EVGP_CONNECT_FIRST_MS;
        tries = 0;
    }
    accepting = chance(accepting ? 2000 : 300) == 0 ? !accepting : accepting;
    silent = chance(silent ? 50 : 1000) == 0 ? !silent : silent;
    /* Often it stops a kart that was commanded to drive and does not move yet. */
    said = chance(action == EVGP_DRIVE && speed == 0 ? 20 : 300) == 0 ? EVGP_RED_RED : said;
    if (*coming == 0 && !silent && chance(4) == 0) {
        come();
    }
    flooding = chance(2000) == 0;
    breaking = opened && chance(1000) == 0 ? 1 + (int)chance(2) : 0;
    if (action == EVGP_DRIVE) {
        driven_since = driven_until == before ? driven_since : clock_ms;
        driven_until = clock_ms;
        at_rest = 0;
    }
    if (action == EVGP_RELEASE) {
        speed = chance(4) == 0 ? 1 : speed; /* somebody pushes it */
        at_rest = 0;
    }
    /* The kart follows each command, to drive or to stop, after its dead time. */
    if (clock_ms - driven_since >= DEAD_MS && clock_ms - driven_until < DEAD_MS) {
        PROMISE(!at_rest);
        speed++;
    } else {
        speed = speed > 2 ? speed - 2 : 0;
    }
    blind = chance(blind ? 40 : 400) == 0 ? !blind : blind;
    reads = 0;
    broke = 0;
    failed_write = 0;
}

int main(void)
{
    static const evgp_hardware hardware = {now,  act,        moves, ready, joined,
                                           join, connect_it, take,  say,   hang_up};
    uint32_t turn;
    int stop = 0;
    ended = clock_ms;
    evgp_board_begin(&board, &hardware, evgp_default_settings());
    for (turn = 0; turn < 200000U; turn++) {
        evgp_verdict verdict;
        world();
        if (chance(2000) == 0) {
            garage = !garage;
            board.kart.settings.drive_in_garage = garage;
        }
        if (stop || chance(500) == 0) { /* rarely, because this also lets time pass */
            stop = !stop;
            evgp_kart_team_stop(&board.kart, EVGP_STOP_BUTTON, stop, clock_ms);
        }
        verdict = evgp_board_turn(&board);
        PROMISE(verdict.open == opened && (up || !opened) && !(failed_write && opened));
        PROMISE(opened || (verdict.obey == EVGP_RED_RED && action == EVGP_BRAKE));
        PROMISE(action == EVGP_BRAKE || verdict.may_drive || at_rest);
        PROMISE(action != EVGP_DRIVE || verdict.obey == EVGP_GREEN_GREEN);
        PROMISE(action != EVGP_SLOW_DOWN || verdict.obey == EVGP_RED_FLAG);
        PROMISE(action == EVGP_BRAKE || acted_at - heard_at < 1000);
        slowed += action == EVGP_SLOW_DOWN;
        released += action == EVGP_RELEASE;
        PROMISE(!opened || !breaking);
        PROMISE(!opened || reads < 16); /* bytes that arrive faster than they are read are old */
        if (verdict.commanded != EVGP_NONE) {
            needed = EVGP_CONNECT_FIRST_MS;
            tries = 0;
        }
        /* It tries again, and soon after any change. */
        PROMISE(opened || joins == 0 ||
                clock_ms - ended < 400U + (tries == 0 ? 500U : up ? 2000U : 20000U));
        drove += action == EVGP_DRIVE;
    }
    printf("%u %u %u %u %u %u %u\n", connects, joins, drove, slowed, released, lost, stopped);
    return 0;
}
