"""Parameters of a board in units: read, described, changed with one commit, refused with the limit."""

import plumb

with plumb.connect("native") as board:
    params = board.params
    about = params.describe("pid.kp")
    print(f"{about.name} = {params['pid.kp']:.4f} {about.unit}, {', '.join(about.words)}")
    params["pid.kp"] = 0.05
    params.update({"kalman.bias_max": 200.0, "esc.max": 1900.0, "arm_hold_ms": 500})
    print(f"{params['pid.kp']:.4f}, {params['kalman.bias_max']:.1f}, {params['esc.max']:.1f}, {params['arm_hold_ms']}")
    try:
        params["pid.kp"] = 5.0
    except plumb.UsageError as error:
        print(error)
    result = board.run("quad", scenario="hold", seconds=14, tuning=params.tuning)
    print(f"hold with these: {result.verdict}")

# Prints:
#     pid.kp_per_deg = 0.0216 1/deg, pid.kp_q22
#     0.0500, 200.0, 1900.0, 500
#     pid.kp_per_deg = 5: too large for its integer, the most is 0.711111
#     hold with these: pass
