"""What a drive with a controller came to."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.peers.ratio import Ratio, p50, p99, ratio_of
from rt_controller.contract.bundle import Array
from rt_controller.tracking import TrackingErrors


class Outcome(NamedTuple):
    """One controller on one drive, once."""

    plan_us: Array
    """(ticks,) state in to inputs out"""
    prepare_us: Array
    """(ticks,) between the ticks; zeros for who has nothing to prepare"""
    errors: TrackingErrors


class Summary(NamedTuple):
    """One controller on one drive, all rounds; ratios are to the default in the same round."""

    name: str
    plan_p50_us: float
    plan_p99_us: float
    plan_max_us: float
    prepare_p50_us: float
    plan_p50_over_default: Ratio
    plan_p99_over_default: Ratio
    both_p50_over_default: Ratio
    """plan and preparation together"""
    ey_rms_m: float
    ey_peak_m: float
    vx_rms_mps: float


def summarise(name: str, mine: Sequence[Outcome], default: Sequence[Outcome]) -> Summary:
    """The rounds of one, beside those of the default."""
    errors = mine[0].errors
    return Summary(
        name=name,
        plan_p50_us=p50([p50(one.plan_us) for one in mine]),
        plan_p99_us=p50([p99(one.plan_us) for one in mine]),
        plan_max_us=p50([float(np.max(one.plan_us)) for one in mine]),
        prepare_p50_us=p50([p50(one.prepare_us) for one in mine]),
        plan_p50_over_default=_compare(mine, default, lambda one: p50(one.plan_us)),
        plan_p99_over_default=_compare(mine, default, lambda one: p99(one.plan_us)),
        both_p50_over_default=_compare(
            mine, default, lambda one: p50(one.plan_us) + p50(one.prepare_us)
        ),
        ey_rms_m=errors.ey_rms_m,
        ey_peak_m=errors.ey_peak_m,
        vx_rms_mps=errors.vx_rms_mps,
    )


def _compare(
    mine: Sequence[Outcome], default: Sequence[Outcome], figure: Callable[[Outcome], float]
) -> Ratio:
    return ratio_of([figure(one) for one in mine], [figure(one) for one in default])
