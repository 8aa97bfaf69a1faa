/* plumb: tilt and attitude in fixed point, every bit the same on a PC and on a microcontroller.
 *
 * A step takes raw counts and gives a record of every signal:
 *
 *     plumb_params_t params;
 *     plumb_attitude_t body;
 *
 *     plumb_design_t made = plumb_attitude_design(&PLUMB_ATTITUDE_TUNING_DEFAULT, &params);
 *
 *     plumb_attitude_init(&body, &params);
 *
 *     plumb_attitude_step(&body, &params, raw, 0);
 *
 * Design and init come once; made.error has to be PLUMB_DESIGN_OK. The step comes every period of the tuning,
 * period_us, and leaves the vertical in body axes in body.words.up_q30, where 2^30 is 1, and the quaternion
 * from body to earth in body.words.attitude.
 *
 * The caller owns all memory; nothing is allocated, kept in a static or read from a clock, so that instances
 * are independent and a run can be repeated. A step is integers alone. Formats are in the names: quantity,
 * unit, Qn for a value times 2^n.
 *
 * A design (plumb/design.h) makes the integers from deg, deg/s, g, s; it needs doubles, once, and may run
 * elsewhere. Without it, fill plumb_params_t with what the host's tools give, and ask
 * plumb_attitude_params_valid. */
#ifndef PLUMB_H
#define PLUMB_H

#include "plumb/angle.h"
#include "plumb/calibration.h"
#include "plumb/design.h"
#include "plumb/kalman.h"
#include "plumb/mounting.h"
#include "plumb/pid.h"
#include "plumb/plausibility.h"
#include "plumb/quaternion.h"
#include "plumb/systems.h"
#include "plumb/takeoff.h"
#include "plumb/tilt.h"
#include "plumb/version.h"
#include "plumb/wheel.h"

#endif
