"""The controller without a bus: it brings a car back to its lane; the model stands in for the car.

pip install -e . && python examples/controller.py
"""

from rt_controller import Controller, PathReference, VehicleState
from rt_controller.contract.timing import PERIOD_S

controller = Controller.load("mdk-net")
lane = PathReference(c0_m=0.0, c1=0.0, c2_per_m=0.0, c3_per_m2=0.0, v_mps=20.0, a_mps2=0.0)
state = VehicleState(vx_mps=20.0, vy_mps=0.0, yaw_rate_radps=0.0, ds_m=0.5, ey_m=1.0, epsi_rad=0.0)
for period in range(81):
    plan = controller.step(state, lane, curvature_per_m=0.0)
    if not plan.is_solved:
        raise SystemExit(f"no plan: {plan.status.name}")
    if period % 20 == 0:
        print(f"{PERIOD_S * period:.1f} s  e_y {state.ey_m:+.3f} m  {plan.control}")
    state = VehicleState(*plan.states[1])
