"""One drive of the matrix, in simulated time: controller and car over a virtual bus."""

from contextlib import closing, suppress
from functools import cache
from itertools import count
from typing import Any

from threadpoolctl import threadpool_limits

from benchmarks.fault_matrix.cases import Case
from benchmarks.fault_matrix.verdict import AT_REST_MPS, LARGEST_LOSS_M, MatrixRow, Observed, judge
from rt_controller.config import ControllerConfig
from rt_controller.contract.errors import RtControllerError
from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from rt_controller.model.bundle import Bundle
from rt_controller.node import build_mpc
from rt_controller.realtime.clock import LockstepClock
from rt_controller.safety.checks import CHECKS
from rt_controller.session import ControllerSession
from rt_controller.settings import VIRTUAL, BusSettings
from sim_bridge.bridge import Bridge
from sim_bridge.session import open_session

LONGEST_TICKS = round(25.0 / PERIOD_S)
LONGEST_STANDBY_TICKS = round(1.5 / PERIOD_S)
"""of a drive with its stop, and of a car that is not driven"""
_HANDSHAKE_S = 1.0
_numbers = count()


class _Observer:
    """The car's end of the bus, with a note of each period."""

    def __init__(self, bridge: Bridge, faults: int) -> None:
        """`faults`: how many of the scenario are those of the case."""
        self.periods: list[Observed] = []
        self.failure: str | None = None  # the error that ended the vehicle's program
        self.session: ControllerSession | None = None
        self._bridge = bridge
        self._faults = bridge.scenario.faults[:faults]
        self._now_ns = self._ticks = 0

    def tick(self, now_ns: int) -> None:
        """One period of the car; before it, note the one that the controller has answered."""
        if self._ticks > 0:
            self._note()
        self._now_ns = now_ns
        self._ticks += 1
        is_stuck = self._bridge.is_waiting and self._ticks > LONGEST_STANDBY_TICKS
        if self.session is not None and (is_stuck or self._ticks > LONGEST_TICKS):
            for _ in range(3):  # the third request ends the loop at once
                self.session.request_stop()
        try:
            self._bridge.tick(now_ns)
        except Exception as error:
            self.failure = f"the vehicle's program failed: {error}"
            raise

    def go_on_alone(self) -> None:
        """Let the vehicle go on without the controller until it stands, or its mission is over."""
        self._note()
        self.session = None
        with suppress(Exception):  # it is noted in `failure`
            while self._ticks < LONGEST_TICKS and self.failure is None:
                if self.periods[-1].speed_mps <= AT_REST_MPS or self._bridge.is_waiting:
                    return
                self.tick(self._now_ns + PERIOD_NS)

    def _note(self) -> None:
        bridge, session, run = self._bridge, self.session, self._bridge.run
        if run.end_ticks > 0:
            return
        result = session.record.result if session is not None and session.is_joined else None
        self.periods.append(
            Observed(
                mode=None if result is None else result.mode,
                has_fault_bit=bool(result and result.faults) or bridge.has_refused,
                is_vehicle_braking=bridge.is_braking,
                is_driven=not bridge.is_waiting,
                is_faulty=any(each.acts(run.ticks) for each in self._faults),
                ey_m=run.ey_error_m,
                speed_mps=run.speed_mps,
                wanted_mps=run.path.v_mps,
            )
        )


def drive_task(case: Case, speed_kmh: float, model: str | None) -> dict[str, Any]:
    """The fields of the row of a drive."""
    return drive_case(case, speed_kmh, _bundle(model))._asdict()


_bundle = cache(Bundle.load)


def drive_case(case: Case, speed_kmh: float, bundle: Bundle) -> MatrixRow:
    """Drive one fault at one speed and judge it.

    If the car was off its path, it is judged beside the same drive without checks, where nothing
    contradicts a signal.
    """
    periods, failure = _drive(case, speed_kmh, bundle, has_checks=True)
    unchecked_m = None
    if any(abs(each.ey_m) > LARGEST_LOSS_M for each in periods):
        unchecked, _ = _drive(case, speed_kmh, bundle, has_checks=False)
        unchecked_m = max(abs(each.ey_m) for each in unchecked)
    return judge(case, speed_kmh, periods, failure, unchecked_m)


def _drive(
    case: Case, speed_kmh: float, bundle: Bundle, has_checks: bool
) -> tuple[list[Observed], str | None]:
    """The periods from the first step of the controller on, and the error that ended a program."""
    config = ControllerConfig()
    bus = BusSettings(bus=VIRTUAL, channel=f"fault-matrix-{next(_numbers)}")
    with (
        closing(open_session(bus, case.scenario(speed_kmh), has_checks=has_checks)) as car,
        threadpool_limits(1, "blas"),
    ):
        observer = _Observer(car.bridge, len(case.faults))
        clock, mpc = LockstepClock(observer.tick), build_mpc(bundle, config.mpc)
        checks = CHECKS if has_checks else ()
        with closing(ControllerSession(bus, config, bundle, mpc, clock, checks=checks)) as session:
            observer.session = session
            session.start(None, False, _HANDSHAKE_S).join()
            if car.bridge.run.end_ticks == 0:
                observer.go_on_alone()
    error, failure = session.failure, observer.failure
    if failure is None and error and not isinstance(error, RtControllerError):
        failure = f"the controller's program failed: {type(error).__name__}: {error}"
    first = next((k for k, each in enumerate(observer.periods) if each.mode is not None), 0)
    return observer.periods[first:], failure
