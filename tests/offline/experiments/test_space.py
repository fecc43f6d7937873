"""The shipped search spaces contain their presets; mistakes in a file are reported."""

import optuna
import pytest

from offline.config import PRESETS
from offline.experiments.tuning import read_space
from rt_controller.contract.errors import ConfigError


@pytest.mark.parametrize("name", ["method", "structure", "paper-weights"])
def test_shipped_space_contains_its_preset(name):
    """Otherwise a search could not find that the preset is the best already."""
    space, base = read_space(name, None, {})
    for parameter in space.parameter:
        value = getattr(base, parameter.field)
        if parameter.choices is not None:
            said = list(value) if isinstance(value, tuple) else value
            assert said in parameter.choices
        else:
            assert parameter.low <= value <= parameter.high


def test_common_settings_are_part_of_the_base():
    _, base = read_space("method", None, {"steps": 7, "threads": 1})
    assert base == PRESETS["recommended"].model_copy(update={"steps": 7, "threads": 1})


def test_range_between_integers_is_of_integers():
    space, _ = read_space("method", None, {})
    found = {parameter.field: parameter.distribution for parameter in space.parameter}
    assert found["horizon_start"] == optuna.distributions.IntDistribution(2, 80, log=True)
    assert found["horizon_growth"] == optuna.distributions.FloatDistribution(0.1, 0.9)


SPACE = '[mine]\nwhy = "w"\nbase = "recommended"\n[[mine.parameter]]\n'


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", r"expected one of .*which has none, found 'mine'"),
        ("[mine", "expected a TOML file"),
        ('[mine]\nwhy = "w"\nbase = "recommended"\n', r"mine\.parameter: expected a value"),
        (SPACE.replace("recomm", "rec") + 'field = "batch"\nlow = 1\nhigh = 2\n', "'recended'"),
        (SPACE + 'field = "batch"\n', "either low and high, or choices"),
        (SPACE + 'field = "batch"\nchoices = []\n', "one or more elements"),
        (SPACE + 'field = "batch"\nlow = 1\nhigh = 2\nchoices = [1]\n', "either low and high"),
        (SPACE + 'field = "batch"\nlow = 3\nhigh = 2\n', "low below high, found 3 and 2"),
        (
            SPACE + 'field = "decay_encoder"\nlow = 0.0\nhigh = 1.0\nscale = "log"\n',
            "low > 0",
        ),
        (SPACE + 'field = "btach"\nlow = 1\nhigh = 2\n', "btach: no such setting.*batch"),
        (SPACE + 'field = "batch"\nlow = -1\nhigh = 2\n', "batch: expected more than 0, found -1"),
        (
            SPACE + 'field = "windows"\nchoices = ["all", "some"]\n',
            "windows: expected .*found 'some'",
        ),
        (
            SPACE + 'field = "batch"\nlow = 1\nhigh = 2\n' + "[[mine.parameter]]\n"
            'field = "batch"\nlow = 1\nhigh = 3\n',
            "found batch again",
        ),
    ],
)
def test_mistake_in_the_file_is_reported(tmp_path, text, complaint):
    file = tmp_path / "spaces.toml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=complaint):
        read_space("mine", file, {})


def test_option_for_a_searched_field_is_refused():
    with pytest.raises(ConfigError, match="found --learning-rate"):
        read_space("method", None, {"learning_rate": 1e-3})
