/* What the files of the library for Python share: how a function is exported, and parameters as words. */
#ifndef PLUMB_BATCH_ENTRY_H
#define PLUMB_BATCH_ENTRY_H

#include "systems/control.h"
#include <string.h>

#if defined(_WIN32)
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

static inline plumb_params_t params_of(const uint32_t *words) {
    plumb_params_t p;
    memcpy(&p, words, sizeof p);
    return p;
}

#endif
