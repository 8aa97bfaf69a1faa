/* The lines of a pilot and of a battery, for programs without a board: nothing comes. */
#include "app/board_battery.h"
#include "app/board_receiver.h"

bool board_battery_read(uint16_t counts[BATTERY_INPUTS]) {
    (void)counts;
    return false;
}

size_t board_receiver_read(uint8_t *bytes, size_t room) {
    (void)bytes, (void)room;
    return 0U;
}

size_t board_receiver_edges(uint16_t *stamps_us, size_t room) {
    (void)stamps_us, (void)room;
    return 0U;
}
