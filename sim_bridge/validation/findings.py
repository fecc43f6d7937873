"""From cars to verdicts: which car drives which test, what was found, and what the table says."""

from dataclasses import dataclass

import numpy as np

from sim_bridge.plant.parameters import load_parameters
from sim_bridge.validation import (
    cornering,
    dwell,
    lane_change,
    longitudinal,
    numerics,
    peer,
    table,
    transients,
)
from sim_bridge.validation.acceptance import Verdict, judge
from sim_bridge.validation.cars import ALL_WHEEL, FRONT_WHEEL, PEER

_FREQUENCIES_HZ = np.linspace(0.2, 2.0, 19)
_QUICK_FROM = 4
"""slow sines take long: the quick sweep begins at 0.6 Hz"""


@dataclass(frozen=True, slots=True)
class Fleet:
    """The car that drives each group of tests, by name; None leaves the group out."""

    main: str
    lane_change: str
    peer: str | None

    @property
    def names(self) -> tuple[str, ...]:
        """Each car once."""
        named = (self.main, self.lane_change, self.peer)
        return tuple(dict.fromkeys(name for name in named if name is not None))


def fleet(car: str | None) -> Fleet:
    """The cars that the table names, or one car for all tests that it can drive."""
    if car is None:
        return Fleet(ALL_WHEEL, FRONT_WHEEL, PEER)
    return Fleet(car, car, PEER if car == PEER else None)


@dataclass(frozen=True, slots=True)
class Findings:
    """Everything that was driven and measured; the report draws it."""

    fleet: Fleet
    numerics: tuple[numerics.Numerics, ...]
    """of each car in the fleet's names"""
    cornering: cornering.Cornering
    lane_change: lane_change.LaneChange
    pairs: tuple[peer.Pair, ...]
    transients: transients.Transients
    dwell: dwell.DwellSeries
    longitudinal: longitudinal.Longitudinal


def investigate(cars: Fleet, quick: bool = False) -> Findings:
    """Drive all tests; `quick` leaves the slowest sines out, the table stays the same.

    Raises:
        ConfigError: there is no such car.
        MissingExtraError: the other model of test 4 is not installed.
    """
    main = load_parameters(cars.main)
    pairs = peer.measure(load_parameters(cars.peer)) if cars.peer is not None else ()
    turning = cornering.measure(main)
    return Findings(
        fleet=cars,
        numerics=tuple(numerics.measure(load_parameters(name)) for name in cars.names),
        cornering=turning,
        lane_change=lane_change.measure(load_parameters(cars.lane_change)),
        pairs=pairs,
        transients=transients.measure(main, _FREQUENCIES_HZ[_QUICK_FROM if quick else 0 :]),
        dwell=dwell.measure(main, turning.wheel_angle_deg),
        longitudinal=longitudinal.measure(main),
    )


def verdicts(findings: Findings) -> list[Verdict]:
    """Every line of the table, in its order."""
    main = findings.fleet.main
    return [
        *(
            judge(line, found, car)
            for car, found in zip(findings.fleet.names, findings.numerics, strict=True)
            for line in table.NUMERICS
            if car == main or line.car is None
        ),
        *(judge(line, findings.cornering, main) for line in table.CORNERING),
        *(
            judge(line, findings.lane_change, findings.fleet.lane_change)
            for line in table.LANE_CHANGE
        ),
        *(
            judge(line, pair, findings.fleet.peer or "")
            for pair in findings.pairs
            for line in table.peer_lines(pair.road_wheel_rad)
        ),
        *(judge(line, findings.transients, main) for line in table.TRANSIENTS),
        *(judge(line, findings.dwell, main) for line in table.DWELL),
        *(judge(line, findings.longitudinal, main) for line in table.LONGITUDINAL),
    ]
