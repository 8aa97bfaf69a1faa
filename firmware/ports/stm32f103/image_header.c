/* The header of an image, and the place of its CRC. */
#include "image_header.h"
#include "build_id.h"
#include "linker.h"

__attribute__((section(".image_header"), used)) const volatile image_header_t image_header = {
    .magic = 0x626d6c70U, /* "plmb" */
    .family = 0x103U,
    .bytes = (uint32_t)(uintptr_t)image_bytes,
    .git_hash = {BUILD_GIT_HASH_HIGH, BUILD_GIT_HASH_LOW},
    .git_dirty = BUILD_GIT_DIRTY,
};

__attribute__((section(".image_crc"), used)) static const uint32_t image_crc = 0xffffffffU;
