"""Tests of the link that run on one port alone, each with the reason; all others run on both by the same body."""

from __future__ import annotations

NATIVE_ONLY = {
    "test_the_clock_wraps": "the simulated chip would have to run for 71 minutes",
    "test_a_step_of_any_size_follows_as_there_is_room": "waits for a transmitter that is slower than the chip's",
    "test_slcan_commands[N\\r-N0001\\r]": "the serial number is that of the board that the test made",
    "test_hello_is_answered_by_identity": "part and commit are those that the test gave the board",
    "test_waiting_in_vain_keeps_it_alive": "the line between drops frames",
    "test_disarming_time_to_the_turn": "turns of the loop one by one",
    "test_a_keep_alive_that_is_too_late_does_not_revive": "a turn of the loop that takes 35 ms",
    "test_values_come_every_10_ms_however_full_the_queue_is_and_only_while_armed": "a line of chosen speed",
    "test_arming_is_refused_with_the_reason": "every fault bit, one after the other",
    "test_what_disarms[disarm_by_fault]": "a fault bit without a cause",
    "test_a_switch_waits_for_rest_and_not_for_ever": "counts without noise or dead time",
    "test_a_fault_keeps_it_from_arming_and_does_not_arm_when_it_goes_long_after": "a fault bit without a cause",
    "test_a_fault_that_goes_at_once_does_not_matter": "a fault bit without a cause",
    "test_a_fault_disarms_it_latched": "a fault bit without a cause",
    "test_neutral_is_held_after_arming_for_the_time_of_the_parameter[10000]": "10 s of the chip take a minute",
    "test_a_worn_flash_says_no_and_keeps_the_old_set": "the simulated chip's flash does not wear",
}
