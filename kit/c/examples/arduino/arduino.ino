// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * A kart on a microcontroller with WiFi (ESP32 and the like), with evgp_kart.h.
 *
 * Copy evgp_kart.h beside this file. RELEASE_PIN releases brake and motors while it is HIGH: wire it
 * so that LOW, a reset and an unpowered pin stop the kart. Replace ready() and standing() with what
 * your kart measures, and feed your hardware watchdog at the marked line, nowhere else.
 *
 * STOP_PIN and MSR_PIN each read a contact to ground that is closed while the kart may drive. An open
 * contact, a broken wire and a plug that came off read HIGH: the kart stops. kit/c/README.md has the
 * drawing.
 */
#include <Arduino.h>
#include <WiFi.h>

#include "evgp_kart.h"

#ifndef EVGP_RACE_CONTROL
#define EVGP_RACE_CONTROL IPAddress(10, 0, 0, 1)
#endif
#define EVGP_OWN_ADDRESS IPAddress(10, 0, 0, 101) /* this kart's, as in the roster (§4.A) */
#define EVGP_NETMASK IPAddress(255, 255, 255, 0)

static const int RELEASE_PIN = 5;
static const int STOP_PIN = 4;        /* the team's stop button (§2.C) */
static const int MSR_PIN = 13;        /* the contact of the MSR's relay (§2.B) */
static const int WHEEL_PIN = 2;       /* changes as the wheel turns */
static const uint32_t STILL_MS = 500;
static const uint32_t WAIT_MS = 500;  /* between two attempts to connect */
static const int CONNECT_MS = 300;    /* for one attempt; less than the watchdog's 500 ms */

static WiFiClient link_to_race_control;
static evgp_kart kart;
static uint32_t lost_at;
static uint32_t wheel_moved_at;
static int wheel_level = LOW;
static evgp_state told = EVGP_NONE;

/* Whether the kart is ready to race: sensors, localisation, whatever yours needs. */
static bool ready() { return true; }

/* Whether the kart stands still, as measured: the wheel's sensor has not changed for STILL_MS. */
static bool standing()
{
    const int level = digitalRead(WHEEL_PIN);
    if (level != wheel_level) {
        wheel_level = level;
        wheel_moved_at = millis();
    }
    return (uint32_t)(millis() - wheel_moved_at) >= STILL_MS;
}

static void close_link(uint32_t now)
{
    link_to_race_control.stop();
    evgp_kart_closed(&kart, now);
    lost_at = now;
}

void setup()
{
    digitalWrite(RELEASE_PIN, LOW); /* before the pin drives anything */
    pinMode(RELEASE_PIN, OUTPUT);
    pinMode(WHEEL_PIN, INPUT);
    pinMode(STOP_PIN, INPUT_PULLUP);
    pinMode(MSR_PIN, INPUT_PULLUP);
    Serial.begin(115200);
    WiFi.config(EVGP_OWN_ADDRESS, EVGP_RACE_CONTROL, EVGP_NETMASK); /* no gateway is needed */
    WiFi.begin("evgp", "password"); /* name and key: the organiser's */
    WiFi.setSleep(false); /* a radio that sleeps hears a stop late */
    evgp_settings settings = evgp_default_settings();
    settings.msr_timeout_ms = 200; /* 0 only on a kart without the MSR's contact */
    evgp_kart_init(&kart, settings, millis());
    wheel_moved_at = millis();
    lost_at = millis() - WAIT_MS;
}

void loop()
{
    uint8_t bytes[256];
    evgp_kart_tick(&kart, millis());
    evgp_kart_team_stop(&kart, EVGP_STOP_BUTTON, digitalRead(STOP_PIN) != LOW, millis());
    evgp_kart_team_stop(&kart, EVGP_STOP_MSR, digitalRead(MSR_PIN) != LOW, millis());

    if (evgp_kart_verdict(&kart).open) {
        int waiting = link_to_race_control.available();
        for (int reads = 0; waiting > 0 && reads < 16; reads++) { /* no flood holds the brake up */
            const int count = link_to_race_control.read(bytes, sizeof bytes);
            if (count <= 0) {
                break;
            }
            evgp_kart_received(&kart, bytes, (size_t)count, millis());
            waiting = link_to_race_control.available();
        }
        if (!link_to_race_control.connected() || !evgp_kart_verdict(&kart).open || waiting > 0) {
            close_link(millis());
        }
    } else if ((uint32_t)(millis() - lost_at) >= WAIT_MS) {
        /* connect() waits, so nothing may be released meanwhile. Nothing is: without a connection
           the kart obeys RED_RED, and the turn before this one has set the pin. The third argument
           is that of ESP32's WiFiClient. On a board without it, limit the time in another way, or
           the watchdog resets the board whenever race control does not answer. */
        digitalWrite(RELEASE_PIN, LOW);
        if (link_to_race_control.connect(EVGP_RACE_CONTROL, EVGP_PORT, CONNECT_MS)) {
            link_to_race_control.setNoDelay(true);
            evgp_kart_connected(&kart, millis());
        } else {
            close_link(millis());
        }
    }

    const evgp_verdict verdict = evgp_kart_verdict(&kart);
    /* RED_FLAG may roll out while may_drive, for a kart that still steers. This one brakes at once. */
    const bool release = verdict.may_drive && verdict.obey != EVGP_RED_FLAG;
    digitalWrite(RELEASE_PIN, release ? HIGH : LOW);
    /* Feed the hardware watchdog here: the clock was looked at, and the brake is set. */

    const bool stands = standing();
    bool reached = false;
    switch (verdict.obey) {
    case EVGP_GREEN_GREEN: reached = !stands; break;
    case EVGP_GRID_ACTIVE: reached = stands && ready(); break;
    case EVGP_IN_GARAGE: reached = true; break;
    case EVGP_RED_FLAG:
    case EVGP_RED_RED:
    case EVGP_NONE: reached = stands; break;
    }
    if (reached) {
        const char *say = evgp_kart_acknowledge(&kart, verdict.order, millis());
        if (say != NULL &&
            link_to_race_control.write((const uint8_t *)say, strlen(say)) != strlen(say)) {
            close_link(millis()); /* half a frame may be out: begin again */
        }
    }
    if (verdict.obey != told) {
        told = verdict.obey;
        Serial.print("obey ");
        Serial.println(evgp_name(told));
    }
}
