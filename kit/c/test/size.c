// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/* Calls each function once, those of evgp_board.h with -DEVGP_BOARD: `make kit-size` measures it. */
#ifdef EVGP_BOARD
#include "evgp_board.h"
evgp_board board;

int turn(const evgp_hardware *hardware, int level)
{
    evgp_board_begin(&board, hardware, evgp_default_settings());
    evgp_kart_team_stop(&board.kart, EVGP_STOP_MSR, level, hardware->now());
    return evgp_board_turn(&board).may_drive;
}
#else
#include "evgp_kart.h"
evgp_kart kart;

const char *turn(const void *bytes, size_t count, uint32_t now)
{
    evgp_kart_init(&kart, evgp_default_settings(), now);
    evgp_kart_tick(&kart, now);
    evgp_kart_connected(&kart, now);
    evgp_kart_received(&kart, bytes, count, now);
    evgp_kart_team_stop(&kart, EVGP_STOP_MSR, 0, now);
    evgp_kart_closed(&kart, now);
    return evgp_kart_acknowledge(&kart, evgp_kart_verdict(&kart).order, now);
}
#endif
