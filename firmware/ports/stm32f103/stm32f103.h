/* Registers of the STM32F103 that this firmware touches, and no others.
 *
 * Addresses, offsets and bits are from RM0008 (reference manual, the section of each block is named) and, for
 * the processor's own blocks, the ARMv7-M architecture manual. tests/boards/test_registers.py compares every
 * line with the vendor's register description: PERIPHERAL_REGISTER, and PERIPHERAL_REGISTER_FIELD[_VALUE] for
 * bits. */
#ifndef PLUMB_STM32F103_H
#define PLUMB_STM32F103_H

#include <stdint.h>

#define REG32(base, offset) (*(volatile uint32_t *)((base) + (offset)))

/* Reset and clock control, RM0008 section 7.3 */
#define RCC_BASE             0x40021000U
#define RCC_CR               REG32(RCC_BASE, 0x00U)
#define RCC_CR_HSION         (1U << 0)
#define RCC_CR_HSIRDY        (1U << 1)
#define RCC_CR_HSEON         (1U << 16)
#define RCC_CR_HSERDY        (1U << 17)
#define RCC_CR_CSSON         (1U << 19)
#define RCC_CR_PLLON         (1U << 24)
#define RCC_CR_PLLRDY        (1U << 25)
#define RCC_CFGR             REG32(RCC_BASE, 0x04U)
#define RCC_CFGR_SW          (3U << 0)
#define RCC_CFGR_SW_PLL      (2U << 0)
#define RCC_CFGR_SWS         (3U << 2)
#define RCC_CFGR_SWS_PLL     (2U << 2)
#define RCC_CFGR_PPRE1_DIV2  (4U << 8)
#define RCC_CFGR_ADCPRE_DIV6 (2U << 14)
#define RCC_CFGR_PLLSRC      (1U << 16) /* HSE; 0 is HSI / 2 */
#define RCC_CFGR_PLLMUL_X9   (7U << 18)
#define RCC_CFGR_PLLMUL_X16  (14U << 18)
#define RCC_APB2RSTR         REG32(RCC_BASE, 0x0cU)
#define RCC_APB2RSTR_ADC1RST (1U << 9)
#define RCC_AHBENR           REG32(RCC_BASE, 0x14U)
#define RCC_AHBENR_DMA1EN    (1U << 0)
#define RCC_AHBENR_CRCEN     (1U << 6)
#define RCC_APB2ENR          REG32(RCC_BASE, 0x18U)
#define RCC_APB2ENR_AFIOEN   (1U << 0)
#define RCC_APB2ENR_IOPAEN   (1U << 2)
#define RCC_APB2ENR_IOPBEN   (1U << 3)
#define RCC_APB2ENR_IOPCEN   (1U << 4)
#define RCC_APB2ENR_ADC1EN   (1U << 9)
#define RCC_APB2ENR_ADC2EN   (1U << 10)
#define RCC_APB2ENR_TIM1EN   (1U << 11)
#define RCC_APB2ENR_SPI1EN   (1U << 12)
#define RCC_APB2ENR_USART1EN (1U << 14)
#define RCC_APB1ENR          REG32(RCC_BASE, 0x1cU)
#define RCC_APB1ENR_TIM2EN   (1U << 0)
#define RCC_APB1ENR_TIM3EN   (1U << 1)
#define RCC_APB1ENR_TIM4EN   (1U << 2)
#define RCC_APB1ENR_WWDGEN   (1U << 11)
#define RCC_APB1ENR_USART3EN (1U << 18)
#define RCC_APB1ENR_I2C1EN   (1U << 21)
#define RCC_APB1ENR_CANEN    (1U << 25)
#define RCC_APB1ENR_BKPEN    (1U << 27)
#define RCC_APB1ENR_PWREN    (1U << 28)
#define RCC_BDCR             REG32(RCC_BASE, 0x20U)
#define RCC_BDCR_LSEON       (1U << 0)
#define RCC_CSR              REG32(RCC_BASE, 0x24U)
#define RCC_CSR_RMVF         (1U << 24)
#define RCC_CSR_PORRSTF      (1U << 27)
#define RCC_CSR_SFTRSTF      (1U << 28)
#define RCC_CSR_IWDGRSTF     (1U << 29)
#define RCC_CSR_WWDGRSTF     (1U << 30)

/* CRC calculation unit, RM0008 section 4.4 */
#define CRC_BASE     0x40023000U
#define CRC_DR       REG32(CRC_BASE, 0x00U)
#define CRC_CR       REG32(CRC_BASE, 0x08U)
#define CRC_CR_RESET (1U << 0)

/* Flash interface, RM0008 section 3.3.3 (and PM0075) */
#define FLASH_BASE            0x40022000U
#define FLASH_ACR             REG32(FLASH_BASE, 0x00U)
#define FLASH_ACR_LATENCY_WS2 (2U << 0)
#define FLASH_ACR_PRFTBE      (1U << 4)
#define FLASH_KEYR            REG32(FLASH_BASE, 0x04U)
#define FLASH_KEYR_KEY_1      0x45670123U
#define FLASH_KEYR_KEY_2      0xcdef89abU
#define FLASH_SR              REG32(FLASH_BASE, 0x0cU)
#define FLASH_SR_BSY          (1U << 0)
#define FLASH_SR_PGERR        (1U << 2)
#define FLASH_SR_WRPRTERR     (1U << 4)
#define FLASH_SR_EOP          (1U << 5)
#define FLASH_CR              REG32(FLASH_BASE, 0x10U)
#define FLASH_CR_PG           (1U << 0)
#define FLASH_CR_PER          (1U << 1)
#define FLASH_CR_STRT         (1U << 6)
#define FLASH_CR_LOCK         (1U << 7)
#define FLASH_AR              REG32(FLASH_BASE, 0x14U)

/* Power control, RM0008 section 5.4, and backup registers, section 6.4; the first one lies at 4 */
#define PWR_BASE   0x40007000U
#define PWR_CR     REG32(PWR_BASE, 0x00U)
#define PWR_CR_DBP (1U << 8)
#define BKP_BASE   0x40006c04U
#define BKP_DR1    REG32(BKP_BASE, 0x00U)

/* General-purpose I/O, RM0008 section 9.2. PIN_*: a pin's four bits in CRL (pins 0 to 7) or CRH (8 to 15) */
#define GPIOA_BASE          0x40010800U
#define GPIOA_CRL           REG32(GPIOA_BASE, 0x00U)
#define GPIOA_CRH           REG32(GPIOA_BASE, 0x04U)
#define GPIOA_IDR           REG32(GPIOA_BASE, 0x08U)
#define GPIOA_BSRR          REG32(GPIOA_BASE, 0x10U)
#define GPIOB_BASE          0x40010c00U
#define GPIOB_CRL           REG32(GPIOB_BASE, 0x00U)
#define GPIOB_CRH           REG32(GPIOB_BASE, 0x04U)
#define GPIOB_IDR           REG32(GPIOB_BASE, 0x08U)
#define GPIOB_BSRR          REG32(GPIOB_BASE, 0x10U)
#define GPIOC_BASE          0x40011000U
#define GPIOC_CRH           REG32(GPIOC_BASE, 0x04U)
#define GPIOC_IDR           REG32(GPIOC_BASE, 0x08U)
#define GPIOC_BSRR          REG32(GPIOC_BASE, 0x10U)
#define PIN_ANALOG          0x0U
#define PIN_OUTPUT_10MHZ    0x1U /* push-pull */
#define PIN_OPEN_DRAIN      0x5U /* 10 MHz */
#define PIN_FLOATING        0x4U /* input, as after reset */
#define PIN_INPUT_PULLED    0x8U /* direction of the pull: the pin's bit in ODR */
#define PIN_ALTERNATE_10MHZ 0x9U /* push-pull */
#define PIN_ALTERNATE_2MHZ  0xaU /* push-pull */
#define PIN_ALTERNATE_DRAIN 0xdU /* open drain, 10 MHz */

/* Alternate functions, RM0008 section 9.4. MAPR.SWJ_CFG cannot be read: the register is written once, whole.
 */
#define AFIO_BASE                 0x40010000U
#define AFIO_MAPR                 REG32(AFIO_BASE, 0x04U)
#define AFIO_MAPR_I2C1_REMAP      (1U << 1)  /* PB8, PB9 */
#define AFIO_MAPR_USART1_REMAP    (1U << 2)  /* PB6, PB7 */
#define AFIO_MAPR_TIM2_REMAP_FULL (3U << 8)  /* PA15, PB3, PB10 */
#define AFIO_MAPR_SWJ_CFG_SWD     (2U << 24) /* no JTAG: PA15, PB3, PB4 are free */

/* USART1, RM0008 section 27.6 */
#define USART1_BASE       0x40013800U
#define USART1_SR         REG32(USART1_BASE, 0x00U)
#define USART1_SR_FE      (1U << 1)
#define USART1_SR_NE      (1U << 2)
#define USART1_SR_ORE     (1U << 3)
#define USART1_DR         REG32(USART1_BASE, 0x04U)
#define USART1_BRR        REG32(USART1_BASE, 0x08U)
#define USART1_CR1        REG32(USART1_BASE, 0x0cU)
#define USART1_CR1_RE     (1U << 2)
#define USART1_CR1_TE     (1U << 3)
#define USART1_CR1_IDLEIE (1U << 4)
#define USART1_CR1_UE     (1U << 13)
#define USART1_CR3        REG32(USART1_BASE, 0x14U)
#define USART1_CR3_EIE    (1U << 0)
#define USART1_CR3_DMAR   (1U << 6)
#define USART1_CR3_DMAT   (1U << 7)

/* USART3, the same registers */
#define USART3_BASE       0x40004800U
#define USART3_SR         REG32(USART3_BASE, 0x00U)
#define USART3_SR_FE      (1U << 1)
#define USART3_SR_NE      (1U << 2)
#define USART3_SR_ORE     (1U << 3)
#define USART3_SR_RXNE    (1U << 5)
#define USART3_DR         REG32(USART3_BASE, 0x04U)
#define USART3_BRR        REG32(USART3_BASE, 0x08U)
#define USART3_CR1        REG32(USART3_BASE, 0x0cU)
#define USART3_CR1_RE     (1U << 2)
#define USART3_CR1_RXNEIE (1U << 5)
#define USART3_CR1_UE     (1U << 13)

/* DMA1, RM0008 section 13.4. Channel 1: ADC1, 2: SPI1_RX, 3: SPI1_TX, 4: USART1_TX,
 * 5: USART1_RX, 7: I2C1_RX (table 78) */
#define DMA1_BASE       0x40020000U
#define DMA1_ISR        REG32(DMA1_BASE, 0x00U)
#define DMA1_ISR_TCIF1  (1U << 1)
#define DMA1_ISR_HTIF1  (1U << 2)
#define DMA1_ISR_TEIF4  (1U << 15)
#define DMA1_ISR_HTIF5  (1U << 18)
#define DMA1_ISR_TCIF5  (1U << 17)
#define DMA1_IFCR       REG32(DMA1_BASE, 0x04U)
#define DMA1_IFCR_CGIF1 (1U << 0)
#define DMA1_IFCR_CGIF2 (1U << 4)
#define DMA1_IFCR_CGIF3 (1U << 8)
#define DMA1_IFCR_CGIF4 (1U << 12)
#define DMA1_IFCR_CGIF5 (1U << 16)
#define DMA1_IFCR_CGIF7 (1U << 24)
#define DMA1_CCR1       REG32(DMA1_BASE, 0x08U)
#define DMA1_CNDTR1     REG32(DMA1_BASE, 0x0cU)
#define DMA1_CPAR1      REG32(DMA1_BASE, 0x10U)
#define DMA1_CMAR1      REG32(DMA1_BASE, 0x14U)
#define DMA1_CCR2       REG32(DMA1_BASE, 0x1cU)
#define DMA1_CNDTR2     REG32(DMA1_BASE, 0x20U)
#define DMA1_CPAR2      REG32(DMA1_BASE, 0x24U)
#define DMA1_CMAR2      REG32(DMA1_BASE, 0x28U)
#define DMA1_CCR3       REG32(DMA1_BASE, 0x30U)
#define DMA1_CNDTR3     REG32(DMA1_BASE, 0x34U)
#define DMA1_CPAR3      REG32(DMA1_BASE, 0x38U)
#define DMA1_CMAR3      REG32(DMA1_BASE, 0x3cU)
#define DMA1_CCR4       REG32(DMA1_BASE, 0x44U)
#define DMA1_CNDTR4     REG32(DMA1_BASE, 0x48U)
#define DMA1_CPAR4      REG32(DMA1_BASE, 0x4cU)
#define DMA1_CMAR4      REG32(DMA1_BASE, 0x50U)
#define DMA1_CCR5       REG32(DMA1_BASE, 0x58U)
#define DMA1_CNDTR5     REG32(DMA1_BASE, 0x5cU)
#define DMA1_CPAR5      REG32(DMA1_BASE, 0x60U)
#define DMA1_CMAR5      REG32(DMA1_BASE, 0x64U)
#define DMA1_CCR7       REG32(DMA1_BASE, 0x80U)
#define DMA1_CNDTR7     REG32(DMA1_BASE, 0x84U)
#define DMA1_CPAR7      REG32(DMA1_BASE, 0x88U)
#define DMA1_CMAR7      REG32(DMA1_BASE, 0x8cU)
/* The control register's bits are the same for every channel. */
#define DMA1_CCR1_EN          (1U << 0)
#define DMA1_CCR1_TCIE        (1U << 1)
#define DMA1_CCR1_HTIE        (1U << 2)
#define DMA1_CCR1_TEIE        (1U << 3)
#define DMA1_CCR1_DIR         (1U << 4) /* from memory */
#define DMA1_CCR1_CIRC        (1U << 5)
#define DMA1_CCR1_MINC        (1U << 7)
#define DMA1_CCR1_PSIZE_16BIT (1U << 8)
#define DMA1_CCR1_MSIZE_16BIT (1U << 10)
#define DMA1_CCR1_PL_HIGH     (2U << 12)

/* ADC1, RM0008 section 11.12 */
#define ADC1_BASE              0x40012400U
#define ADC1_CR1               REG32(ADC1_BASE, 0x04U)
#define ADC1_CR1_SCAN          (1U << 8)
#define ADC1_CR2               REG32(ADC1_BASE, 0x08U)
#define ADC1_CR2_ADON          (1U << 0)
#define ADC1_CR2_CAL           (1U << 2)
#define ADC1_CR2_RSTCAL        (1U << 3)
#define ADC1_CR2_DMA           (1U << 8)
#define ADC1_CR2_EXTSEL_TIM3   (4U << 17) /* TIM3_TRGO, table 69 */
#define ADC1_CR2_EXTTRIG       (1U << 20)
#define ADC1_SMPR2             REG32(ADC1_BASE, 0x10U)
#define ADC1_SMPR2_SMP0_71CYC5 (6U << 0)
#define ADC1_SMPR2_SMP1_71CYC5 (6U << 3)
#define ADC1_SMPR2_SMP2_71CYC5 (6U << 6)
#define ADC1_SMPR2_SMP3_71CYC5 (6U << 9)
#define ADC1_SMPR2_SMP8_71CYC5 (6U << 24)
#define ADC1_SMPR2_SMP9_71CYC5 (6U << 27)
#define ADC1_SQR1              REG32(ADC1_BASE, 0x2cU)
#define ADC1_SQR1_L_2CH        (1U << 20) /* for every channel after the first */
#define ADC1_SQR3              REG32(ADC1_BASE, 0x34U)
#define ADC1_SQR3_SQ1_IN0      (0U << 0)
#define ADC1_SQR3_SQ2_IN1      (1U << 5)
#define ADC1_SQR3_SQ3_IN2      (2U << 10)
#define ADC1_SQR3_SQ4_IN3      (3U << 15)
#define ADC1_SQR3_SQ5_IN8      (8U << 20)
#define ADC1_SQR3_SQ6_IN9      (9U << 25)
#define ADC1_DR                REG32(ADC1_BASE, 0x4cU)

/* ADC2, RM0008 section 11.12 */
#define ADC2_BASE              0x40012800U
#define ADC2_SR                REG32(ADC2_BASE, 0x00U)
#define ADC2_SR_EOC            (1U << 1)
#define ADC2_CR2               REG32(ADC2_BASE, 0x08U)
#define ADC2_CR2_ADON          (1U << 0)
#define ADC2_CR2_CAL           (1U << 2)
#define ADC2_SMPR2             REG32(ADC2_BASE, 0x10U)
#define ADC2_SMPR2_SMP2_71CYC5 (6U << 6)
#define ADC2_SMPR2_SMP8_71CYC5 (6U << 24)
#define ADC2_SMPR2_SMP9_71CYC5 (6U << 27)
#define ADC2_SQR3              REG32(ADC2_BASE, 0x34U)
#define ADC2_SQR3_SQ1_IN2      (2U << 0)
#define ADC2_SQR3_SQ1_IN8      (8U << 0)
#define ADC2_DR                REG32(ADC2_BASE, 0x4cU)

/* TIM1, RM0008 section 14.4 */
#define TIM1_BASE               0x40012c00U
#define TIM1_CR1                REG32(TIM1_BASE, 0x00U)
#define TIM1_CR1_CEN            (1U << 0)
#define TIM1_CR1_CMS_MODE1      (1U << 5) /* centre-aligned */
#define TIM1_CR1_CKD_DIV2       (1U << 8)
#define TIM1_CR1_ARPE           (1U << 7)
#define TIM1_CR2                REG32(TIM1_BASE, 0x04U)
#define TIM1_CR2_CCPC           (1U << 0) /* CCxE, CCxNE and OCxM wait for COMG */
#define TIM1_DIER               REG32(TIM1_BASE, 0x0cU)
#define TIM1_DIER_CC1IE         (1U << 1)
#define TIM1_SR                 REG32(TIM1_BASE, 0x10U)
#define TIM1_SR_BIF             (1U << 7)
#define TIM1_EGR                REG32(TIM1_BASE, 0x14U)
#define TIM1_EGR_UG             (1U << 0)
#define TIM1_EGR_COMG           (1U << 5)
#define TIM1_CCMR1              REG32(TIM1_BASE, 0x18U)
#define TIM1_CCMR1_CC1S_TI1     (1U << 0)
#define TIM1_CCMR1_OC1PE        (1U << 3)
#define TIM1_CCMR1_IC1F_SLOWEST (15U << 4) /* 8 samples at 1/32 of the sampling clock */
#define TIM1_CCMR1_OC1M_LOW     (4U << 4)  /* forced inactive */
#define TIM1_CCMR1_OC1M_PWM1    (6U << 4)
#define TIM1_CCMR2              REG32(TIM1_BASE, 0x1cU)
#define TIM1_CCER               REG32(TIM1_BASE, 0x20U)
#define TIM1_CCER_CC1E          (1U << 0)
#define TIM1_CCER_CC1NE         (1U << 2)
#define TIM1_CCER_CC2NE         (1U << 6)
#define TIM1_CCER_CC3NE         (1U << 10)
#define TIM1_PSC                REG32(TIM1_BASE, 0x28U)
#define TIM1_ARR                REG32(TIM1_BASE, 0x2cU)
#define TIM1_CCR1               REG32(TIM1_BASE, 0x34U)
#define TIM1_CCR2               REG32(TIM1_BASE, 0x38U)
#define TIM1_CCR3               REG32(TIM1_BASE, 0x3cU)
#define TIM1_BDTR               REG32(TIM1_BASE, 0x44U)
#define TIM1_BDTR_DTG_DOUBLE    (4U << 5) /* from here on steps of two, 64 more (14.4.18) */
#define TIM1_BDTR_LOCK_LEVEL2   (2U << 8)
#define TIM1_BDTR_OSSI          (1U << 10)
#define TIM1_BDTR_OSSR          (1U << 11)
#define TIM1_BDTR_BKE           (1U << 12)
#define TIM1_BDTR_MOE           (1U << 15)

/* TIM2, RM0008 section 15.4 */
#define TIM2_BASE               0x40000000U
#define TIM2_CR1                REG32(TIM2_BASE, 0x00U)
#define TIM2_CR1_CEN            (1U << 0)
#define TIM2_CR1_CKD_DIV4       (2U << 8)
#define TIM2_CR2                REG32(TIM2_BASE, 0x04U)
#define TIM2_CR2_TI1S           (1U << 7) /* exclusive or of channels 1 to 3 */
#define TIM2_SMCR               REG32(TIM2_BASE, 0x08U)
#define TIM2_SMCR_TS_TI1F_ED    (4U << 4) /* both edges of TI1 */
#define TIM2_DIER               REG32(TIM2_BASE, 0x0cU)
#define TIM2_DIER_CC1IE         (1U << 1)
#define TIM2_SR                 REG32(TIM2_BASE, 0x10U)
#define TIM2_SR_CC1IF           (1U << 1)
#define TIM2_CCMR1              REG32(TIM2_BASE, 0x18U)
#define TIM2_CCMR1_CC1S_TRC     (3U << 0)
#define TIM2_CCMR1_IC1F_8_DIV32 (15U << 4) /* 8 equal samples, each 32 of the divided clock */
#define TIM2_CCER               REG32(TIM2_BASE, 0x20U)
#define TIM2_CCER_CC1E          (1U << 0)

/* TIM3 and TIM4, RM0008 section 15.4 */
#define TIM3_BASE           0x40000400U
#define TIM3_CR1            REG32(TIM3_BASE, 0x00U)
#define TIM3_CR1_CEN        (1U << 0)
#define TIM3_CR1_ARPE       (1U << 7)
#define TIM3_CR2            REG32(TIM3_BASE, 0x04U)
#define TIM3_CR2_MMS_UPDATE (2U << 4)
#define TIM3_DIER           REG32(TIM3_BASE, 0x0cU)
#define TIM3_DIER_UIE       (1U << 0)
#define TIM3_SR             REG32(TIM3_BASE, 0x10U)
#define TIM3_SR_UIF         (1U << 0)
#define TIM3_EGR            REG32(TIM3_BASE, 0x14U)
#define TIM3_EGR_UG         (1U << 0)
#define TIM3_CNT            REG32(TIM3_BASE, 0x24U)
#define TIM3_PSC            REG32(TIM3_BASE, 0x28U)
#define TIM3_ARR            REG32(TIM3_BASE, 0x2cU)
#define TIM4_BASE           0x40000800U

/* TIM2 and TIM4 as pulse outputs, by their base. Each register of modes has a byte for each of two channels.
 */
#define PULSE_CR1(base)         REG32(base, 0x00U)
#define PULSE_CR1_CEN           (1U << 0)
#define PULSE_CR1_UDIS          (1U << 1)
#define PULSE_CR1_ARPE          (1U << 7)
#define PULSE_EGR(base)         REG32(base, 0x14U)
#define PULSE_EGR_UG            (1U << 0)
#define PULSE_CCMR1(base)       REG32(base, 0x18U)
#define PULSE_CCMR2(base)       REG32(base, 0x1cU)
#define PULSE_CCMR_OCPE         (1U << 3)
#define PULSE_CCMR_OCM_PWM1     (6U << 4)
#define PULSE_CCER(base)        REG32(base, 0x20U)
#define PULSE_CCER_CC(number)   (1U << 4U * (number)) /* channel `number`, from 0 */
#define PULSE_CNT(base)         REG32(base, 0x24U)
#define PULSE_PSC(base)         REG32(base, 0x28U)
#define PULSE_ARR(base)         REG32(base, 0x2cU)
#define PULSE_CCR(base, number) REG32(base, 0x34U + 4U * (number))

/* The same as encoders of two inputs: what their other registers mean. */
#define ENCODER_SMCR(base)            REG32(base, 0x08U)
#define ENCODER_SMCR_SMS_BOTH         (3U << 0)              /* the edges of both inputs count */
#define ENCODER_CCMR1_INPUTS          (1U << 0 | 1U << 8)    /* channels 1 and 2: TI1 and TI2 */
#define ENCODER_CCMR1_FILTERS_SLOWEST (15U << 4 | 15U << 12) /* 8 equal samples, each 32 clocks */

/* bxCAN, RM0008 section 24.9. A mailbox is four registers: identifier, length, bytes 0 to 3, bytes 4 to 7;
 * mailboxes follow each other every 16 bytes, filter banks of two registers every 8. */
#define CAN_BASE       0x40006400U
#define CAN_MCR        REG32(CAN_BASE, 0x00U)
#define CAN_MCR_INRQ   (1U << 0)
#define CAN_MCR_TXFP   (1U << 2) /* mailboxes go out in the order they were filled */
#define CAN_MSR        REG32(CAN_BASE, 0x04U)
#define CAN_MSR_INAK   (1U << 0)
#define CAN_TSR        REG32(CAN_BASE, 0x08U)
#define CAN_TSR_RQCP0  (1U << 0)
#define CAN_TSR_ABRQ0  (1U << 7)
#define CAN_TSR_RQCP1  (1U << 8)
#define CAN_TSR_ABRQ1  (1U << 15)
#define CAN_TSR_RQCP2  (1U << 16)
#define CAN_TSR_ABRQ2  (1U << 23)
#define CAN_TSR_CODE   (3U << 24) /* number of a mailbox that is empty, if one is */
#define CAN_TSR_TME0   (1U << 26)
#define CAN_TSR_TME1   (1U << 27)
#define CAN_TSR_TME2   (1U << 28)
#define CAN_RF0R       REG32(CAN_BASE, 0x0cU)
#define CAN_RF0R_FMP0  (3U << 0)
#define CAN_RF0R_FOVR0 (1U << 4)
#define CAN_RF0R_RFOM0 (1U << 5)
#define CAN_IER        REG32(CAN_BASE, 0x14U)
#define CAN_IER_TMEIE  (1U << 0)
#define CAN_IER_FMPIE0 (1U << 1)
#define CAN_ESR        REG32(CAN_BASE, 0x18U)
#define CAN_ESR_BOFF   (1U << 2)
#define CAN_ESR_LEC    (7U << 4)
#define CAN_ESR_TEC    (0xffU << 16)
#define CAN_ESR_REC    (0xffU << 24)
#define CAN_BTR        REG32(CAN_BASE, 0x1cU)
#define CAN_BTR_TS1_15 (14U << 16)
#define CAN_BTR_TS2_2  (1U << 20)
#define CAN_BTR_SJW_2  (1U << 24)
#define CAN_TI0R       REG32(CAN_BASE, 0x180U)
#define CAN_TI0R_TXRQ  (1U << 0)
#define CAN_RI0R       REG32(CAN_BASE, 0x1b0U)
#define CAN_FMR        REG32(CAN_BASE, 0x200U)
#define CAN_FMR_FINIT  (1U << 0)
#define CAN_FM1R       REG32(CAN_BASE, 0x204U) /* by bank: 1 a list of identifiers, 0 identifier and mask */
#define CAN_FS1R       REG32(CAN_BASE, 0x20cU) /* by bank: 1 one or two of 32 bits, 0 two or four of 16 */
#define CAN_FFA1R      REG32(CAN_BASE, 0x214U) /* by bank: 0 into FIFO 0 */
#define CAN_FA1R       REG32(CAN_BASE, 0x21cU) /* by bank: active */
#define CAN_F0R1       REG32(CAN_BASE, 0x240U)

/* I2C1, RM0008 section 26.6 */
#define I2C1_BASE        0x40005400U
#define I2C1_CR1         REG32(I2C1_BASE, 0x00U)
#define I2C1_CR1_PE      (1U << 0)
#define I2C1_CR1_START   (1U << 8)
#define I2C1_CR1_STOP    (1U << 9)
#define I2C1_CR1_ACK     (1U << 10)
#define I2C1_CR1_SWRST   (1U << 15)
#define I2C1_CR2         REG32(I2C1_BASE, 0x04U) /* bits 5 to 0: PCLK1 in MHz */
#define I2C1_CR2_ITERREN (1U << 8)
#define I2C1_CR2_ITEVTEN (1U << 9)
#define I2C1_CR2_DMAEN   (1U << 11)
#define I2C1_CR2_LAST    (1U << 12)
#define I2C1_DR          REG32(I2C1_BASE, 0x10U)
#define I2C1_SR1         REG32(I2C1_BASE, 0x14U)
#define I2C1_SR1_SB      (1U << 0)
#define I2C1_SR1_ADDR    (1U << 1)
#define I2C1_SR1_BTF     (1U << 2)
#define I2C1_SR1_AF      (1U << 10)
#define I2C1_SR2         REG32(I2C1_BASE, 0x18U)
#define I2C1_CCR         REG32(I2C1_BASE, 0x1cU)
#define I2C1_CCR_F_S     (1U << 15)
#define I2C1_TRISE       REG32(I2C1_BASE, 0x20U)

/* SPI1, RM0008 section 25.5 */
#define SPI1_BASE          0x40013000U
#define SPI1_CR1           REG32(SPI1_BASE, 0x00U)
#define SPI1_CR1_CPHA      (1U << 0)
#define SPI1_CR1_CPOL      (1U << 1)
#define SPI1_CR1_MSTR      (1U << 2)
#define SPI1_CR1_BR_LOWEST 8U
#define SPI1_CR1_SPE       (1U << 6)
#define SPI1_CR1_SSI       (1U << 8)
#define SPI1_CR1_SSM       (1U << 9)
#define SPI1_CR2           REG32(SPI1_BASE, 0x04U)
#define SPI1_CR2_RXDMAEN   (1U << 0)
#define SPI1_CR2_TXDMAEN   (1U << 1)
#define SPI1_SR            REG32(SPI1_BASE, 0x08U)
#define SPI1_DR            REG32(SPI1_BASE, 0x0cU)

/* Independent watchdog, RM0008 section 19.4 */
#define WWDG_BASE    0x40002c00U
#define WWDG_CR      REG32(WWDG_BASE, 0x00U)
#define WWDG_CR_WDGA (1U << 7)
#define WWDG_CR_T    (127U << 0)
#define WWDG_CFR     REG32(WWDG_BASE, 0x04U)
#define WWDG_CFR_W   (127U << 0)

#define IWDG_BASE          0x40003000U
#define IWDG_KR            REG32(IWDG_BASE, 0x00U)
#define IWDG_KR_KEY_UNLOCK 0x5555U
#define IWDG_KR_KEY_FEED   0xaaaaU
#define IWDG_KR_KEY_START  0xccccU
#define IWDG_PR            REG32(IWDG_BASE, 0x04U)
#define IWDG_PR_PR_DIV16   (2U << 0)
#define IWDG_RLR           REG32(IWDG_BASE, 0x08U)
#define IWDG_SR            REG32(IWDG_BASE, 0x0cU)
#define IWDG_SR_PVU        (1U << 0)
#define IWDG_SR_RVU        (1U << 1)

/* Device electronic signature, RM0008 section 30: read-only memory, written in the factory */
#define DEVICE_SYSTEM_MEMORY 0x1ffff000U /* the ROM bootloader's vectors, section 3.3.3 */
#define DEVICE_FLASH_KIB     (*(volatile const uint16_t *)0x1ffff7e0U)
#define DEVICE_UID(word)     REG32(0x1ffff7e8U, 4U * (word))

/* Processor: ARMv7-M architecture manual, sections B3.2 (SCB), B3.3 (SysTick), B3.4 (NVIC) */
#define SYST_CSR           REG32(0xe000e010U, 0x0U)
#define SYST_CSR_ENABLE    (1U << 0)
#define SYST_CSR_TICKINT   (1U << 1)
#define SYST_CSR_CLKSOURCE (1U << 2) /* processor clock */
#define SYST_RVR           REG32(0xe000e010U, 0x4U)
#define SYST_CVR           REG32(0xe000e010U, 0x8U)
#define NVIC_ISER(word)    REG32(0xe000e100U, 4U * (word))
#define NVIC_ISPR(word)    REG32(0xe000e200U, 4U * (word))
#define NVIC_ICPR(word)    REG32(0xe000e280U, 4U * (word))
#define NVIC_IPR(word)     REG32(0xe000e400U, 4U * (word))
#define SCB_ICSR           REG32(0xe000ed00U, 0x04U)
#define SCB_ICSR_PENDSVSET (1U << 28)
#define SCB_SHPR3          REG32(0xe000ed00U, 0x20U)
#define SCB_VTOR           REG32(0xe000ed00U, 0x08U)
#define SCB_AIRCR          REG32(0xe000ed00U, 0x0cU)
#define SCB_AIRCR_RESET    ((0x5faU << 16) | (1U << 2)) /* key and SYSRESETREQ */

/* Positions in the vector table after the processor's 16, RM0008 section 10.1.2 (table 63) */
#define IRQ_DMA1_Channel1 11U
#define IRQ_DMA1_Channel2 12U
#define IRQ_DMA1_Channel4 14U
#define IRQ_DMA1_Channel5 15U
#define IRQ_DMA1_Channel7 17U
#define IRQ_CAN1_TX       19U
#define IRQ_CAN1_RX0      20U
#define IRQ_TIM1_CC       27U
#define IRQ_TIM2          28U
#define IRQ_TIM3          29U
#define IRQ_I2C1_EV       31U
#define IRQ_I2C1_ER       32U
#define IRQ_USART1        37U
#define IRQ_USART3        39U

#endif
