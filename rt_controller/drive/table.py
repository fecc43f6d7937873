"""A finished drive as a table: one row for each tick, columns with names and units."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from rt_controller.contract.arrays import Array
from rt_controller.contract.errors import ConfigError, MissingExtraError, needs_extra, require_type
from rt_controller.contract.files import atomic_write
from rt_controller.contract.signals import NEUTRAL_INPUT, VEHICLE, ControlInput, Mode, Signal
from rt_controller.drive.scenario import CarFigure, DrivenScenario, LateralError, Outline

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TIME = Signal("time_s", "s")
REFERENCE = Signal("path_ey_m", "m"), Signal("path_epsi_rad", "rad"), Signal("path_vx_mps", "m/s")
MODE = Signal("mode", "1")
PLACE = Signal("s_m", "m")
COLUMNS = (TIME, *VEHICLE.states, *VEHICLE.exogenous, *REFERENCE, *VEHICLE.inputs, MODE, PLACE)
"""of a drive: time, measured states and curvature, reference at the car, input sent, `Mode`, and
arc length: of a simulated car its true place, else the sum of `ds_m` since the car was first driven
(a period without a new state counts as the one before)"""


class TrackingErrors(NamedTuple):
    """The car minus its reference over the ticks that drove; of the speed without a safe stop."""

    ey_rms_m: float
    ey_peak_m: float
    epsi_rms_rad: float
    epsi_peak_rad: float
    vx_rms_mps: float
    vx_peak_mps: float


class PredictedPath(NamedTuple):
    """Where the plan of one tick takes the car, by its model."""

    tick: int
    s_m: Array
    """(N + 1,), arc length from the begin of the plan on"""
    ey_m: Array


@dataclass(frozen=True, slots=True, repr=False)
class Drive:
    """What happened in one drive, tick by tick, in SI units.

        drive = simulate("double_lane_change")
        drive["ey_m"].max(), drive.errors.ey_rms_m
        drive.plot("drive.svg")

    NaN where a tick received no new state or path.
    """

    values: Array
    """(ticks, columns), see `COLUMNS`"""
    errors: TrackingErrors
    model: str
    """name of the controller: of a model with the first digits of its hash, or of a law"""
    ending: str
    """why the drive ended"""
    stop_cause: str = "NONE"
    """name of the fault of a safe stop, or of a car that was not taken over"""
    stop_tick: int | None = None
    """in which the last safe stop began, counted from zero; None: there was none"""
    stop_s: float | None = None
    """time of that tick since the first one"""
    car_figures: tuple[CarFigure, ...] = ()
    """of a simulated drive: the figures that its scenario names or limits"""
    car_error: LateralError | None = None
    """of a simulated drive: the error of the car itself, not as it was sent"""
    at_limit_s: ControlInput = NEUTRAL_INPUT
    """for how long each input was at its upper bound, the steering wheel at either, in s"""
    scenario: DrivenScenario | None = None
    """of a simulated drive"""
    true_poses: Array | None = None
    """(ticks, 3), s_m, ey_m, epsi_rad of the car itself; None: only what was received is known"""
    horizons: tuple[PredictedPath, ...] = ()
    """of every fourth tick of a drive in simulated time"""

    @property
    def poses(self) -> Array:
        """(ticks, 3), s_m, ey_m, epsi_rad: the true ones, or the last ones that were received."""
        if self.true_poses is not None:
            return self.true_poses
        return np.stack([filled(self[name]) for name in ("s_m", "ey_m", "epsi_rad")], axis=1)

    @property
    def body(self) -> Outline:
        """Of the scenario; on a real bus that of an ordinary car."""
        return Outline() if self.scenario is None else self.scenario.body

    @property
    def columns(self) -> tuple[str, ...]:
        """Names of the columns; each ends in its unit."""
        return tuple(signal.name for signal in COLUMNS)

    @property
    def units(self) -> dict[str, str]:
        """Unit of each column."""
        return {signal.name: signal.unit for signal in COLUMNS}

    @property
    def modes(self) -> tuple[Mode, ...]:
        """Mode of the controller in each tick."""
        return tuple(Mode(round(number)) for number in self["mode"])

    @property
    def lateral_error(self) -> LateralError:
        """That of the car itself if it is simulated, otherwise as received."""
        return self.car_error or LateralError(self.errors.ey_rms_m, self.errors.ey_peak_m)

    def __len__(self) -> int:
        return len(self.values)

    def __iter__(self) -> Iterator[str]:
        return iter(self.columns)

    def __repr__(self) -> str:
        return (
            f"<Drive of {len(self)} ticks with {self.model}, {self.ending}: "
            f"lateral error {self.lateral_error.text}>"
        )

    def _repr_html_(self) -> str:
        """The drive in a notebook: its figure, if matplotlib is installed, and its errors."""
        rows = "".join(
            f"<tr><td>{name}</td><td>{value:.4g}</td></tr>"
            for name, value in self.errors._asdict().items()
        )
        text = f"<p>{escape(repr(self)[1:-1])}</p><table>{rows}</table>"
        file = BytesIO()
        try:
            self.plot().savefig(file, format="svg")
        except MissingExtraError:
            return text
        svg = file.getvalue().decode()
        return svg[svg.index("<svg") :] + text

    def __getitem__(self, column: str) -> Array:
        """One column (ticks,)."""
        if column not in self.columns:
            raise KeyError(f"expected one of {', '.join(self.columns)}, found {column!r}")
        values: Array = self.values[:, self.columns.index(column)]
        return values

    def of_scenario(
        self,
        scenario: DrivenScenario,
        car_figures: tuple[CarFigure, ...],
        car_error: LateralError,
        true_poses: Array,
        horizons: tuple[PredictedPath, ...] = (),
    ) -> "Drive":
        """The drive with its scenario and figures; its arc length is the true one.

        That of `horizons` is counted from the car.
        """
        values = self.values.copy()
        # The sum of ds_m has a period more: a simulated car stands until the first command.
        values[:, self.columns.index(PLACE.name)] = true_poses[:, 0]
        placed = tuple(
            each._replace(s_m=each.s_m + true_poses[each.tick, 0])
            for each in horizons
            if each.tick < len(true_poses)
        )
        return replace(
            self,
            values=values,
            car_figures=car_figures,
            car_error=car_error,
            scenario=scenario,
            true_poses=true_poses,
            horizons=placed,
        )

    def to_csv(self, file: Path | str) -> None:
        """Write the table as CSV, one column for each name."""
        require_type("file", file, str | Path, "the path of a file")
        try:
            with atomic_write(Path(file)) as out:
                header = ",".join(self.columns)
                np.savetxt(out, self.values, "%.9g", ",", header=header, comments="")
        except OSError as error:
            raise ConfigError(
                f"{file}: expected a file that can be written, found {error.strerror}. Name "
                f"another file, in a folder that exists."
            ) from error

    def to_pandas(self) -> Any:
        """The table as a `pandas.DataFrame`, its units in `attrs["units"]`."""
        with needs_extra("logs", "A data frame"):
            import pandas as pd

        frame = pd.DataFrame(self.values, columns=list(self.columns))
        frame.attrs["units"] = self.units
        return frame

    def plot(self, file: Path | str | None = None) -> "Figure":
        """The drive from above, and curves over time: a matplotlib figure.

        Args:
            file: also write the figure there; the suffix chooses the format (.png, .svg,
                .pdf; .gif is a moving picture from above, without curves).
        """
        require_type("file", file, str | Path | None, "the path of a file")
        from rt_controller.report.drive_figure import draw_drive

        return draw_drive(self, None if file is None else Path(file))


def filled(values: Array) -> Array:
    """The column with its gaps filled by the value before them."""
    known = np.flatnonzero(np.isfinite(values))
    if known.size == 0:
        return np.zeros_like(values)
    last = np.maximum(np.searchsorted(known, np.arange(len(values)), side="right") - 1, 0)
    return np.asarray(values[known[last]])
