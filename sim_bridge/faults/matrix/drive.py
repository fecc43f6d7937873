"""One drive of the matrix, in simulated time: controller and car over a virtual bus.

The only module of the simulation that imports the controller as a whole.
"""

from contextlib import closing
from itertools import count

from threadpoolctl import threadpool_limits

from rt_controller.config import ControllerConfig
from rt_controller.contract.errors import RtControllerError
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.timing import PERIOD_NS, PERIOD_S
from rt_controller.planner import build_mpc
from rt_controller.realtime.clock import LockstepClock
from rt_controller.safety.checks import CHECKS
from rt_controller.session import ControllerSession
from rt_controller.settings import VIRTUAL, BusSettings
from sim_bridge.faults.matrix.cases import Case
from sim_bridge.faults.matrix.row import AT_REST_MPS, MatrixRow, Observed, judge
from sim_bridge.session import BridgeSession, open_session

LONGEST_TICKS = round(25.0 / PERIOD_S)
"""of a drive with its stop"""
LONGEST_STANDBY_TICKS = round(1.5 / PERIOD_S)
"""of a car that is not driven"""
_HANDSHAKE_S = 1.0
_numbers = count()


class _Observer:
    """The car's end of the bus, with a note of each period."""

    def __init__(self, car: BridgeSession, faults: int) -> None:
        """`faults`: how many of the scenario are those of the case."""
        self.periods: list[Observed] = []
        self.failure: str | None = None
        """the error that ended the vehicle's program"""
        self.session: ControllerSession | None = None
        self._bridge = car.bridge
        self._faults = car.bridge.scenario.faults[:faults]
        self._now_ns = self._ticks = 0

    def tick(self, now_ns: int) -> None:
        """One period of the car; before it, note the one that the controller has answered."""
        if self._ticks > 0:
            self.note()
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

    def note(self) -> None:
        """Add the period that is over."""
        bridge, session = self._bridge, self.session
        if bridge.is_mission_over:
            return
        is_joined = session is not None and session.is_joined
        result = session.record.result if session is not None and is_joined else None
        truth = bridge.truth
        self.periods.append(
            Observed(
                mode=None if result is None else result.mode,
                has_fault_bit=bool(result and result.faults) or truth.has_refused,
                is_vehicle_braking=truth.is_vehicle_braking,
                is_driven=not bridge.is_waiting,
                is_faulty=any(each.acts(bridge.driven_ticks) for each in self._faults),
                ey_m=truth.ey_error_m,
                speed_mps=truth.speed_mps,
                wanted_mps=truth.wanted_mps,
            )
        )

    def go_on_alone(self) -> None:
        """Let the vehicle go on without the controller until it stands."""
        self.note()
        self.session = None
        while self._ticks < LONGEST_TICKS and self.failure is None:
            if self.periods[-1].speed_mps <= AT_REST_MPS or self._bridge.is_waiting:
                return
            try:
                self.tick(self._now_ns + PERIOD_NS)
            except Exception:  # it is noted in `failure`
                return


def drive_case(case: Case, speed_kmh: float, bundle: Bundle, has_checks: bool = True) -> MatrixRow:
    """Drive one fault at one speed and judge it; without checks nothing contradicts a signal."""
    config = ControllerConfig()
    bus = BusSettings(bus=VIRTUAL, channel=f"fault-matrix-{next(_numbers)}")
    scenario = case.scenario(speed_kmh)
    with (
        closing(open_session(bus, scenario, has_checks=has_checks)) as car,
        threadpool_limits(1, "blas"),
    ):
        observer = _Observer(car, len(case.faults))
        clock = LockstepClock(observer.tick)
        mpc = build_mpc(bundle, config.mpc)
        checks = CHECKS if has_checks else ()
        joined = ControllerSession(bus, config, bundle, mpc, clock, checks=checks)
        with closing(joined) as session:
            observer.session = session
            session.start(None, False, _HANDSHAKE_S).join()
            error, failure = session.failure, observer.failure
            if failure is None and error and not isinstance(error, RtControllerError):
                failure = f"the controller's program failed: {type(error).__name__}: {error}"
            if not car.bridge.is_mission_over:
                observer.go_on_alone()
    # Before the first step of the controller nothing is judged.
    first = next((k for k, each in enumerate(observer.periods) if each.mode is not None), 0)
    return judge(case, speed_kmh, observer.periods[first:], observer.failure or failure)
