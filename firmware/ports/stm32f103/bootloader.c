/* Entry into the ROM bootloader without touching BOOT0 (AN2606): writes a word into a backup register and
 * resets the system; the reset handler then jumps before any clock or pin has left its reset state.
 *
 * The reset also stops both watchdogs, which the bootloader would not feed. The word only counts after a
 * software reset: not when power failed or a watchdog reset the board in between. */
#include "bootloader.h"
#include "app/board.h"
#include "app/board_actuators.h"
#include "stm32f103.h"

#define ASKED         0xb007U /* of 16 bits */
#define BACKUP_CLOCKS (RCC_APB1ENR_PWREN | RCC_APB1ENR_BKPEN)
#define RESET_CAUSES  (RCC_CSR_SFTRSTF | RCC_CSR_PORRSTF | RCC_CSR_IWDGRSTF | RCC_CSR_WWDGRSTF)

void board_enter_bootloader(void) {
    board_actuator_neutral();
    RCC_APB1ENR |= BACKUP_CLOCKS;
    PWR_CR |= PWR_CR_DBP; /* the backup registers can be written */
    BKP_DR1 = ASKED;
    __asm volatile("dsb" ::: "memory");
    SCB_AIRCR = SCB_AIRCR_RESET;
    for (;;) { /* the reset takes a few cycles; should it fail, the watchdog resets the board */
    }
}

void bootloader_if_asked(void) {
    const bool by_software = (RCC_CSR & RESET_CAUSES) == RCC_CSR_SFTRSTF;
    RCC_APB1ENR |= BACKUP_CLOCKS;
    const bool asked = BKP_DR1 == ASKED;
    PWR_CR |= PWR_CR_DBP;
    BKP_DR1 = 0U; /* after every reset, so that the word acts on one start only */
    const bool cleared = BKP_DR1 == 0U;
    PWR_CR &= ~PWR_CR_DBP;
    RCC_APB1ENR &= ~BACKUP_CLOCKS;
    if (by_software && asked && cleared) {
        SCB_VTOR = DEVICE_SYSTEM_MEMORY;
        __asm volatile("ldr r0, [%0] \n"
                       "ldr lr, [%0, #4] \n"
                       "msr msp, r0 \n"
                       "bx lr" ::"r"(DEVICE_SYSTEM_MEMORY)
                       : "r0", "lr", "memory");
        __builtin_unreachable();
    }
}
