/* The two slots of saved parameters: the last 4 KiB of the smallest part's flash (PM0075 2.3, RM0008 3.3).
 *
 * The flash cannot be read while it is erased or programmed, so the processor, which runs from it, stalls: up
 * to 40 ms for a page, 70 us for a half-word (datasheet, table of flash characteristics). Interrupts wait,
 * and the board's clock loses that time. HSI clocks the operations and is never switched off. */
#include "app/board.h"
#include "app/board_store.h"
#include "clock.h"
#include "linker.h"
#include "stm32f103.h"
#include "watchdog.h"

#define MEDIUM_DENSITY_KIB 128U
#define SLOT_BYTES         (2U * BOARD_STORE_HALFWORDS)
/* Twice the worst case, in polls of 64 cycles at 72 MHz; a stalled processor only polls more slowly. */
#define ERASE_POLLS   90000U
#define PROGRAM_POLLS 160U
#define ERRORS        (FLASH_SR_PGERR | FLASH_SR_WRPRTERR)

static volatile uint16_t *slot_start(uint32_t slot) {
    return store_start + slot * BOARD_STORE_HALFWORDS;
}

const uint16_t *board_store_slot(uint32_t slot) {
    return (const uint16_t *)slot_start(slot);
}

static void write_keys(void) {
    FLASH_KEYR = FLASH_KEYR_KEY_1;
    FLASH_KEYR = FLASH_KEYR_KEY_2;
}

/* Unlocks the controller for erasing or programming: FLASH_CR_PER or FLASH_CR_PG. Keys that are written while
 * it is unlocked lock it until the next reset, so they are written when LOCK says so; and, for clones whose
 * LOCK reads 0 while they are locked, once after a write of CR that changed nothing. */
static bool unlock(uint32_t mode) {
    if ((FLASH_CR & FLASH_CR_LOCK) != 0U) {
        write_keys();
    }
    FLASH_SR = ERRORS | FLASH_SR_EOP; /* cleared by writing 1 */
    FLASH_CR = mode;
    if ((FLASH_CR & mode) == 0U) {
        write_keys();
        FLASH_CR = mode;
    }
    return (FLASH_CR & (mode | FLASH_CR_LOCK)) == mode;
}

/* Waits for the end of the operation, then locks the controller. */
static bool finish(uint32_t polls) {
    const bool ended = clock_wait(&FLASH_SR, FLASH_SR_BSY, 0U, polls);
    const bool good = ended && (FLASH_SR & ERRORS) == 0U;
    FLASH_CR = FLASH_CR_LOCK;
    return good;
}

static bool erase_page(uint32_t address) {
    watchdog_feed_longest();
    if (!unlock(FLASH_CR_PER)) {
        return false;
    }
    FLASH_AR = address;
    FLASH_CR = FLASH_CR_PER | FLASH_CR_STRT;
    (void)FLASH_CR; /* BSY is valid one cycle after STRT at the earliest (PM0075 2.3.2) */
    return finish(ERASE_POLLS);
}

bool board_store_erase(uint32_t slot) {
    const uint32_t start = (uint32_t)(uintptr_t)slot_start(slot);
    /* When the size is unreadable: 1 KiB, which erases a page of 2 KiB twice. */
    const uint32_t page_bytes = board_identity()->flash_kib > MEDIUM_DENSITY_KIB ? 2048U : 1024U;
    bool good = true;
    for (uint32_t at = 0U; at < SLOT_BYTES && good; at += page_bytes) {
        good = erase_page(start + at);
    }
    return good;
}

bool board_store_program(uint32_t slot, uint32_t halfword, uint16_t value) {
    watchdog_feed(); /* a whole slot takes longer than the watchdog's limit */
    if (!unlock(FLASH_CR_PG)) {
        return false;
    }
    slot_start(slot)[halfword] = value;
    return finish(PROGRAM_POLLS);
}
