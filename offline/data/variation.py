"""`Variation`: the ranges of road, wind, load and tyres of simulated drives.

Imports neither numpy nor the car, so that command lines load quickly.
"""

from typing import Annotated, Literal, TypeVar

from pydantic import AfterValidator, Field, model_validator

from rt_controller.contract.errors import ConfigError
from rt_controller.settings_table import Settings

Number = TypeVar("Number", bound=float)


def _ascending(limits: tuple[float, float]) -> tuple[float, float]:
    if limits[0] > limits[1]:
        raise ValueError(f"expected the lower end first, found {limits[0]:g} {limits[1]:g}")
    return limits


_Range = Annotated[tuple[Number, Number], AfterValidator(_ascending)]
_Share = Annotated[float, Field(ge=0.0, le=1.0)]
_Friction = Annotated[float, Field(ge=0.1, le=2.0)]
_MassFactor = Annotated[float, Field(ge=0.5, le=2.0)]
_Payload = Annotated[float, Field(ge=0.0, le=1000.0)]
_Place = Annotated[float, Field(ge=-3.0, le=3.0)]
_StiffnessFactor = Annotated[float, Field(ge=0.3, le=3.0)]
_Slope = Annotated[float, Field(ge=-0.3, le=0.3)]
_Wind = Annotated[float, Field(ge=-40.0, le=40.0)]


class Variation(Settings):
    """Shares of the episodes, and ranges of their conditions; a missing range does not vary.

    An episode is nominal (the car file on its own road, no wind), constant (one value of each
    condition throughout) or changing (load and tyres constant, road and wind change on the way).
    """

    nominal_share: _Share = 0.0
    """share of the episodes in which nothing varies"""
    changing_share: _Share = 0.0
    """share of the episodes in which road and wind change on the way"""
    friction: _Range[_Friction] | None = None
    """of the road, 1 as in the tyre test"""
    patch_friction: _Range[_Friction] | None = None
    """of patches in changing episodes, under all wheels or under those of one side"""
    mass_factor: _Range[_MassFactor] | None = None
    """mass of the empty car, relative to the car file"""
    payload_kg: _Range[_Payload] | None = None
    """mass of the load"""
    payload_ahead_m: _Range[_Place] | None = None
    """place of the load, ahead of the centre of gravity of the empty car"""
    stiffness_factor: _Range[_StiffnessFactor] | None = None
    """cornering stiffness of the tyres, relative to the car file"""
    bank_rad: _Range[_Slope] | None = None
    """cross slope, positive if the left side is higher"""
    grade_rad: _Range[_Slope] | None = None
    """slope along the road, positive uphill"""
    wind_forward_mps: _Range[_Wind] | None = None
    """wind along the car, positive from behind"""
    wind_left_mps: _Range[_Wind] | None = None
    """wind across the car, positive towards the left"""
    gust_mps: float = Field(default=0.0, ge=0.0, le=20.0)
    """largest deviation from the mean wind in changing episodes, along and across"""

    @model_validator(mode="after")
    def _shares_fit(self) -> "Variation":
        if self.nominal_share + self.changing_share > 1.0:
            raise ValueError(
                f"expected `nominal_share` and `changing_share` of at most 1 together, found "
                f"{self.nominal_share:g} and {self.changing_share:g}"
            )
        return self


RecipeName = Literal["nominal", "varied"]

NOMINAL = Variation()
VARIED = Variation(
    nominal_share=0.3,
    changing_share=0.3,
    friction=(0.5, 1.0),
    patch_friction=(0.3, 1.0),
    mass_factor=(0.85, 1.15),
    payload_kg=(0.0, 300.0),
    payload_ahead_m=(-1.8, 0.2),
    stiffness_factor=(0.8, 1.2),
    bank_rad=(-0.105, 0.105),
    grade_rad=(-0.08, 0.08),
    wind_forward_mps=(-12.0, 12.0),
    wind_left_mps=(-12.0, 12.0),
    gust_mps=5.0,
)


def choose_variation(recipe: RecipeName, ranges: Variation | None) -> Variation | None:
    """The variation of that recipe with the explicitly given fields; None if nothing varies.

    Raises:
        ConfigError: the fields do not fit together, or one has no effect.
    """
    chosen = {} if ranges is None else ranges.model_dump(exclude_unset=True)
    start = VARIED if recipe == "varied" else NOMINAL
    variation = Variation(**{**start.model_dump(), **chosen})
    without_effect = sorted(set(chosen) & {"patch_friction", "gust_mps"})
    if without_effect and variation.changing_share == 0.0:
        names = " and ".join(f"`{name}`" for name in without_effect)
        raise ConfigError(
            f"expected a `changing_share` above 0 beside {names}, which acts in changing episodes "
            f"only, found 0. Add `changing_share`, for instance 0.3."
        )
    return None if variation == NOMINAL else variation


def describe(variation: Variation | None) -> str:
    """The values in one line: "recipe nominal" if nothing varies."""
    if variation is None:
        return "recipe nominal"
    given = {name: value for name, value in variation if value not in (None, 0.0)}
    return ", ".join(
        f"{name} {' to '.join(f'{part:g}' for part in value)}"
        if isinstance(value, tuple)
        else f"{name} {value:g}"
        for name, value in given.items()
    )
