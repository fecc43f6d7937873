"""The messages about missing extras."""

from pathlib import Path

from rt_controller.contract import errors


def test_a_source_checkout_is_installed_editable(monkeypatch, tmp_path: Path) -> None:
    (tmp_path / "pyproject.toml").touch()
    monkeypatch.setattr(errors, "__file__", str(tmp_path / "rt_controller/contract/errors.py"))
    assert errors.install_command("offline") == 'pip install -e ".[offline]"'


def test_an_installed_package_is_extended_by_its_name(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(errors, "__file__", str(tmp_path / "rt_controller/contract/errors.py"))
    assert errors.install_command("offline,tune") == 'pip install "rt-controller[offline,tune]"'
