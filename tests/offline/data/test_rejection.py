"""Rejected drives by the friction of the road."""

import numpy as np

from offline.data.recipe import FrictionBand, by_friction


def test_each_episode_is_counted_in_the_band_of_its_lowest_friction():
    bands = by_friction(np.array([0.3, 0.55, 0.6, 0.85]), np.array([4, 1, 0, 0]))
    assert bands == (
        FrictionBand((0.0, 0.4), 1, 4),
        FrictionBand((0.55, 0.7), 2, 1),
        FrictionBand((0.85, 2.0), 1, 0),
    )


def test_the_rejected_share_is_that_of_all_drawn_drives():
    assert FrictionBand((0.0, 0.4), 1, 4).rejected_fraction == 0.8
    assert FrictionBand((0.85, 2.0), 5, 0).rejected_fraction == 0.0
