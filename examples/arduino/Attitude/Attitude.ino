/* Roll and pitch of a body from an MPU-6050 on the pins SDA and SCL, 200 times a second.
 * It prints ten lines a second at 115200 baud: roll, pitch and their standard deviation, deg. */
#include <Wire.h>
#include <plumb.h>

static const uint8_t ADDRESS = 0x68; /* 0x69 where AD0 is high */
static const int16_t NO_SAMPLE = -32768;

static plumb_params_t params;
static plumb_attitude_t body;
static uint32_t period_us, next_us;

static void write_register(uint8_t number, uint8_t value) {
    Wire.beginTransmission(ADDRESS);
    Wire.write(number);
    Wire.write(value);
    Wire.endTransmission();
}

static int16_t read_word() {
    const int high = Wire.read(), low = Wire.read();
    return (int16_t)(uint16_t)(((unsigned)high << 8) | (unsigned)low);
}

/* The chip sends acceleration, temperature, rate; a step takes rate, acceleration. */
static bool read_counts(int16_t raw[PLUMB_RAW_MAX]) {
    Wire.beginTransmission(ADDRESS);
    Wire.write((uint8_t)0x3B);
    if (Wire.endTransmission(false) != 0 || Wire.requestFrom(ADDRESS, (uint8_t)14) != 14) {
        return false;
    }
    for (int i = 3; i < 6; i++) {
        raw[i] = read_word();
    }
    (void)read_word();
    for (int i = 0; i < 3; i++) {
        raw[i] = read_word();
    }
    return true;
}

void setup() {
    Serial.begin(115200);
    Wire.begin();
    Wire.setClock(400000);
    write_register(0x6B, 0x01); /* awake, on the clock of the gyro */
    write_register(0x19, 4);    /* 1 kHz / (4 + 1) */
    write_register(0x1A, 0x03); /* low-pass, 44 Hz */
    write_register(0x1B, 0x18); /* +-2000 deg/s */
    write_register(0x1C, 0x18); /* +-16 g */

    plumb_attitude_tuning_t tuning = PLUMB_ATTITUDE_TUNING_MPU6050; /* deg/s, g, s: change what you need */
    period_us = (uint32_t)tuning.period_us;
    const plumb_design_t made = plumb_attitude_design(&tuning, &params);
    while (made.error != PLUMB_DESIGN_OK) {
        Serial.print(made.field);
        Serial.println(" is refused");
        delay(1000);
    }
    plumb_attitude_init(&body, &params);
    next_us = micros();
}

void loop() {
    if ((int32_t)((uint32_t)micros() - next_us) < 0) {
        return;
    }
    next_us += period_us;
    int16_t raw[PLUMB_RAW_MAX] = {0};
    if (!read_counts(raw)) { /* the step bridges a gap */
        for (int i = 0; i < 6; i++) {
            raw[i] = NO_SAMPLE;
        }
    }
    plumb_attitude_step(&body, &params, raw, 0);
    if (body.words.step % 20U == 0U) {
        const int32_t *const up = body.words.up_q30; /* the vertical in axes of the body */
        const float deg = 360.0f / 4294967296.0f, variance_rad2 = (float)body.words.tilt_variance_rad2_q32 / 4294967296.0f;
        Serial.print((float)plumb_angle_atan2(up[1], up[2]) * deg);
        Serial.print(' ');
        Serial.print((float)plumb_angle_asin(-up[0]) * deg);
        Serial.print(' ');
        Serial.println(sqrtf(variance_rad2) * 57.29578f);
    }
}
