"""Ranges of road, wind, load and tyres."""

import json

import pytest

from offline.data.manifest import Simulated
from offline.data.recipe import Recipe
from offline.data.variation import NOMINAL, VARIED, Variation, choose_variation, describe
from rt_controller.contract.errors import ConfigError


@pytest.mark.parametrize(
    ("fields", "complaint"),
    [
        ({"friction": (0.0, 1.0)}, "friction"),
        ({"friction": (1.0, 0.5)}, "lower end first"),
        ({"payload_kg": (-1.0, 100.0)}, "payload_kg"),
        ({"bank_rad": (-6.0, 6.0)}, "bank_rad"),
        ({"wind_left_mps": (0.0, float("nan"))}, "wind_left_mps"),
        ({"nominal_share": 0.8, "changing_share": 0.3}, "at most 1 together"),
        ({"fricton": (0.5, 1.0)}, "friction"),
    ],
)
def test_ranges_that_no_car_can_drive_in_are_refused(fields, complaint):
    with pytest.raises(ConfigError, match=complaint):
        Variation(**fields)


def test_the_nominal_recipe_varies_nothing():
    assert choose_variation("nominal", None) is None
    assert choose_variation("nominal", NOMINAL) is None


def test_a_range_replaces_that_of_the_recipe_and_leaves_the_others():
    chosen = choose_variation("varied", Variation(friction=(0.6, 0.9), payload_kg=None))
    assert chosen == VARIED.model_copy(update={"friction": (0.6, 0.9), "payload_kg": None})


def test_a_single_range_is_varied_alone():
    assert choose_variation("nominal", Variation(mass_factor=(0.9, 1.1))) == Variation(
        mass_factor=(0.9, 1.1)
    )


@pytest.mark.parametrize("fields", [{"patch_friction": (0.3, 0.5)}, {"gust_mps": 4.0}])
def test_what_acts_in_changing_episodes_only_needs_a_share_of_them(fields):
    with pytest.raises(ConfigError, match="changing_share"):
        choose_variation("nominal", Variation(**fields))
    assert choose_variation("nominal", Variation(changing_share=0.5, **fields)) is not None


def test_the_description_names_every_value_that_varies():
    assert describe(None) == "recipe nominal"
    text = describe(Variation(changing_share=0.5, friction=(0.5, 1.0), gust_mps=4.0))
    assert text == "changing_share 0.5, friction 0.5 to 1, gust_mps 4"


def test_data_sets_of_different_ranges_have_different_names():
    variations = [None, VARIED, VARIED.model_copy(update={"gust_mps": 4.0})]
    names = {Simulated(Recipe(variation=each), 100, 0, "car").name for each in variations}
    assert len(names) == 3


def test_a_variation_is_the_same_after_json():
    assert Variation(**json.loads(VARIED.model_dump_json())) == VARIED
