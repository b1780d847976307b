// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * Fuzzes the kit: reads any bytes as inputs, and checks what must hold after each of them.
 *
 * With clang: clang -fsanitize=fuzzer,address,undefined -DEVGP_LIBFUZZER -I.. fuzz.c
 * Otherwise main() makes random bytes: fuzz [runs [seed]].
 */
#include <stdio.h>
#include <stdlib.h>

#include "evgp_kart.h"

#define MUST(what)                                                                                \
    do {                                                                                          \
        if (!(what)) {                                                                            \
            fprintf(stderr, "line %d: %s\n", __LINE__, #what);                                    \
            abort();                                                                              \
        }                                                                                         \
    } while (0)

/* Give the same input to a kart that reads whole pieces, and to one that reads byte by byte. */
#define BOTH(input, ...) (input(&whole, __VA_ARGS__), input(&pieces, __VA_ARGS__))

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static int same(const evgp_kart *one, const evgp_kart *other)
{
    const evgp_verdict a = evgp_kart_verdict(one), b = evgp_kart_verdict(other);
    return a.obey == b.obey && a.commanded == b.commanded && a.order == b.order &&
           a.may_drive == b.may_drive && a.open == b.open && a.team_stop == b.team_stop &&
           a.acknowledged == b.acknowledged && one->malformed == other->malformed;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size)
{
    static const evgp_state states[] = {EVGP_GREEN_GREEN, EVGP_GRID_ACTIVE, EVGP_IN_GARAGE,
                                        EVGP_RED_FLAG, EVGP_RED_RED};
    evgp_settings settings = evgp_default_settings();
    evgp_kart whole, pieces; /* the same bytes, at once and one by one */
    uint32_t now, heard_at = 0;
    int heard = 0, green_allowed = 0, was_ready = 0;
    size_t at = 6;
    if (size < 6) {
        return 0;
    }
    settings.remote_timeout_ms = data[4] % 4 == 0 ? 500U : 0U;
    settings.msr_timeout_ms = data[4] % 8 == 1 ? 500U : 0U;
    settings.drive_in_garage = data[5] & 1;
    now = (uint32_t)data[0] << 24 | (uint32_t)data[1] << 16 | (uint32_t)data[2] << 8 | data[3];
    evgp_kart_init(&whole, settings, now);
    evgp_kart_init(&pieces, settings, now);
    while (at + 1 < size) {
        const uint8_t kind = data[at], value = data[at + 1];
        const evgp_verdict before = evgp_kart_verdict(&whole);
        evgp_verdict after;
        const char *say = NULL, *again = NULL;
        at += 2;
        now += kind >= 128                  ? (uint32_t)(value % 64)
               : (kind == 64 || kind == 65) ? 16U * value
                                            : 0U;
        switch (kind % 8) {
        case 0:
            if (!before.open || value % 16 == 0) {
                BOTH(evgp_kart_connected, now);
                heard = 0;
            } else {
                BOTH(evgp_kart_tick, now);
            }
            break;
        case 1:
            if (value % 8 == 0) {
                BOTH(evgp_kart_closed, now);
            } else {
                BOTH(evgp_kart_tick, now);
            }
            break;
        case 2:
            BOTH(evgp_kart_team_stop, (evgp_stop_source)(value % 4), value >= 240, now);
            MUST(value % 4 < 3 || evgp_kart_verdict(&whole).team_stop); /* no source: a stop */
            break;
        case 3:
        case 4: {
            const uint32_t order = value < 200 ? before.order : value - 200U;
            say = evgp_kart_acknowledge(&whole, order, now);
            again = evgp_kart_acknowledge(&pieces, order, now);
            MUST(say == again || (say != NULL && again != NULL && strcmp(say, again) == 0));
            break;
        }
        default: {
            const char *frame = evgp_frame(states[value % 5]);
            const uint8_t *bytes = (const uint8_t *)frame;
            size_t count = strlen(frame), i;
            if (value >= 200) { /* raw bytes */
                bytes = data + at;
                count = (size_t)(value - 200) < size - at ? (size_t)(value - 200) : size - at;
                at += count;
            }
            evgp_kart_received(&whole, bytes, count, now);
            evgp_kart_received(&pieces, bytes, 0, now);
            for (i = 0; i < count; i++) {
                evgp_kart_received(&pieces, bytes + i, 1, now);
            }
        }
        }
        MUST(same(&whole, &pieces));
        after = evgp_kart_verdict(&whole);
        /* A second implementation of the rules, as far as one step shows them. */
        MUST(after.obey == EVGP_RED_RED ||
             (after.obey == after.commanded && after.obey != EVGP_NONE));
        MUST(after.open || after.obey == EVGP_RED_RED);
        MUST(!after.team_stop || after.obey == EVGP_RED_RED);
        MUST((after.order == 0) == (after.commanded == EVGP_NONE));
        MUST(!after.may_drive || (after.obey != EVGP_RED_RED && after.obey != EVGP_GRID_ACTIVE));
        MUST((evgp_kart_reason(&whole)[0] == 0) == (after.obey == after.commanded));
        if (say != NULL) { /* the state that is commanded, perhaps after IN_GARAGE */
            const int itself = after.obey == EVGP_RED_RED && (after.commanded == EVGP_GRID_ACTIVE ||
                                                              after.commanded == EVGP_GREEN_GREEN);
            const char *word = evgp_frame(itself ? EVGP_RED_RED : after.commanded);
            const char *garage = evgp_frame(EVGP_IN_GARAGE);
            MUST(after.acknowledged);
            MUST(!itself || was_ready); /* or the kart has stopped itself, */
            MUST(!itself || !before.acknowledged || before.obey != EVGP_RED_RED); /* once */
            if (strcmp(say, word) != 0) {
                MUST(after.commanded != EVGP_IN_GARAGE);
                MUST(strncmp(say, garage, strlen(garage)) == 0);
                MUST(strcmp(say + strlen(garage), word) == 0);
            }
        }
        if (say != NULL && after.commanded == EVGP_GRID_ACTIVE &&
            after.obey == EVGP_GRID_ACTIVE) {
            green_allowed = 1;
            was_ready = 1;
        }
        if (after.commanded != EVGP_GRID_ACTIVE && after.commanded != EVGP_GREEN_GREEN) {
            was_ready = 0;
        }
        if (after.team_stop || (after.commanded != EVGP_GRID_ACTIVE &&
                                after.commanded != EVGP_GREEN_GREEN)) {
            green_allowed = 0;
        }
        MUST(after.obey != EVGP_GREEN_GREEN || green_allowed);
        if (kind % 8 > 4 && after.open && after.order != before.order) {
            heard = 1;
            heard_at = now;
        }
        if (kind % 8 < 5 && heard && !before.open && kind % 8 != 0) {
            MUST(!after.open); /* only a new connection brings it back */
        }
        if (after.open && heard && kind % 8 > 4 && after.order == before.order) {
            heard_at = now; /* perhaps a frame */
        }
        MUST(!after.open || !heard || (uint32_t)(now - heard_at) < 1000);
    }
    /* After any garbage, the next frame is found, and silence stops the kart. */
    evgp_kart_connected(&whole, now);
    evgp_kart_received(&whole, data, size, now);
    evgp_kart_received(&whole, "$RED_FLAG;", 10, now);
    MUST(evgp_kart_verdict(&whole).commanded == EVGP_RED_FLAG);
    evgp_kart_tick(&whole, now + 999U);
    MUST(evgp_kart_verdict(&whole).open);
    evgp_kart_tick(&whole, now + 1000U);
    MUST(!evgp_kart_verdict(&whole).open && evgp_kart_verdict(&whole).obey == EVGP_RED_RED);
    return 0;
}

#ifndef EVGP_LIBFUZZER
static uint32_t dice;

static uint32_t roll(uint32_t sides) /* xorshift */
{
    dice ^= dice << 13;
    dice ^= dice >> 17;
    dice ^= dice << 5;
    return dice % sides;
}

int main(int argc, char **argv)
{
    static const char alphabet[] = "$$$;;;GREDAFLINCTV_ \r\n\xff";
    const unsigned long runs = argc > 1 ? strtoul(argv[1], NULL, 10) : 100000UL;
    unsigned long run;
    dice = argc > 2 ? (uint32_t)strtoul(argv[2], NULL, 10) : 1U;
    dice = dice == 0 ? 1U : dice;
    for (run = 0; run < runs; run++) {
        const size_t size = roll(400);
        uint8_t *data = (uint8_t *)malloc(size > 0 ? size : 1);
        size_t i;
        if (data == NULL) {
            return 2;
        }
        for (i = 0; i < size; i++) {
            data[i] = (uint8_t)(roll(3) == 0 ? (uint32_t)(uint8_t)alphabet[roll(sizeof alphabet)]
                                             : roll(256));
        }
        if (size > 100 && roll(4) == 0) { /* a frame of about the maximum length */
            const size_t from = 6 + 2 * roll(25), count = 29 + roll(5);
            data[from] = 7;
            data[from + 1] = (uint8_t)(200 + 2 + count);
            data[from + 2] = '$';
            memset(data + from + 3, 'R', count);
            data[from + 3 + count] = ';';
        }
        LLVMFuzzerTestOneInput(data, size);
        free(data);
    }
    printf("%lu runs\n", run);
    return 0;
}
#endif
