"""Figures of a log of the bus, for both programs."""

from typing import Any

from rt_controller.bus.log.recorder import Recorder


def log_to_json(recorder: Recorder | None) -> dict[str, Any]:
    """The figures of a log; its name is null without one, and its failure if it is complete."""
    return {
        "log_file": None if recorder is None or recorder.path is None else str(recorder.path),
        "log_frames_written": 0 if recorder is None else recorder.written,
        "log_frames_dropped": 0 if recorder is None else recorder.dropped,
        "log_failure": (recorder and recorder.last_failure) or None,
    }


def log_sentence(recorder: Recorder | None) -> str | None:
    """The same for people; None without a log."""
    if recorder is None or recorder.path is None:
        return None
    lost = f": {recorder.last_failure}" if recorder.last_failure else ""
    return f"{recorder.path}, {recorder.written} frames, {recorder.dropped} dropped{lost}"
