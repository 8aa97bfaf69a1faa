/* An MPU-6050 behind Wire. Its samples come from standard input: rates, then accelerations, in counts; a line
 * with a first count of -32768 is a chip that does not answer. */
#ifndef TEST_WIRE_H
#define TEST_WIRE_H

#include "Arduino.h"

struct Chip {
    void begin() {}
    void setClock(unsigned long) {}
    void beginTransmission(uint8_t) {
        written = 0;
    }
    void write(uint8_t value) {
        if (written++ == 0) {
            number = value;
        } else {
            registers[number] = value;
        }
    }
    int endTransmission(bool = true) {
        return 0;
    }
    int requestFrom(uint8_t address, uint8_t wanted) {
        if (address != 0x68 || number != 0x3B || sample[0] == -32768) {
            return 0;
        }
        const int words[7] = {sample[3], sample[4], sample[5], 0, sample[0], sample[1], sample[2]};
        for (int i = 0; i < 7; i++) {
            bytes[2 * i] = (uint8_t)((unsigned)words[i] >> 8);
            bytes[2 * i + 1] = (uint8_t)words[i];
        }
        place = 0;
        return wanted;
    }
    int read() {
        return bytes[place++];
    }
    bool next() {
        int *const s = sample;
        return std::scanf("%d %d %d %d %d %d", s, s + 1, s + 2, s + 3, s + 4, s + 5) == 6;
    }
    int sample[6], written = 0, place = 0;
    uint8_t number = 0, bytes[14], registers[256] = {0};
};

extern Chip Wire;

#endif
