"""`rt-controller signals`: check a mapping against a bus or a log, or run it as a gateway."""

import time
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import can
from rich.console import Console

from rt_controller.bus.transport import close_bus
from rt_controller.contract.car import DEFAULT_CAR
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.figures import require_writable, write_figures
from rt_controller.gateway.command_check import require_sendable
from rt_controller.gateway.lateral_speed import choose_car, choose_lateral_speed
from rt_controller.gateway.process import LEAVING_REQUEST, Gateway, run_gateway
from rt_controller.gateway.signals_check import BIT_RATE, CheckReport, check_signals
from rt_controller.mapping.can_log import LoggedFrame, read_frames
from rt_controller.mapping.car_file import CarFile, read_car
from rt_controller.mapping.relations import HELP, HOLDS, Comparison
from rt_controller.model.artifact import find_model, load_bundle
from rt_controller.realtime.scheduling import real_time_process, set_thread_priority
from rt_controller.report.table import Cell, Column, Table, format_number, print_table, print_text
from rt_controller.settings import BusSettings
from rt_controller.terminal.entry import INTERRUPTED
from rt_controller.terminal.progress import announce, show
from rt_controller.terminal.stop_signals import stop_on_signals

if TYPE_CHECKING:
    from rt_controller.terminal.options import CheckOptions, GatewayOptions

REMEDY = "Name another log (.blf, .asc, .log, .trc), or record it again."
EXIT_FOUND = 8
"""a signal is missing or implausible"""
_LONGEST_WAIT_S = 0.02
_PAUSE_S = 0.05
"""between two reads, from which on this program was not run"""


def check_at_terminal(file: Path, log: Path | None, options: "CheckOptions") -> int:
    """Print what arrives of each signal; 0, or 8 if something was found."""
    bus = options.bus and BusSettings(
        bus=options.bus, channel=options.channel, bitrate=options.bitrate
    )
    require_writable(options.json_file, inputs=(file, log))
    if (log is None) == (not bus):
        raise ConfigError(
            "expected a log or --bus, found "
            + ("both" if log is not None else "neither")
            + ". Name a CAN log (.blf, .asc, .log, .trc), or the bus to listen to."
        )
    car = _read_car(file)
    if bus:
        bus.require_openable(car.database.is_fd)
    require_sendable(car, choose_car(car, load_bundle(find_model(None))))
    pauses_s: list[float] = []
    channel: int | str | None = None  # of a log
    with ExitStack() as opened:
        if bus:
            listened = bus.open_bus(car.database.is_fd)
            opened.callback(close_bus, listened)
            listen_s = options.listen_s
            opened.enter_context(announce(f"listening for {listen_s:g} s", options.quiet))
            frames, where = _listen(listened, listen_s, pauses_s), str(listened.channel_info)
        elif log is not None:
            frames, where, channel = read_frames(log, REMEDY), str(log), car.mapping.can.channel
        report = check_signals(car, frames, where, channel)
    _print(report)
    if pauses_s:
        show(
            f"note: this program was not run for {max(pauses_s):.3g} s at most, "
            f"{sum(pauses_s):.3g} s in all. If a gap is reported, repeat the check on a machine "
            f"with less load."
        )
    write_figures(options.json_file, {**report.figures(), "not_run_s": pauses_s})
    return 0 if report.is_ok else EXIT_FOUND


def gateway_at_terminal(file: Path, options: "GatewayOptions") -> int:
    """Translate until Ctrl-C."""
    bus = BusSettings(bus=options.bus, channel=options.channel, bitrate=options.bitrate)
    car_bus = BusSettings(
        bus=options.car_bus, channel=options.car_channel, bitrate=options.car_bitrate
    )
    require_writable(options.json_file, inputs=(file,))
    car = _read_car(file)
    car_bus.require_openable(car.database.is_fd)
    bus.require_openable()
    bundle = load_bundle(find_model(options.model))
    lateral_speed, description = choose_lateral_speed(car, bundle), choose_car(car, bundle)
    require_sendable(car, description)
    of_model = (bundle.car or DEFAULT_CAR).own_values
    if description.own_values != of_model:
        show(
            f"note: [car] of {file} has {description.own_values or 'no values'} beside the "
            f"geometry, the model {bundle.name} {of_model or 'none'}: the gateway refuses commands "
            f"beyond its limits. Drive with a model that was exported with the same table."
        )
    with ExitStack() as opened:
        # First: the threads that a bus starts inherit the settings of the process.
        guarantees = opened.enter_context(real_time_process(options.priority))
        below = car_bus.open_bus(car.database.is_fd)
        opened.callback(close_bus, below)
        above = bus.open_bus()
        opened.callback(close_bus, above)
        gateway = Gateway(below, above, car, lateral_speed, description)
        opened.enter_context(stop_on_signals(gateway.request_end))
        guarantees = set_thread_priority(options.priority, process=guarantees)
        show(f"translating between {below.channel_info} and {above.channel_info}")
        show(guarantees.sentence())
        run_gateway(gateway)
    figures = asdict(gateway.counts)
    shown = {**figures, **figures["refused_because"], **figures["braked_because"]}
    for counted in ("refused_because", "braked_because"):
        shown.pop(counted)
    Console().print("  ".join(f"{name} {value}" for name, value in shown.items()))
    write_figures(options.json_file, figures)
    return INTERRUPTED if gateway.requests >= LEAVING_REQUEST else 0


def _read_car(file: Path) -> CarFile:
    car = read_car(file)
    if car.database.note:
        show(f"note: {car.database.note}")
    return car


def _listen(bus: can.BusABC, listen_s: float, pauses_s: list[float]) -> Iterator[LoggedFrame]:
    """Each frame with its number and its stamp in s.

    The stamp counts also if this program was not run meanwhile; the lengths of such pauses are
    appended to `pauses_s`.
    """
    last_s = time.monotonic()
    end_s, number = last_s + listen_s, 0
    while last_s < end_s:
        frame = bus.recv(min(_LONGEST_WAIT_S, end_s - last_s))
        now_s = time.monotonic()
        if now_s - last_s > _PAUSE_S:
            pauses_s.append(now_s - last_s)
        if frame is not None:
            number += 1
            frame.timestamp = frame.timestamp or now_s
            yield LoggedFrame(number, frame, "")
        last_s = now_s


def _print(report: CheckReport) -> None:
    columns = (
        Column("signal", is_text=True),
        *(Column("samples"), Column("period", "ms"), Column("lowest"), Column("highest")),
        *(Column(name, is_text=True) for name in ("unit", "column", "message")),
        Column("", is_text=True, width="long"),
    )
    rows = tuple(
        (
            each.signal,
            str(each.samples),
            _number(each.period_s, 3, 1e3),
            _number(each.lowest),
            _number(each.highest),
            each.unit,
            each.column,
            f"{each.message} {each.identifier}",
            Cell(text, status="bad") if text else "ok",
        )
        for each, text in zip(report.slots, _problems(report), strict=True)
    )
    title = (
        f"{report.frames} frames in {report.duration_s:.1f} s, {report.bus_load_percent:.0f} % of "
        f"a bus with {BIT_RATE // 1000} kbit/s"
    )
    print_table(Table(title, columns, rows), Console())
    relations = tuple((text, _verdict(found)) for text, found in report.relations.items())
    heads = (Column("relation", is_text=True), Column("", is_text=True))
    print_table(Table("Relations between signals", heads, relations), Console())
    plain = partial(print_text, console=Console())
    if any(each.is_contradicted for each in report.relations.values()):
        plain(f"{HELP}.")
    for name, count in report.dropped.items():
        plain(f"{name}: {count} frames damaged or repeated")


def _verdict(found: Comparison) -> str | Cell:
    """Of a relation."""
    if found.is_contradicted:
        return Cell(found.answer.replace("yes", "CONTRADICTED", 1), status="bad")
    return Cell("holds", status="good") if found.answer == HOLDS else found.answer


def _problems(report: CheckReport) -> Iterator[str]:
    """What is wrong with each signal; the same text of one message only once."""
    first: dict[tuple[str, str], str] = {}
    for each in report.slots:
        name = first.setdefault((each.message, each.problem), each.signal)
        is_first = name == each.signal
        text = f"{each.problem}. {each.remedy}." if is_first else f"same as {name}"
        yield text if each.problem else ""


def _number(value: float | None, digits: int = 4, factor: float = 1.0) -> str:
    return "–" if value is None else format_number(factor * value, digits)
