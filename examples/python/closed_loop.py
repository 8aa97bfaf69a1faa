"""Attitude hold on the simulated STM32F103: the flash image closes the loop, and every step equals the model's."""

import plumb

result = plumb.run("quad", board="virtual", scenario="hold", seed=1000, seconds=14)
tilt_deg, true_deg = result["tilt_deg"], result.truth["tilt_deg"]
released = int((true_deg > 19.9).nonzero()[0][-1])  # pulled to 20 deg by hand, and let go
for later_s in (-0.6, 0.0, 0.4, 1.4, 2.2):
    at = released + round(later_s / 0.005)
    print(f"{later_s:4.1f} s  tilt {true_deg[at]:6.2f} deg  estimated {tilt_deg[at]:6.2f} deg")
print(f"{result.steps} steps, bit-exact: {result.bit_exact}")

# Prints:
#     -0.6 s  tilt   0.18 deg  estimated   0.27 deg
#      0.0 s  tilt  19.90 deg  estimated  20.36 deg
#      0.4 s  tilt -20.23 deg  estimated -20.34 deg
#      1.4 s  tilt   2.99 deg  estimated   3.33 deg
#      2.2 s  tilt  -1.41 deg  estimated  -0.98 deg
#     2800 steps, bit-exact: True
