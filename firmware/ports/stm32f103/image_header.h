/* What an image says of itself: follows the vector table, at 0x130. The image's last word, behind everything
 * that gets flashed, is the CRC-32 of all bytes before it; tools/finish_image.py writes it. */
#ifndef PLUMB_STM32F103_IMAGE_HEADER_H
#define PLUMB_STM32F103_IMAGE_HEADER_H

#include <stdint.h>

typedef struct {
    uint32_t magic;
    uint32_t family; /* what the image runs on */
    uint32_t bytes;  /* of the image, CRC included */
    uint32_t git_hash[2];
    uint32_t git_dirty;
    uint32_t reserved[2];
} image_header_t;

/* volatile: read from the flash, so that no code, and no size of it, depends on the name of a commit. */
extern const volatile image_header_t image_header;

#endif
