"""Wrong units of a single log are found from the motion of road vehicles."""

import pytest
from made_logs import MAPPING, episode_of, make_drive, make_drive_of_many_speeds, make_sliding_drive

from offline.logs.checks.motion import check_motion

DT_S = 0.02
STEERING_WHEEL = MAPPING.replace("road_wheel_rad", "steer_rad")
CAR = "[car]\nwheelbase_m = 2.7\nrear_axle_m = 1.4\nsteering_ratio = 15.0\n"


@pytest.fixture(scope="module")
def lively():
    """A drive with forces of up to 8 kN."""
    made = make_drive(60.0, DT_S)
    forces = 4.0 * made.force
    speed = made.speed[0] + 4.0 * (made.speed - made.speed[0])
    return made._replace(speed=speed, force=forces, turn=made.turn * speed / made.speed)


def check(parse, made, text=MAPPING, period_s=DT_S, **factors):
    made = made._replace(**{name: getattr(made, name) * by for name, by in factors.items()})
    episode = episode_of(made)
    renamed = episode.signals.rename(columns={"road_wheel_rad": "steer_rad"})
    if "steer_rad" in text:
        object.__setattr__(episode, "signals", renamed)
    return check_motion([episode], parse(f"period_s = {period_s}\n" + text))


def test_a_road_vehicle_raises_nothing(parse, lively):
    measures, suspected, unusual = check(parse, lively)
    assert (suspected, unusual) == ([], [])
    length = next(each for each in measures if each.unit == "m")
    assert length.value == pytest.approx(2.7, rel=0.1)


@pytest.mark.parametrize(
    ("factors", "words"),
    [
        ({"speed": 3.6}, "speed in km/h taken for m/s"),
        ({"speed": 3.6, "side": 3.6}, "both speeds in km/h taken for m/s"),
        ({"speed": 1 / 3.6}, "speed in m/s taken for km/h"),
        ({"wheel": 57.3}, "steering angle in degrees taken for radians"),
        ({"wheel": 1 / 57.3}, "steering angle in radians taken for degrees"),
        ({"turn": 1 / 57.3}, "yaw rate in radians taken for degrees"),
        ({"force": 1e-3}, "force in kN taken for N"),
        ({"force": 1e3}, "force in N taken for kN"),
    ],
)
def test_a_wrong_unit_of_a_single_log_is_named(parse, lively, factors, words):
    _, suspected, unusual = check(parse, lively, **factors)
    assert [each.check for each in suspected] == ["units"]
    assert words in suspected[0].message
    assert unusual == []


@pytest.mark.parametrize(("wheel", "speed"), [(15.0, 3.6), (15.0, 1 / 3.6)])
def test_a_wrong_unit_is_found_with_the_angle_of_a_steering_wheel(parse, lively, wheel, speed):
    assert check(parse, lively, STEERING_WHEEL, wheel=wheel)[1:] == ([], [])
    _, suspected, _ = check(parse, lively, STEERING_WHEEL, wheel=wheel, speed=speed)
    assert len(suspected) == 1


def test_the_car_of_the_mapping_narrows_what_is_usual(parse):
    made = make_drive_of_many_speeds()
    assert check(parse, made, STEERING_WHEEL + CAR, wheel=15.0)[1:] == ([], [])
    assert check(parse, made, STEERING_WHEEL, wheel=24.0)[1:] == ([], [])
    assert check(parse, made, STEERING_WHEEL + CAR, wheel=24.0)[2] != []


def test_understeer_and_an_offset_of_the_angle_do_not_change_the_wheelbase(parse):
    made = make_drive_of_many_speeds()
    steered = 1.0 + (made.speed / 18.0) ** 2
    made = made._replace(wheel=made.wheel * steered + 0.01)
    measures, suspected, unusual = check(parse, made)
    assert (suspected, unusual) == ([], [])
    length = next(each for each in measures if each.unit == "m")
    assert length.value == pytest.approx(2.7, rel=0.02)


def test_a_drive_at_nearly_constant_speed_raises_nothing(parse):
    made = make_drive_of_many_speeds()
    steady = 20.0 + 0.02 * (made.speed - 15.0)
    made = made._replace(
        speed=steady, turn=made.turn * steady / made.speed, force=0.02 * made.force
    )
    assert check(parse, made)[1:] == ([], [])


@pytest.mark.parametrize(("factor", "words"), [(2.0, "too long"), (0.5, "too short")])
def test_a_wrong_period_is_found_from_the_sideslip(parse, factor, words):
    made = make_sliding_drive(dt_s=DT_S)
    assert check(parse, made)[1:] == ([], [])
    _, suspected, _ = check(parse, made, period_s=factor * DT_S)
    assert f"times {words} by a factor of 2" in suspected[0].message


def test_a_vehicle_that_no_wrong_unit_explains_is_reported_and_not_suspected(parse, lively):
    """The wheelbase of a model car is that of no other unit."""
    _, suspected, unusual = check(parse, lively, wheel=0.1, turn=1.0)
    assert suspected == []
    assert unusual[0].check == "motion"
    assert "speed times steering over yaw rate, with understeer 0.2" in unusual[0].message


def test_logs_without_speed_are_not_judged(parse):
    text = """[states]
roll_rad = { column = "roll", unit = "rad" }
[inputs]
steer_rad = { column = "wheel", unit = "rad" }
"""
    assert check_motion([episode_of(make_drive())], parse(text)) == ([], [], [])
