/* CAN at 125 kbit/s to 1 Mbit/s on PA11 and PA12 (bxCAN, RM0008 24).
 *
 * Receive: the filters pass only the host's identifiers; an interrupt empties the FIFO of three frames into a
 * ring. Transmit: three mailboxes, in the order they were filled; an interrupt signals a free one. Everything
 * that takes time (entering and leaving initialisation, eleven recessive bits, recovery from bus-off) is a
 * state that the loop polls, so that nothing blocks, also on a dead bus.
 *
 * Alone on the bus, a controller repeats its frame for ever without going bus-off (RM0008 24.7.6: an
 * acknowledgement error in error passive does not count), so such a frame is aborted after GIVE_UP_MS. */
#include "bxcan.h"
#include "app/board_links.h"
#include "clock.h"
#include "idle.h"
#include "nvic.h"
#include "stm32f103.h"
#include "systick.h"

#define CRYSTAL_MHZ  72U
#define QUANTA_KHZ   2000U /* prescaler times kbit/s: 36 MHz over the 18 quanta of a bit, sampled at 16 */
#define RX_FRAMES    16U   /* a power of two; 1.8 ms at 1 Mbit/s */
#define BANK_IDS     4U
#define REST_MIN_MS  10U
#define REST_MAX_MS  1000U
#define GIVE_UP_MS   500U
#define ALL_EMPTY    (CAN_TSR_TME0 | CAN_TSR_TME1 | CAN_TSR_TME2)
#define ABORT_ALL    (CAN_TSR_ABRQ0 | CAN_TSR_ABRQ1 | CAN_TSR_ABRQ2)
#define STANDARD_ID  21U /* position of an 11-bit identifier in a mailbox */
#define FILTER_ID    5U  /* and in a filter of 16 bits; the bits below say: data frame, no extension */
#define MAILBOX_STEP 4U  /* registers */
#define FIFO_MASK    (RX_FRAMES - 1U)

typedef enum {
    CAN_OFF,     /* no crystal */
    CAN_ASKING,  /* initialisation mode requested: granted at the end of the frame under way */
    CAN_JOINING, /* waits for eleven recessive bits, after bus-off for 128 times eleven */
    CAN_ON,
    CAN_RESTING /* pause after bus-off */
} can_state_t;

static can_state_t state;
static uint32_t rate_kbit;
static uint32_t since_ms;         /* when the state began */
static uint32_t looked_ms;        /* when the error counters were last read */
static uint32_t rest_ms;          /* pause after the next bus-off */
static volatile uint32_t sent_ms; /* when a mailbox last became empty, or the first one was filled */
static can_frame_t rx_ring[RX_FRAMES];
static volatile uint32_t rx_in, rx_out; /* free-running; written by the interrupt, by the loop */
static volatile bool rx_stopped;        /* the interrupt found the ring full and switched itself off */
static volatile bool overrun;
static board_can_health_t health;

static void enter(can_state_t next) {
    state = next;
    since_ms = systick_ms();
}

void can_init(void) {
    health.bus_off = true;
    if (clock_mhz() != CRYSTAL_MHZ) {
        return; /* the internal oscillator is off by up to 2.5 %, CAN tolerates 0.5 % */
    }
    RCC_APB1ENR |= RCC_APB1ENR_CANEN;
    rest_ms = REST_MIN_MS;
    nvic_enable(IRQ_CAN1_TX);
    nvic_enable(IRQ_CAN1_RX0);
    CAN_MCR = CAN_MCR_INRQ | CAN_MCR_TXFP; /* this also ends sleep mode, the state after reset */
    enter(CAN_ASKING);
}

bool can_overrun(void) {
    return overrun;
}

/* List mode, four identifiers of 16 bits in a bank, all into FIFO 0. Unused places of the last bank repeat
 * its first identifier. */
static void set_filters(const uint16_t *ids, size_t count) {
    volatile uint32_t *const bank = &CAN_F0R1;
    uint32_t active = 0U;
    CAN_FMR |= CAN_FMR_FINIT;
    for (size_t from = 0U; from < count; from += BANK_IDS) {
        uint32_t filter[BANK_IDS];
        for (size_t i = 0U; i < BANK_IDS; i++) {
            filter[i] = (uint32_t)ids[from + i < count ? from + i : from] << FILTER_ID;
        }
        bank[from / 2U] = filter[0] | filter[1] << 16;
        bank[from / 2U + 1U] = filter[2] | filter[3] << 16;
        active = active << 1 | 1U;
    }
    CAN_FM1R = active;
    CAN_FS1R = 0U;
    CAN_FFA1R = 0U;
    CAN_FA1R = active;
    CAN_FMR &= ~CAN_FMR_FINIT;
}

static void set_up(const uint16_t *ids, size_t count) {
    CAN_BTR = CAN_BTR_SJW_2 | CAN_BTR_TS2_2 | CAN_BTR_TS1_15 | (QUANTA_KHZ / rate_kbit - 1U);
    set_filters(ids, count);
    CAN_IER = CAN_IER_TMEIE | CAN_IER_FMPIE0;
    CAN_MCR &= ~CAN_MCR_INRQ;
    enter(CAN_JOINING);
}

static void go_off(void) {
    health.bus_offs++;
    enter(CAN_RESTING);
}

/* While on the bus: handles bus-off and frames without acknowledgement. errors: CAN_ESR. */
static void monitor(uint32_t errors, uint32_t now_ms) {
    if ((errors & CAN_ESR_BOFF) != 0U) {
        go_off();
    } else if (now_ms - since_ms >= REST_MAX_MS) {
        rest_ms = REST_MIN_MS; /* on the bus for REST_MAX_MS: the next pause is short again */
    }
    if (now_ms - sent_ms >= GIVE_UP_MS && (CAN_TSR & ALL_EMPTY) != ALL_EMPTY) {
        CAN_TSR = ABORT_ALL;
    }
}

void board_can_join(uint32_t kbit, const uint16_t *ids, size_t count) {
    if (state == CAN_OFF) {
        return;
    }
    if (kbit != rate_kbit) {
        rate_kbit = kbit;
        CAN_MCR |= CAN_MCR_INRQ;
        enter(CAN_ASKING);
    }
    const uint32_t now_ms = systick_ms();
    if (state == CAN_ON && now_ms == looked_ms) {
        return; /* once a millisecond is enough */
    }
    looked_ms = now_ms;
    const uint32_t errors = CAN_ESR;
    switch (state) {
    case CAN_ASKING:
        if ((CAN_MSR & CAN_MSR_INAK) != 0U) {
            set_up(ids, count);
        }
        break;
    case CAN_JOINING:
        if ((CAN_MSR & CAN_MSR_INAK) == 0U && (errors & CAN_ESR_BOFF) == 0U) {
            sent_ms = now_ms; /* the time limit of frames in the mailboxes begins now */
            enter(CAN_ON);
        }
        break;
    case CAN_ON:
        monitor(errors, now_ms);
        break;
    default:
        if (now_ms - since_ms >= rest_ms) {
            rest_ms = 2U * rest_ms < REST_MAX_MS ? 2U * rest_ms : REST_MAX_MS;
            CAN_MCR |= CAN_MCR_INRQ;
            enter(CAN_ASKING);
        }
    }
    health.transmit_errors = (uint8_t)((errors & CAN_ESR_TEC) >> 16);
    health.receive_errors = (uint8_t)((errors & CAN_ESR_REC) >> 24);
    health.last_error = (uint8_t)((errors & CAN_ESR_LEC) >> 4);
    health.bus_off = state != CAN_ON;
}

const board_can_health_t *board_can_health(void) {
    return &health;
}

void can_rx_handler(void) {
    for (;;) {
        const uint32_t status = CAN_RF0R;
        if ((status & CAN_RF0R_FOVR0) != 0U) {
            CAN_RF0R = CAN_RF0R_FOVR0;
            overrun = true;
        }
        /* While a release is under way the next frame is not visible yet; its interrupt will come. */
        if ((status & CAN_RF0R_FMP0) == 0U || (status & CAN_RF0R_RFOM0) != 0U) {
            break;
        }
        if (rx_in - rx_out >= RX_FRAMES) {
            CAN_IER = CAN_IER_TMEIE; /* until the loop has made room */
            rx_stopped = true;
            break;
        }
        const volatile uint32_t *const mailbox = &CAN_RI0R;
        can_frame_t *const frame = &rx_ring[rx_in & FIFO_MASK];
        const uint32_t low = mailbox[2], high = mailbox[3];
        frame->id = (uint16_t)(mailbox[0] >> STANDARD_ID);
        frame->dlc = (uint8_t)(mailbox[1] & 15U);
        for (uint32_t i = 0U; i < 4U; i++) {
            frame->data[i] = (uint8_t)(low >> (8U * i));
            frame->data[4U + i] = (uint8_t)(high >> (8U * i));
        }
        CAN_RF0R = CAN_RF0R_RFOM0;
        memory_fence();
        rx_in = rx_in + 1U;
    }
    idle_end();
}

bool can_frame_waits(void) {
    return rx_in != rx_out;
}

bool board_can_read(can_frame_t *frame) {
    if (!can_frame_waits()) {
        return false;
    }
    *frame = rx_ring[rx_out & FIFO_MASK];
    memory_fence();
    rx_out = rx_out + 1U;
    if (rx_stopped) {
        rx_stopped = false;
        CAN_IER = CAN_IER_TMEIE | CAN_IER_FMPIE0;
    }
    return true;
}

bool board_can_room(void) {
    return state == CAN_ON && (CAN_TSR & ALL_EMPTY) != 0U;
}

void board_can_send(const can_frame_t *frame) {
    const uint32_t status = CAN_TSR;
    volatile uint32_t *const mailbox = &CAN_TI0R + MAILBOX_STEP * ((status & CAN_TSR_CODE) >> 24);
    if ((status & ALL_EMPTY) == ALL_EMPTY) {
        sent_ms = systick_ms();
    }
    uint32_t word[2] = {0U, 0U};
    for (uint32_t i = 0U; i < 8U; i++) {
        word[i / 4U] |= (uint32_t)frame->data[i] << (8U * (i % 4U));
    }
    mailbox[1] = frame->dlc;
    mailbox[2] = word[0];
    mailbox[3] = word[1];
    mailbox[0] = (uint32_t)frame->id << STANDARD_ID | CAN_TI0R_TXRQ;
}

void can_tx_handler(void) {
    CAN_TSR = CAN_TSR_RQCP0 | CAN_TSR_RQCP1 | CAN_TSR_RQCP2;
    sent_ms = systick_ms();
    idle_end();
}
