#include "permissions.h"
#include "generated/messages.h"
#include "systems/control.h"

bool permissions_more_inputs(uint16_t id) {
#if CONTROL_COUNTS_MAX > 6U
    if (id >= MESSAGE_SAMPLE_C_ID && id < MESSAGE_SAMPLE_C_ID + (CONTROL_COUNTS_MAX - 6U) / 3U) {
        return true;
    }
#endif
#if CONTROL_COMMANDS_MAX > 0U
    if (id >= MESSAGE_COMMAND_A_ID && id < MESSAGE_COMMAND_A_ID + CONTROL_COMMANDS_MAX / 3U) {
        return true;
    }
#endif
    (void)id;
    return false;
}

bool permissions_need_greeting(const can_frame_t *f) {
    switch (f->id) {
    case MESSAGE_SAMPLE_A_ID:
    case MESSAGE_SAMPLE_B_ID:
    case MESSAGE_SETPOINT_ID:
    case MESSAGE_RUN_BEGIN_ID:
    case MESSAGE_PARAM_SET_ID:
    case MESSAGE_PARAM_COMMIT_ID:
        return true;
    case MESSAGE_EXECUTE_ID:
        /* ARM is refused later, with all blocking reasons; a missing greeting is one of them. */
        return message_execute_unpack(f).verb != MESSAGE_EXECUTE_VERB_BOOTLOADER &&
               message_execute_unpack(f).verb != MESSAGE_EXECUTE_VERB_ARM;
    default:
        return permissions_more_inputs(f->id);
    }
}
