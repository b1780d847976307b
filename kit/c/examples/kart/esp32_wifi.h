// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/* Network and watchdog of an ESP32, for Espressif's Arduino core 3 or newer. */
#include <WiFi.h>
#include <driver/gpio.h>
#include <esp_task_wdt.h>

static WiFiClient client;

static void begin_network()
{
    WiFi.config(EVGP_OWN_ADDRESS, EVGP_RACE_CONTROL, EVGP_NETMASK); /* no gateway is needed */
    WiFi.setAutoReconnect(false); /* evgp_board.h does it, with a growing delay */
    WiFi.begin(EVGP_WLAN);
    WiFi.setSleep(false); /* a sleeping radio receives a stop late */
}
/* WiFi.status() may stay WL_CONNECTED after some kinds of disconnection. */
static int joined() { return WiFi.STA.connected() && WiFi.STA.hasIP(); }
static void join() { WiFi.reconnect(); }
static int connect_it()
{
    return client.connect(EVGP_RACE_CONTROL, EVGP_PORT, CONNECT_MS) &&
           client.setNoDelay(true) >= 0;
}

static const char *why_reset()
{
    const esp_reset_reason_t why = esp_reset_reason();
    return why == ESP_RST_BROWNOUT   ? "reset: brown-out"
           : why == ESP_RST_TASK_WDT ? "reset: the program hung"
                                     : "started";
}
/* The watchdog calls this first. It then prints on the serial line what hung, and resets the chip. */
extern "C" void esp_task_wdt_isr_user_handler()
{
    gpio_set_level((gpio_num_t)POWER_PIN, 0);
    gpio_set_level((gpio_num_t)RELEASE_PIN, 0);
}
static void begin_watchdog()
{
    const esp_task_wdt_config_t watchdog = {500, 0, true}; /* ms; it resets the chip */
    esp_task_wdt_reconfigure(&watchdog);
    esp_task_wdt_add(NULL);
}
static void feed_watchdog() { esp_task_wdt_reset(); }
