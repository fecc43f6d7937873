"""Lists of variants are data: they resolve, they differ, and mistakes in them are named."""

from itertools import pairwise

import pytest

from offline.campaign.variants import read_variants
from offline.config import PRESETS, TrainingConfig
from rt_controller.contract.errors import ConfigError

WHO_AND_WHERE = {"preset", "threads"}
"""fields that say where a configuration comes from or runs, not what it learns"""


def differences(one: TrainingConfig, other: TrainingConfig) -> set[str]:
    fields = set(TrainingConfig.model_fields) - WHO_AND_WHERE
    return {name for name in fields if getattr(one, name) != getattr(other, name)}


def test_the_ladder_leads_from_the_paper_to_the_recommended_network():
    """Its first rung is the paper's preset in batches and steps of the recommended one."""
    rungs = read_variants("ladder", None, {}).variants
    common = {"steps", "batch", "evaluate_every"}
    assert differences(rungs[0].config, PRESETS["paper"]) == common
    assert differences(rungs[-1].config, PRESETS["recommended"]) == set()


def test_each_rung_changes_what_it_says_and_nothing_else():
    for below, above in pairwise(read_variants("ladder", None, {}).variants):
        assert differences(below.config, above.config) == set(above.changes)
        assert above.changes


def test_leaving_one_out_changes_what_it_says_and_nothing_else():
    whole, *others = read_variants("leave-one-out", None, {}).variants
    assert differences(whole.config, PRESETS["recommended"]) == set()
    for variant in others:
        assert differences(whole.config, variant.config) == set(variant.changes)
        assert variant.changes


def test_every_variant_says_why_it_is_there():
    for name in ("ladder", "leave-one-out"):
        found = read_variants(name, None, {})
        assert all(variant.why for variant in found.variants)


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
