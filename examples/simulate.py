"""Two models on the same double lane change: tracking errors, and a figure of each drive.

pip install -e ".[report]" && python examples/simulate.py
"""

from math import degrees

from rt_controller import simulate

for model in ("mdk-net", "lti"):
    drive = simulate("double_lane_change", model=model)
    largest_deg = degrees(abs(drive["steer_rad"]).max())
    print(
        f"{model:8s} lateral error RMS {drive.errors.ey_rms_m:.3f} m, "
        f"peak {drive.errors.ey_peak_m:.3f} m, steering wheel up to {largest_deg:.0f} deg"
    )
    drive.plot(f"{model}.svg")
