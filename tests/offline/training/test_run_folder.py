"""The folder of a run, and what is refused on resume."""

import json
from dataclasses import replace
from datetime import datetime

import pytest
from run_contents import history, weights_equal

from offline.config import TrainingConfig
from offline.training.export import export_checkpoint
from offline.training.run import create_run, cut_history, load_checkpoint, open_run, save_checkpoint
from offline.training.train import train
from rt_controller.contract.errors import ArtifactError, RtControllerError


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


@pytest.mark.parametrize("content", [None, "{", '{"config": {}}', '{"config": {"steps": -1}}'])
def test_a_folder_without_a_run_is_refused(tmp_path, content):
    if content is not None:
        (tmp_path / "config.json").write_text(content)
    with pytest.raises(ArtifactError, match="offline-train"):
        open_run(tmp_path)


def test_resuming_removes_history_lines_after_the_checkpoint(tiny_config, toy_dataset, new_run):
    """A crash may leave history lines later than the last checkpoint."""
    run = new_run(tiny_config)
    train(tiny_config, toy_dataset, run)
    cut_history(run, 6)
    assert [line["step"] for line in history(run)] == [0, 5]


def test_resuming_removes_an_incomplete_history_line(tiny_config, toy_dataset, new_run):
    run = new_run(tiny_config)
    train(tiny_config, toy_dataset, run)
    whole = run.history.read_text()
    run.history.write_text(whole + '{"step": 15, "tra')
    cut_history(run, 12)
    assert run.history.read_text() == whole


def test_a_checkpoint_is_saved_and_loaded_unchanged(config, toy_dataset, new_run):
    run = new_run(config)
    train(config, toy_dataset, run)
    written = load_checkpoint(run.last)
    save_checkpoint(run.last, written)
    read = load_checkpoint(run.last)
    assert read.config == config
    assert weights_equal(read.model, written.model)
    assert read.validation_losses == written.validation_losses


@pytest.mark.parametrize("keep", [None, 0, 1000])
def test_a_damaged_checkpoint_is_refused(keep, tiny_config, toy_dataset, new_run):
    run = new_run(tiny_config)
    train(tiny_config, toy_dataset, run)
    whole = run.last.read_bytes()
    run.last.unlink()
    if keep is not None:
        run.last.write_bytes(whole[:keep])
    with pytest.raises(ArtifactError, match="expected a checkpoint"):
        load_checkpoint(run.last)


def test_a_full_disk_leaves_the_previous_checkpoint(tiny_config, toy_dataset, new_run, monkeypatch):
    run = new_run(tiny_config)
    train(tiny_config, toy_dataset, run)
    before = run.last.read_bytes()

    def full_disk(fields, stream):
        stream.write(b"half of it")
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("offline.training.run.torch.save", full_disk)
    with pytest.raises(RtControllerError, match="No space left"):
        save_checkpoint(run.last, load_checkpoint(run.last))
    assert run.last.read_bytes() == before
    assert sorted(path.suffix for path in run.path.iterdir()) == [".json", ".jsonl", ".pt", ".pt"]


def without(config, name):
    return {key: value for key, value in config.model_dump(mode="json").items() if key != name}


def test_a_run_without_a_setting_of_this_version_is_refused(tiny_config, new_run):
    run = new_run(tiny_config)
    fields = json.loads((run.path / "config.json").read_text())
    fields["config"] = without(tiny_config, "operator_rate")
    (run.path / "config.json").write_text(json.dumps(fields))
    with pytest.raises(ArtifactError, match=r"config without operator_rate.*train again"):
        open_run(run.path)


def test_weights_that_do_not_fit_the_settings_are_refused_with_a_remedy(
    tiny_config, toy_dataset, new_run
):
    run = new_run(tiny_config)
    train(tiny_config, toy_dataset, run)
    checkpoint = load_checkpoint(run.last)
    newer = TrainingConfig.model_validate(without(checkpoint.config, "hidden"))
    with pytest.raises(ArtifactError, match="revision, or train again"):
        export_checkpoint(replace(checkpoint, config=newer), toy_dataset)


def test_a_setting_that_this_version_does_not_have_is_named(tiny_config, new_run):
    run = new_run(tiny_config)
    whole = (run.path / "config.json").read_text()
    (run.path / "config.json").write_text(whole.replace('"mirror"', '"mirorr"'))
    with pytest.raises(ArtifactError, match=r"config\.mirorr: no such setting\)"):
        open_run(run.path)
