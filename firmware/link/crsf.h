/* CRSF, the serial protocol of a radio receiver: bytes in, frames out.
 *
 * A frame is 0xC8, the number of bytes that follow, a type, a payload and a CRC-8 (polynomial 0xD5, initial
 * value 0, over type and payload). It has 4 to 64 bytes. Two types count here; a frame of any other type or
 * length is consumed whole when its CRC is right, so nothing in its payload is taken for a frame:
 *
 *     0x16  22 bytes  16 channels of 11 bits, the lowest bit of the first channel first
 *     0x14  10 bytes  link statistics; byte 2 is the quality of the link to the receiver, 0 to 100 %
 *
 * Bytes that only looked like the beginning of a frame are searched again. Behind them a whole frame is found
 * at most 62 bytes late: a false length delays two frames of channels, or until crsf_pause(). The exception
 * is what looks like a frame and has the right CRC, as 1 in 256 of such does. Of damaged frames the CRC finds
 * every one with an odd number of wrong bits, or with all wrong bits within 8 in a row. Of the 18,336 pairs
 * of wrong bits that it covers in a frame of channels 105 leave it right; 91 of these leave the type, and
 * pass. */
#ifndef PLUMB_LINK_CRSF_H
#define PLUMB_LINK_CRSF_H

#include <stddef.h>
#include <stdint.h>

#define CRSF_CHANNELS    16U
#define CRSF_FRAME_BYTES 64U /* the longest frame */

typedef enum { CRSF_NOTHING, CRSF_STICKS, CRSF_STATISTICS } crsf_event_t;

/* Zero at the start. */
typedef struct {
    uint8_t length; /* bytes that may be a frame, or its beginning */
    uint8_t used;   /* of them, those of the frame that the last call found */
    uint8_t bytes[CRSF_FRAME_BYTES];
} crsf_t;

/* Handle one byte of the line: what kind of frame it completes. The frame stays readable until the next call.
 */
crsf_event_t crsf_push(crsf_t *c, uint8_t byte);

/* The line has paused: what was awaited is no frame. Call it until CRSF_NOTHING: the kind of each frame in
 * what looked like the beginning of a longer one. */
crsf_event_t crsf_pause(crsf_t *c);

/* Channel 0 to 15 of the frame that crsf_push() found, CRSF_STICKS: 0 to 2047. */
uint16_t crsf_channel(const crsf_t *c, unsigned channel);

/* Link quality in percent of the frame that crsf_push() found, CRSF_STATISTICS. */
uint8_t crsf_link_quality(const crsf_t *c);

#endif
