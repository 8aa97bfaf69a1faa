"""Take-off, landing and the thrust of a hover of `attitude` with the aid of a vehicle, in integers.

The functions have the names of docs/reference/arithmetic/attitude.md.
"""

from __future__ import annotations

from plumb.kernels.fixed.kernels import Params
from plumb.kernels.integers import Integer, clamp, mul, select, wrap_i32
from plumb.systems.attitude.fixed_covariance import AXES, VELOCITY_Q28
from plumb.systems.attitude.fixed_state import LANDED_BLOCKS, ControlState

MAYBE_LANDED_BLOCKS, TAKE_OFF_BLOCKS = 8, 4
FOUR_G_Q18 = 1 << 20
WEIGHT_MIN_Q16, WEIGHT_MAX_Q16 = 53084, 79299
FALLS_Q16, HOVER_SQUARE_MAX_Q16 = 16384, (1 << 20) - 1
CUBE_ROOTS_Q14 = (23407, 18578, 14746, 11704, 9289, 7373)
"""0.9 * 2^(-n/3) for n from -2."""
THIRD_Q32 = 1431655765
HOVER_MIN_Q15, HOVER_MAX_Q15, COMMAND_MAX_Q15 = 3277, 27853, 31130
LIFTS_GS_Q28 = 8053064
COUNT_MAX, FIRST_BLOCKS = 255, 16


def square_g2_q16(mean: list[Integer]) -> Integer:
    """Square of the length of a mean acceleration, g^2 Q16."""
    x, y, z = (64 * clamp(one, -FOUR_G_Q18, FOUR_G_Q18) for one in mean)
    return mul(x, x) + mul(y, y) + mul(z, z)


def inverse_cube_root_q14(x_q16: Integer) -> Integer:
    """x^(-1/3), Q14 of Q16, for 1/4 <= x < 16."""
    y = 0 * x_q16 + CUBE_ROOTS_Q14[0]
    for exponent, start in enumerate(CUBE_ROOTS_Q14[1:], 15):
        y = select(x_q16 >= 1 << exponent, start, y)
    for _ in range(2):
        cube = (((y * y) >> 14) * y) >> 14
        y = mul(y * ((4 << 14) - ((x_q16 * cube) >> 16)), THIRD_Q32) >> 14
    return y


def learned_hover(hover: Integer, thrust: Integer, square: Integer, fast: Integer) -> Integer:
    """The thrust of a hover, Q15, after a block in flight with this thrust and this square of the acceleration."""
    at_1_g = (thrust * inverse_cube_root_q14(clamp(square, FALLS_Q16, HOVER_SQUARE_MAX_Q16))) >> 14
    off = at_1_g - hover
    change = select(fast, (off + 2) >> 2, select(off < 0, (off + 2) >> 5, (off + 2) >> 4))
    learned = clamp(hover + change, HOVER_MIN_Q15, HOVER_MAX_Q15)
    tells = (square >= FALLS_Q16) & (square <= HOVER_SQUARE_MAX_Q16) & (thrust <= COMMAND_MAX_Q15)
    return select(tells, learned, hover)


def follow_flight(c: ControlState, p: Params) -> None:
    """Count the blocks of take-off, flight and landing; learn the weight on the ground and the hover in flight."""
    mean = [mul(c.force_sum[i], p["attitude.inverse_block_q32"]) for i in AXES]
    square = square_g2_q16(mean)
    thrust, hover, zero = clamp(c.thrust, 0, 32767), c.hover, 0 * c.hover
    block_s = (p["attitude.block_steps"] * p["attitude.dt_s_q33"]) >> 1
    lifted = clamp(wrap_i32(mean[2] - c.weight), -FOUR_G_Q18, FOUR_G_Q18)
    felt = c.accel_run == 0
    weighs = felt & (square >= WEIGHT_MIN_Q16) & (square <= WEIGHT_MAX_Q16)
    climb = clamp(c.climb + mul(lifted << 10, block_s) - (c.climb >> 5), -VELOCITY_Q28, VELOCITY_Q28 - 1)

    landed, off = c.carried_blocks == LANDED_BLOCKS, thrust == 0
    c.climb = select(landed & off, zero, climb)
    c.weight = select(landed & weighs, c.weight + (lifted >> 5), c.weight)
    hovers = landed & (hover != 0) & (8 * thrust >= 7 * hover)
    waited = select(hovers, clamp(c.thrust_blocks + 1, 0, TAKE_OFF_BLOCKS), zero)
    lifts = (c.climb > LIFTS_GS_Q28) | (c.climb < -LIFTS_GS_Q28)
    takes_off = landed & (off == 0) & ((waited == TAKE_OFF_BLOCKS) | lifts)
    c.thrust_blocks = select(takes_off, zero, waited)

    light = 4 * thrust < 3 * hover
    more = select(weighs & light, c.carried_blocks + 1, zero)
    done = off & (more >= MAYBE_LANDED_BLOCKS)
    in_flight = select(done, zero + LANDED_BLOCKS, more)
    c.carried_blocks = select(landed, select(takes_off, zero, c.carried_blocks), in_flight)
    c.flown_blocks = select(takes_off, zero, select(landed, c.flown_blocks, clamp(c.flown_blocks + 1, 0, COUNT_MAX)))

    rises = (c.climb > 0) & (thrust < hover)
    begun = select(takes_off & ((hover == 0) | rises), clamp(thrust, HOVER_MIN_Q15, HOVER_MAX_Q15), hover)
    c.climb = select((landed == 0) & (c.carried_blocks >= MAYBE_LANDED_BLOCKS), zero, c.climb)
    first = c.flown_blocks < FIRST_BLOCKS
    learns = felt & (landed == 0) & ((light == 0) | (first & (8 * thrust >= 3 * hover)))
    c.hover = select(learns, learned_hover(hover, thrust, square, first), begun)
