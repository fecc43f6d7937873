"""The shipped lists have the configurations that they describe; mistakes in a file are reported."""

import tomllib
from importlib import resources
from itertools import pairwise

import pytest
import torch

from offline.config import PRESETS, TrainingConfig
from offline.data.sampling import open_source
from offline.data.signals import fit_scaling
from offline.experiments.comparison import BUDGET, SHIPPED, read_variants
from offline.model.losses import total_loss
from offline.model.network import MdkNet
from offline.model.observables import sizes_of
from rt_controller.contract.errors import ConfigError

NOT_LEARNED = {"preset", "threads"}
"""fields without influence on the model"""


def differences(one: TrainingConfig, other: TrainingConfig) -> set[str]:
    fields = set(TrainingConfig.model_fields) - NOT_LEARNED
    return {name for name in fields if getattr(one, name) != getattr(other, name)}


LISTS = tuple(tomllib.loads((resources.files("offline.experiments") / SHIPPED).read_text("utf-8")))


@pytest.mark.parametrize(
    ("name", "variant", "preset"),
    [
        ("ladder", "noise", "recommended"),
        ("leave-one-out", "recommended", "recommended"),
        ("leave-one-out", "without-bilinear", "linear"),
        ("sizes", "recommended", "recommended"),
        ("paper-readings", "paper", "paper"),
        ("paper-readings", "paper-literal", "paper-literal"),
    ],
)
def test_variant_that_is_a_preset_equals_the_preset(name, variant, preset):
    (found,) = read_variants(name, None, {}, [variant])[1]
    assert differences(found.config, PRESETS[preset]) == set()


def test_ladder_begins_with_the_paper_at_the_cost_of_the_recommended_network():
    first = read_variants("ladder", None, {})[1][0].config
    assert differences(first, PRESETS["paper"]) <= set(BUDGET)
    assert all(getattr(first, name) == getattr(PRESETS["recommended"], name) for name in BUDGET)


def test_ladder_ends_with_the_recommended_network():
    last = read_variants("ladder", None, {})[1][-1]
    assert differences(last.config, PRESETS["recommended"]) == set()


def test_each_variant_of_the_ladder_makes_exactly_its_changes():
    for below, above in pairwise(read_variants("ladder", None, {})[1]):
        assert differences(below.config, above.config) == set(above.variant.changes)
        assert above.variant.changes


@pytest.mark.parametrize("name", [name for name in LISTS if name != "ladder"])
def test_each_variant_differs_from_the_first_in_exactly_its_changes(name):
    whole, *others = read_variants(name, None, {})[1]
    for variant in others:
        assert differences(whole.config, variant.config) == set(variant.variant.changes)
        assert variant.variant.changes


@pytest.mark.parametrize("name", LISTS)
def test_all_variants_of_a_list_have_the_same_cost(name):
    budgets = {(v.config.steps, v.config.batch) for v in read_variants(name, None, {})[1]}
    assert len(budgets) == 1


@pytest.mark.parametrize("name", LISTS)
def test_every_variant_can_be_trained(name, toy_dataset):
    """Each field may be valid and the combination still fit no network or loss."""
    few = {"batch": 4, "threads": 1}
    for variant in read_variants(name, None, few)[1]:
        scaling = fit_scaling(toy_dataset.select("train"), toy_dataset.schema, toy_dataset.roles)
        source = open_source(variant.config, toy_dataset, scaling)
        sizes = sizes_of(toy_dataset.schema, toy_dataset.roles)
        torch.manual_seed(0)
        model = MdkNet(variant.config, sizes)
        losses = total_loss(model, variant.config, source.draw(4, torch.Generator()))
        losses.total.backward()
        gradients = [each.grad for each in model.parameters() if each.numel()]
        assert all(torch.isfinite(gradient).all() for gradient in gradients), variant.variant


@pytest.mark.parametrize("name", LISTS)
def test_every_variant_has_a_purpose_of_its_own(name):
    reasons = [each.variant.why for each in read_variants(name, None, {})[1]]
    assert all(reasons)
    assert len(set(reasons)) == len(reasons)


def test_preset_is_a_list_of_one_variant():
    _, variants = read_variants("linear", None, {"steps": 7})
    (variant,) = variants
    assert variant.config == PRESETS["linear"].model_copy(update={"steps": 7})


def test_common_settings_hold_for_all_variants():
    _, variants = read_variants("ladder", None, {"steps": 7, "threads": 1})
    assert {(v.config.steps, v.config.threads) for v in variants} == {(7, 1)}


def test_chosen_variant_of_the_ladder_has_the_changes_of_those_before_it():
    _, ladder = read_variants("ladder", None, {})
    by_name = {each.variant.name: each.config for each in ladder}
    (mirror,) = read_variants("ladder", None, {}, ["mirror"])[1]
    assert mirror.config == by_name["mirror"]


def test_text_none_in_the_file_is_no_value(tmp_path):
    file = tmp_path / "lists.toml"
    file.write_text(
        '[mine]\nwhy = "w"\nbase = "recommended"\n'
        '[[mine.variant]]\nname = "a"\nwhy = "w"\nchanges = { gradient_clip = "none" }\n'
    )
    (variant,) = read_variants("mine", file, {})[1]
    assert variant.config.gradient_clip is None


LIST = '[mine]\nwhy = "w"\nbase = "{base}"\n'
VARIANT = '[[mine.variant]]\nname = "{name}"\nwhy = "w"\nchanges = {{ {changes} }}\n'


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", r"expected one of the lists of the file, which has none, or .*found 'mine'"),
        ("mine = 3", "mine: expected a table"),
        ("[mine", "expected a TOML file"),
        (LIST.format(base="papre") + VARIANT.format(name="a", changes=""), "found 'papre'"),
        (LIST.format(base="paper"), r"mine\.variant: expected a value"),
        (LIST.format(base="paper") + VARIANT.format(name="A b", changes=""), "found 'A b'"),
        (LIST.format(base="paper") + 2 * VARIANT.format(name="a", changes=""), "found a again"),
        (
            LIST.format(base="paper") + VARIANT.format(name="a", changes="latnets = 3"),
            "variant a: latnets: no such setting.*latents",
        ),
        (
            LIST.format(base="paper") + VARIANT.format(name="a", changes="latents = -3"),
            "variant a: latents: expected more than 0, found -3",
        ),
    ],
)
def test_mistake_in_the_file_is_reported(tmp_path, text, complaint):
    file = tmp_path / "lists.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=complaint):
        read_variants("mine", file, {})


def test_missing_file_is_reported(tmp_path):
    with pytest.raises(ConfigError, match="expected a readable file"):
        read_variants("mine", tmp_path / "lists.toml", {})


def test_unknown_variant_is_reported_with_the_known_ones():
    with pytest.raises(ConfigError, match=r"names among paper, horizon-objective.*found mirrors"):
        read_variants("ladder", None, {}, ["mirrors"])


def test_option_for_a_field_of_a_variant_is_refused_only_with_that_variant():
    with pytest.raises(ConfigError, match=r"variant history: expected no option.*--history-steps"):
        read_variants("ladder", None, {"history_steps": 2})
    (paper,) = read_variants("ladder", None, {"history_steps": 2}, ["paper"])[1]
    assert paper.config.history_steps == 2
