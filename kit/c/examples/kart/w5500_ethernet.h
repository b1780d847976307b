// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * Network of a W5500, whose cable leads to the kart's WLAN client, for Arduino's library Ethernet 2;
 * and the watchdog of an AVR. On another board, replace the lines with wdt and MCUSR.
 *
 * Set the AVR's fuses to brown-out detection at 4.3 V: below that it may do anything. Test your
 * bootloader: one that leaves the watchdog on resets the board forever.
 */
#include <Ethernet.h>
#include <avr/wdt.h>

static EthernetClient client;
static uint8_t mac[] = {0x02, 0, 0, 0, 0, 101}; /* unique in this network */

static int joined()
{
    return Ethernet.hardwareStatus() != EthernetNoHardware && Ethernet.linkStatus() == LinkON;
}
/* Without a W5500 this takes so long that the watchdog resets the board, which then tries again. */
static void join()
{
    Ethernet.begin(mac, EVGP_OWN_ADDRESS, EVGP_RACE_CONTROL, EVGP_RACE_CONTROL, EVGP_NETMASK);
}
static void begin_network()
{
    join();
    client.setConnectionTimeout(CONNECT_MS);
}
static int connect_it()
{
    join(); /* the W5500 may have lost its address in a brown-out that the board survived */
    return client.connect(EVGP_RACE_CONTROL, EVGP_PORT);
}

static const char *why_reset()
{
    const uint8_t why = MCUSR; /* 0 where the bootloader has cleared it */
    MCUSR = 0;
    wdt_disable();
    return why & _BV(BORF)   ? "reset: brown-out"
           : why & _BV(WDRF) ? "reset: the program hung"
                             : "started";
}
static void begin_watchdog() { wdt_enable(WDTO_500MS); }
static void feed_watchdog() { wdt_reset(); }
