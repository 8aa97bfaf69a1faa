/* A program that ends in an instruction that the core does not have; its handler loops, as that of most
 * images. */
#include "part.h"
RESULTS;

int main(void) {
    results[0] = 1;
    __asm volatile("udf #3");
    return 0;
}
