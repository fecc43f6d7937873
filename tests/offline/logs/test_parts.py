"""No drive is learned from and judged on."""

import numpy as np
import pytest

from offline.logs.mapping import SplitSettings
from offline.logs.parts import split
from rt_controller.contract.errors import ConfigError, DatasetError

FILES = [f"run_{k // 4}.csv" for k in range(40)]


def parts_of(files, part):
    return {file: set(part[[f == file for f in files]].tolist()) for file in files}


def test_a_tenth_of_the_episodes_goes_to_each_part_held_back():
    part = split(FILES, SplitSettings())
    assert np.bincount(part).tolist() == [32, 4, 4]
    assert not np.array_equal(part, split(FILES, SplitSettings(seed=1)))
    assert np.array_equal(part, split(FILES, SplitSettings()))


def test_the_share_may_be_chosen():
    assert np.bincount(split(FILES, SplitSettings(share=0.2))).tolist() == [24, 8, 8]


def test_split_by_file_no_file_is_in_two_parts():
    part = split(FILES, SplitSettings(by="file"))
    assert np.bincount(part).tolist() == [32, 4, 4]
    assert all(len(parts) == 1 for parts in parts_of(FILES, part).values())


def test_named_files_go_where_they_are_named_and_nothing_else_does():
    settings = SplitSettings(validation=("run_1.csv",), test=("run_[23].csv",))
    assert parts_of(FILES, split(FILES, settings)) == {
        f"run_{k}.csv": {{1: 1, 2: 2, 3: 2}.get(k, 0)} for k in range(10)
    }


def test_what_is_not_named_is_drawn_from_the_rest():
    part = split(FILES, SplitSettings(by="file", test=("run_0.csv",)))
    assert parts_of(FILES, part)["run_0.csv"] == {2}
    assert np.bincount(part).tolist() == [32, 4, 4]


def test_a_few_drives_still_give_one_to_each_part():
    assert sorted(split(["a", "b", "c"], SplitSettings()).tolist()) == [0, 1, 2]


def test_too_few_drives_are_refused_with_the_way_out():
    with pytest.raises(DatasetError, match="longest_episode_s"):
        split(["a", "b"], SplitSettings())
    with pytest.raises(DatasetError, match="none for train"):
        split(["a", "b"], SplitSettings(validation=("a",), test=("b",)))


def test_a_pattern_that_fits_nothing_is_a_mistake():
    with pytest.raises(ConfigError, match=r"'run_99\.csv', which fits none"):
        split(FILES, SplitSettings(test=("run_99.csv",)))


def test_a_file_in_two_parts_is_a_mistake():
    with pytest.raises(ConfigError, match=r"in validation and in test: run_1\.csv"):
        split(FILES, SplitSettings(validation=("run_1.csv",), test=("run_1*",)))
