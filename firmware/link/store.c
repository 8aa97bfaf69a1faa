#include "store.h"
#include "app/board_sensors.h"
#include "app/board_store.h"
#include "core/digest.h"
#include "core/esc.h"

#define MAGIC_LOW  0x6C70U /* "plpa" */
#define MAGIC_HIGH 0x6170U
#define SEAL       0x0000U
#define ENTRIES    5U /* where they begin, in half-words */
#define ENTRY      3U
#define CRC        2U
#define COUNT_MAX  ((BOARD_STORE_HALFWORDS - ENTRIES - CRC - 1U) / ENTRY)

typedef char the_table_fits_a_slot[PARAMS_HELD <= COUNT_MAX ? 1 : -1];

#define NO_SLOT BOARD_STORE_SLOTS

static uint32_t word_at(const uint16_t *slot, size_t at) {
    return slot[at] | (uint32_t)slot[at + 1U] << 16;
}

static size_t crc_place(const uint16_t *slot) {
    return ENTRIES + ENTRY * (size_t)slot[4];
}

static bool has_magic(const uint16_t *slot) {
    return slot[0] == MAGIC_LOW && slot[1] == MAGIC_HIGH && slot[4] <= COUNT_MAX;
}

static bool sealed(const uint16_t *slot) {
    return has_magic(slot) && slot[crc_place(slot) + CRC] == SEAL;
}

static bool whole(const uint16_t *slot) {
    return sealed(slot) && digest_crc32(slot, 2U * crc_place(slot)) == word_at(slot, crc_place(slot));
}

static uint32_t sequence_of(const uint16_t *slot) {
    return word_at(slot, 2U);
}

/* The slot that counts, NO_SLOT with none. */
static uint32_t newest_slot(void) {
    uint32_t newest = NO_SLOT;

    for (uint32_t i = 0; i < BOARD_STORE_SLOTS; i++) {
        const uint16_t *const slot = board_store_slot(i);

        if (whole(slot) &&
            (newest == NO_SLOT || sequence_of(slot) - sequence_of(board_store_slot(newest)) < 0x80000000U)) {
            newest = i;
        }
    }
    return newest;
}

bool store_accepts(const params_t *params) {
    /* Conditions between parameters of the control step and of the board: a pulse and the gap after it fit
     * into a frame. This holds for every system, because the outputs carry neutral pulses with every system.
     */
    const int32_t frame_halfus = (int32_t)(2U * params->esc_period_us);

    /* All scans of a sample end within its period, and a bit of CAN is a multiple of 18 quanta of 36 MHz
     * (firmware/ports/stm32f103/bxcan.c). */
    return control_params_valid(&params->control) && plumb_esc_valid(&params->control.esc) &&
           params->control.esc.max_halfus + ESC_GAP_MIN_HALFUS <= frame_halfus &&
           2000U % params->can_bitrate_kbit == 0 &&
           BOARD_SCAN_US << params->adc_oversample_log2 <= params->period_us;
}

/* Copies every value of a complete slot that this image holds into *params; false when one is outside its
 * range. */
static bool read_values(const uint16_t *slot, params_t *params, store_report_t *report) {
    bool good = true;
    uint16_t place = 0;

    report->missing = PARAMS_HELD;
    for (size_t at = ENTRIES; at < crc_place(slot); at += ENTRY) {
        const uint16_t index = params_find(slot[at], &place);
        const uint32_t value = word_at(slot, at + 1U);

        if (index == PARAMS_COUNT) {
            report->unknown++;
            continue;
        }
        report->missing--;
        good = good && params_in_range(index, value);
        params_set_word(params, index, value);
    }
    return good;
}

store_report_t store_load(params_t *params) {
    store_report_t report = {.found = STORE_NOTHING};
    const uint32_t newest = newest_slot();

    params_default(params);
    if (newest == NO_SLOT) {
        for (uint32_t i = 0; i < BOARD_STORE_SLOTS; i++) {
            report.found = sealed(board_store_slot(i)) ? STORE_DAMAGED : report.found;
        }
        return report;
    }
    report.sequence = sequence_of(board_store_slot(newest));
    report.found = STORE_LOADED;
    if (!read_values(board_store_slot(newest), params, &report) || !store_accepts(params)) {
        report.found = STORE_REFUSED;
        params_default(params);
    }
    return report;
}

/* True when the entries of a slot equal *params. */
static bool holds(const uint16_t *slot, const params_t *params) {
    bool same = slot[4] == PARAMS_HELD;

    for (uint16_t i = 0; i < PARAMS_HELD && same; i++) {
        const size_t at = ENTRIES + ENTRY * (size_t)i;

        same = slot[at] == params_id(i) && word_at(slot, at + 1U) == params_word(params, params_held(i));
    }
    return same;
}

/* Programs half-words into a slot one after the other; stops at the first that does not read back as written.
 */
typedef struct {
    uint32_t slot;
    uint32_t at;
    bool good;
} writer_t;

static void put(writer_t *w, uint16_t value) {
    w->good =
        w->good && board_store_program(w->slot, w->at, value) && board_store_slot(w->slot)[w->at] == value;
    w->at++;
}

static void put_word(writer_t *w, uint32_t value) {
    put(w, (uint16_t)(value & 0xFFFFU));
    put(w, (uint16_t)(value >> 16));
}

static bool write_slot(uint32_t slot, uint32_t sequence, const params_t *params) {
    const uint16_t *const found = board_store_slot(slot);
    writer_t w = {.slot = slot, .good = board_store_erase(slot)};

    put(&w, MAGIC_LOW);
    put(&w, MAGIC_HIGH);
    put_word(&w, sequence);
    put(&w, PARAMS_HELD);
    for (uint16_t i = 0; i < PARAMS_HELD; i++) {
        put(&w, params_id(i));
        put_word(&w, params_word(params, params_held(i)));
    }
    put_word(&w, digest_crc32(found, 2U * w.at));
    put(&w, SEAL);
    return w.good && whole(found);
}

bool store_save(const params_t *params, uint32_t *sequence) {
    const uint32_t newest = newest_slot();

    if (newest == NO_SLOT) {
        *sequence = 1U;
        return write_slot(0U, *sequence, params) || write_slot(1U, *sequence, params);
    }
    const uint16_t *const slot = board_store_slot(newest);
    if (holds(slot, params)) {
        *sequence = sequence_of(slot);
        return true;
    }
    *sequence = sequence_of(slot) + 1U;
    return board_store_program(newest, (uint32_t)crc_place(slot) + CRC, SEAL) &&
           write_slot(1U - newest, *sequence, params);
}
