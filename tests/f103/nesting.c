/* Preemption, tail-chaining, masks and system calls; each step notes a letter in the order it happens. */
#include "part.h"
RESULTS;
static volatile uint32_t length;

static void note(char letter) {
    ((volatile char *)results)[length++] = letter;
}

static uint32_t ipsr(void) {
    uint32_t number;
    __asm volatile("mrs %0, ipsr" : "=r"(number));
    return number;
}

void irq0_handler(void) /* low */
{
    note(ipsr() == 16 ? 'a' : '?');
    NVIC_ISPR(0) = 2; /* preempts at once */
    note('b');
    NVIC_ISPR(0) = 4; /* same priority: waits, then tail-chains */
    note('c');
}

void irq1_handler(void) /* high */
{
    note('(');
    note(ipsr() == 17 ? 'h' : '?');
    note(')');
}

void irq2_handler(void) {
    note('t');
}

void svcall_handler(void) {
    note('s');
}

void pendsv_handler(void) {
    note('p');
}

int main(void) {
    for (uint32_t i = 0; i < 64; i++) {
        results[i] = 0;
    }
    NVIC_IPR8(0) = 0x80;
    NVIC_IPR8(1) = 0x40;
    NVIC_IPR8(2) = 0x80;
    SCB_SHPR8(11) = 0x20;
    SCB_SHPR8(14) = 0xF0;
    NVIC_ISER(0) = 7;
    register uint32_t kept __asm("r4") = 0x12345678U;
    __asm volatile("" : "+r"(kept));
    NVIC_ISPR(0) = 1;
    note('1');
    irq_off();
    NVIC_ISPR(0) = 1;
    SCB_ICSR = 1U << 28; /* PendSV waits too */
    note('2');
    irq_on();
    note('3');
    __asm volatile("svc 0" ::: "memory");
    note('4');
    /* Masked by BASEPRI at 0x80: only the high one gets through. */
    __asm volatile("msr basepri, %0" ::"r"(0x80U) : "memory");
    NVIC_ISPR(0) = 4;
    note('5');
    NVIC_ISPR(0) = 2;
    note('6');
    __asm volatile("msr basepri, %0" ::"r"(0U) : "memory");
    note('7');
    __asm volatile("" : "+r"(kept));
    results[60] = kept == 0x12345678U && ipsr() == 0;
    return 0;
}
