"""Everybody through every recording, several times in turn: figures and their spread."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from benchmarks.peers.entrants.roster import COLD, DEFAULT, Entrant
from benchmarks.peers.exact import exact_first_inputs
from benchmarks.peers.race import Lap, Mode, drive_lap, find_tolerance, first_input_error
from benchmarks.peers.ratio import Ratio, p50, p99, ratio_of
from benchmarks.peers.recording import Recording


class Standing(NamedTuple):
    """One solver on one recording in one mode."""

    name: str
    tolerance: float | None
    """None: it has none that is exact enough, or needs none"""
    is_exact_enough: bool
    unsolved: int
    first_input_error: float
    p50_us: float
    p99_us: float
    max_us: float
    p50_over_cold: Ratio
    p99_over_cold: Ratio
    p50_over_default: Ratio
    p99_over_default: Ratio


def compare(
    recording: Recording,
    entrants: Sequence[Entrant],
    mode: Mode,
    rounds: int,
) -> list[Standing]:
    """Each in the loosest setting that is exact enough, all of them in every round."""
    exact = exact_first_inputs(recording)
    tolerances: dict[str, float | None] = {}
    laps: dict[str, list[Lap]] = {entrant.name: [] for entrant in entrants}
    for entrant in entrants:
        tolerances[entrant.name] = find_tolerance(entrant, recording, exact)
    order = np.random.default_rng(0)
    for _ in range(rounds):
        for at in order.permutation(len(entrants)):
            entrant = entrants[at]
            tolerance = tolerances[entrant.name]
            laps[entrant.name].append(drive_lap(entrant, tolerance or 1e-6, recording, mode))
    medians = {name: [p50(lap.times_us) for lap in mine] for name, mine in laps.items()}
    tails = {name: [p99(lap.times_us) for lap in mine] for name, mine in laps.items()}
    standings = []
    for entrant in entrants:
        mine, median, tail = laps[entrant.name], medians[entrant.name], tails[entrant.name]
        tolerance = tolerances[entrant.name]
        standings.append(
            Standing(
                name=entrant.name,
                tolerance=tolerance if entrant.has_tolerance else None,
                is_exact_enough=tolerance is not None,
                unsolved=max(lap.unsolved for lap in mine),
                first_input_error=max(first_input_error(lap, exact) for lap in mine),
                p50_us=p50(median),
                p99_us=p50(tail),
                max_us=p50([lap.times_us.max() for lap in mine]),
                p50_over_cold=ratio_of(median, medians[COLD]),
                p99_over_cold=ratio_of(tail, tails[COLD]),
                p50_over_default=ratio_of(median, medians[DEFAULT]),
                p99_over_default=ratio_of(tail, tails[DEFAULT]),
            )
        )
    return standings
