/* Voltage and current of the battery by ADC2, input 8 and 9 in turn, or in the pin set wheels the voltage
 * alone, input 2; one conversion a whole turn of the loop (RM0008 11.3, 11.4, 11.12). ADC1, whose scans are
 * the samples of analog sensors, has no part in it, and no interrupt and no DMA channel either. */
#include "battery_adc.h"
#include "app/board.h"
#include "app/board_battery.h"
#include "clock.h"
#include "stm32f103.h"

#define CALIBRATION_POLLS 64U /* 83 ADC cycles at 12 MHz are 500 processor cycles, 8 polls */

static bool calibrated; /* the converter is in use */
static uint32_t next;   /* input under way */
static bool one_input;
static uint16_t latest[BATTERY_INPUTS];

void battery_adc_init(uint32_t pins) {
    one_input = board_pins_wheels(pins);
    RCC_APB2ENR |= RCC_APB2ENR_ADC2EN;
    /* Calibration may begin two ADC cycles after power-up (RM0008 11.4): the 128 processor cycles of these
     * two polls are more. */
    ADC2_CR2 = ADC2_CR2_ADON;
    (void)clock_wait(&ADC2_CR2, ADC2_CR2_ADON, 0U, 2U);
    ADC2_CR2 = ADC2_CR2_ADON | ADC2_CR2_CAL;
    calibrated = clock_wait(&ADC2_CR2, ADC2_CR2_CAL, 0U, CALIBRATION_POLLS);
    /* 7 us a conversion at 12 MHz, enough for a divider of 50 kOhm (datasheet, table of R_AIN). */
    ADC2_SMPR2 = ADC2_SMPR2_SMP2_71CYC5 | ADC2_SMPR2_SMP8_71CYC5 | ADC2_SMPR2_SMP9_71CYC5;
    ADC2_SQR3 = one_input ? ADC2_SQR3_SQ1_IN2 : ADC2_SQR3_SQ1_IN8;
    /* Writing ADON = 1 again, with no other bit changed, starts a conversion (RM0008 11.12.3). */
    ADC2_CR2 = ADC2_CR2_ADON;
}

bool board_battery_read(uint16_t counts[BATTERY_INPUTS]) {
    if (!calibrated || (ADC2_SR & ADC2_SR_EOC) == 0U) {
        return false;
    }
    latest[next] = (uint16_t)ADC2_DR; /* clears EOC */
    if (!one_input) {
        next ^= 1U;
        ADC2_SQR3 = ADC2_SQR3_SQ1_IN8 + next;
    }
    ADC2_CR2 = ADC2_CR2_ADON;
    counts[0] = latest[0];
    counts[1] = latest[1];
    return true;
}
