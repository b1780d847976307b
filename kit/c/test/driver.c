// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * Gives a kart the inputs from standard input, and writes its verdict after each.
 *
 * First the settings: four uint32 (frame_timeout_ms, red_flag_drive_ms, remote_timeout_ms,
 * msr_timeout_ms), one uint8 (drive_in_garage), and the uint32 time. Then, for each input: uint8 kind, uint32 time,
 * uint32 number (the order, or whether to stop, or how many bytes follow), and the bytes. Numbers
 * are little-endian. For each input 20 bytes come out; see answer().
 */
#include <stdio.h>
#include <stdlib.h>

#include "evgp_kart.h"

static uint32_t number(void)
{
    uint8_t bytes[4];
    if (fread(bytes, 1, 4, stdin) != 4) {
        exit(2);
    }
    return (uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 |
           (uint32_t)bytes[3] << 24;
}

static void answer(const evgp_kart *kart, const char *say)
{
    const evgp_verdict verdict = evgp_kart_verdict(kart);
    const uint32_t numbers[] = {verdict.order, evgp_kart_malformed(kart)};
    uint8_t out[20] = {0};
    int i;
    for (i = 0; i < 8; i++) {
        out[i] = (uint8_t)((numbers[i / 4] >> (8 * (i % 4))) & 255U);
    }
    out[8] = (uint8_t)verdict.obey;
    out[9] = (uint8_t)verdict.commanded;
    out[10] = verdict.may_drive != 0;
    out[11] = verdict.open != 0;
    out[12] = verdict.team_stop != 0;
    out[13] = verdict.acknowledged != 0;
    out[14] = (uint8_t)(say == NULL ? 0 : say[2]); /* R, A or E: unique together with the length */
    out[15] = (uint8_t)(say == NULL ? 0 : strlen(say));
    out[16] = evgp_kart_reason(kart)[0] != 0;
    fwrite(out, 1, sizeof out, stdout);
}

int main(void)
{
    evgp_settings settings;
    evgp_kart kart;
    int kind;
    settings.frame_timeout_ms = number();
    settings.red_flag_drive_ms = number();
    settings.remote_timeout_ms = number();
    settings.msr_timeout_ms = number();
    settings.drive_in_garage = getchar();
    evgp_kart_init(&kart, settings, number());
    while ((kind = getchar()) != EOF) {
        const uint32_t now = number();
        const uint32_t value = number();
        const char *say = NULL;
        switch (kind) {
        case 't': evgp_kart_tick(&kart, now); break;
        case 'c': evgp_kart_connected(&kart, now); break;
        case 'x': evgp_kart_closed(&kart, now); break;
        case 'b': evgp_kart_team_stop(&kart, EVGP_STOP_BUTTON, value != 0, now); break;
        case 'r': evgp_kart_team_stop(&kart, EVGP_STOP_REMOTE, value != 0, now); break;
        case 'm': evgp_kart_team_stop(&kart, EVGP_STOP_MSR, value != 0, now); break;
        case 'e': evgp_kart_received(&kart, "", (size_t)-1, now); break; /* as recv() fails */
        case 'i': evgp_kart_team_stop(&kart, (evgp_stop_source)3, value != 0, now); break;
        case 'a': say = evgp_kart_acknowledge(&kart, value, now); break;
        case 'd': {
            /* Of exactly this size, so that the sanitizer sees an access beyond it. */
            uint8_t *bytes = (uint8_t *)malloc(value > 0 ? value : 1);
            if (bytes == NULL || fread(bytes, 1, value, stdin) != value) {
                return 2;
            }
            evgp_kart_received(&kart, bytes, value, now);
            free(bytes);
            break;
        }
        default: return 2;
        }
        answer(&kart, say);
    }
    return 0;
}
