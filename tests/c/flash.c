#include "flash.h"
#include <string.h>

flash_t flash;
uint32_t flash_page_bytes = 1024U;
uint16_t flash_stuck_low[FLASH_CELLS], flash_stuck_high[FLASH_CELLS];
size_t flash_weak = FLASH_CELLS;
void (*flash_half_done)(void);

void flash_blank(void) {
    memset(&flash, 0xFF, sizeof flash);
    memset(flash_stuck_low, 0, sizeof flash_stuck_low);
    memset(flash_stuck_high, 0, sizeof flash_stuck_high);
    flash_page_bytes = 1024U;
    flash_weak = FLASH_CELLS;
    flash_half_done = NULL;
}

const uint16_t *board_store_slot(uint32_t slot) {
    return &flash.cell[slot * BOARD_STORE_HALFWORDS];
}

static uint16_t worn(size_t at, uint32_t value) {
    return (uint16_t)((value & ~(uint32_t)flash_stuck_low[at]) | flash_stuck_high[at]);
}

/* xorshift32: which bits a half-done operation has done. */
static uint32_t next_random(void) {
    static uint32_t x = 1;

    x ^= x << 13;
    x ^= x >> 17;
    x ^= x << 5;
    return x;
}

/* Cells from..to become `after`. On the way: half of the cells done, and random halves of the bits, few,
 * many. */
static void change(size_t from, size_t to, uint16_t after) {
    static flash_t before;

    if (flash_half_done != NULL) {
        before = flash;
        for (unsigned way = 0; way < 4U; way++) {
            for (size_t at = from; at < to; at++) {
                const uint32_t random = next_random();
                const uint32_t few = random & (random >> 16), many = random | (random >> 16);
                const uint32_t done = way == 0U   ? (at < (from + to) / 2U ? 0xFFFFU : 0U)
                                      : way == 1U ? few
                                      : way == 2U ? many
                                                  : random;

                flash.cell[at] = worn(at, (before.cell[at] & ~done) | (after & done));
            }
            flash_half_done();
            flash = before;
        }
    }
    for (size_t at = from; at < to; at++) {
        flash.cell[at] = worn(at, after);
    }
}

bool board_store_erase(uint32_t slot) {
    const size_t page = flash_page_bytes / 2U, start = slot * (size_t)BOARD_STORE_HALFWORDS;
    bool good = true;

    for (size_t at = start; at < start + BOARD_STORE_HALFWORDS; at += page) {
        change(at, at + page, 0xFFFFU);
    }
    for (size_t at = start; at < start + BOARD_STORE_HALFWORDS; at++) {
        good = good && flash.cell[at] == 0xFFFFU;
    }
    return good;
}

bool board_store_program(uint32_t slot, uint32_t halfword, uint16_t value) {
    const size_t at = slot * (size_t)BOARD_STORE_HALFWORDS + halfword;

    if (flash.cell[at] != 0xFFFFU && value != 0U) {
        return false;
    }
    change(at, at + 1U, value);
    flash_weak = flash_weak == at ? FLASH_CELLS : flash_weak;
    return true;
}
