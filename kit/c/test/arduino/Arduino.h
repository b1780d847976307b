// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/* What arduino.ino needs of Arduino, on POSIX: so that the tests compile it and let it race. */
#ifndef ARDUINO_STUB_H
#define ARDUINO_STUB_H

#include <cstdint>
#include <cstdio>
#include <ctime>

enum { LOW = 0, HIGH = 1, INPUT_PULLUP = 2, OUTPUT = 3, INPUT = 4 };

static int arduino_pins[16]; /* all LOW: every contact to ground is closed */

inline uint32_t millis()
{
    timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return static_cast<uint32_t>(now.tv_sec * 1000 + now.tv_nsec / 1000000);
}
inline void pinMode(int, int) {}
/* Pin 2 is the wheel of a kart that moves while pin 5 is HIGH, and else brakes. */
inline int arduino_wheel()
{
    static uint32_t last = millis();
    static double speed = 0.0, distance = 0.0;
    const uint32_t now = millis();
    const double seconds = (now - last) / 1000.0;
    last = now;
    speed += arduino_pins[5] == HIGH ? 3.0 * seconds : -6.0 * seconds;
    speed = speed < 0.0 ? 0.0 : speed > 5.0 ? 5.0 : speed;
    distance += speed * seconds;
    return static_cast<long>(distance / 0.1) % 2 == 0 ? LOW : HIGH;
}
inline int digitalRead(int pin) { return pin == 2 ? arduino_wheel() : arduino_pins[pin]; }
inline void digitalWrite(int pin, int level) { arduino_pins[pin] = level; }

struct SerialStub {
    void begin(long) {}
    void print(const char *text) { std::fputs(text, stdout); }
    void println(const char *text) { std::puts(text); std::fflush(stdout); }
};
static SerialStub Serial;

void setup();
void loop();

#endif
