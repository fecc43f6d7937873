"""XML files of maps: what is refused before anything is read, in one line with the file."""

from pathlib import Path

import pytest

from rt_controller.contract.errors import ConfigError
from sim_bridge.scenario import load_scenario
from sim_bridge.scenario.maps import xml_file

BOMB = """<!DOCTYPE a [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><OpenDRIVE>&b;</OpenDRIVE>"""
EXTERNAL = """<!DOCTYPE a [<!ENTITY a SYSTEM "/etc/hostname">]><OpenDRIVE>&a;</OpenDRIVE>"""


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("no xml", "syntax error"),
        ("", "no element found"),
        ('<?xml version="1.0" encoding="no-such"?><a/>', "unknown encoding"),
        (BOMB, "no <!DOCTYPE> expected, found one"),
        (EXTERNAL, "no <!DOCTYPE> expected, found one"),
        ("<a/>", "found <a>"),
        (None, "No such file"),
    ],
)
def test_a_file_that_is_no_map_is_refused(
    tmp_path: Path, content: str | None, message: str
) -> None:
    path = tmp_path / "a.xodr"
    if content is not None:
        path.write_text(content)
    with pytest.raises(ConfigError, match=message) as refused:
        load_scenario(str(path))
    assert str(refused.value).startswith(f"{path}: expected ")
    assert len(str(refused.value).splitlines()) == 1


def test_a_huge_file_is_refused_before_it_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(xml_file, "LARGEST_MB", 1)
    (tmp_path / "a.xodr").write_text("<OpenDRIVE>" + " " * 2_000_000)
    with pytest.raises(ConfigError, match="2 MB, where at most 1 MB are read"):
        load_scenario(str(tmp_path / "a.xodr"))
