"""A control law of one's own beside the MPC: pure pursuit, and one pedal for the speed.

rt-controller --bus virtual --controller examples/pure_pursuit.py:PurePursuit
"""

from rt_controller import ControlInput, Observation, compare

WHEELBASE_M, STEERING_RATIO, UNDERSTEER = 2.91, 18.5, 0.0025


class PurePursuit:
    """Steers along the circle through the point of the path half a second ahead."""

    def control(self, now: Observation) -> ControlInput:
        state, path = now.state, now.path
        ahead_m = 3.0 + 0.5 * state.vx_mps
        aside_m = path.ey_at(ahead_m) - state.ey_m - ahead_m * state.epsi_rad
        curvature_per_m = now.curvature_per_m + 2.0 * aside_m / ahead_m**2
        front_rad = (WHEELBASE_M + UNDERSTEER * state.vx_mps**2) * curvature_per_m
        steer_rad = STEERING_RATIO * front_rad
        wanted_mps2 = path.a_mps2 + 1.5 * (path.v_mps - state.vx_mps)
        throttle, brake_n = 0.05 + 0.15 * wanted_mps2, -15.0 * wanted_mps2 - 5.0
        return ControlInput(max(throttle, 0.0), max(brake_n, 0.0), steer_rad)


if __name__ == "__main__":
    comparison = compare(["mdk-net", PurePursuit()], ["double_lane_change", "slalom"])
    for row in comparison.rows:
        print(f"{row.controller} in {row.scenario}: RMS of the lateral error {row.ey_rms_m:.3f} m")
    comparison.plot().savefig("pure_pursuit.svg")
