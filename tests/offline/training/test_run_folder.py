"""The configuration of a run and its folder: what is kept, and what is refused on resume."""

import json
from dataclasses import replace
from datetime import datetime

import pytest
from run_contents import history

from offline.config import PAST_STEPS, PRESETS, STEPS, TrainingConfig, resolve
from offline.training.export import export_checkpoint
from offline.training.run import create_run, cut_history, load_checkpoint, open_run, save_checkpoint
from rt_controller.contract.errors import ArtifactError, ConfigError, RtControllerError


def test_the_default_is_the_preset_recommended():
    recommended = PRESETS["recommended"]
    assert resolve(None) == TrainingConfig() == recommended
    assert resolve(TrainingConfig(steps=7)) == recommended.model_copy(update={"steps": 7})


@pytest.mark.parametrize("name", PRESETS)
def test_every_preset_passes_the_validation_of_its_fields(name):
    written = PRESETS[name].model_dump(mode="json")
    assert TrainingConfig.model_validate(written) == PRESETS[name]


def test_an_explicit_setting_overrides_the_preset():
    resolved = resolve(TrainingConfig(preset="quick", steps=7, seed=0))
    assert (resolved.steps, resolved.seed) == (7, 0)
    assert resolved.evaluate_every == PRESETS["quick"].evaluate_every


@pytest.mark.parametrize(
    ("name", "value"),
    [("steps", 0), ("forgetting", 1.5), ("learning_rate", -1.0), ("stability", "none"),
     ("windows", "some"), ("history_steps", PAST_STEPS + 1), ("horizon_start", STEPS + 1),
     ("horizon_growth", 0.0), ("bilinear_rank", -1), ("hidden", (0,)), ("typo", 1)],
)  # fmt: skip
def test_a_setting_out_of_range_is_refused(name, value):
    with pytest.raises(ConfigError, match=rf"TrainingConfig\.{name}[:[]"):
        TrainingConfig(**{name: value})


@pytest.mark.parametrize("name", ["paper", "paper-literal"])
def test_the_presets_of_the_paper_use_no_extension(name):
    config = PRESETS[name]
    assert (config.windows, config.symmetry, config.objective) == ("slices", "none", "paper")
    assert (config.lift_exogenous, config.history_steps, config.bilinear_rank) == (False, 0, 0)
    assert (config.rate_schedule, config.activation) == ("plateau", "relu")
    assert config.latents_start == "identity"
    assert (config.separate_motion, config.saturating_gains, config.drift_rank) == (False, False, 0)


def test_the_preset_quick_shares_no_episode_with_the_full_data_set():
    """Data sets of different seeds share no episode."""
    assert PRESETS["quick"].data_seed != PRESETS["paper"].data_seed
    assert PRESETS["recommended"].data_seed == PRESETS["paper"].data_seed


def test_the_link_latest_points_to_the_newest_run(tiny_config, tmp_path, toy_folder, toy_dataset):
    for second in (5, 6):
        now = datetime(2026, 1, 2, 3, 4, second)
        newest = create_run(tmp_path, tiny_config, toy_folder, toy_dataset.sha256, now)
    opened = open_run(tmp_path / "latest")
    assert opened.path == newest.path.resolve()
    assert opened.config == tiny_config
    assert opened.data_sha256 == toy_dataset.sha256
    assert "torch" in opened.versions


def test_a_second_run_in_one_second_has_a_folder_of_its_own(
    tiny_config, tmp_path, toy_folder, toy_dataset
):
    now = datetime(2026, 1, 2, 3, 4, 5)
    first, second = (
        create_run(tmp_path, tiny_config, toy_folder, toy_dataset.sha256, now) for _ in range(2)
    )
    assert second.path.name == f"{first.path.name}-2"
    assert open_run(tmp_path / "latest").path == second.path.resolve()


def test_resuming_removes_lines_that_a_crash_left_after_the_checkpoint(copied):
    whole = copied.history.read_text()
    copied.history.write_text(whole + '{"step": 15, "tra')
    cut_history(copied, 12)
    assert copied.history.read_text() == whole
    cut_history(copied, 6)
    assert [line["step"] for line in history(copied)] == [0, 5]


def test_a_full_disk_leaves_the_previous_checkpoint(copied, monkeypatch):
    before, checkpoint = copied.last.read_bytes(), load_checkpoint(copied.last)

    def full_disk(fields, stream):
        stream.write(b"half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("offline.training.run.torch.save", full_disk)
    with pytest.raises(RtControllerError, match="No space left"):
        save_checkpoint(copied.last, checkpoint)
    assert copied.last.read_bytes() == before
    assert {path.suffix for path in copied.path.iterdir()} == {".json", ".jsonl", ".pt"}


def without_operator_rate(raw):
    fields = json.loads(raw)
    del fields["config"]["operator_rate"]
    return json.dumps(fields).encode()


@pytest.mark.parametrize("config", ["paper"], indirect=True)
@pytest.mark.parametrize(
    ("name", "edit", "words"),
    [
        ("config.json", None, "offline-train"),
        ("config.json", lambda raw: b"{", "offline-train"),
        ("config.json", lambda raw: b'{"config": {"steps": -1}}', "offline-train"),
        ("config.json", without_operator_rate, r"config without operator_rate.*train again"),
        ("config.json", lambda raw: raw.replace(b'"symmetry"', b'"simmetry"'), r"config\.simmetry"),
        ("last.pt", None, "expected a checkpoint"),
        ("last.pt", lambda raw: raw[:0], "expected a checkpoint"),
        ("last.pt", lambda raw: raw[:1000], "expected a checkpoint"),
    ],
)
def test_a_damaged_run_or_one_of_another_version_is_refused(copied, name, edit, words):
    file = copied.path / name
    whole = file.read_bytes()
    file.unlink()
    if edit is not None:
        file.write_bytes(edit(whole))
    with pytest.raises(ArtifactError, match=words):
        load_checkpoint(open_run(copied.path).last)


@pytest.mark.parametrize("config", ["paper"], indirect=True)
def test_weights_that_do_not_fit_the_settings_are_refused_with_a_remedy(finished, toy_dataset):
    checkpoint = load_checkpoint(finished.last)
    newer = checkpoint.config.model_copy(update={"hidden": (8,)})
    with pytest.raises(ArtifactError, match="revision, or train again"):
        export_checkpoint(replace(checkpoint, config=newer), toy_dataset)
