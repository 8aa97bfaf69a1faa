/* What the sketches call of an Arduino board: its clock stands for a period in every turn of loop(), and what
 * it prints is counted. */
#ifndef TEST_ARDUINO_H
#define TEST_ARDUINO_H

#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>

extern uint32_t now_us;

inline uint32_t micros() {
    return now_us;
}

inline void delay(unsigned) {
    std::exit(2); /* a design was refused */
}

struct Printer {
    void begin(unsigned long) {}
    template <typename T> void print(T) {}
    template <typename T> void println(T) {
        lines++;
    }
    unsigned lines = 0;
};

extern Printer Serial;

#endif
