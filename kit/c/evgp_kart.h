// Copyright 2026 EVGP race control contributors
// SPDX-License-Identifier: Apache-2.0

/*
 * What a kart must obey, for karts without ROS: EVGP race control's protocol (docs/wire.md), in C.
 *
 * One header, C99 or C++. It allocates nothing, opens nothing and keeps all its state in the struct
 * that you give it. You pass it the received bytes and the time; it returns what the kart must obey
 * and what to send. In each turn of your loop, at least 20 times a second:
 *
 *     evgp_kart_tick(&kart, now);                       first: is race control silent?
 *     evgp_kart_received(&kart, bytes, count, now);     everything that has arrived
 *     evgp_verdict verdict = evgp_kart_verdict(&kart);
 *     if (!verdict.open) ... close the socket, if any, and reconnect later
 *     int reached = drive(verdict.obey, verdict.may_drive);
 *     if (reached) {
 *         const char *say = evgp_kart_acknowledge(&kart, verdict.order, now);
 *         if (say) ... send these characters
 *     }
 *
 * Call evgp_kart_connected() and evgp_kart_closed() when that happens. drive() must not wait. It
 * returns whether the kart HAS reached what it obeys: ready in GRID_ACTIVE, driving in GREEN_GREEN,
 * standing still in the reds. People walk onto the track because of an acknowledged stop: report
 * only what is true.
 *
 * The rules are those of evgp_protocol/arbiter.py, which explains them. The test test_kart_kit.py
 * gives both the same inputs and requires the same answers.
 *
 *   - RED_RED before the first frame of a connection, after frame_timeout_ms of silence, without a
 *     connection, and under a team stop.
 *   - GREEN_GREEN is obeyed only directly after a GRID_ACTIVE that was acknowledged on this
 *     connection, with no team stop since. Otherwise it is RED_RED.
 *   - A kart that a team stop takes out of that GRID_ACTIVE or GREEN_GREEN obeys RED_RED until
 *     another command. It reports RED_RED once, like an acknowledgement, so that race control knows.
 *   - An acknowledgement names the order that the kart acted on, and counts for no other.
 *
 * Time: milliseconds of a counter that nobody sets and that includes sleep. It may wrap to 0 after
 * 2^32 ms. If a time is before an earlier one, the connection counts as lost. Call evgp_kart_tick()
 * at least once in 24 days.
 *
 * One thread owns an evgp_kart. Do not call these functions from an interrupt at the same time.
 */
#ifndef EVGP_KART_H
#define EVGP_KART_H

#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* The TCP port on which race control listens. */
#define EVGP_PORT 12017

/* Maximum length of a frame in bytes, including '$' and ';'. */
#define EVGP_MAX_FRAME_BYTES 32

/* The race states (§3.A), with the numbers of evgp_rcs_msgs/RaceState. They are not in order of
   strictness: do not compare them with < or >. EVGP_NONE: race control has commanded nothing. */
typedef enum {
    EVGP_NONE = 0,
    EVGP_IN_GARAGE = 1,
    EVGP_GRID_ACTIVE = 2,
    EVGP_GREEN_GREEN = 3,
    EVGP_RED_FLAG = 4,
    EVGP_RED_RED = 5
} evgp_state;

/* Where a team stop comes from (§2.B, §2.C). Each must release its own. */
typedef enum {
    EVGP_STOP_BUTTON = 0, /* a button, a program, or anything else that reports both stop and go */
    EVGP_STOP_REMOTE = 1, /* the safety remote; silence of remote_timeout_ms is a stop */
    EVGP_STOP_MSR = 2     /* the MSR's contact; silence of msr_timeout_ms is a stop */
} evgp_stop_source;
#define EVGP_STOP_SOURCES 3

/* The parameters of the rules; evgp_kart_init() limits each to its range. */
typedef struct {
    uint32_t frame_timeout_ms;  /* silence after which the connection is lost; 1 to 1000 */
    uint32_t red_flag_drive_ms; /* time for which RED_FLAG lets a driving kart continue; to 30000 */
    uint32_t remote_timeout_ms; /* silence of the safety remote that is a team stop; to 10000; 0: no
                                   remote */
    uint32_t msr_timeout_ms;    /* time without a reading of the MSR's contact that is a team stop;
                                   to 1000; 0: no contact is wired */
    int drive_in_garage;        /* not 0: the kart may drive in IN_GARAGE, where its team has it */
} evgp_settings;

/* What the kart must do as of the last input. */
typedef struct {
    evgp_state obey;      /* what the kart must do; never EVGP_NONE */
    evgp_state commanded; /* what race control commands; EVGP_NONE: nothing */
    uint32_t order;       /* the number of that command, for its acknowledgement; 0: no command */
    int may_drive;        /* not 0: the kart may move */
    int open;             /* 0: there is no connection, or the socket must be closed */
    int team_stop;        /* not 0: the kart stops itself, for the team or the MSR */
    int acknowledged;     /* not 0: what it obeys was acknowledged */
} evgp_verdict;

/* A kart. Only the functions below use its fields. All zeros is a kart that stops. */
typedef struct {
    evgp_settings settings;
    uint32_t now;
    /* the last two ticks: what is passed now arrived after the first of them, or it would have been
       read before the second */
    uint32_t turn;
    uint32_t turn_before;
    /* the connection */
    uint32_t heard_at;
    uint32_t order;
    uint32_t next_order;
    uint32_t slowing_since;
    uint32_t malformed;
    evgp_state commanded;
    uint8_t open;
    uint8_t acknowledged;
    uint8_t armed;
    uint8_t slowing;
    /* the last acknowledgement: at most one per frame of race control */
    uint32_t said_order;
    uint8_t heard_since_said;
    /* the team's stop */
    uint8_t engaged[EVGP_STOP_SOURCES];
    uint8_t source_heard[EVGP_STOP_SOURCES];
    uint8_t stopped;
    uint32_t source_at[EVGP_STOP_SOURCES];
    /* the decoder: the frame so far, including '$' */
    char frame[EVGP_MAX_FRAME_BYTES];
    uint8_t frame_bytes;
    uint8_t skipping;
    uint8_t garage_owed; /* IN_GARAGE was not acknowledged: it goes before the next acknowledgement */
    uint8_t out; /* the kart stopped itself after it was armed, under the same commands */
} evgp_kart;

/* ----- names ------------------------------------------------------------------------------- */

/* Return the frame of a state, such as "$RED_RED;"; "" for EVGP_NONE. */
static inline const char *evgp_frame(evgp_state state)
{
    switch (state) {
    case EVGP_GREEN_GREEN: return "$GREEN_GREEN;";
    case EVGP_GRID_ACTIVE: return "$GRID_ACTIVE;";
    case EVGP_IN_GARAGE: return "$IN_GARAGE;";
    case EVGP_RED_FLAG: return "$RED_FLAG;";
    case EVGP_RED_RED: return "$RED_RED;";
    case EVGP_NONE: break;
    }
    return "";
}

/* Return the name of a state, for people. */
static inline const char *evgp_name(evgp_state state)
{
    switch (state) {
    case EVGP_GREEN_GREEN: return "GREEN_GREEN";
    case EVGP_GRID_ACTIVE: return "GRID_ACTIVE";
    case EVGP_IN_GARAGE: return "IN_GARAGE";
    case EVGP_RED_FLAG: return "RED_FLAG";
    case EVGP_RED_RED: return "RED_RED";
    case EVGP_NONE: break;
    }
    return "nothing";
}

/* ----- the rules; evgp_p_ marks private functions ------------------------------------------ */

/* Return the silence of a source that is a team stop; 0: its silence is allowed. */
static inline uint32_t evgp_p_timeout(const evgp_kart *kart, int source)
{
    return source == EVGP_STOP_REMOTE ? kart->settings.remote_timeout_ms
           : source == EVGP_STOP_MSR  ? kart->settings.msr_timeout_ms
                                      : 0U;
}

/* Return whether a source stops the kart: it says stop, or is silent and must not be. */
static inline int evgp_p_stops(const evgp_kart *kart, int source)
{
    return kart->engaged[source] ||
           (evgp_p_timeout(kart, source) > 0 && !kart->source_heard[source]);
}

static inline int evgp_p_team_stop(const evgp_kart *kart)
{
    return evgp_p_stops(kart, EVGP_STOP_BUTTON) || evgp_p_stops(kart, EVGP_STOP_REMOTE) ||
           evgp_p_stops(kart, EVGP_STOP_MSR);
}

static inline evgp_state evgp_p_obey(const evgp_kart *kart)
{
    if (kart->commanded == EVGP_NONE || kart->out || evgp_p_team_stop(kart)) {
        return EVGP_RED_RED;
    }
    if (kart->commanded == EVGP_GREEN_GREEN && !kart->armed) {
        return EVGP_RED_RED;
    }
    return kart->commanded;
}

/* Return the state to acknowledge once the kart has reached what it obeys; EVGP_NONE: none. */
static inline evgp_state evgp_p_reached(const evgp_kart *kart)
{
    const int to_race =
        kart->commanded == EVGP_GRID_ACTIVE || kart->commanded == EVGP_GREEN_GREEN;
    return kart->out                                          ? EVGP_RED_RED
           : to_race && evgp_p_obey(kart) != kart->commanded ? EVGP_NONE
                                                              : kart->commanded;
}

static inline int evgp_p_may_drive(const evgp_kart *kart)
{
    switch (evgp_p_obey(kart)) {
    case EVGP_GREEN_GREEN: return 1;
    case EVGP_IN_GARAGE: return kart->settings.drive_in_garage != 0;
    case EVGP_RED_FLAG: return kart->slowing != 0;
    case EVGP_GRID_ACTIVE:
    case EVGP_RED_RED:
    case EVGP_NONE: break;
    }
    return 0;
}

/* Give the present command, if any, a new number. */
static inline void evgp_p_number(evgp_kart *kart)
{
    if (kart->commanded != EVGP_NONE) {
        kart->order = kart->next_order;
        kart->next_order = kart->next_order == UINT32_MAX ? 1U : kart->next_order + 1U;
    }
}

static inline void evgp_p_lose(evgp_kart *kart)
{
    kart->open = 0;
    kart->commanded = EVGP_NONE;
    kart->order = 0;
    kart->acknowledged = 0;
    kart->armed = 0;
    kart->out = 0;
    kart->slowing = 0;
    kart->garage_owed = 0;
    kart->frame_bytes = 0;
    kart->skipping = 0;
}

/* Apply a team stop: nothing that allowed the kart to drive survives it. */
static inline void evgp_p_on_team_stop(evgp_kart *kart)
{
    kart->stopped = 1;
    kart->slowing = 0;
    if (kart->armed) {
        kart->armed = 0;
        kart->out = 1;
        kart->acknowledged = 0;
        evgp_p_number(kart); /* a program that acted on GREEN_GREEN must not acknowledge RED_RED */
    }
}

/* Let what is due happen, before the input is judged. */
static inline void evgp_p_pass(evgp_kart *kart, uint32_t now)
{
    /* Unsigned differences stay right when the counter wraps to 0. */
    const int backwards = (uint32_t)(now - kart->now) > UINT32_MAX / 2U;
    int source;
    kart->now = now;
    if (kart->open &&
        (backwards || (uint32_t)(now - kart->heard_at) >= kart->settings.frame_timeout_ms)) {
        evgp_p_lose(kart);
    }
    for (source = 0; source < EVGP_STOP_SOURCES; source++) {
        if (kart->source_heard[source] &&
            (backwards ||
             (uint32_t)(now - kart->source_at[source]) >= evgp_p_timeout(kart, source))) {
            kart->source_heard[source] = 0;
            evgp_p_on_team_stop(kart);
        }
    }
    if (kart->slowing &&
        (uint32_t)(now - kart->slowing_since) >= kart->settings.red_flag_drive_ms) {
        kart->slowing = 0;
    }
}

/* End an input: an acknowledgement from before the end of a team stop must not count after it. */
static inline void evgp_p_settle(evgp_kart *kart)
{
    const int stopped = evgp_p_team_stop(kart);
    if (kart->stopped && !stopped) {
        evgp_p_number(kart);
    }
    kart->stopped = (uint8_t)stopped;
}

static inline void evgp_p_heard(evgp_kart *kart, evgp_state state)
{
    kart->heard_at = kart->turn_before;
    kart->heard_since_said = 1;
    if (state != kart->commanded) {
        const int was_driving = evgp_p_may_drive(kart);
        const int to_race = kart->commanded == EVGP_GRID_ACTIVE && state == EVGP_GREEN_GREEN;
        kart->commanded = state;
        evgp_p_number(kart);
        kart->acknowledged = 0;
        kart->slowing = was_driving && state == EVGP_RED_FLAG &&
                        kart->settings.red_flag_drive_ms > 0;
        kart->slowing_since = kart->now;
        if (state == EVGP_IN_GARAGE) {
            kart->garage_owed = 1;
        }
        if (!to_race) {
            kart->armed = 0;
            kart->out = 0;
        }
    }
}

/* Return the state of a whole frame; EVGP_NONE: it is malformed. */
static inline evgp_state evgp_p_state_of(const char *frame, size_t count)
{
    static const evgp_state states[] = {EVGP_GREEN_GREEN, EVGP_GRID_ACTIVE, EVGP_IN_GARAGE,
                                        EVGP_RED_FLAG, EVGP_RED_RED};
    size_t i;
    for (i = 0; i < sizeof states / sizeof states[0]; i++) {
        const char *right = evgp_frame(states[i]);
        if (strlen(right) == count && memcmp(right, frame, count) == 0) {
            return states[i];
        }
    }
    return EVGP_NONE;
}

/* Return the state of the frame that this byte completes; EVGP_NONE: none. */
static inline evgp_state evgp_p_decode(evgp_kart *kart, uint8_t byte)
{
    evgp_state state = EVGP_NONE;
    if (byte == (uint8_t)'$') {
        if (kart->frame_bytes > 0) {
            kart->malformed++; /* cut off by a new frame */
        }
        kart->skipping = 0;
        kart->frame[0] = '$';
        kart->frame_bytes = 1;
    } else if (kart->frame_bytes == 0) {
        const int space = byte == (uint8_t)' ' || byte == (uint8_t)'\t' ||
                          byte == (uint8_t)'\r' || byte == (uint8_t)'\n' || byte == 0U;
        if (!kart->skipping && !space) {
            kart->malformed++; /* a byte outside a frame */
            kart->skipping = 1;
        }
    } else if (byte == (uint8_t)';') {
        kart->frame[kart->frame_bytes] = ';';
        state = evgp_p_state_of(kart->frame, (size_t)kart->frame_bytes + 1U);
        if (state == EVGP_NONE) {
            kart->malformed++; /* not the name of a state */
        }
        kart->frame_bytes = 0;
    } else if (byte > 127U || kart->frame_bytes == EVGP_MAX_FRAME_BYTES - 1) {
        kart->malformed++; /* not ASCII, or no ';' within EVGP_MAX_FRAME_BYTES */
        kart->skipping = 1;
        kart->frame_bytes = 0;
    } else {
        kart->frame[kart->frame_bytes] = (char)byte;
        kart->frame_bytes++;
    }
    return state;
}

/* ----- the functions to call --------------------------------------------------------------- */

/* Return the default settings: 1 s of silence, 15 s for RED_FLAG, no remote, no MSR contact, no
   driving in IN_GARAGE. */
static inline evgp_settings evgp_default_settings(void)
{
    evgp_settings settings;
    settings.frame_timeout_ms = 1000;
    settings.red_flag_drive_ms = 15000;
    settings.remote_timeout_ms = 0;
    settings.msr_timeout_ms = 0;
    settings.drive_in_garage = 0;
    return settings;
}

/* Initialize. The kart obeys RED_RED until race control sends another state. */
static inline void evgp_kart_init(evgp_kart *kart, evgp_settings settings, uint32_t now)
{
    memset(kart, 0, sizeof *kart);
    if (settings.frame_timeout_ms == 0 || settings.frame_timeout_ms > 1000) {
        settings.frame_timeout_ms = 1000;
    }
    if (settings.red_flag_drive_ms > 30000) {
        settings.red_flag_drive_ms = 30000;
    }
    if (settings.remote_timeout_ms > 10000) {
        settings.remote_timeout_ms = 10000;
    }
    if (settings.msr_timeout_ms > 1000) {
        settings.msr_timeout_ms = 1000;
    }
    kart->settings = settings;
    kart->now = now;
    kart->next_order = 1;
    kart->stopped = (uint8_t)evgp_p_team_stop(kart);
}

/* Let time pass. Call it once in every turn of the loop that brakes: without it, the connection is
   lost after frame_timeout_ms. */
static inline void evgp_kart_tick(evgp_kart *kart, uint32_t now)
{
    kart->turn_before = kart->turn;
    kart->turn = now;
    evgp_p_pass(kart, now);
    evgp_p_settle(kart);
}

/* A new connection to race control was made; the one before counts as lost. */
static inline void evgp_kart_connected(evgp_kart *kart, uint32_t now)
{
    evgp_p_pass(kart, now);
    evgp_p_lose(kart);
    kart->open = 1;
    kart->heard_at = now;
    kart->turn = now;
    kart->turn_before = now;
    evgp_p_settle(kart);
}

/* The connection is closed or broken, or you close it. Call it as soon as you know. */
static inline void evgp_kart_closed(evgp_kart *kart, uint32_t now)
{
    evgp_p_pass(kart, now);
    evgp_p_lose(kart);
    evgp_p_settle(kart);
}

/*
 * Take what arrived on the present connection: any number of bytes, split anywhere.
 *
 * Read everything before you look at the verdict, so that the kart obeys the last frame. Bytes that
 * arrive after the timeout are too late: the connection is already lost. Frames may have waited while
 * the kart was held up, so silence counts from the tick before the last one. A count below 0, as
 * recv() returns on failure, is a lost connection.
 */
static inline void evgp_kart_received(evgp_kart *kart, const void *bytes, size_t count,
                                      uint32_t now)
{
    const uint8_t *each = (const uint8_t *)bytes;
    size_t i;
    evgp_p_pass(kart, now);
    if (count > SIZE_MAX / 2U) {
        evgp_p_lose(kart);
    }
    for (i = 0; i < count && kart->open; i++) {
        const evgp_state state = evgp_p_decode(kart, each[i]);
        if (state != EVGP_NONE) {
            evgp_p_heard(kart, state);
        }
    }
    evgp_p_settle(kart);
}

/*
 * Engage the team's stop (stop is not 0), or release it. It is on while any source engages it. An
 * unknown source is always a stop, until EVGP_STOP_BUTTON releases it.
 *
 * With remote_timeout_ms, call it for every message of the remote, also for those that say go. With
 * msr_timeout_ms, call it with EVGP_STOP_MSR each time that you have read the contact.
 */
static inline void evgp_kart_team_stop(evgp_kart *kart, evgp_stop_source source, int stop,
                                       uint32_t now)
{
    const int own = source == EVGP_STOP_REMOTE || source == EVGP_STOP_MSR ? (int)source : 0;
    evgp_p_pass(kart, now);
    kart->engaged[own] = stop != 0 || (int)source != own;
    if (evgp_p_timeout(kart, own) > 0) {
        kart->source_heard[own] = 1;
        kart->source_at[own] = now;
    }
    if (evgp_p_team_stop(kart)) {
        evgp_p_on_team_stop(kart);
    }
    evgp_p_settle(kart);
}

/* Return what the kart must do as of the last input. */
static inline evgp_verdict evgp_kart_verdict(const evgp_kart *kart)
{
    evgp_verdict verdict;
    verdict.obey = evgp_p_obey(kart);
    verdict.commanded = kart->commanded;
    verdict.order = kart->order;
    verdict.may_drive = evgp_p_may_drive(kart);
    verdict.open = kart->open;
    verdict.team_stop = evgp_p_team_stop(kart);
    verdict.acknowledged = kart->acknowledged;
    return verdict;
}

/* Return the frame to send, after any IN_GARAGE that other frames have overtaken. */
static inline const char *evgp_p_reply(const evgp_kart *kart)
{
    const evgp_state reached = evgp_p_reached(kart);
    if (!kart->garage_owed) {
        return evgp_frame(reached);
    }
    switch (reached) {
    case EVGP_GRID_ACTIVE: return "$IN_GARAGE;$GRID_ACTIVE;";
    case EVGP_RED_FLAG: return "$IN_GARAGE;$RED_FLAG;";
    case EVGP_RED_RED: return "$IN_GARAGE;$RED_RED;";
    default: return evgp_frame(reached);
    }
}

/*
 * Report that the kart has reached what a verdict obeys; return the characters to send, or NULL.
 *
 * Call it in every turn in which that is true, with the order of the verdict that the kart acted
 * on, not a newer one. For a kart that stopped itself in GRID_ACTIVE or GREEN_GREEN and stands still,
 * this reports RED_RED, once. NULL: the order is over, there is nothing to report, or the same was
 * already sent and no frame has arrived since. Send all of the characters with nothing in between, or
 * close the connection.
 */
static inline const char *evgp_kart_acknowledge(evgp_kart *kart, uint32_t order, uint32_t now)
{
    const char *say = NULL;
    evgp_p_pass(kart, now);
    if (order == kart->order && evgp_p_reached(kart) != EVGP_NONE &&
        !(kart->out && kart->acknowledged)) {
        kart->acknowledged = 1;
        kart->slowing = 0;
        if (kart->commanded == EVGP_GRID_ACTIVE && !kart->out) {
            kart->armed = 1;
        }
        if (kart->said_order != order || kart->heard_since_said) {
            kart->said_order = order;
            kart->heard_since_said = 0;
            say = evgp_p_reply(kart);
            kart->garage_owed = 0;
        }
    }
    evgp_p_settle(kart);
    return say;
}

/* Return why the kart does not obey what race control commands, for people; "": it does. */
static inline const char *evgp_kart_reason(const evgp_kart *kart)
{
    if (evgp_p_obey(kart) == kart->commanded) {
        return "";
    }
    if (!kart->open) {
        return "not connected to race control";
    }
    if (kart->commanded == EVGP_NONE) {
        return "race control has sent nothing on this connection yet";
    }
    if (evgp_p_team_stop(kart)) {
        return evgp_p_stops(kart, EVGP_STOP_MSR) ? "the MSR's contact is open, or not read"
                                                 : "team stop";
    }
    if (kart->out) {
        return "the kart stopped itself after it acknowledged GRID_ACTIVE, and needs a new GRID_ACTIVE";
    }
    return "GREEN_GREEN needs an acknowledged GRID_ACTIVE before it, on this connection";
}

/* Return the number of malformed frames so far. */
static inline uint32_t evgp_kart_malformed(const evgp_kart *kart)
{
    return kart->malformed;
}

#ifdef __cplusplus
}
#endif

#endif /* EVGP_KART_H */
