"""`RecordingOptions`: which recorded drives the car is compared with."""

from math import inf
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter
from pydantic import Field

from rt_controller.contract.errors import ConfigError
from rt_controller.settings_table import Settings

_SEVERAL = Parameter(negative=(), show_default=False)


class RecordingOptions(Settings):
    """Logs of real cars in place of the acceptance tests."""

    recording: Annotated[tuple[Path, ...], _SEVERAL] = ()
    """log of a real car (.csv, .csv.gz, .npz, .parquet): its steering and speed drive the car, its
    other signals are compared and not judged; may be given several times"""
    column: Annotated[tuple[str, ...], _SEVERAL] = ()
    """NAME=COLUMN: signal and unit of a column of the log, as in yaw_rate_degps=r; NAME=-COLUMN
    changes the sign; may be given several times"""
    period_s: Annotated[float, Field(gt=0.0, lt=1.0)] | None = None
    """period of a log without a column of times"""
    from_s: Annotated[float, Field(ge=0.0, allow_inf_nan=False)] = 0.0
    """use the log from this time on, counted from its beginning"""
    to_s: Annotated[float, Field(gt=0.0), Parameter(show_default=False)] = inf
    """use the log until this time"""
    friction: Annotated[float, Field(gt=0.0, allow_inf_nan=False)] | None = None
    """of the road of the recording; default: that of the car file"""

    def require_recording(self) -> None:
        """Return if no other option is given without a recording.

        Raises:
            ConfigError: one is.
        """
        given = sorted(self.model_fields_set - {"recording"})
        if given and not self.recording:
            listed = ", ".join(f"--{name.replace('_', '-')}" for name in given)
            raise ConfigError(
                f"{listed}: expected together with --recording, found no recording. Name the log "
                f"by --recording FILE."
            )
