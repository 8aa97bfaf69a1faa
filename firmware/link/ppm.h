/* PPM, the pulse train of a radio receiver: rising edges in, frames out.
 *
 * A frame is nine edges, and the time between two of them, 750 to 2250 us, is a channel. It ends when no edge
 * has come for PPM_PAUSE_US by the board's clock: only then is the number of its channels known. A frame with
 * another number of edges, or with a time outside of these, is no frame. Pauses are not told by the stamps of
 * the edges, which are modulo 2^16 us. */
#ifndef PLUMB_LINK_PPM_H
#define PLUMB_LINK_PPM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define PPM_CHANNELS  8U
#define PPM_PULSE_MIN 750U
#define PPM_PULSE_MAX 2250U
#define PPM_PAUSE_US  3000U

/* Zero at the start. */
typedef struct {
    uint8_t edges; /* of the frame under way, PPM_CHANNELS + 2: too many, or a wrong time between two */
    uint16_t last_us;
    uint32_t received_us; /* the newest edge, by the board's clock */
    uint16_t pulse_us[PPM_CHANNELS];
} ppm_t;

/* Handle the edges until now, and the time without one. stamps_us: when they came, modulo 2^16. True when a
 * frame has ended: it stays in pulse_us until the next call. */
bool ppm_follow(ppm_t *p, const uint16_t *stamps_us, size_t count, uint32_t now_us);

#endif
