"""Coefficients of the Magic Formula 5.2 and 6.x, and the quantities that follow from them."""

from math import atan, sin
from typing import Annotated, NamedTuple

from pydantic import AfterValidator, Field

_RADII_M = (0.1, 2.0)


def _require_negative(number: float) -> float:
    if not number < 0.0:
        raise ValueError("expected a negative number, as the ISO axes of these files have it")
    return number


def _require_radius(radius_m: float) -> float:
    least, most = _RADII_M
    if not least <= radius_m <= most:
        raise ValueError(f"expected a radius in m of {least:g} to {most:g}")
    return radius_m


_Positive = Annotated[float, Field(gt=0)]
_Negative = Annotated[float, AfterValidator(_require_negative), Field(lt=0)]
_RadiusM = Annotated[float, AfterValidator(_require_radius), Field(ge=_RADII_M[0], le=_RADII_M[1])]
"""`Field` states the limits for the exported FMU too"""


class TyreFileParameters(NamedTuple):
    """Coefficients of a `.tir` file, with its names in lower case; see `magic_formula`.

    A load of 0 N says that there is no such file. Names without a value here are required.
    """

    fnomin: _Positive
    """nominal load in N"""
    unloaded_radius: _RadiusM
    """in m"""
    pcx1: _Positive
    pdx1: _Positive
    pkx1: _Positive
    pcy1: _Positive
    pdy1: float
    """of either sign: a negative one also changes those of RVY1 to RVY3 and QBZ10"""
    pky1: _Negative
    """negative: side force against the slip angle"""
    pky2: _Positive
    is_right: Annotated[float, Field(ge=0, le=1)] = 0.0
    """1 if the tyre was measured on the right side of a car (TYRESIDE), else 0"""
    lfzo: _Positive = 1.0
    lcx: _Positive = 1.0
    lmux: _Positive = 1.0
    lex: float = 1.0
    lkx: _Positive = 1.0
    lhx: float = 1.0
    lvx: float = 1.0
    lgax: float = 1.0
    lcy: _Positive = 1.0
    lmuy: _Positive = 1.0
    ley: float = 1.0
    lky: _Positive = 1.0
    lhy: float = 1.0
    lvy: float = 1.0
    lgay: float = 1.0
    ltr: float = 1.0
    lres: float = 1.0
    lgaz: float = 1.0
    lxal: float = 1.0
    lyka: float = 1.0
    lvyka: float = 1.0
    ls: float = 1.0
    pdx2: float = 0.0
    pdx3: float = 0.0
    pex1: float = 0.0
    pex2: float = 0.0
    pex3: float = 0.0
    pex4: float = 0.0
    pkx2: float = 0.0
    pkx3: float = 0.0
    phx1: float = 0.0
    phx2: float = 0.0
    pvx1: float = 0.0
    pvx2: float = 0.0
    rbx1: float = 0.0
    rbx2: float = 0.0
    rbx3: float = 0.0
    rcx1: float = 0.0
    rex1: float = 0.0
    rex2: float = 0.0
    rhx1: float = 0.0
    pdy2: float = 0.0
    pdy3: float = 0.0
    pey1: float = 0.0
    pey2: float = 0.0
    pey3: float = 0.0
    pey4: float = 0.0
    pey5: float = 0.0
    pky3: float = 0.0
    pky4: _Positive = 2.0
    """2 in version 5.2, which has no such coefficient"""
    pky5: float = 0.0
    pky6: float = 0.0
    pky7: float = 0.0
    phy1: float = 0.0
    phy2: float = 0.0
    phy3: float = 0.0
    pvy1: float = 0.0
    pvy2: float = 0.0
    pvy3: float = 0.0
    pvy4: float = 0.0
    rby1: float = 0.0
    rby2: float = 0.0
    rby3: float = 0.0
    rby4: float = 0.0
    rcy1: float = 0.0
    rey1: float = 0.0
    rey2: float = 0.0
    rhy1: float = 0.0
    rhy2: float = 0.0
    rvy1: float = 0.0
    rvy2: float = 0.0
    rvy3: float = 0.0
    rvy4: float = 0.0
    rvy5: float = 0.0
    rvy6: float = 0.0
    qbz1: float = 0.0
    qbz2: float = 0.0
    qbz3: float = 0.0
    qbz4: float = 0.0
    qbz5: float = 0.0
    qbz9: float = 0.0
    qbz10: float = 0.0
    qcz1: float = 0.0
    qdz1: float = 0.0
    qdz2: float = 0.0
    qdz3: float = 0.0
    qdz4: float = 0.0
    qdz6: float = 0.0
    qdz7: float = 0.0
    qdz8: float = 0.0
    qdz9: float = 0.0
    qdz10: float = 0.0
    qdz11: float = 0.0
    qez1: float = 0.0
    qez2: float = 0.0
    qez3: float = 0.0
    qez4: float = 0.0
    qez5: float = 0.0
    qhz1: float = 0.0
    qhz2: float = 0.0
    qhz3: float = 0.0
    qhz4: float = 0.0
    ssz1: float = 0.0
    ssz2: float = 0.0
    ssz3: float = 0.0
    ssz4: float = 0.0


NO_TYRE_FILE = TyreFileParameters(0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0, -1.0, 1.0)


class TyreQuantities(NamedTuple):
    """What follows from several coefficients, at the nominal load; named after the main one."""

    pdx1: float
    """peak friction along the tyre"""
    pdy1: float
    """peak friction across it, of either sign of PDY1"""
    pkx1: float
    """slip stiffness over load"""
    pky1: float
    """cornering stiffness over load"""


LEAST_PLAUSIBLE = TyreQuantities(0.2, 0.2, 2.0, 2.0)
"""friction of wet ice; tyres of trucks and racing cars have stiffnesses of 5 to 100"""
MOST_PLAUSIBLE = TyreQuantities(2.5, 2.5, 200.0, 200.0)


def tyre_quantities(t: TyreFileParameters) -> TyreQuantities:
    """The quantities whose size tells whether the coefficients are those of a tyre."""
    return TyreQuantities(
        pdx1=t.pdx1 * t.lmux,
        pdy1=abs(t.pdy1) * t.lmuy,
        pkx1=t.pkx1 * t.lkx,
        pky1=abs(t.pky1) * sin(t.pky4 * atan(1.0 / t.pky2)) * t.lky,
    )
