#include "flash.h"
#include <string.h>

flash_t flash;
uint32_t flash_page_bytes = 1024U;
uint16_t flash_stuck_low[FLASH_CELLS], flash_stuck_high[FLASH_CELLS];
size_t flash_weak = FLASH_CELLS;
uint64_t flash_marked;
uint8_t flash_seed;
bool flash_refuses;
uint32_t flash_operations;
void (*flash_half_done)(void);

void flash_blank(void) {
    memset(&flash, 0xFF, sizeof flash);
    memset(flash_stuck_low, 0, sizeof flash_stuck_low);
    memset(flash_stuck_high, 0, sizeof flash_stuck_high);
    flash_page_bytes = 1024U;
    flash_weak = FLASH_CELLS;
    flash_half_done = NULL;
    flash_refuses = false;
    flash_operations = 0;
}

const uint16_t *board_store_slot(uint32_t slot) {
    return &flash.cell[slot * BOARD_STORE_HALFWORDS];
}

static uint16_t worn(size_t at, uint32_t value) {
    return (uint16_t)((value & ~(uint32_t)flash_stuck_low[at]) | flash_stuck_high[at]);
}

static uint64_t scrambled(uint64_t x) {
    x *= 0x9E3779B97F4A7C15U;

    x = (x ^ (x >> 29)) * 0xBF58476D1CE4E5B9U;
    return x ^ (x >> 32);
}

static uint64_t mark_of(size_t at, uint16_t value) {
    return scrambled((uint64_t)at << 16 | value);
}

uint64_t flash_mark(void) {
    uint64_t mark = 0;

    for (size_t at = 0; at < FLASH_CELLS; at++) {
        mark += mark_of(at, flash.cell[at]);
    }
    return mark;
}

static void become(size_t at, uint32_t value) {
    flash_marked -= mark_of(at, flash.cell[at]);
    flash.cell[at] = worn(at, value);
    flash_marked += mark_of(at, flash.cell[at]);
}

/* Cells from..to become `after`. On the way: half of the cells done, and random halves of the bits, few,
 * many. */
static void change(size_t from, size_t to, uint16_t after) {
    static flash_t before;

    flash_operations++;
    if (flash_half_done != NULL) {
        memcpy(before.cell + from, flash.cell + from, (to - from) * sizeof before.cell[0]);
        for (unsigned way = 0; way < FLASH_WAYS; way++) {
            for (size_t at = from; at < to; at++) {
                const uint32_t random = (uint32_t)scrambled((uint64_t)at << 16 | way << 8 | flash_seed);
                const uint32_t few = random & (random >> 16), many = random | (random >> 16);
                const uint32_t done = way == 0U   ? (at < (from + to) / 2U ? 0xFFFFU : 0U)
                                      : way == 1U ? few
                                      : way == 2U ? many
                                                  : random;

                become(at, (before.cell[at] & ~done) | (after & done));
            }
            flash_half_done();
            for (size_t at = from; at < to; at++) {
                become(at, before.cell[at]);
            }
        }
    }
    for (size_t at = from; at < to; at++) {
        become(at, after);
    }
}

bool board_store_erase(uint32_t slot) {
    const size_t page = flash_page_bytes / 2U, start = slot * (size_t)BOARD_STORE_HALFWORDS;
    bool good = !flash_refuses;

    for (size_t at = start; good && at < start + BOARD_STORE_HALFWORDS; at += page) {
        change(at, at + page, 0xFFFFU);
    }
    for (size_t at = start; at < start + BOARD_STORE_HALFWORDS; at++) {
        good = good && flash.cell[at] == 0xFFFFU;
    }
    return good;
}

bool board_store_program(uint32_t slot, uint32_t halfword, uint16_t value) {
    const size_t at = slot * (size_t)BOARD_STORE_HALFWORDS + halfword;

    if (flash_refuses || (flash.cell[at] != 0xFFFFU && value != 0U)) {
        return false;
    }
    change(at, at + 1U, value);
    flash_weak = flash_weak == at ? FLASH_CELLS : flash_weak;
    return true;
}
