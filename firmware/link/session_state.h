/* The state of the session (session.h), and its buffers. Only the files of the session and of the requests
 * see inside; the modules that own its parts know no session. */
#ifndef PLUMB_LINK_SESSION_STATE_H
#define PLUMB_LINK_SESSION_STATE_H

#include "arming.h"
#include "battery.h"
#include "commands.h"
#include "generated/used_parts.h"
#include "long_replies.h"
#include "nonce.h"
#include "readiness.h"
#include "receiver.h"
#include "run.h"
#include "staging.h"
#include "status.h"
#include "systems/control.h"
#include "telemetry.h"

/* Buffers: queued frames, samples and digests, and parameters not in use yet. They need no check word: frames
 * carry a CRC, and staged parameters are committed by theirs. */
typedef struct {
    routing_buffers_t routing;
    commands_t commands;
    params_t staged;
    run_buffers_t run;
    uint32_t digest[RUN_QUEUE_LENGTH];
    status_news_t news[LINKS];
#if USED_RECEIVER
    crsf_t crsf;
    ppm_t ppm;
#endif
} session_buffers_t;

/* State that decides whether and how an actuator moves: the board keeps a check word over all of it
 * (board_memory_seal()). Large data that decides nothing belongs into the buffers. */
typedef struct {
    routing_t routing;
    const board_identity_t *board;
    control_t *control;
    params_t *params;               /* in use */
    const control_system_t *system; /* that of the parameters in use */
    session_buffers_t *buffers;
    run_t run;
    telemetry_t telemetry;
    staging_t staging;
    arming_t arming;
    readiness_t readiness;
    status_t status;
#if USED_RECEIVER
    receiver_t receiver;
    uint32_t busy_us; /* when a run was last on, or a host last asked for a board without one */
#endif
#if USED_BATTERY
    battery_t battery;
#endif
#if CONTROL_LEARNS
    bool own_state; /* *control comes from a run on the board's own sensors with the parameters in use */
#endif
    bool step_overdue; /* no step of the run in real time comes (run.h) */
    random_t random;
    nonce_t nonce[LINKS]; /* valid only on the link that asked for it */
    long_replies_t long_replies[LINKS];
    bool bootloader_asked;
    uint32_t bootloader_us; /* when the bootloader was asked for */
} session_t;

#endif
