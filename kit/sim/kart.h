// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * A kart in C on a track: it replaces the kart in ../c/examples/posix.c, with -DEVGP_KART.
 *
 * Its base, which steers by itself, is a datagram socket at the port BASE: the kart sends the speed
 * that it wants, and receives its true speed, in m/s.
 */
#define TOP 6.5       /* maximum speed, m/s */
#define FRESH_MS 200U /* maximum age of the base's last message */

static int base = -1;
static evgp_action action;
static double wanted = 0.0, speed = 0.0;
static uint32_t heard_at = 0;

static void begin(void)
{
    struct sockaddr_in to;
    const char *port = getenv("BASE");
    memset(&to, 0, sizeof to);
    to.sin_family = AF_INET;
    to.sin_port = htons((uint16_t)atoi(port ? port : ""));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    base = socket(AF_INET, SOCK_DGRAM, 0);
    if (!port || connect(base, (struct sockaddr *)&to, sizeof to) != 0) {
        fprintf(stderr, "BASE must be the port of the kart's base\n");
        exit(2);
    }
}

static int fresh(void) { return heard_at != 0 && now() - heard_at < FRESH_MS; }

static void act(evgp_action what) { action = what; }
static int moves(void) { return fresh() ? speed > 0.0 : -1; }
static int ready(void) { return fresh(); }

/* Carry out the action for one turn, without waiting. */
static void drive(void)
{
    char text[100];
    ssize_t size;
    int length;
    if (base < 0) {
        begin();
    }
    while ((size = recv(base, text, sizeof text - 1, MSG_DONTWAIT)) > 0) {
        text[size] = 0;
        if (sscanf(text, "%lf", &speed) == 1) {
            heard_at = now();
        }
    }
    wanted = wanted < speed ? wanted : speed;
    wanted = !fresh() || action == EVGP_BRAKE ? 0.0
             : action == EVGP_DRIVE           ? TOP
             : wanted > 0.03                  ? wanted - 0.03
                                              : 0.0;
    length = snprintf(text, sizeof text, "%g", wanted);
    (void)send(base, text, (size_t)length, 0); /* without messages, the base brakes */
}
