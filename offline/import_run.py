"""What `offline-import` does: read logs, look at them, write them as a data set.

Nothing is written before everything was read, checked and found good.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from offline.dataset import exists, save_dataset
from offline.logs.assembly import assemble, roads_of, slice_windows
from offline.logs.episode import cut_episodes, make_schema
from offline.logs.inspection import inspect, require_episodes
from offline.logs.mapping import Mapping
from offline.logs.mapping_file import read_mapping
from offline.logs.parts import split
from offline.logs.reference_line import read_line
from offline.logs.series import Drive, to_drive
from offline.logs.source import describe_source, find_logs, read_log
from offline.manifest import Imported
from offline.terminal import CONSOLE
from rt_controller.contract.errors import ConfigError, DatasetError
from rt_controller.contract.figures import write_figures
from rt_controller.contract.schema import VEHICLE, Schema


def import_logs(
    mapping_file: Path,
    places: Sequence[Path],
    folder: Path | None,
    *,
    replace: bool,
    json_file: Path | None,
) -> int:
    """Exit code of `offline-import`; without a folder the logs are only looked at.

    Raises:
        ConfigError: the mapping makes no sense, or the folder holds a data set already.
        DatasetError: a log is damaged, or says something that cannot be.
    """
    if folder is not None and exists(folder) and not replace:
        raise ConfigError(
            f"--data {folder}: expected a folder without a data set, found one. Name another, or "
            f"add --replace."
        )
    mapping, text = read_mapping(mapping_file)
    paths = find_logs(places, mapping)
    with CONSOLE.status("reading") as status:
        drives: list[Drive] = []
        for path in paths:
            status.update(f"reading {path.name}")
            drives.append(to_drive(read_log(path, mapping), mapping))
        status.update("cutting")
        line = read_line(mapping.pose) if mapping.pose else None
        cuts = [cut_episodes(drive, mapping, line) for drive in drives]
        require_episodes(drives, cuts, mapping)
        schema = _common_schema(drives, mapping)
        episodes = [episode for cut in cuts for episode in cut.episodes]
        part = split([episode.path.name for episode in episodes], mapping.split)
        recording, roads = assemble(episodes, mapping), roads_of(mapping)
        slices = slice_windows(recording, roads, mapping.split.seed)
        status.update("looking")
        report = inspect(drives, cuts, slices, part, mapping, schema)
    CONSOLE.print(report.tables())
    _say_who_may_drive(schema)
    figures = {"folder": None, "sha256": None, **report.figures()}
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
                tuple(describe_source(path) for path in [*paths, *_companions(mapping)]),
                text,
                len(episodes),
                mapping.split.seed,
            ),
            rejected=sum(len(cut.left_out) for cut in cuts),
        )
        figures |= {"folder": str(folder), "sha256": dataset.sha256}
        CONSOLE.print(
            f"SHA-256 {dataset.sha256:.16}…\n{folder}\nNext:\n  offline-train --data {folder}",
            soft_wrap=True,
        )
    write_figures(json_file, figures)
    return 0


def _common_schema(drives: Sequence[Drive], mapping: Mapping) -> Schema:
    """The signals of all drives.

    Raises:
        DatasetError: a signal has one unit in one log and another in the next.
    """
    schema = make_schema(mapping, drives[0])
    for drive in drives[1:]:
        for first, other in zip(drives[0].signals, drive.signals, strict=True):
            if first.unit != other.unit:
                raise DatasetError(
                    f"{drive.path}, column {other.column}: expected {first.name} in {first.unit} "
                    f"as in {drives[0].path.name}, found {other.unit}. All logs of one import "
                    f"share their units; convert that one."
                )
    return schema


def _companions(mapping: Mapping) -> list[Path]:
    """Files beside the logs that the numbers follow from."""
    line = mapping.pose.reference_line if mapping.pose else None
    return [path for path in (line, mapping.can.dbc if mapping.can else None) if path]


def _say_who_may_drive(schema: Schema) -> None:
    if not np.isclose(schema.dt_s, VEHICLE.dt_s, rtol=1e-9):
        CONSOLE.print(
            f"The period is {1e3 * schema.dt_s:g} ms: models of it predict and are compared, but "
            f"the controller drives every {1e3 * VEHICLE.dt_s:g} ms only."
        )
    elif schema != VEHICLE:
        CONSOLE.print(
            "These are not the signals that the controller drives with "
            f"({', '.join((*VEHICLE.state_names, *VEHICLE.input_names))}): models of them predict "
            "and are compared, but do not drive."
        )
