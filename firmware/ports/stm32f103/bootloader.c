/* Into the ROM bootloader without touching BOOT0 (AN2606): a word in a backup register, a system reset, and
 * the reset handler jumps before any clock or pin has left its state after reset.
 *
 * The reset also stops both watchdogs, which the bootloader would not feed. A word that power failed behind,
 * or that a watchdog overtook, counts for nothing: only the software reset that belongs to it does. */
#include "bootloader.h"
#include "app/board.h"
#include "app/board_actuators.h"
#include "stm32f103.h"

#define ASKED         0xb007u /* of 16 bits */
#define BACKUP_CLOCKS (RCC_APB1ENR_PWREN | RCC_APB1ENR_BKPEN)
#define RESET_CAUSES  (RCC_CSR_SFTRSTF | RCC_CSR_PORRSTF | RCC_CSR_IWDGRSTF | RCC_CSR_WWDGRSTF)

void board_enter_bootloader(void) {
    board_actuator_neutral();
    RCC_APB1ENR |= BACKUP_CLOCKS;
    PWR_CR |= PWR_CR_DBP; /* the backup registers can be written */
    BKP_DR1 = ASKED;
    __asm volatile("dsb" ::: "memory");
    SCB_AIRCR = SCB_AIRCR_RESET;
    for (;;) { /* a few cycles; should the reset fail, the watchdog does it */
    }
}

void bootloader_if_asked(void) {
    const bool by_software = (RCC_CSR & RESET_CAUSES) == RCC_CSR_SFTRSTF;
    RCC_APB1ENR |= BACKUP_CLOCKS;
    const bool asked = BKP_DR1 == ASKED;
    PWR_CR |= PWR_CR_DBP;
    BKP_DR1 = 0u; /* whatever the reset was: the word never outlives the start behind it */
    const bool forgotten = BKP_DR1 == 0u;
    PWR_CR &= ~PWR_CR_DBP;
    RCC_APB1ENR &= ~BACKUP_CLOCKS;
    if (by_software && asked && forgotten) {
        SCB_VTOR = DEVICE_SYSTEM_MEMORY;
        __asm volatile("ldr r0, [%0] \n"
                       "ldr lr, [%0, #4] \n"
                       "msr msp, r0 \n"
                       "bx lr" ::"r"(DEVICE_SYSTEM_MEMORY)
                       : "r0", "lr", "memory");
        __builtin_unreachable();
    }
}
