"""`offline-import`: a data set from the logs of a real car."""

from collections.abc import Iterator, Sequence
from functools import partial
from math import isclose
from pathlib import Path
from typing import TYPE_CHECKING, Any

from offline.commands.options import JsonFile, Logs
from offline.commands.terminal import STDERR, STDOUT, print_plain, quoted
from rt_controller.contract.errors import ConfigError, DatasetError, require_packages
from rt_controller.contract.figures import require_folder, require_writable, write_figures
from rt_controller.contract.signals import VEHICLE, Schema
from rt_controller.terminal.command_line import new_app, run_command

if TYPE_CHECKING:
    from offline.logs.completion import Accuracy
    from offline.logs.mapping import LogMapping

app = new_app(
    "offline-import",
    "Make a data set of recorded logs: CSV, Parquet, MF4, npz, MATLAB, or CAN with a DBC. "
    "Nothing is written unless every log passes the checks. docs/own-data.md has the mapping file.",
    "MAPPING LOGS",
)
main = partial(run_command, app)


@app.default
def import_command(
    mapping: Path,
    logs: Logs,
    *,
    data: Path | None = None,
    replace: bool = False,
    json_file: JsonFile = None,
) -> None:
    """Convert logs of a real car into a data set to train on, and report what they contain.

    Args:
        mapping: TOML file that maps columns to signals
        logs: log files, or folders of them
        data: folder for the data set; default: none, the logs are only checked
        replace: overwrite an existing data set
    """
    require_packages("offline,logs", ("pandas",), "offline-import")
    require_writable(json_file, inputs=(mapping, *logs))
    require_folder(data, "--data")
    write_figures(json_file, import_logs(mapping, logs, data, replace=replace))


def import_logs(
    mapping_file: Path, places: Sequence[Path], folder: Path | None, *, replace: bool
) -> dict[str, Any]:
    """Figures of `offline-import`; without a folder the logs are only checked.

    Nothing is written before all logs were read and passed the checks.

    Raises:
        ConfigError: the mapping is wrong, or the folder has a data set already.
        DatasetError: a log is damaged, or fails a check; or logs with the same samples would
            become one data set, where they are in several parts.
    """
    from offline.data.dataset import exists, save_dataset
    from offline.data.manifest import CAR_OF_LOGS, Imported
    from offline.logs import episode as episodes_of
    from offline.logs.completion import complete
    from offline.logs.inspection import inspect_drives, require_episodes
    from offline.logs.mapping import read_mapping
    from offline.logs.readers.source import find_logs, read_log, source_file, source_files
    from offline.logs.repeated import find_repeated
    from offline.logs.signal import to_drive
    from rt_controller.mapping.reference_line import read_line

    if folder is not None and exists(folder) and not replace:
        raise ConfigError(
            f"--data {folder}: expected a folder without a data set, found one. Name another, or "
            f"add --replace."
        )
    mapping, text = read_mapping(mapping_file)
    found = find_logs(places, mapping)
    with STDERR.status("reading") as status:
        drives = []
        for each in found:
            status.update(f"reading {each.name}")
            drives.append(to_drive(read_log(each, mapping), mapping))
        status.update("comparing the logs")
        repeated = find_repeated(drives, mapping.period_s)
        if repeated and folder is not None and not mapping.checks.accept_repeated:
            raise DatasetError("expected different drives, found that " + "\n".join(repeated))
        status.update("cutting into episodes")
        line = read_line(mapping.pose) if mapping.pose else None
        sampled = [episodes_of.sample_drive(drive, mapping) for drive in drives]
        car, accuracy = None if mapping.car is None else mapping.car.car, None
        is_enough = any(
            len(part) >= episodes_of.LEAST_SAMPLES for parts in sampled for part in parts
        )
        if mapping.is_completed and is_enough:
            status.update("estimating the lateral speed")
            sampled, accuracy = complete(sampled, drives, mapping)
            car = accuracy.car
        cuts = [episodes_of.cut_drive(each, mapping, line) for each in sampled]
        require_episodes(drives, cuts, mapping)
        schema = episodes_of.make_schema(mapping, drives)
        episodes = [episode for cut in cuts for episode in cut.episodes]
        part = episodes_of.assign_parts([episode.drive for episode in episodes], mapping.split)
        roads = episodes_of.roads_of(mapping)
        recording = episodes_of.join_episodes(episodes, mapping)
        slices = episodes_of.slice_windows(recording, roads, mapping.split.seed)
        status.update("checking")
        report = {
            "repeated": repeated,
            **inspect_drives(drives, cuts, slices, part, mapping, schema),
        }
    _print_report(report, mapping, schema, accuracy)
    others = [mapping.pose and mapping.pose.reference_line, mapping.can and mapping.can.dbc]
    figures = {
        "folder": None,
        "sha256": None,
        "car": CAR_OF_LOGS,
        "lateral_speed": accuracy and accuracy.figures(),
        **report,
    }
    if folder is not None:
        dataset = save_dataset(
            folder,
            recording,
            slices,
            part,
            schema=schema,
            roles=mapping.resolve_roles(),
            roads=roads,
            origin=Imported(
                (
                    *(file for each in found for file in source_files(each, mapping)),
                    *(source_file(path, path.name) for path in others if path),
                ),
                text,
                len(episodes),
                mapping.split.seed,
                accuracy and accuracy.std_mps,
            ),
            car=car,
            rejected=sum(len(cut.left_out) for cut in cuts),
        )
        figures |= {"folder": str(folder), "sha256": dataset.sha256}
        beginning = "--init mdk-net " if schema == VEHICLE else ""
        print_plain(
            f"SHA-256 {dataset.sha256:.16}…\n{folder}\nCar of its models: {CAR_OF_LOGS}.\n"
            f"Next, a few minutes:\n"
            f"  offline-train --steps 2000 {beginning}--data {quoted(folder)}"
        )
    return figures


def _print_report(
    report: dict[str, Any], mapping: "LogMapping", schema: Schema, accuracy: "Accuracy | None"
) -> None:
    from offline.logs.inspection import report_tables, summary
    from rt_controller.report.table import print_table

    for table in report_tables(report):
        print_table(table, STDOUT)
    for sentence in report["repeated"]:
        print_plain(f"note: {sentence}")
    if mapping.can is not None:
        from rt_controller.mapping.car_file import load_dbc  # cantools, for CAN logs only

        if note := load_dbc(mapping.can.dbc).note:
            print_plain(f"note: {note}")
    for sentence in (summary(report), *_limits_of_use(schema)):
        STDOUT.print(sentence)
    if accuracy is not None:
        print_plain(accuracy.sentences(mapping.car is not None))


def _limits_of_use(schema: Schema) -> Iterator[str]:
    """A sentence if the controller cannot drive with models of these signals."""
    if not isclose(schema.dt_s, VEHICLE.dt_s, rel_tol=1e-9):
        yield (
            f"The period is {1e3 * schema.dt_s:g} ms: models of this data set predict and are "
            f"compared, but the controller drives every {1e3 * VEHICLE.dt_s:g} ms only."
        )
    elif schema != VEHICLE:
        yield (
            f"These are not the signals that the controller drives with "
            f"({', '.join((*VEHICLE.state_names, *VEHICLE.input_names))}): models of this data set "
            f"predict and are compared, but do not drive."
        )
