/* Live sensors: TIM3 starts a scan of PA0, PA1, PA2 once per control period, DMA1 channel 1 stores it, and
 * the end of the scan is the tick (RM0008 11.3, 11.12, 15.4). No instruction takes part in the timing of a
 * sample. */
#include "port.h"

#define CHANNELS          3u
#define CALIBRATION_POLLS 64u /* 83 ADC cycles at 12 MHz are 500 processor cycles, 8 polls */
#define LATE_MAX          255u

/* Two scans: while one is being written the other can be read for a whole period. */
static volatile uint16_t scans[2][CHANNELS];
static volatile uint32_t scans_done;
static volatile uint32_t newest; /* index of the last complete scan */
static uint32_t scans_taken;
static uint32_t late;
static uint32_t running_us; /* 0: stopped */
static bool trusted;

/* The whole converter from reset: whatever scan was under way, the next one begins with the first channel. */
bool adc_start(void) {
    RCC_APB2ENR |= RCC_APB2ENR_ADC1EN;
    RCC_APB2RSTR |= RCC_APB2RSTR_ADC1RST;
    RCC_APB2RSTR &= ~RCC_APB2RSTR_ADC1RST;
    DMA1_CCR1 = 0u;
    DMA1_IFCR = DMA1_IFCR_CGIF1;
    scans_done = 0u;
    scans_taken = 0u;
    late = 0u;

    /* Powered up, two ADC cycles later calibrated (RM0008 11.4); the wait before its first poll is long
     * enough. */
    ADC1_CR2 = ADC1_CR2_ADON;
    (void)clock_wait(&ADC1_CR2, ADC1_CR2_ADON, 0u, 2u);
    ADC1_CR2 = ADC1_CR2_ADON | ADC1_CR2_RSTCAL;
    trusted = clock_wait(&ADC1_CR2, ADC1_CR2_RSTCAL, 0u, CALIBRATION_POLLS);
    ADC1_CR2 = ADC1_CR2_ADON | ADC1_CR2_CAL;
    trusted = clock_wait(&ADC1_CR2, ADC1_CR2_CAL, 0u, CALIBRATION_POLLS) && trusted;

    /* 71.5 + 12.5 cycles at 12 MHz: 7 us a channel, enough for a source of 50 kOhm (datasheet, table of
     * R_AIN). */
    ADC1_SMPR2 = ADC1_SMPR2_SMP0_71CYC5 | ADC1_SMPR2_SMP1_71CYC5 | ADC1_SMPR2_SMP2_71CYC5;
    ADC1_SQR1 = ADC1_SQR1_L_3CH;
    ADC1_SQR3 = ADC1_SQR3_SQ1_IN0 | ADC1_SQR3_SQ2_IN1 | ADC1_SQR3_SQ3_IN2;
    ADC1_CR1 = ADC1_CR1_SCAN;

    DMA1_CPAR1 = (uint32_t)(uintptr_t)&ADC1_DR;
    DMA1_CMAR1 = (uint32_t)(uintptr_t)&scans[0][0];
    DMA1_CNDTR1 = 2u * CHANNELS;
    DMA1_CCR1 = DMA1_CCR1_EN | DMA1_CCR1_CIRC | DMA1_CCR1_MINC | DMA1_CCR1_PSIZE_16BIT |
                DMA1_CCR1_MSIZE_16BIT | DMA1_CCR1_HTIE | DMA1_CCR1_TCIE;
    irq_enable(IRQ_DMA1_Channel1);
    ADC1_CR2 = ADC1_CR2_ADON | ADC1_CR2_DMA | ADC1_CR2_EXTSEL_TIM3 | ADC1_CR2_EXTTRIG;
    return trusted;
}

uint32_t adc_late(void) {
    return late;
}

void adc_dma_handler(void) {
    newest = (DMA1_ISR & DMA1_ISR_TCIF1) != 0u ? 1u : 0u;
    DMA1_IFCR = DMA1_IFCR_CGIF1;
    scans_done++;
    port_wake = true;
}

void board_set_period_us(uint32_t period_us) {
    if (period_us == running_us) {
        return;
    }
    running_us = period_us;
    RCC_APB1ENR |= RCC_APB1ENR_TIM3EN;
    TIM3_CR1 = 0u;
    TIM3_CR2 = TIM3_CR2_MMS_UPDATE;
    if (period_us == 0u) {
        return;
    }
    /* 1 us a count, 2 us where 16 bits do not reach. The prescaler is taken over by an update event (UG),
     * which is also a trigger: the converter is set up after it, so that the first scan comes with the first
     * full period. */
    const uint32_t step_us = period_us > 65536u ? 2u : 1u;
    TIM3_PSC = clock_mhz() * step_us - 1u;
    TIM3_ARR = period_us / step_us - 1u;
    TIM3_EGR = TIM3_EGR_UG;
    if (adc_start()) {
        port_faults &= ~(BOARD_FAULT_ADC | BOARD_FAULT_LATE);
    } else {
        port_faults |= BOARD_FAULT_ADC;
    }
    TIM3_CR1 = TIM3_CR1_CEN;
}

bool board_take_tick(void) {
    const uint32_t done = scans_done;
    if (running_us == 0u || done == scans_taken) {
        return false;
    }
    for (uint32_t missed = done - scans_taken - 1u; missed > 0u && late < LATE_MAX; missed--) {
        late++;
        port_faults |= BOARD_FAULT_LATE;
    }
    scans_taken = done;
    return true;
}

bool board_read_sensors(int16_t raw[BOARD_RAW_MAX]) {
    const volatile uint16_t *const scan = scans[newest];
    for (uint32_t i = 0u; i < BOARD_RAW_MAX; i++) {
        raw[i] = i < CHANNELS ? (int16_t)scan[i] : 0;
    }
    return trusted;
}
