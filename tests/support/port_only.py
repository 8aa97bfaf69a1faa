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
    "test_keep_alive_values_come_every_10_ms_only_while_armed": "a line of chosen speed",
    "test_arming_is_refused_with_the_reason": "every fault bit, one after the other",
    "test_what_disarms[disarm_by_fault]": "a fault bit without a cause",
    "test_a_switch_waits_for_rest_and_not_for_ever": "counts without noise or dead time",
    "test_a_fault_prevents_arming_and_clearing_it_late_does_not_arm": "a fault bit without a cause",
    "test_a_fault_that_goes_at_once_does_not_matter": "a fault bit without a cause",
    "test_a_fault_disarms_it_latched": "a fault bit without a cause",
    "test_neutral_is_held_after_arming_for_the_time_of_the_parameter[10000]": "10 s of the chip take a minute",
    "test_a_full_queue_drops_whole_telemetry_and_never_replies": "a line of chosen speed",
    "test_a_host_that_does_not_read_is_not_answered_beyond_the_queue": "a line of chosen speed",
    "test_a_live_run_can_be_run_again": "a line of chosen speed",
    "test_no_frame_and_no_noise_upsets_the_board": "a line of chosen speed",
    "test_sixteen_in_flight_and_no_more": "a line of chosen speed",
    "test_the_next_step_reports_that_frames_were_dropped": "a line of chosen speed",
    "test_another_system_begins_with_nothing_selected": "no digital sensors are on the pins of the chip",
    "test_every_digest_arrives_over_a_bad_line": "its bound of time is that of a line that takes none",
    "test_step_numbers_go_round": "66,000 steps in lockstep take the chip minutes",
    "test_a_lost_count_or_digest_is_noticed": "what is lost is found in chunks that hold whole frames",
    "test_a_worn_flash_says_no_and_keeps_the_old_set": "the simulated chip's flash does not wear",
}
