"""What a drive is recorded to: a log of frames with its journal, an MCAP file."""

from pathlib import Path
from typing import NamedTuple

from rt_controller.bus.log.recorder import Recorder, epoch_offset_ns
from rt_controller.config import ControllerConfig
from rt_controller.model.bundle import Bundle
from rt_controller.recording.header import describe_run
from rt_controller.recording.journal import Journal


class RecordingFiles(NamedTuple):
    """Where a drive is recorded; None: not there."""

    log: Path | None = None
    """frames; its journal is written beside it"""
    mcap: Path | None = None
    """decoded signals, plan and cause"""
    overwrites: bool = False
    """replace existing files"""


NO_FILES = RecordingFiles()


def open_recording(
    files: RecordingFiles,
    channel: str,
    is_lockstep: bool,
    config: ControllerConfig,
    bundle: Bundle,
    max_iterations: int | None,
    is_fd: bool = False,
) -> Recorder | None:
    """The recorder of a drive; None if nothing is recorded.

    Args:
        files: what to record to.
        channel: name of the bus.
        is_lockstep: stamps are simulated time, and a slow disk is waited for.
        config: settings of the controller, for the journal.
        bundle: its model.
        max_iterations: of a solve, where its time is limited.
        is_fd: the bus has frames of CAN FD.

    Raises:
        ConfigError: a file cannot be written, or exists already.
        MissingExtraError: MCAP needs a package that is not installed.
    """
    if files.log is None and files.mcap is None:
        return None
    offset_ns, overwrites = epoch_offset_ns(is_lockstep), files.overwrites
    recorder = Recorder(
        files.log,
        channel,
        is_lockstep=is_lockstep,
        epoch_offset_ns=offset_ns,
        replaces=overwrites,
    )
    try:
        if recorder.path is not None and recorder.path.is_file():  # no device, no pipe
            header = describe_run(config, bundle, max_iterations, is_fd)
            recorder.add(Journal(recorder.path, header, overwrites))
        if files.mcap is not None:
            from rt_controller.recording.mcap_sink import McapSink

            recorder.add(McapSink(files.mcap, offset_ns, overwrites, is_fd))
    except BaseException:
        recorder.close()
        raise
    return recorder
