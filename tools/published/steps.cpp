// Steps of published filters for tools/measure_published.py: an entry each, begin() first, samples in rad/s
// and m/s^2. VQF and BasicVQF are the C++ of the package vqf; Mahony is our own lines.

#include <cmath>
#include <new>

#include "basicvqf.hpp"
#include "vqf.hpp"

namespace {
alignas(8) unsigned char vqf_at[sizeof(VQF)];
alignas(8) unsigned char basic_at[sizeof(BasicVQF)];
VQF *vqf;
BasicVQF *basic;

// R. Mahony, T. Hamel, J.-M. Pflimlin, "Nonlinear complementary filters on the special orthogonal group",
// IEEE TAC 53(5), 2008, explicit form with bias, gains of the package AHRS: k_P 1, k_I 0.3.
struct Mahony {
    float q[4], bias[3], period_s;
} mahony;
} // namespace

extern "C" {
void begin(unsigned period_us) {
    const float period_s = static_cast<float>(period_us) * 1e-6F;
    vqf = new (vqf_at) VQF(period_s);
    basic = new (basic_at) BasicVQF(period_s);
    mahony = Mahony{{1.0F, 0.0F, 0.0F, 0.0F}, {0.0F, 0.0F, 0.0F}, period_s};
}

void vqf_step(const float *gyr_radps, const float *acc_mps2) {
    vqf->update(gyr_radps, acc_mps2);
}

void basicvqf_step(const float *gyr_radps, const float *acc_mps2) {
    basic->update(gyr_radps, acc_mps2);
}

void mahony_step(const float *gyr_radps, const float *acc_mps2) {
    float *q = mahony.q, rate[3];
    const float length =
        std::sqrt(acc_mps2[0] * acc_mps2[0] + acc_mps2[1] * acc_mps2[1] + acc_mps2[2] * acc_mps2[2]);
    for (int i = 0; i < 3; i++) {
        rate[i] = gyr_radps[i] - mahony.bias[i];
    }
    if (length > 0.0F) {
        const float a[3] = {acc_mps2[0] / length, acc_mps2[1] / length, acc_mps2[2] / length};
        const float v[3] = {2.0F * (q[1] * q[3] - q[0] * q[2]), 2.0F * (q[2] * q[3] + q[0] * q[1]),
                            1.0F - 2.0F * (q[1] * q[1] + q[2] * q[2])};
        for (int i = 0; i < 3; i++) {
            const int j = (i + 1) % 3, k = (i + 2) % 3;
            const float error = a[j] * v[k] - a[k] * v[j];
            mahony.bias[i] -= 0.3F * error * mahony.period_s;
            rate[i] += error;
        }
    }
    const float h = 0.5F * mahony.period_s;
    const float w = q[0] - h * (q[1] * rate[0] + q[2] * rate[1] + q[3] * rate[2]);
    const float x = q[1] + h * (q[0] * rate[0] + q[2] * rate[2] - q[3] * rate[1]);
    const float y = q[2] + h * (q[0] * rate[1] - q[1] * rate[2] + q[3] * rate[0]);
    const float z = q[3] + h * (q[0] * rate[2] + q[1] * rate[1] - q[2] * rate[0]);
    const float scale = 1.0F / std::sqrt(w * w + x * x + y * y + z * z);
    q[0] = w * scale;
    q[1] = x * scale;
    q[2] = y * scale;
    q[3] = z * scale;
}

const float *mahony_quaternion() {
    return mahony.q;
}
}
