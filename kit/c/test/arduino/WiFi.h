// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/* WiFiClient on a POSIX socket; see Arduino.h. The first two words of the command line are race
   control's port and this kart's own address. */
#ifndef WIFI_STUB_H
#define WIFI_STUB_H

#include <arpa/inet.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdint>
#include <cerrno>
#include <cstdlib>

static const char *arduino_port, *arduino_own;

struct IPAddress {
    uint32_t address;
    IPAddress(int a, int b, int c, int d)
        : address(static_cast<uint32_t>(a << 24 | b << 16 | c << 8 | d)) {}
};

class WiFiClient {
public:
    int connect(IPAddress to, uint16_t, int32_t)
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

struct WiFiStub {
    void config(IPAddress, IPAddress, IPAddress) {}
    void begin(const char *, const char *) {}
    void setSleep(bool) {}
};
static WiFiStub WiFi;

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
