"""Attitude hold on the simulated STM32F103: the flash image closes the loop, and every step equals the model's."""

import plumb

result = plumb.run("quad", board="virtual", scenario="hold", seed=1000, seconds=14)
tilt_deg, true_deg = result["tilt_deg"], result.truth["tilt_deg"]
for time_s in (10.0, 10.6, 11.0, 12.0, 13.5):  # pulled to 20 deg by hand, and released at 10.6 s
    at = int(result.time_s.searchsorted(time_s - 1e-9))
    print(f"{time_s:4.1f} s  tilt {true_deg[at]:6.2f} deg  estimated {tilt_deg[at]:6.2f} deg")
print(f"{result.steps} steps, bit-exact: {result.bit_exact}")

# Prints:
#     10.0 s  tilt   0.00 deg  estimated  -0.42 deg
#     10.6 s  tilt  20.00 deg  estimated  20.04 deg
#     11.0 s  tilt -20.29 deg  estimated -20.76 deg
#     12.0 s  tilt   3.39 deg  estimated   3.81 deg
#     13.5 s  tilt  -0.60 deg  estimated  -0.19 deg
#     2800 steps, bit-exact: True
