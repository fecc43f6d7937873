"""The work of `offline-import`: read logs, check them, write them as a data set.

Nothing is written before all logs were read and passed the checks.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from offline.commands.terminal import STDERR, STDOUT, print_plain, quoted
from offline.data.dataset import exists, save_dataset
from offline.data.manifest import CAR_OF_LOGS, Imported
from offline.logs.completion import complete
from offline.logs.episode import (
    LEAST_SAMPLES,
    assign_parts,
    cut_drive,
    join_episodes,
    make_schema,
    roads_of,
    sample_drive,
    slice_windows,
)
from offline.logs.inspection import inspect_drives, report_tables, require_episodes, summary
from offline.logs.mapping import read_mapping
from offline.logs.readers.source import find_logs, read_log, source_file, source_files
from offline.logs.repeated import find_repeated
from offline.logs.signal import to_drive
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.signals import VEHICLE, Schema
from rt_controller.mapping.reference_line import read_line
from rt_controller.report.table import print_table


def import_logs(
    mapping_file: Path,
    places: Sequence[Path],
    folder: Path | None,
    *,
    replace: bool,
) -> dict[str, Any]:
    """Figures of `offline-import`; without a folder the logs are only checked.

    Raises:
        ConfigError: the mapping is wrong, or the folder has a data set already.
        DatasetError: a log is damaged, or fails a check; or logs with the same samples would
            become one data set, where they are in several parts.
    """
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
        sampled = [sample_drive(drive, mapping) for drive in drives]
        car, accuracy = None if mapping.car is None else mapping.car.car, None
        is_enough = any(len(part) >= LEAST_SAMPLES for parts in sampled for part in parts)
        if mapping.is_completed and is_enough:
            status.update("estimating the lateral speed")
            sampled, accuracy = complete(sampled, drives, mapping)
            car = accuracy.car
        cuts = [cut_drive(each, mapping, line) for each in sampled]
        require_episodes(drives, cuts, mapping)
        schema = make_schema(mapping, drives)
        episodes = [episode for cut in cuts for episode in cut.episodes]
        part = assign_parts([episode.drive for episode in episodes], mapping.split)
        recording, roads = join_episodes(episodes, mapping), roads_of(mapping)
        slices = slice_windows(recording, roads, mapping.split.seed)
        status.update("checking")
        report = inspect_drives(drives, cuts, slices, part, mapping, schema)
    for table in report_tables(report):
        print_table(table, STDOUT)
    for sentence in repeated:
        print_plain(f"note: {sentence}")
    if mapping.can is not None:
        from rt_controller.mapping.car_file import load_dbc  # cantools, for CAN logs only

        if note := load_dbc(mapping.can.dbc).note:
            print_plain(f"note: {note}")
    for sentence in (summary(report), *_limits_of_use(schema)):
        STDOUT.print(sentence)
    if accuracy is not None:
        print_plain(accuracy.sentences(mapping.car is not None))
    others = [mapping.pose and mapping.pose.reference_line, mapping.can and mapping.can.dbc]
    figures = {
        "folder": None,
        "sha256": None,
        "car": CAR_OF_LOGS,
        "repeated": repeated,
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


def _limits_of_use(schema: Schema) -> Iterator[str]:
    """A sentence if the controller cannot drive with models of these signals."""
    if not np.isclose(schema.dt_s, VEHICLE.dt_s, rtol=1e-9):
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
