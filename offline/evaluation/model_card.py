"""The model card of a bundle, in Markdown."""

import json
from collections.abc import Sequence

from offline.evaluation.comparison import Comparison
from offline.evaluation.tables import mse_table
from rt_controller.contract.model.bundle import Bundle
from rt_controller.contract.model.follow import Follow
from rt_controller.contract.model.validation import find_objection_to_driving
from rt_controller.report.table import Fact, facts_table, to_markdown

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
    matrix = "constant"
    if bundle.bilinear is not None:
        matrix = f"bilinear of rank {bundle.bilinear.rank}, {_FOLLOWED[bundle.bilinear.follows]}"
    return [
        Fact("observables", f"{bundle.n_observables}, lifted from {'; '.join(sources)}"),
        Fact("input matrix", matrix),
        Fact("inputs", ", ".join(schema.input_names)),
        Fact("period", f"{1000 * schema.dt_s:g} ms"),
    ]


def identity_facts(bundle: Bundle) -> list[Fact]:
    """Digests of the model and of its training data."""
    return [
        Fact("model, SHA-256", bundle.sha256),
        Fact("trained on data set, SHA-256", bundle.data_sha256),
    ]


def stability_text(bundle: Bundle) -> str:
    """Spectral radius and growth over 20 and 80 steps, observables in units of their spread."""
    return (
        f"spectral radius {bundle.spectral_radius:.5f}, ||A^20|| {bundle.growth(20):.3g}, "
        f"||A^80|| {bundle.growth(80):.3g}"
    )


def write_card(bundle: Bundle, parity: float, comparison: Comparison, facts: Sequence[Fact]) -> str:
    """The card in Markdown; `parity` as from `check_export`, `facts` say how the model was made."""
    is_drivable = find_objection_to_driving(bundle) is None
    errors = mse_table(comparison, comparison.sets[0])
    hashes = [*identity_facts(bundle), Fact("encoder, SHA-256", bundle.encoder_sha256)]
    configuration = json.dumps(json.loads(bundle.training), indent=2)
    return f"""# {bundle.name}

A lifted {"linear" if bundle.bilinear is None else "bilinear"} model with {bundle.n_observables} \
observables, sampled every {1000 * bundle.schema.dt_s:g} ms, in physical units. Load it with \
`rt_controller.Bundle.load`\
{", drive with `rt-controller --bus virtual --model`" if is_drivable else ""}.

## What it predicts from

{to_markdown(facts_table(model_facts(bundle)))}

## How it was made

{to_markdown(facts_table([*facts, *hashes]))}

## Stability and errors

Of A: {stability_text(bundle)} (2-norm, observables in units of their spread). Largest difference \
between the encoder in ONNX and as trained: {parity:.1e}, in these units.

{errors.title}, held out by episode. {" ".join(errors.footnotes)}

{to_markdown(errors)}

## Configuration

```json
{configuration}
```
"""
