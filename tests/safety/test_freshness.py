"""Old news, and news from the future, are no news."""

import pytest

from rt_controller.safety.freshness import is_fresh


@pytest.mark.parametrize(
    ("arrival_ns", "fresh"), [(1000, True), (900, True), (899, False), (1001, False)]
)
def test_freshness_ends_with_the_age_and_never_begins_in_the_future(
    arrival_ns: int, fresh: bool
) -> None:
    assert is_fresh(arrival_ns, now_ns=1000, max_age_ns=100) is fresh
