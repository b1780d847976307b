// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * A kart on an ESP32 (the original, as on a DevKitC; an S3 or C3 has other pins) with WiFi, or on an
 * Arduino Mega 2560 with a W5500. The network code is in the tab of that name. Set the values below;
 * replace ready() and moves() with what your kart measures. This library's README.md shows how to wire
 * the contacts, and how to add a safety remote (§2.C), which this sketch does not have.
 *
 * RELEASE_PIN releases the brake while it is HIGH, POWER_PIN powers the motors. Connect both to ground
 * with 10 kOhm: they float while the board starts, also after a brown-out. Do not use pins 0, 1, 3, 5,
 * 14 and 15 of an ESP32, which it pulls up at start, nor 20 and 21 of a Mega, which it always pulls up
 * (10 kOhm, for I2C).
 */
#include <Arduino.h>

#include <evgp_board.h>

#ifndef EVGP_RACE_CONTROL
#define EVGP_RACE_CONTROL IPAddress(10, 0, 0, 1)
#endif
#define EVGP_OWN_ADDRESS IPAddress(10, 0, 0, 101) /* this kart's, as in the roster (§4.A) */
#define EVGP_NETMASK IPAddress(255, 255, 255, 0)
#define EVGP_WLAN "evgp", "password" /* name and key, from the organiser */

static const int RELEASE_PIN = 23;
static const int POWER_PIN = 27;
static const int WHEEL_PIN = 22;   /* changes at least every 2 cm as the wheel turns */
static const int STOP_PIN = 25;    /* the team's stop button (§2.C) */
static const int MSR_PIN = 26;     /* the contact of the MSR's relay (§2.B) */
static const int CONNECT_MS = 300; /* to connect or to close; less than the watchdog's 500 ms */

#ifdef ESP32
#include "esp32_wifi.h"
#else
#include "w5500_ethernet.h"
#endif

static evgp_board board;
static evgp_state printed = EVGP_NONE;
static const char *printed_why = "";

static uint32_t now() { return millis(); }
/* In RED_FLAG the kart coasts. If yours needs longer than 15 s to stop, also brake a little. */
static void act(evgp_action what)
{
    digitalWrite(RELEASE_PIN, what != EVGP_BRAKE ? HIGH : LOW);
    digitalWrite(POWER_PIN, what == EVGP_DRIVE ? HIGH : LOW);
}
/* Whether the wheel turned since the last call. With this single input, a broken wire looks like a
   standstill: a real kart needs two sensors, or one that reports faults; return -1 when in doubt. */
static int moves()
{
    static int level = -1;
    const int before = level;
    level = digitalRead(WHEEL_PIN);
    return level != before;
}
static int ready() { return 1; } /* check sensors, localisation and whatever else yours needs */
static int take(uint8_t *to, size_t size)
{
    return client.available() > 0 ? client.read(to, size) : client.connected() ? 0 : -1;
}
/* It blocks only while race control reads nothing; the watchdog ends that. */
static int say(const char *from, size_t size)
{
    return client.write((const uint8_t *)from, size) == size;
}
static void hang_up() { client.stop(); }

static const evgp_hardware hardware = {now,  act,        moves, ready, joined,
                                       join, connect_it, take,  say,   hang_up};

void setup()
{
    pinMode(RELEASE_PIN, OUTPUT); /* LOW after a reset */
    pinMode(POWER_PIN, OUTPUT);
    act(EVGP_BRAKE);
    pinMode(WHEEL_PIN, INPUT_PULLUP);
    pinMode(STOP_PIN, INPUT_PULLUP);
    pinMode(MSR_PIN, INPUT_PULLUP);
    Serial.begin(115200);
    Serial.println(why_reset());
    begin_network();
    evgp_settings settings = evgp_default_settings();
    settings.msr_timeout_ms = 200; /* 0 only on a kart without the MSR's contact */
    evgp_board_begin(&board, &hardware, settings);
    begin_watchdog();
}

void loop()
{
    evgp_kart_team_stop(&board.kart, EVGP_STOP_BUTTON, digitalRead(STOP_PIN) != LOW, now());
    evgp_kart_team_stop(&board.kart, EVGP_STOP_MSR, digitalRead(MSR_PIN) != LOW, now());
    const evgp_verdict verdict = evgp_board_turn(&board);
    feed_watchdog(); /* only here: the clock was checked and the brake is set */
    const char *why = evgp_kart_reason(&board.kart);
    /* A UART sends this within 10 ms, whether anybody reads it or not. A board with USB of its own
       (Leonardo, S3, C3) may wait for the computer: there, ask Serial.availableForWrite() first. */
    if (verdict.obey != printed || why != printed_why) {
        printed = verdict.obey;
        printed_why = why;
        Serial.print("obey ");
        Serial.print(evgp_name(printed));
        Serial.print(" ");
        Serial.println(why);
    }
}
