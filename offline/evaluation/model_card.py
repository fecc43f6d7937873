"""The model card of a bundle, in Markdown."""

import json
from collections.abc import Sequence

import numpy as np

from offline.evaluation.comparison import Comparison
from offline.evaluation.tables import mse_table
from offline.model.export_checks import SAMPLES, BoxStability, ExportFigures
from rt_controller.model.bundle import Bundle
from rt_controller.model.dynamics import Shape
from rt_controller.model.follow import Follow
from rt_controller.model.validation import find_objection_to_driving
from rt_controller.model.validity import CONDITIONS, QUANTITIES, Validity
from rt_controller.report.table import Column, Fact, Table, facts_table, to_markdown

_FOLLOWED = {
    Follow.PREDICTION: "following the lifted state",
    Follow.FREE_RESPONSE: "along the free response of the first lifted state",
    Follow.START: "frozen at the first lifted state",
}


def model_facts(bundle: Bundle) -> list[Fact]:
    """What the model predicts from, and how the inputs act in it."""
    lift, schema = bundle.lift, bundle.schema
    sources = [f"the states {', '.join(schema.state_names)}"]
    if lift.sees_exogenous:
        sources.append(f"the exogenous {', '.join(schema.exogenous_names)}")
    if lift.sees_history:
        sources.append(
            f"the last {lift.history_steps} periods "
            f"({1000 * lift.history_steps * schema.dt_s:g} ms) of {', '.join(lift.history_fields)}"
        )
    matrix, drift = "constant", "linear in the lifted state"
    if bundle.gains is not None:
        m, gains = len(schema.inputs), bundle.gains
        is_of_input = gains.factor < m
        saturations = int(np.count_nonzero(gains.shape == Shape.SATURATION))
        if count := int(np.count_nonzero(is_of_input)):
            saturating = "saturating, " if Shape.TANH in gains.shape[is_of_input] else ""
            rank = f"bilinear of rank {count / m:g}"
            matrix = f"{saturating}{rank}, {_FOLLOWED[gains.follows]}"
        if count < len(gains.factor):
            drift = (
                f"saturating with rank {saturations}, and {len(gains.factor) - count - saturations}"
                f" products with {' and '.join(schema.exogenous_names)}"
            )
    return [
        Fact("observables", f"{bundle.n_observables}, lifted from {'; '.join(sources)}"),
        Fact("input matrix", matrix),
        Fact("motion without inputs", drift),
        Fact("inputs", ", ".join(schema.input_names)),
        Fact("period", f"{1000 * schema.dt_s:g} ms"),
    ]


def stability_text(bundle: Bundle) -> str:
    """Spectral radius and growth over 20 and 80 steps, observables in units of their spread."""
    return (
        f"spectral radius {bundle.spectral_radius:.5f}, ||A^20|| {bundle.growth(20):.3g}, "
        f"||A^80|| {bundle.growth(80):.3g}"
    )


def driven_text(stability: BoxStability) -> str:
    """The same under inputs and exogenous signals within the range of the training data."""
    return "under inputs: " + "; ".join(
        f"gains {name.replace('_', ' ')}: spectral radius {part.radius:.5f}, growth over 80 steps "
        f"{part.growth:.3g}"
        for name, part in stability._asdict().items()
    )


def validity_text(validity: Validity | None) -> str:
    """The ranges of the training data, in Markdown."""
    if validity is None:
        return "The ranges of its training data are not known."
    heads = (f"{each.name} [{each.unit}]" for each in QUANTITIES)
    rows = zip(*validity[: len(QUANTITIES)], strict=True)
    shown = tuple(
        tuple(each.number(v) for each, v in zip(QUANTITIES, row, strict=True)) for row in rows
    )
    by_speed = Table("", tuple(map(Column, heads)), shown)
    facts = [
        Fact(each.name, each.span(limits))
        for each, limits in zip(CONDITIONS, validity.conditions, strict=False)
    ] or [Fact(", ".join(each.name for each in CONDITIONS), "not known")]
    return f"""Largest values near each speed, to the left as to the right; the first and the last \
speed, and these values, leave out 0.1 % of the samples. A drive outside of them is reported.

{to_markdown(by_speed)}

{to_markdown(facts_table(facts))}"""


def write_card(
    bundle: Bundle, checks: ExportFigures, comparison: Comparison, facts: Sequence[Fact]
) -> str:
    """The card in Markdown; `facts` say how the model was made."""
    is_drivable = find_objection_to_driving(bundle) is None
    errors = mse_table(comparison)
    hashes = [
        Fact("model, SHA-256", bundle.sha256),
        Fact("trained on data set, SHA-256", bundle.data_sha256),
        Fact("encoder, SHA-256", bundle.encoder_sha256),
    ]
    configuration = json.dumps(json.loads(bundle.training), indent=2)
    ratios = ", ".join(
        f"{name} {ratio:.3g}"
        for name, ratio in zip(
            bundle.schema.state_names, checks.persistence_over_model, strict=True
        )
    )
    return f"""# {bundle.name}

A lifted {"linear" if bundle.gains is None else "bilinear"} model with {bundle.n_observables} \
observables, sampled every {1000 * bundle.schema.dt_s:g} ms, in physical units. Load it with \
`rt_controller.Bundle.load`\
{", drive with `rt-controller --bus virtual --model`" if is_drivable else ""}.

## What it predicts from

{to_markdown(facts_table(model_facts(bundle)))}

## How it was made

{to_markdown(facts_table([*facts, *hashes]))}

## What it was trained with

{validity_text(bundle.validity)}

## Stability and errors

Of A: {stability_text(bundle)} (2-norm, observables in units of their spread). \
{driven_text(checks.stability).capitalize()} (at all corners of the range of inputs and exogenous \
signals, and at {SAMPLES} random points inside; entirely saturated gains at the corners). Largest \
difference between the encoder in ONNX and as trained: {checks.parity:.1e}, in these units.

Mean squared error of persistence over that of the model, two seconds, validation part: \
{ratios}.

{errors.title}, held out by episode. {" ".join(errors.footnotes)}

{to_markdown(errors)}

## Configuration

```json
{configuration}
```
"""
