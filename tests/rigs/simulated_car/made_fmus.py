"""FMUs built during a test: a small car with its own units and signs."""

import sys
import zipfile
from pathlib import Path

from pythonfmu import FmuBuilder

FOREIGN_CAR = """
from math import nan
from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real
from pythonfmu.enums import Fmi2Status


class {name}(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.pedal = self.pressure_bar = self.wheel_deg = 0.0
        self.v0_kmh = 36.0
        self.mu = 1.0
        self.fails_at_s = self.loses_itself_at_s = 1e9
        self.trailers = 0
        self.speed_kmh = self.slide_mps = self.turn_degps = 0.0
        for name in ("pedal", "pressure_bar", "wheel_deg"):
            self.register_variable(Real(name, causality=Fmi2Causality.input))
        for name in ("v0_kmh", "mu", "fails_at_s", "loses_itself_at_s"):
            self.register_variable(
                Real(name, causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed)
            )
        self.register_variable(
            Integer(
                "trailers", causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed
            )
        )
        for name in ("speed_kmh", "slide_mps", "turn_degps"):
            self.register_variable(Real(name, causality=Fmi2Causality.output))

    def exit_initialization_mode(self):
        self.speed_kmh = self.v0_kmh

    def do_step(self, current_time, step_size):
        if current_time >= self.fails_at_s:
            self.log("no fuel left", Fmi2Status.error)
            return False
        pull_mps2 = (4.0 * self.pedal - 0.2 * self.pressure_bar) * self.mu
        self.speed_kmh += 3.6 * step_size * pull_mps2 / (1 + self.trailers)
        self.turn_degps = self.wheel_deg * self.speed_kmh / 3.6 / 50.0
        if current_time >= self.loses_itself_at_s:
            self.turn_degps = nan
        return True
"""
"""Its units are km/h, bar and degrees, and angles are positive to the right."""

FOREIGN_MAPPING = """
communication_step_s = 0.005
[inputs]
throttle = "pedal"
brake_n = {variable = "pressure_bar", unit = "bar", scale = 40000.0}
steer_rad = {variable = "wheel_deg", unit = "deg", sign = -1}
[outputs]
vx_mps = {variable = "speed_kmh", unit = "km/h"}
vy_mps = "slide_mps"
yaw_rate_radps = {variable = "turn_degps", unit = "deg/s", sign = -1}
[start]
vx_mps = {variable = "v0_kmh", unit = "km/h"}
road_friction = "mu"
[parameters]
trailers = 1
"""


def build(script: Path, folder: Path) -> Path:
    """An FMI 2 FMU of a pythonfmu slave."""
    # The builder adds the script's folder to the path of this process.
    path = list(sys.path)
    try:
        return Path(FmuBuilder.build_FMU(script, dest=folder))
    finally:
        sys.path[:] = path


def make_foreign_car(folder: Path, name: str, mapping: str = FOREIGN_MAPPING) -> Path:
    """An FMU of the small car with its mapping file beside it; its class is called `name`."""
    script = folder / f"{name.lower()}_slave.py"
    script.write_text(FOREIGN_CAR.replace("{name}", name))
    fmu = build(script, folder)
    fmu.with_suffix(".toml").write_text(mapping)
    return fmu


def remap(fmu: Path, old: str, new: str) -> Path:
    """The FMU's mapping, with one passage changed."""
    assert old in FOREIGN_MAPPING
    fmu.with_suffix(".toml").write_text(FOREIGN_MAPPING.replace(old, new))
    return fmu


def rewrite_description(fmu: Path, old: str, new: str) -> None:
    """Change a passage in the FMU's modelDescription.xml."""
    changed = fmu.with_suffix(".changed")
    with zipfile.ZipFile(fmu) as source, zipfile.ZipFile(changed, "w") as target:
        for item in source.infolist():
            content = source.read(item)
            if item.filename == "modelDescription.xml":
                text = content.decode()
                assert old in text, f"{old} is not in {text}"
                content = text.replace(old, new).encode()
            target.writestr(item, content)
    changed.replace(fmu)
