"""The benchmark of the curvature ahead: each drive with it and without it."""

import json
from pathlib import Path

import pytest

from benchmarks.preview import app

BEND = """
format = 2
name = "sudden bend"
duration_s = 2.0
road.curvature_per_m = { kind = "step", at_s_m = 20.0, to_per_m = 0.003 }
reference.speed_kmh = 80.0
"""


def test_every_drive_is_made_with_and_without_the_curvature_ahead(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scenario, figures = tmp_path / "bend.toml", tmp_path / "figures.json"
    scenario.write_text(BEND)
    with pytest.raises(SystemExit) as ended:
        app(["--scenarios", str(scenario), "--models", "lti", "--json", str(figures)])
    assert ended.value.code == 0
    head, _, row = capsys.readouterr().out.splitlines()
    assert head.startswith("| scenario | model | e_y RMS, m | e_y peak, m | e_psi peak, mrad |")
    assert row.startswith("| `bend` | `lti` | 0.0")
    assert row.count(" → ") == 4
    without, with_preview = json.loads(figures.read_text())["drives"]
    assert [without["has_preview"], with_preview["has_preview"]] == [False, True]
    assert with_preview["epsi_peak_rad"] < without["epsi_peak_rad"]
    assert with_preview["wheel_rate_rms_degps"] < without["wheel_rate_rms_degps"]
