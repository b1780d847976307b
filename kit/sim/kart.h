// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * A kart in C on a track: it replaces the kart in ../c/examples/posix.c, with -DEVGP_KART.
 *
 * Its base is a datagram socket at the port BASE: the kart sends a speed (m/s) and a turn rate
 * (rad/s), and receives x, y (m), heading (rad) and speed. TRACK is the file with the track's middle.
 */
#include <math.h>

#define TOP 6.5          /* maximum speed, m/s */
#define LANE 1.2         /* distance of its lane from the middle, to the left, m */
#define AHEAD 2          /* number of points ahead at which it aims: 3 m */
#define FRESH_MS 200U    /* maximum age of the base's last message */
#define MOST_POINTS 1000

static int base = -1, count = 0;
static evgp_action action;
static double middle[MOST_POINTS][2], pose[3], wanted = 0.0, speed = 0.0;
static uint32_t heard_at = 0;

static void begin(void)
{
    struct sockaddr_in to;
    char line[200];
    const char *port = getenv("BASE"), *path = getenv("TRACK");
    FILE *track = fopen(path ? path : "", "r");
    while (track && count < MOST_POINTS && fgets(line, sizeof line, track)) {
        count += sscanf(line, "%lf, %lf", &middle[count][0], &middle[count][1]) == 2;
    }
    memset(&to, 0, sizeof to);
    to.sin_family = AF_INET;
    to.sin_port = htons((uint16_t)atoi(port ? port : ""));
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    base = socket(AF_INET, SOCK_DGRAM, 0);
    if (count == 0 || connect(base, (struct sockaddr *)&to, sizeof to) != 0) {
        fprintf(stderr, "TRACK must be a file of points, and BASE the port of the kart's base\n");
        exit(2);
    }
    fclose(track);
}

static int fresh(void) { return heard_at != 0 && now() - heard_at < FRESH_MS; }

static void act(evgp_action what) { action = what; }
static int moves(void) { return fresh() ? speed > 0.0 : -1; }
static int ready(void) { return fresh(); }

/* Return the curvature, 1/m, that leads to the kart's lane: pure pursuit. */
static double steer(void)
{
    int index, nearest = 0;
    double x, y, angle;
    const double *before, *at, *after;
    for (index = 1; index < count; index++) {
        if (hypot(middle[index][0] - pose[0], middle[index][1] - pose[1]) <
            hypot(middle[nearest][0] - pose[0], middle[nearest][1] - pose[1])) {
            nearest = index;
        }
    }
    before = middle[(nearest + AHEAD - 1) % count];
    at = middle[(nearest + AHEAD) % count];
    after = middle[(nearest + AHEAD + 1) % count];
    angle = atan2(after[1] - before[1], after[0] - before[0]);
    x = at[0] - LANE * sin(angle) - pose[0];
    y = at[1] + LANE * cos(angle) - pose[1];
    return 2.0 * sin(atan2(y, x) - pose[2]) / hypot(x, y);
}

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
        if (sscanf(text, "%lf %lf %lf %lf", &pose[0], &pose[1], &pose[2], &speed) == 4) {
            heard_at = now();
        }
    }
    wanted = !fresh() || action == EVGP_BRAKE ? 0.0
             : action == EVGP_DRIVE           ? TOP
                                              : fmax(0.0, fmin(wanted, speed) - 0.03);
    length = snprintf(text, sizeof text, "%g %g", wanted, wanted * steer());
    (void)send(base, text, (size_t)length, 0); /* without messages, the base brakes */
}
