// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * What the sketch needs of Arduino, on POSIX: so that the tests compile it and let it race. The
 * toolchains of the boards come from registries of their own, which tests must not depend on. The
 * other headers here are empty.
 *
 * The first two words of the command line are race control's port and this kart's own address.
 */
#ifndef ARDUINO_STUB_H
#define ARDUINO_STUB_H

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <ctime>

enum { LOW = 0, HIGH = 1, INPUT_PULLUP = 2, OUTPUT = 3, INPUT = 4 };

static int arduino_pins[32]; /* all LOW: every contact to ground is closed */
static const char *arduino_port, *arduino_own;

inline uint32_t millis()
{
    timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return static_cast<uint32_t>(now.tv_sec * 1000 + now.tv_nsec / 1000000);
}
inline void pinMode(int, int) {}
/* Pin 22 is the wheel of a kart whose motors pin 27 powers, and whose brake pin 23 releases. */
inline int arduino_wheel()
{
    static uint32_t last = millis();
    static double speed = 0.0, distance = 0.0;
    const uint32_t now = millis();
    const double seconds = (now - last) / 1000.0;
    last = now;
    speed += seconds * (arduino_pins[23] != HIGH   ? -6.0
                        : arduino_pins[27] == HIGH ? 3.0
                                                   : -1.0);
    speed = speed < 0.0 ? 0.0 : speed > 5.0 ? 5.0 : speed;
    distance += speed * seconds;
    return static_cast<long>(distance / 0.02) % 2 == 0 ? LOW : HIGH;
}
inline int digitalRead(int pin) { return pin == 22 ? arduino_wheel() : arduino_pins[pin]; }
inline void digitalWrite(int pin, int level) { arduino_pins[pin] = level; }

struct SerialStub {
    void begin(long) {}
    void print(const char *text) { std::fputs(text, stdout); }
    void println(const char *text) { std::puts(text); std::fflush(stdout); }
};
static SerialStub Serial;

struct IPAddress {
    uint32_t address;
    IPAddress(int a, int b, int c, int d)
        : address(static_cast<uint32_t>(a << 24 | b << 16 | c << 8 | d)) {}
};

/* The functions of WiFiClient and EthernetClient, on a POSIX socket. */
class Client {
public:
    int connect(IPAddress to, uint16_t, int32_t = 0)
    {
        stop();
        socket_ = ::socket(AF_INET, SOCK_STREAM, 0);
        sockaddr_in own = {}, peer = {};
        own.sin_family = peer.sin_family = AF_INET;
        inet_pton(AF_INET, arduino_own, &own.sin_addr);
        peer.sin_addr.s_addr = htonl(to.address);
        peer.sin_port = htons(static_cast<uint16_t>(std::atoi(arduino_port)));
        return ::bind(socket_, reinterpret_cast<sockaddr *>(&own), sizeof own) == 0 &&
               ::connect(socket_, reinterpret_cast<sockaddr *>(&peer), sizeof peer) == 0;
    }
    int available()
    {
        int count = 0;
        ioctl(socket_, FIONREAD, &count);
        return count;
    }
    uint8_t connected()
    {
        char byte;
        return available() > 0 || (recv(socket_, &byte, 1, MSG_PEEK | MSG_DONTWAIT) != 0 &&
                                   (errno == EAGAIN || errno == EWOULDBLOCK));
    }
    int read(uint8_t *bytes, size_t size)
    {
        return static_cast<int>(recv(socket_, bytes, size, MSG_DONTWAIT));
    }
    size_t write(const uint8_t *bytes, size_t size)
    {
        const ssize_t sent = send(socket_, bytes, size, MSG_NOSIGNAL | MSG_DONTWAIT);
        return sent < 0 ? 0 : static_cast<size_t>(sent);
    }
    int setNoDelay(bool on)
    {
        const int value = on;
        return setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &value, sizeof value);
    }
    void setConnectionTimeout(uint16_t) {}
    void stop()
    {
        if (socket_ >= 0) {
            close(socket_);
        }
        socket_ = -1;
    }

private:
    int socket_ = -1;
};

/* An ESP32 whose WLAN is always up, and whose watchdog never fires. */
typedef Client WiFiClient;

struct WiFiStub {
    struct {
        bool connected() { return true; }
        bool hasIP() { return true; }
    } STA;
    void config(IPAddress, IPAddress, IPAddress) {}
    void setAutoReconnect(bool) {}
    void begin(const char *, const char *) {}
    void setSleep(bool) {}
    void reconnect() {}
};
[[maybe_unused]] static WiFiStub WiFi;

enum esp_reset_reason_t { ESP_RST_POWERON = 1, ESP_RST_TASK_WDT = 6, ESP_RST_BROWNOUT = 9 };
inline esp_reset_reason_t esp_reset_reason() { return ESP_RST_POWERON; }

typedef int gpio_num_t;
inline void gpio_set_level(gpio_num_t pin, uint32_t level)
{
    arduino_pins[pin] = static_cast<int>(level);
}

struct esp_task_wdt_config_t {
    uint32_t timeout_ms, idle_core_mask;
    bool trigger_panic;
};
inline void esp_task_wdt_reconfigure(const esp_task_wdt_config_t *) {}
inline void esp_task_wdt_add(void *) {}
inline void esp_task_wdt_reset() {}

/* A W5500 whose cable is always connected, and a Mega 2560's watchdog. */
typedef Client EthernetClient;
enum { EthernetNoHardware, EthernetW5500 };
enum { Unknown, LinkON, LinkOFF };

struct EthernetStub {
    void begin(uint8_t *, IPAddress, IPAddress, IPAddress, IPAddress) {}
    int hardwareStatus() { return EthernetW5500; }
    int linkStatus() { return LinkON; }
};
[[maybe_unused]] static EthernetStub Ethernet;

[[maybe_unused]] static uint8_t MCUSR;
enum { WDRF = 3, BORF = 2, WDTO_500MS = 5 };
#define _BV(bit) (1 << (bit))
inline void wdt_disable() {}
inline void wdt_enable(int) {}
inline void wdt_reset() {}

void setup();
void loop();

int main(int argc, char **argv)
{
    if (argc != 3) {
        return 2;
    }
    arduino_port = argv[1];
    arduino_own = argv[2];
    for (setup();; usleep(1000)) {
        loop();
    }
}

#endif
