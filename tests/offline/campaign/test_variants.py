"""Lists of variants are data: they resolve, they differ, and mistakes in them are named."""

import tomllib
from importlib import resources
from itertools import pairwise

import pytest

from offline.campaign.variants import BUDGET, SHIPPED, read_variants
from offline.config import PRESETS, TrainingConfig
from offline.learner import Learner
from offline.model import sizes_of
from offline.scaling import fit_scaling
from offline.source import open_source
from rt_controller.contract.errors import ConfigError

WHO_AND_WHERE = {"preset", "threads"}
"""fields that say where a configuration comes from or runs, not what it learns"""


def differences(one: TrainingConfig, other: TrainingConfig) -> set[str]:
    fields = set(TrainingConfig.model_fields) - WHO_AND_WHERE
    return {name for name in fields if getattr(one, name) != getattr(other, name)}


LISTS = tuple(tomllib.loads((resources.files("offline.campaign") / SHIPPED).read_text("utf-8")))


@pytest.mark.parametrize(
    ("name", "variant", "preset"),
    [
        ("ladder", "bilinear", "recommended"),
        ("leave-one-out", "recommended", "recommended"),
        ("leave-one-out", "without-bilinear", "linear"),
        ("sizes", "recommended", "recommended"),
        ("paper-readings", "paper", "paper"),
        ("paper-readings", "paper-literal", "paper-literal"),
    ],
)
def test_where_a_list_stands_on_a_preset_it_is_that_preset(name, variant, preset):
    (found,) = read_variants(name, None, {}, [variant]).variants
    assert differences(found.config, PRESETS[preset]) == set()


def test_the_ladder_begins_with_the_paper_at_the_price_of_the_recommended_network():
    """In batches and steps of the recommended preset: what is left is the method."""
    first = read_variants("ladder", None, {}).variants[0].config
    assert differences(first, PRESETS["paper"]) == set(BUDGET)
    assert all(getattr(first, name) == getattr(PRESETS["recommended"], name) for name in BUDGET)


def test_the_ladder_ends_with_the_recommended_network():
    last = read_variants("ladder", None, {}).variants[-1]
    assert differences(last.config, PRESETS["recommended"]) == set()


def test_each_rung_changes_what_it_says_and_nothing_else():
    for below, above in pairwise(read_variants("ladder", None, {}).variants):
        assert differences(below.config, above.config) == set(above.changes)
        assert above.changes


@pytest.mark.parametrize("name", [name for name in LISTS if name != "ladder"])
def test_each_variant_differs_from_the_first_in_what_it_says_and_nothing_else(name):
    whole, *others = read_variants(name, None, {}).variants
    for variant in others:
        assert differences(whole.config, variant.config) == set(variant.changes)
        assert variant.changes


@pytest.mark.parametrize("name", LISTS)
def test_all_variants_of_a_list_cost_as_many_steps_and_trajectories(name):
    budgets = {(v.config.steps, v.config.batch) for v in read_variants(name, None, {}).variants}
    assert len(budgets) == 1


@pytest.mark.parametrize("name", LISTS)
def test_every_variant_can_be_trained(name, toy_dataset):
    """A combination may be allowed field by field and still fit no network or loss."""
    few = {"batch": 4, "threads": 1}
    for variant in read_variants(name, None, few).variants:
        scaling = fit_scaling(toy_dataset.select("train"), toy_dataset.schema, toy_dataset.roles)
        source = open_source(variant.config, toy_dataset, scaling)
        sizes = sizes_of(toy_dataset.schema, toy_dataset.roles)
        learner = Learner(variant.config, sizes, scaling, toy_dataset.sha256)
        assert learner.update(learner.losses_on_random_batch(source)), variant.name


@pytest.mark.parametrize("name", LISTS)
def test_every_variant_says_why_it_is_there(name):
    reasons = [variant.why for variant in read_variants(name, None, {}).variants]
    assert all(reasons)
    assert len(set(reasons)) == len(reasons)


def test_a_preset_is_a_list_of_one():
    found = read_variants("linear", None, {"steps": 7})
    (variant,) = found.variants
    assert variant.config == PRESETS["linear"].model_copy(update={"steps": 7})


def test_common_settings_hold_for_all_variants():
    found = read_variants("ladder", None, {"steps": 7, "threads": 1})
    assert {(v.config.steps, v.config.threads) for v in found.variants} == {(7, 1)}


def test_a_chosen_rung_stands_on_those_below_it():
    ladder = read_variants("ladder", None, {})
    by_name = {variant.name: variant.config for variant in ladder.variants}
    (mirror,) = read_variants("ladder", None, {}, ["mirror"]).variants
    assert mirror.config == by_name["mirror"]


def test_none_is_a_word_for_what_toml_has_none_for(tmp_path):
    file = tmp_path / "lists.toml"
    file.write_text(
        '[mine]\nwhy = "w"\nbase = "recommended"\n'
        '[[mine.variant]]\nname = "a"\nwhy = "w"\nchanges = { gradient_clip = "none" }\n'
    )
    (variant,) = read_variants("mine", file, {}).variants
    assert variant.config.gradient_clip is None


LIST = '[mine]\nwhy = "w"\nbase = "{base}"\n'
VARIANT = '[[mine.variant]]\nname = "{name}"\nwhy = "w"\nchanges = {{ {changes} }}\n'


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", r"expected one of the lists .*found 'mine'"),
        ("mine = 3", "'mine'"),
        ("[mine", "expected a TOML file"),
        (LIST.format(base="papre") + VARIANT.format(name="a", changes=""), "found 'papre'"),
        (LIST.format(base="paper"), "'mine.variant'"),
        (LIST.format(base="paper") + VARIANT.format(name="A b", changes=""), "found 'A b'"),
        (LIST.format(base="paper") + 2 * VARIANT.format(name="a", changes=""), "found a again"),
        (
            LIST.format(base="paper") + VARIANT.format(name="a", changes="latnets = 3"),
            r"variant a: expected another 'latnets'",
        ),
        (
            LIST.format(base="paper") + VARIANT.format(name="a", changes="latents = -3"),
            r"variant a: expected another 'latents', found -3",
        ),
    ],
)
def test_a_mistake_in_the_file_is_named(tmp_path, text, complaint):
    file = tmp_path / "lists.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=complaint):
        read_variants("mine", file, {})


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(ConfigError, match="expected a file that can be read"):
        read_variants("mine", tmp_path / "lists.toml", {})


def test_unknown_variants_are_named_beside_the_known_ones():
    with pytest.raises(ConfigError, match=r"names among paper, horizon-objective.*found mirrors"):
        read_variants("ladder", None, {}, ["mirrors"])


def test_an_option_that_undoes_a_variant_is_refused_only_with_that_variant():
    with pytest.raises(ConfigError, match=r"variant history: expected no option.*--history-steps"):
        read_variants("ladder", None, {"history_steps": 2})
    (paper,) = read_variants("ladder", None, {"history_steps": 2}, ["paper"]).variants
    assert paper.config.history_steps == 2
