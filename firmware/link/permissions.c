#include "permissions.h"
#include "generated/messages.h"

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
        return false;
    }
}
