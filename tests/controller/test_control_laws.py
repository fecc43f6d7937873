"""A control law of one's own: what it receives, how it is found, and what happens if it fails."""

import json
import textwrap

import numpy as np
import pytest

from rt_controller import Bundle, ControlInput, Observation, cli, simulate
from rt_controller.config import ControllerConfig
from rt_controller.contract.errors import ConfigError, ControlLawError
from rt_controller.contract.signals import Mode
from rt_controller.recording.replay import Replay, differences, read_recorded_drive

PURE_PURSUIT = '''
    """Pure pursuit."""

    class PurePursuit:
        def control(self, now):
            state, ahead_m = now.state, 4.0 + 0.5 * now.state.vx_mps
            aside_m = now.path.ey_at(ahead_m) - state.ey_m - ahead_m * state.epsi_rad
            curvature = now.curvature_per_m + 2.0 * aside_m / ahead_m**2
            wanted = now.path.a_mps2 + now.path.v_mps - state.vx_mps
            return max(0.3 * wanted + 0.1, 0.0), max(-15.0 * wanted, 0.0), 50.0 * curvature

    class Named:
        pass

    class Unfit:
        def control(self, now, more):
            pass

    class Greedy:
        def __init__(self, gain):
            pass

'''


class Recorded:
    """Holds the speed, and keeps what it received."""

    def __init__(self) -> None:
        self.seen: list[Observation] = []
        self.sent: list[ControlInput] = []
        self.resets: list[int] = []

    def reset(self) -> None:
        self.resets.append(len(self.seen))

    def control(self, now: Observation) -> ControlInput:
        self.seen.append(now)
        error = now.path.v_mps - now.state.vx_mps
        steer_rad = -0.5 * (now.state.ey_m - now.path.ey_at(0.0)) - 2.0 * now.state.epsi_rad
        self.sent.append(ControlInput(max(0.15 + 0.3 * error, 0.0), 0.0, steer_rad))
        return self.sent[-1]


@pytest.fixture
def own_file(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(textwrap.dedent(PURE_PURSUIT))
    return file


def test_a_law_receives_the_measured_state_the_path_and_its_own_inputs_under_way():
    law = Recorded()
    drive = simulate("straight", controller=law, duration_s=2.0)
    assert drive.model == "Recorded"
    assert law.resets[0] == 0
    assert law.resets[-1] < 5  # until it is known which input acts
    first, last = law.seen[0], law.seen[40]
    driven = [mode.drives for mode in drive.modes].index(True)
    assert first.state == pytest.approx(tuple(drive.values[driven, 1:7]))
    assert last.previous.steer_rad == pytest.approx(law.sent[39].steer_rad)
    assert len(last.under_way) == 2  # one period on the bus, one in the actuators
    assert last.under_way[-1] == last.previous
    assert last.path.v_mps == pytest.approx(drive["path_vx_mps"][driven])
    assert drive.stop_cause == "STOP_REQUESTED"


def test_what_a_law_wants_is_limited_as_every_other_input():
    class Wild:
        def control(self, now: Observation) -> ControlInput:
            return ControlInput(5.0, 500.0, 30.0)

    drive = simulate("straight", controller=Wild(), duration_s=1.0)
    steer_rad = drive["steer_rad"]
    assert np.abs(np.diff(steer_rad)).max() <= np.radians(200.0) * 0.025 + 1e-6
    assert not np.any((drive["throttle"] > 0.0) & (drive["brake_n"] > 0.0))


@pytest.mark.parametrize(
    ("found", "words"),
    [
        (None, "it returned None, expected a ControlInput of 3 finite numbers[.]"),
        ((0.1, 0.0), "it returned .0.1, 0.0., expected a ControlInput of 3 finite numbers[.]"),
        (("0.1", 0.0, 0.0), "it returned .'0.1', 0.0, 0.0., expected"),
        ((0.1, 0.0, np.nan), "it returned .0.1, 0.0, nan., expected"),
        (SystemExit(3), "SystemExit: 3"),
        (ZeroDivisionError("no lookahead"), "ZeroDivisionError: no lookahead .test_control_laws"),
    ],
    ids=["nothing", "two numbers", "a text", "NaN", "an end", "an exception"],
)
def test_a_law_that_gives_no_input_stops_the_car_and_is_named(found, words):
    class Failing(Recorded):
        def control(self, now: Observation) -> ControlInput:
            if len(self.seen) < 40:
                return super().control(now)
            if isinstance(found, BaseException):
                raise found
            return found

    law = Failing()
    with pytest.raises(ControlLawError, match=f"controller Failing: .*{words}") as failed:
        simulate("straight", controller=law)
    assert failed.value.__cause__ is not None
    assert len(law.seen) == 40


def test_a_law_that_fails_at_once_is_named_too():
    class Never:
        def control(self, now: Observation) -> ControlInput:
            raise KeyError("model")

    with pytest.raises(ControlLawError, match=r"controller Never: .*KeyError: 'model'"):
        simulate("straight", controller=Never())


@pytest.mark.parametrize("name", ["stanley", "bicycle-mpc", "FILE:PurePursuit"])
def test_a_drive_with_a_law_is_recorded_and_replayed_to_the_bit(tmp_path, own_file, name, capsys):
    name = name.replace("FILE", str(own_file))
    files = "--record", str(tmp_path / "x.log"), "--json", str(tmp_path / "x.json")
    with pytest.raises(SystemExit) as ended:
        cli.run_command(
            cli.app,
            ["--bus=virtual", "--pace=lockstep", "--controller", name, "--duration-s=3", *files],
        )
    assert ended.value.code == 0, capsys.readouterr().err
    summary = json.loads((tmp_path / "x.json").read_text())
    assert summary["controller"] == name
    assert summary["model"].startswith("mdk-net ")
    replay = Replay(read_recorded_drive(tmp_path / "x.log"))
    ticks = list(replay.ticks())
    replay.close()
    assert sum(tick.result.mode is Mode.NOMINAL for tick in ticks) > 100
    assert not any(differences(tick) for tick in ticks)


def test_the_name_of_a_model_is_the_mpc_with_it():
    by_name = simulate("straight", controller="lti", duration_s=0.5)
    by_model = simulate("straight", model="lti", duration_s=0.5)
    assert by_name.model == by_model.model
    np.testing.assert_array_equal(by_name.values, by_model.values)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("stanly", "expected one of mdk-net, .*, found 'stanly' .did you mean stanley"),
        (
            "no_such_module:Law",
            "that can be imported, found ModuleNotFoundError",
        ),
        ("missing.py:Law", "found FileNotFoundError: .*No such file"),
        ("FILE:PurePursuits", "expected a class PurePursuits .* .did you mean PurePursuit"),
        ("FILE:Named", "expected an object with a method control"),
        ("FILE:Unfit", "expected a method control.now., found that one argument does not fit it"),
        ("FILE:Greedy", "needs no arguments, found that it raises TypeError"),
        ("BROKEN:Law", "found NameError: name 'nothing' is not defined .broken.py, line 1"),
    ],
)
def test_a_law_that_cannot_be_used_is_refused_before_the_drive(own_file, tmp_path, name, words):
    (tmp_path / "broken.py").write_text("nothing()\n")
    name = name.replace("FILE", str(own_file)).replace("BROKEN", str(tmp_path / "broken.py"))
    with pytest.raises(ConfigError, match=words):
        simulate("straight", controller=name)


def test_a_law_is_not_planned_with_in_c():
    with pytest.raises(
        ConfigError, match="plan: expected python, since stanley is no model, found native"
    ):
        ControllerConfig(controller="stanley", plan="native")


def test_two_models_are_refused():
    with pytest.raises(
        ConfigError,
        match="controller: expected no other model than lti",
    ):
        simulate("straight", controller="lti", model="mdk-net")
    with pytest.raises(ConfigError, match="expected an object with a method control"):
        simulate("straight", controller=3)
    with pytest.raises(ConfigError, match="expected an object, found the class Recorded"):
        simulate("straight", controller=Recorded)
    with pytest.raises(ConfigError, match="model: expected none beside the controller lti"):
        simulate("straight", controller="lti", model=Bundle.load())


def test_a_log_is_not_replayed_with_a_law_that_has_changed_since(tmp_path, own_file, capsys):
    options = ["--bus=virtual", "--pace=lockstep", "--duration-s=1", "--scenario=straight"]
    options += ["--controller", f"{own_file}:PurePursuit", "--record", str(tmp_path / "x.log")]
    with pytest.raises(SystemExit):
        cli.run_command(cli.app, options)
    own_file.write_text(own_file.read_text().replace("50.0", "60.0"))
    with pytest.raises(ConfigError, match="expected the recorded one, found that its file has"):
        Replay(read_recorded_drive(tmp_path / "x.log"))
