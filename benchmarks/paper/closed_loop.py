"""Figure 4 and the computation times: the double lane change in closed loop."""

from functools import cache

import numpy as np
from matplotlib.figure import Figure

from benchmarks.figures.closed_loop import Row, scenario_of
from benchmarks.paper.elements import COMPUTATION_S, LTI, MDK_NET, Element, Figures
from rt_controller.config import ControllerConfig, MpcSettings
from rt_controller.contract.arrays import Array
from rt_controller.drive.comfort import wheel_rate_rms_degps
from rt_controller.drive.table import Drive
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_mpc
from rt_controller.realtime.timing import TickTimes
from rt_controller.report.canvas import FAINT, add_legend, empty_figure, line_styles
from rt_controller.report.page import Plot
from rt_controller.session import ControllerSession
from rt_controller.settings import CarSettings
from rt_controller.simulation import drive_in_lockstep

STEPS = 400
"""10 s"""
AS_PAPER = MpcSettings(preset="paper")
CONTROLLERS = {
    "mdk-net": ("mdk-net", MpcSettings()),
    "mdk-net, cost of the paper": ("mdk-net", AS_PAPER),
    "mdk-net-paper": ("mdk-net-paper", AS_PAPER),
    "lti": ("lti", AS_PAPER),
}
"""model and cost by name"""
OF_PAPER = {"mdk-net-paper": MDK_NET, "lti": LTI}
ERRORS = ("ey_rms_m", "ey_peak_m", "epsi_peak_rad", "speed_rms_mps")
"""measured at the car, not on the bus"""
PANELS = {
    "e_y / m": ("ey_m", 1.0, "path_ey_m"),
    "e_ψ / deg": ("epsi_rad", float(np.degrees(1.0)), "path_epsi_rad"),
    "v_x / (km/h)": ("vx_mps", 3.6, "path_vx_mps"),
    "v_y / (km/h)": ("vy_mps", 3.6, None),
    "yaw rate / (deg/s)": ("yaw_rate_radps", float(np.degrees(1.0)), None),
    "steering wheel / deg": ("steer_rad", float(np.degrees(1.0)), None),
    "throttle / 1": ("throttle", 1.0, None),
}
"""by title: column, factor to its unit, and column of the reference"""


@cache
def drive_with(name: str) -> tuple[Drive, Array]:
    """The drive with one of `CONTROLLERS`, and the computation time of each of its plans in ms."""
    model, mpc = CONTROLLERS[name]
    bundle, times = Bundle.load(model), list[Array]()

    def note(session: ControllerSession) -> None:
        times.append(session.record.deadlines.last()[-1].copy())

    drive = drive_in_lockstep(
        ControllerConfig(mpc=mpc),
        bundle,
        build_mpc(bundle, mpc),
        CarSettings(),
        scenario=scenario_of(Row("double lane change", "double_lane_change")),
        after_tick=note,
    )
    parts = [TickTimes._fields.index(part) for part in ("preparation_us", "plan_us")]
    return drive, np.sum(np.array(times)[:STEPS, parts], axis=1) / 1e3


def figure_4() -> Element:
    """Tracking errors and inputs of each controller. Paper: fig:MPC_comparison."""
    drives = {name: drive_with(name)[0] for name in CONTROLLERS}
    rows = {}
    for name, drive in drives.items():
        truth = {figure.name: figure.value for figure in drive.car_figures}
        rows[name] = {error: truth[error] for error in ERRORS}
        rows[name]["wheel_rate_rms_degps"] = wheel_rate_rms_degps(drive)
    mdk_net, lti = OF_PAPER
    ratio = rows[lti]["ey_rms_m"] / rows[mdk_net]["ey_rms_m"]
    return Element(
        "Figure 4",
        "Double lane change in closed loop, here of another car. The cost of the paper is eq. (14) "
        "over 20 periods, R on the changes of the inputs. The paper gives neither its weights nor "
        f"its errors; the weights are chosen here. {lti} leaves its path by up to "
        f"{rows[lti]['ey_peak_m']:.2f} m, {mdk_net} by {rows[mdk_net]['ey_peak_m']:.2f} m.",
        {f"RMS of the lateral error, {lti} / {mdk_net}": {"here": ratio}},
        {"paper_closed_loop": rows},
        {"figure-4": Plot(_draw(drives), "Dashed: the reference.")},
    )


def _draw(drives: dict[str, Drive]) -> Figure:
    figure, axes = empty_figure(4, 2, 9.6, sharex=True)
    styles = line_styles(list(drives), ())
    for name, drive in drives.items():
        error_m = drive["ey_m"] - drive["path_ey_m"]
        axes[-1].plot(drive["time_s"][:STEPS], error_m[:STEPS], **styles[name])
    axes[-1].set_title("lateral error / m", loc="left")
    for axis, (title, (column, factor, reference)) in zip(axes, PANELS.items(), strict=False):
        axis.set_title(title, loc="left")
        for name, drive in drives.items():
            time_s = drive["time_s"][:STEPS]
            axis.plot(time_s, factor * drive[column][:STEPS], **styles[name], label=name)
        if reference is not None:
            wanted = factor * drive[reference][:STEPS]
            axis.plot(time_s, wanted, color=FAINT, linestyle="--", zorder=3)
    for axis in axes[-2:]:
        axis.set_xlabel("time / s")
    add_legend(figure, axes[0])
    return figure


def computation_time() -> Element:
    """Time of all plans of 10 s. Paper: section IV-A, below fig:MPC_comparison."""
    rows, summary = Figures(), Figures()
    for name in CONTROLLERS:
        plan_ms = drive_with(name)[1]
        rows[name] = {
            f"{STEPS}_steps_s": float(np.sum(plan_ms)) / 1e3,
            "median_ms": float(np.median(plan_ms)),
            "p99_ms": float(np.percentile(plan_ms, 99)),
        }
    for name, of_paper in OF_PAPER.items():
        here = rows[name][f"{STEPS}_steps_s"]
        summary[f"{STEPS} steps with {name}, s"] = {"here": here, "paper": COMPUTATION_S[of_paper]}
    mdk_net, lti = summary.values()
    ratio = {which: mdk_net[which] / lti[which] for which in mdk_net}
    return Element(
        "Section IV-A",
        f"Computation time of {STEPS} plans, in the paper of MATLAB on a Core i7-1165G7, here of "
        "one core of this machine, with the dry run before each plan: only the ratio is "
        "comparable.",
        {**summary, " / ".join(OF_PAPER): ratio},
        {"paper_times": rows},
    )
