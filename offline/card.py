"""The card of a bundle: what a person should know before driving with it."""

import json
from collections.abc import Sequence
from typing import NamedTuple

from offline.evaluation_sheets import mse_sheet
from offline.export import Gate
from offline.judgement import Judgement
from offline.sheet import sheet_as_markdown
from rt_controller.contract.artifact import Bundle
from rt_controller.contract.fitness import find_objection_to_driving
from rt_controller.contract.follow import Follow

_FOLLOWED = {
    Follow.PREDICTION: "following the lifted state",
    Follow.FREE_RESPONSE: "along the free response of the first lifted state",
    Follow.START: "frozen at the first lifted state",
}


class Fact(NamedTuple):
    """A line of the table that says how a model was made."""

    name: str
    value: str


def describe_model(bundle: Bundle) -> list[Fact]:
    """What the model predicts from, and how the inputs act in it."""
    lift, schema = bundle.lift, bundle.schema
    seen = [f"the states {', '.join(schema.state_names)}"]
    if lift.sees_exogenous:
        seen.append(f"the exogenous {', '.join(schema.exogenous_names)}")
    if lift.sees_history:
        seen.append(
            f"the last {lift.history_steps} periods "
            f"({1000 * lift.history_steps * schema.dt_s:g} ms) of {', '.join(lift.history_fields)}"
        )
    matrix = "constant"
    if bundle.bilinear is not None:
        matrix = f"bilinear of rank {bundle.bilinear.rank}, {_FOLLOWED[bundle.bilinear.follows]}"
    return [
        Fact("observables", f"{bundle.n_observables}, lifted from {'; '.join(seen)}"),
        Fact("input matrix", matrix),
        Fact("inputs", ", ".join(schema.input_names)),
        Fact("period", f"{1000 * schema.dt_s:g} ms"),
    ]


def write_card(bundle: Bundle, gate: Gate, judgement: Judgement, facts: Sequence[Fact]) -> str:
    """The card in Markdown."""
    library = judgement.sets[0]
    drives = find_objection_to_driving(bundle) is None
    pooled = mse_sheet(judgement, library)
    lines = [
        f"# {bundle.name}",
        "",
        f"A lifted {'linear' if bundle.bilinear is None else 'bilinear'} model with "
        f"{bundle.n_observables} observables, sampled every {1000 * bundle.schema.dt_s:g} ms, in "
        "physical units. Load it with `rt_controller.contract.artifact.load_bundle`"
        + (", drive with `rt-controller --bus virtual --model`." if drives else "."),
        "",
        "## What it predicts from",
        "",
        *_table(describe_model(bundle)),
        "",
        "## How it was made",
        "",
        *_table(facts),
        f"| data set, SHA-256 | `{bundle.data_sha256}` |",
        f"| encoder, SHA-256 | `{bundle.encoder_sha256}` |",
        f"| model, SHA-256 | `{bundle.sha256}` |",
        "",
        "## How far it may be trusted",
        "",
        f"Spectral radius of A {gate.spectral_radius:.5f}; growth over 20 steps "
        f"{gate.growth_20:.3g}, over 80 steps {gate.growth_80:.3g} (2-norm of the power of A, "
        "observables in units of their spread). "
        f"Largest difference between the encoder as ONNX and as it was made {gate.parity:.1e}, "
        "in the same units.",
        "",
        f"{pooled.title}, held out by episode. {pooled.note}",
        "",
        sheet_as_markdown(pooled),
        "",
        "## Configuration",
        "",
        "```json",
        json.dumps(json.loads(bundle.training), indent=2),
        "```",
        "",
    ]
    return "\n".join(lines)


def _table(facts: Sequence[Fact]) -> list[str]:
    return ["| | |", "|---|---|", *(f"| {fact.name} | {fact.value} |" for fact in facts)]
