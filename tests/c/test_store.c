/* The two slots under power cuts: at every half-word and every page, and any two in a row, what is loaded is
 * a set that was saved, the old one or the new one. Then wear, other versions' tables, and what makes no
 * sense. */
#include "check.h"
#include "core/digest.h"
#include "link/store.h"
#include "ports/native/flash.h"
#include <stddef.h>
#include <string.h>

#define STATES_MAX 8192U
/* Under the sanitizers, where a state costs five times as much, the second cut is made in every seventh
 * state: there it is about the memory that the code touches, which the state changes little. */
#ifdef __SANITIZE_ADDRESS__
#define STATES_STEP 7U
#else
#define STATES_STEP 1U
#endif

static params_t sets[3]; /* saved one after the other: sets[0], sets[1], sets[2] */
static params_t loaded;

/* Flash as power left it, each state once, and which set was found in it. */
static flash_t states[STATES_MAX];
static unsigned found_in[STATES_MAX];
static unsigned state_count;

/* What may be found now: one of sets[oldest..newest]. */
static unsigned oldest, newest;
static unsigned looks;

/* Three valid sets that differ in most words. */
static void make_sets(void) {
    for (unsigned n = 0; n < 3U; n++) {
        params_default(&sets[n]);
        for (uint16_t i = 0; i < PARAMS_COUNT; i++) {
            for (unsigned tries = 0; tries < 20U; tries++) {
                const uint32_t kept = params_word(&sets[n], i),
                               wanted = kept ^ (check_random() >> (tries + 12U));

                if (params_in_range(i, wanted)) {
                    params_set_word(&sets[n], i, wanted);
                    if (store_accepts(&sets[n])) {
                        break;
                    }
                    params_set_word(&sets[n], i, kept);
                }
            }
        }
        CHECK(store_accepts(&sets[n]));
    }
    unsigned differing = 0;
    for (uint16_t i = 0; i < PARAMS_COUNT; i++) {
        differing += params_word(&sets[0], i) != params_word(&sets[1], i);
    }
    CHECK(differing > PARAMS_COUNT / 2U);
}

/* The set that a start would find; 3: none of them. */
static unsigned what_loads(void) {
    const store_report_t report = store_load(&loaded);
    unsigned n = 0;

    while (n < 3U && memcmp(&loaded, &sets[n], sizeof loaded) != 0) {
        n++;
    }
    return report.found == STORE_LOADED ? n : 3U;
}

static bool save(unsigned n) {
    uint32_t sequence;

    return store_save(&sets[n], &sequence);
}

static void look(void) {
    const unsigned found = what_loads();

    looks++;
    CHECK(found == oldest || found == newest);
}

/* A fingerprint per state seen in the second save: what was looked at once need not be again. */
static uint64_t seen[1U << 20];

static bool seen_before(void) {
    const uint64_t mark = (flash_marked + oldest) * 0x9E3779B97F4A7C15U | 1U;
    size_t place = (size_t)(mark >> 44);
    while (seen[place] != 0U && seen[place] != mark) {
        place = (place + 1U) % (sizeof seen / sizeof seen[0]);
    }
    const bool before = seen[place] == mark;
    seen[place] = mark;
    return before;
}

static void look_once(void) {
    if (!seen_before()) {
        look();
    }
}

static void look_and_remember(void) {
    look();
    if (state_count < STATES_MAX) {
        states[state_count] = flash;
        found_in[state_count] = what_loads();
    }
    state_count++;
}

/* Every cut of the save of sets[1] over sets[0], and after each of them every cut of the save of sets[2].
 * saved_before: decides which slot is in use, and what the other one holds. */
static void check_cuts(uint32_t page_bytes, unsigned saved_before) {
    flash_blank();
    flash_page_bytes = page_bytes;
    for (unsigned n = 0; n < saved_before; n++) {
        CHECK(save(n % 2U + 1U));
    }
    CHECK(save(0) && what_loads() == 0);
    state_count = 0;
    oldest = 0;
    newest = 1;
    flash_seed = (uint8_t)(2U * saved_before);
    flash_half_done = look_and_remember;
    CHECK(save(1));
    flash_half_done = NULL;
    CHECK(what_loads() == 1);
    CHECK(state_count > 4U * 3U * PARAMS_COUNT && state_count <= STATES_MAX);

    flash_seed++; /* the second cut is another one */
    memset(seen, 0, sizeof seen);
    for (unsigned n = 0; n < state_count && n < STATES_MAX; n += STATES_STEP) {
        flash = states[n];
        flash_marked = flash_mark();
        oldest = found_in[n];
        newest = 2;
        flash_half_done = look_once;
        CHECK(save(2));
        flash_half_done = NULL;
        CHECK(what_loads() == 2);
    }
}

/* The first save of all: before it the defaults, reported as nothing saved, or the new set. */
static void first_look(void) {
    const store_report_t report = store_load(&loaded);
    params_t defaults;

    params_default(&defaults);
    looks++;
    CHECK(report.found == STORE_NOTHING
              ? memcmp(&loaded, &defaults, sizeof loaded) == 0
              : report.found == STORE_LOADED && memcmp(&loaded, &sets[1], sizeof loaded) == 0);
}

static void check_the_first_save(void) {
    flash_blank();
    flash_half_done = first_look;
    CHECK(save(1));
    flash_half_done = NULL;
    CHECK(what_loads() == 1);
}

static void look_both_ways(void) {
    look();
    if (flash_weak != FLASH_CELLS) {
        const uint16_t reads = flash.cell[flash_weak];

        flash.cell[flash_weak] = 0xFFFFU;
        CHECK(what_loads() == 0 || what_loads() == newest);
        flash.cell[flash_weak] = reads;
    }
}

/* A seal that power failed in may read either way. Read as there, it is made firm before the older slot goes;
 * read as missing, its slot is the one that is written. */
static void check_a_weak_seal(void) {
    const size_t seal = BOARD_STORE_HALFWORDS + 5U + 3U * PARAMS_COUNT + 2U;

    flash_blank();
    CHECK(save(0) && save(1));
    flash_weak = seal;
    oldest = 1;
    newest = 2;
    flash_half_done = look_both_ways;
    CHECK(save(2));
    flash_half_done = NULL;
    CHECK(flash_weak == FLASH_CELLS);

    flash_blank();
    CHECK(save(0) && save(1));
    flash.cell[seal] = 0x0041U;
    CHECK(what_loads() == 0);
    oldest = 0;
    flash_half_done = look;
    CHECK(save(2));
    flash_half_done = NULL;
    CHECK(what_loads() == 2);
}

/* One bit stuck at one level: what was saved is there, or saving said no and the old set is. */
static void check_worn_bit(size_t at, unsigned level, unsigned bit) {
    flash_blank();
    (level == 0U ? flash_stuck_low : flash_stuck_high)[at] = (uint16_t)(1U << bit);
    flash.cell[at] = level == 0U ? (uint16_t)~flash_stuck_low[at] : 0xFFFFU;
    unsigned holds = save(0) ? 0U : 3U;
    for (unsigned n = 1; n < 3U; n++) {
        holds = save(n) ? n : holds;
        CHECK(what_loads() == holds);
    }
    /* A good slot is always found for the first. */
    CHECK(holds != 3U);
}

/* Any bit of what precedes the entries, and any one bit of every half-word after it. */
static void check_wear(void) {
    for (size_t at = 0; at < FLASH_CELLS; at++) {
        const bool head = at % BOARD_STORE_HALFWORDS < 5U;

        for (unsigned bit = 0; bit < (head ? 16U : 1U); bit++) {
            check_worn_bit(at, 0, head ? bit : check_random() % 16U);
            check_worn_bit(at, 1, head ? bit : check_random() % 16U);
        }
    }
}

/* Flash with one slot of these entries. */
static void hand_made(const uint16_t *ids, const uint32_t *values, uint16_t count, uint32_t sequence) {
    uint16_t *const slot = flash.cell + (sequence % 2U) * BOARD_STORE_HALFWORDS;
    size_t at = 5;

    slot[0] = 0x6C70U;
    slot[1] = 0x6170U;
    slot[2] = (uint16_t)(sequence & 0xFFFFU);
    slot[3] = (uint16_t)(sequence >> 16);
    slot[4] = count;
    for (unsigned n = 0; n < count; n++) {
        slot[at++] = ids[n];
        slot[at++] = (uint16_t)(values[n] & 0xFFFFU);
        slot[at++] = (uint16_t)(values[n] >> 16);
    }
    const uint32_t crc = digest_crc32(slot, 2U * at);
    slot[at++] = (uint16_t)(crc & 0xFFFFU);
    slot[at++] = (uint16_t)(crc >> 16);
    slot[at] = 0;
}

/* Another version's set: what it knows and we do not is skipped, what we know and it does not is at its
 * default. */
static void check_other_tables(void) {
    const uint16_t last = PARAMS_COUNT - 1U;
    uint16_t strange = 1, place = 0;
    while (params_find(strange, &place) != PARAMS_COUNT) {
        strange++;
    }
    uint16_t ids[] = {params_id(last), strange, params_id(0)};
    uint32_t values[] = {params_word(&sets[1], last), 12345, params_word(&sets[1], 0)};
    store_report_t report;
    params_t wanted;

    flash_blank();
    hand_made(ids, values, 3, 7);
    report = store_load(&loaded);
    params_default(&wanted);
    params_set_word(&wanted, last, values[0]);
    params_set_word(&wanted, 0, values[2]);
    CHECK(report.found == STORE_LOADED && report.sequence == 7);
    CHECK(report.unknown == 1 && report.missing == PARAMS_COUNT - 2U);
    CHECK(memcmp(&loaded, &wanted, sizeof loaded) == 0);

    /* Out of range, or contradicting each other: defaults, and a name for it. */
    const uint16_t bounded = (uint16_t)(offsetof(params_t, period_us) / 4U);
    params_default(&wanted);
    ids[0] = params_id(bounded);
    values[0] = 0xFFFFFFFFU;
    CHECK(!params_in_range(bounded, values[0]));
    hand_made(ids, values, 3, 8);
    report = store_load(&loaded);
    CHECK(report.found == STORE_REFUSED && report.sequence == 8);
    CHECK(memcmp(&loaded, &wanted, sizeof loaded) == 0);

    const uint16_t shortest = params_id((uint16_t)(offsetof(params_t, control.esc.min_halfus) / 4U));
    const uint32_t too_long = (uint32_t)wanted.control.esc.max_halfus + 1U;
    hand_made(&shortest, &too_long, 1, 9);
    report = store_load(&loaded);
    CHECK(report.found == STORE_REFUSED && report.sequence == 9);
    CHECK(memcmp(&loaded, &wanted, sizeof loaded) == 0);

    CHECK(save(2) && what_loads() == 2);
}

static void check_sequence_numbers_wrap(void) {
    const uint16_t id = params_id(0);
    const uint32_t old = params_word(&sets[0], 0), new = params_word(&sets[1], 0);

    flash_blank();
    hand_made(&id, &old, 1, 0xFFFFFFFFU);
    hand_made(&id, &new, 1, 0x00000000U);
    CHECK(store_load(&loaded).sequence == 0 && params_word(&loaded, 0) == new);
    CHECK(save(2) && what_loads() == 2);
    CHECK(store_load(&loaded).sequence == 1);
}

/* A sealed slot whose bytes changed, with no other: not silently the defaults. */
static void check_damage(void) {
    flash_blank();
    CHECK(store_load(&loaded).found == STORE_NOTHING);
    CHECK(save(1));
    flash.cell[20] ^= 1U;
    CHECK(store_load(&loaded).found == STORE_DAMAGED);
    CHECK(save(2) && what_loads() == 2);
    memset(&flash, 0, sizeof flash);
    CHECK(store_load(&loaded).found == STORE_NOTHING);
    for (unsigned n = 0; n < 1000; n++) {
        for (size_t at = 0; at < FLASH_CELLS; at++) {
            flash.cell[at] = (uint16_t)(check_random() >> 16);
        }
        flash.cell[0] = 0x6C70U; /* with the magic, and a count that leads anywhere */
        flash.cell[1] = 0x6170U;
        CHECK(store_load(&loaded).found != STORE_LOADED);
    }
}

/* Saving the same again writes nothing. */
static void check_the_same_again(void) {
    uint32_t sequence = 0;

    flash_blank();
    CHECK(save(0) && save(1));
    const flash_t before = flash;
    CHECK(store_save(&sets[1], &sequence) && sequence == 2);
    CHECK(memcmp(&before, &flash, sizeof flash) == 0);
}

int main(void) {
    make_sets();
    for (unsigned saved_before = 0; saved_before < 3U; saved_before++) {
        check_cuts(saved_before % 2U ? 2048U : 1024U, saved_before);
    }
    check_the_first_save();
    check_a_weak_seal();
    check_wear();
    check_other_tables();
    check_sequence_numbers_wrap();
    check_damage();
    check_the_same_again();
    printf("%u parameters, %u states of flash looked at\n", (unsigned)PARAMS_COUNT, looks);
    return check_failures != 0;
}
