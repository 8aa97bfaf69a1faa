/* Analog sensors: a trigger of TIM3 starts a scan of three or six inputs, DMA1 channel 1 stores it
 * (RM0008 11.3, 11.12). A sample is the rounded mean of 1, 2, 4, 8 or 16 scans: the trigger starts the first,
 * the end of each scan starts the next. The triggers between two samples (sampling.c: at least one per
 * millisecond) start one scan each. An input is checked for being at a rail or stuck on single conversions,
 * those of the first scan after every trigger, because the noise of one conversion depends neither on the
 * period nor on oversampling. */
#include "adc.h"
#include "app/board_sensors.h"
#include "clock.h"
#include "core/watch.h"
#include "idle.h"
#include "nvic.h"
#include "samples.h"
#include "stm32f103.h"
#include "systick.h"

#define CALIBRATION_POLLS 64U /* 83 ADC cycles at 12 MHz are 500 processor cycles, 8 polls */
#define SILENT_TRIGGERS   10U /* so many without a scan, 10 ms at most: the converter has failed */
#define RESTART_MS        20U
#define STUCK_LEAST       3U /* conversions without a change, however slow the scans are */
#define COUNT_MAX         4095
#define CONVERSION_US     7U /* the shortest: 84 ADC cycles at 12 MHz */

static volatile uint16_t scans[2U * BOARD_RAW_MAX]; /* two, of `channels` counts each */
static uint32_t channels;
static uint32_t oversample_log2;
static uint32_t rail_limit, stuck_limit; /* conversions; 0: never */
static bool marks_bad;                   /* deliver INT16_MIN for a railed or stuck channel */
static uint32_t scans_summed;
static uint16_t sums[BOARD_RAW_MAX]; /* of up to 16 counts of 4095 */
static watch_t watches[BOARD_RAW_MAX];
static volatile uint16_t railed, stuck; /* one bit a channel */
static volatile bool waiting;           /* a sample was triggered and is not complete */
static volatile uint32_t silent_triggers;
static bool calibrated = true;
static uint32_t started_ms;

void adc_stop(void) {
    DMA1_CCR1 = 0U;
    DMA1_IFCR = DMA1_IFCR_CGIF1;
    nvic_forget(IRQ_DMA1_Channel1);
    railed = 0U;
    stuck = 0U;
    silent_triggers = 0U;
    calibrated = true;
    waiting = false;
}

/* Resets and sets up the whole converter, so that the next scan begins with the first channel. */
static void restart(void) {
    RCC_APB2ENR |= RCC_APB2ENR_ADC1EN;
    RCC_APB2RSTR |= RCC_APB2RSTR_ADC1RST;
    RCC_APB2RSTR &= ~RCC_APB2RSTR_ADC1RST;
    started_ms = systick_ms();
    scans_summed = 0U;

    /* Calibration may begin two ADC cycles after power-up (RM0008 11.4): the 128 processor cycles of these
     * two polls are more. */
    ADC1_CR2 = ADC1_CR2_ADON;
    (void)clock_wait(&ADC1_CR2, ADC1_CR2_ADON, 0U, 2U);
    ADC1_CR2 = ADC1_CR2_ADON | ADC1_CR2_RSTCAL;
    calibrated = clock_wait(&ADC1_CR2, ADC1_CR2_RSTCAL, 0U, CALIBRATION_POLLS);
    ADC1_CR2 = ADC1_CR2_ADON | ADC1_CR2_CAL;
    calibrated = clock_wait(&ADC1_CR2, ADC1_CR2_CAL, 0U, CALIBRATION_POLLS) && calibrated;

    /* 71.5 + 12.5 cycles at 12 MHz: 7 us a channel, enough for a source of 50 kOhm (datasheet, table of
     * R_AIN). */
    ADC1_SMPR2 = ADC1_SMPR2_SMP0_71CYC5 | ADC1_SMPR2_SMP1_71CYC5 | ADC1_SMPR2_SMP2_71CYC5 |
                 ADC1_SMPR2_SMP3_71CYC5 | ADC1_SMPR2_SMP8_71CYC5 | ADC1_SMPR2_SMP9_71CYC5;
    ADC1_SQR1 = (channels - 1U) * ADC1_SQR1_L_2CH;
    ADC1_SQR3 = ADC1_SQR3_SQ1_IN0 | ADC1_SQR3_SQ2_IN1 | ADC1_SQR3_SQ3_IN2 | ADC1_SQR3_SQ4_IN3 |
                ADC1_SQR3_SQ5_IN8 | ADC1_SQR3_SQ6_IN9;
    ADC1_CR1 = ADC1_CR1_SCAN;

    DMA1_CPAR1 = (uint32_t)(uintptr_t)&ADC1_DR;
    DMA1_CMAR1 = (uint32_t)(uintptr_t)scans;
    DMA1_CNDTR1 = 2U * channels;
    DMA1_CCR1 = DMA1_CCR1_EN | DMA1_CCR1_CIRC | DMA1_CCR1_MINC | DMA1_CCR1_PSIZE_16BIT |
                DMA1_CCR1_MSIZE_16BIT | DMA1_CCR1_HTIE | DMA1_CCR1_TCIE;
    nvic_enable(IRQ_DMA1_Channel1);
    ADC1_CR2 = ADC1_CR2_ADON | ADC1_CR2_DMA | ADC1_CR2_EXTSEL_TIM3 | ADC1_CR2_EXTTRIG;
}

void adc_start(const board_sensors_t *sensors, uint32_t interval_us) {
    marks_bad = sensors->kind == BOARD_SENSORS_ANALOG_6;
    channels = marks_bad ? 6U : 3U;
    oversample_log2 = sensors->oversample_log2;
    rail_limit = watch_limit(sensors->rail_ms, interval_us, WATCH_RAIL_LEAST);
    stuck_limit = watch_limit(sensors->stuck_ms, interval_us, STUCK_LEAST);
    for (uint32_t i = 0U; i < BOARD_RAW_MAX; i++) {
        watches[i] = (watch_t){0};
    }
    restart();
}

bool adc_failed(void) {
    return !calibrated || silent_triggers >= SILENT_TRIGGERS;
}

void adc_poll(void) {
    if (adc_failed() && systick_ms() - started_ms >= RESTART_MS) {
        DMA1_CCR1 = 0U;
        DMA1_IFCR = DMA1_IFCR_CGIF1;
        nvic_forget(IRQ_DMA1_Channel1);
        restart();
    }
}

void adc_triggered(bool begins_sample) {
    if (silent_triggers < SILENT_TRIGGERS) {
        silent_triggers++;
    }
    waiting = waiting || begins_sample;
}

/* Updates `railed` and `stuck` of channel i with one conversion. */
static void check_input(uint32_t i, uint16_t count) {
    watch_feed(&watches[i], (int16_t)count, 0, COUNT_MAX);
    railed = watch_bits(railed, i, watch_railed(&watches[i], rail_limit));
    stuck = watch_bits(stuck, i, watch_stuck(&watches[i], stuck_limit));
}

static void publish(void) {
    int16_t *const raw = samples_next();
    const uint32_t half = (1U << oversample_log2) >> 1;
    for (uint32_t i = 0U; i < channels; i++) {
        const bool bad = ((uint32_t)(railed | stuck) >> i & 1U) != 0U;
        raw[i] = marks_bad && bad ? INT16_MIN : (int16_t)((sums[i] + half) >> oversample_log2);
    }
    samples_publish();
}

void adc_on_scan(void) {
    const uint32_t both = DMA1_ISR_HTIF1 | DMA1_ISR_TCIF1;
    const bool overrun = (DMA1_ISR & both) == both;
    DMA1_IFCR = DMA1_IFCR_CGIF1;
    silent_triggers = 0U;
    /* The DMA counts the remaining transfers down: at `channels` or below, it is filling the second half, and
     * the first half is complete. */
    const volatile uint16_t *const scan = &scans[DMA1_CNDTR1 <= channels ? 0U : channels];
    if (scans_summed == 0U) {
        for (uint32_t i = 0U; i < channels; i++) {
            check_input(i, scan[i]);
        }
        if ((railed | stuck) != 0U) {
            idle_tell();
        }
        if (waiting && overrun) { /* two scans are stored: which of them is the sample's is unknown */
            waiting = false;
            samples_miss();
            return;
        }
        if (!waiting || TIM3_CNT < CONVERSION_US * channels) {
            return; /* a scan between two samples, or one that began before the sample's trigger */
        }
    }
    for (uint32_t i = 0U; i < channels; i++) {
        sums[i] = (uint16_t)(scans_summed == 0U ? scan[i] : sums[i] + scan[i]);
    }
    scans_summed++;
    if (scans_summed < 1U << oversample_log2) {
        /* Writing ADON = 1 again, with no other bit changed, starts a conversion (RM0008 11.12.3). */
        ADC1_CR2 = ADC1_CR2_ADON | ADC1_CR2_DMA | ADC1_CR2_EXTSEL_TIM3 | ADC1_CR2_EXTTRIG;
        return;
    }
    scans_summed = 0U;
    waiting = false;
    if (calibrated) {
        publish();
    }
}

void adc_health(board_health_t *health) {
    health->railed = railed;
    health->stuck = stuck;
}
