"""The card of a bundle: what a person should know before driving with it."""

import json
from collections.abc import Sequence
from typing import NamedTuple

from offline.evaluate import UNITS, Evaluation
from offline.export import Gate
from rt_controller.contract.artifact import Bundle


class Fact(NamedTuple):
    """A line of the table that says how a model was made."""

    name: str
    value: str


def write_card(bundle: Bundle, gate: Gate, evaluation: Evaluation, facts: Sequence[Fact]) -> str:
    """The card in Markdown."""
    lines = [
        f"# {bundle.name}",
        "",
        f"A lifted linear model of a car with {bundle.n_observables} observables, sampled every "
        f"{1000 * bundle.dt_s:g} ms, in physical units. Load it with "
        "`rt_controller.contract.artifact.load_bundle`, drive with "
        "`rt-controller --bus virtual --model`.",
        "",
        "## How it was made",
        "",
        "| | |",
        "|---|---|",
        *(f"| {fact.name} | {fact.value} |" for fact in facts),
        f"| data set, SHA-256 | `{bundle.data_sha256}` |",
        f"| encoder, SHA-256 | `{bundle.encoder_sha256}` |",
        f"| model, SHA-256 | `{bundle.sha256}` |",
        "",
        "## How far it may be trusted",
        "",
        f"Spectral radius of A {gate.spectral_radius:.5f}; growth over 20 steps "
        f"{gate.growth_20:.3g}, over 80 steps {gate.growth_80:.3g} (2-norm of the power of A, "
        "observables in units of their spread). "
        f"Largest difference between ONNX and the trained network {gate.parity:.1e}, "
        "in the same units.",
        "",
        f"Mean squared error over 80 open-loop steps (2 s) on {evaluation.n_trajectories} "
        "trajectories held out by episode:",
        "",
        "| model | " + " | ".join(f"{name}, {unit}" for name, unit in UNITS.items()) + " |",
        "|---|" + "---|" * len(UNITS),
        *(
            f"| {name} | " + " | ".join(f"{number:.4g}" for number in errors) + " |"
            for name, errors in evaluation.pooled.items()
        ),
        "",
        "## Configuration",
        "",
        "```json",
        json.dumps(json.loads(bundle.training), indent=2),
        "```",
        "",
    ]
    return "\n".join(lines)
