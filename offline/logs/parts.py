"""Which episodes are held back for validation and test."""

from collections.abc import Sequence
from fnmatch import fnmatch

import numpy as np
from numpy.typing import NDArray

from offline.dataset import PARTS, Part
from offline.logs.mapping import SplitSettings
from rt_controller.contract.errors import ConfigError, DatasetError

Names = Sequence[str]


def split(files: Names, settings: SplitSettings) -> NDArray[np.int8]:
    """Part (E,) of each episode, of which `files` (E) names the log it comes from.

    Files that the mapping names are held back as it says. What it does not name is drawn, a share
    of it for each part and one at least, by episode or by file.

    Raises:
        ConfigError: a pattern fits no file, or a file is of two parts.
        DatasetError: too few episodes or files for three parts.
    """
    named = _named(files, settings)
    part = np.full(len(files), PARTS.index("train"), dtype=np.int8)
    for name, names in named.items():
        part[[file in names for file in files]] = PARTS.index(name)
    free = [e for e, file in enumerate(files) if not any(file in each for each in named.values())]
    units = [files[e] if settings.by == "file" else str(e) for e in free]
    drawn = _shuffle(units, settings.seed)
    held_back = max(1, round(settings.share * len(drawn)))
    for name in ("validation", "test"):
        if not named[name]:
            chosen, drawn = drawn[:held_back], drawn[held_back:]
            part[[e for e, unit in zip(free, units, strict=True) if unit in chosen]] = PARTS.index(
                name
            )
    for name in PARTS:
        if not np.any(part == PARTS.index(name)):
            raise DatasetError(
                f"expected episodes for train, validation and test, found none for {name}: "
                f"{len(files)} episodes of {len(set(files))} files, split by {settings.by}. Name "
                f"other files in [split], set longest_episode_s there to cut long drives into "
                f"several, or record more."
            )
    return part


def _named(files: Names, settings: SplitSettings) -> dict[Part, set[str]]:
    """The files that the mapping gives to each part held back."""
    named: dict[Part, set[str]] = {"validation": set(), "test": set()}
    patterns: dict[Part, tuple[str, ...]] = {
        "validation": settings.validation,
        "test": settings.test,
    }
    for part, wanted in patterns.items():
        for pattern in wanted:
            fits = {file for file in files if fnmatch(file, pattern)}
            if not fits:
                raise ConfigError(
                    f"[split] {part}: expected names or patterns of logs with episodes, found "
                    f"{pattern!r}, which fits none of {', '.join(sorted(set(files)))}."
                )
            named[part] |= fits
    both = named["validation"] & named["test"]
    if both:
        raise ConfigError(
            f"[split]: expected each file in one part, found in validation and in test: "
            f"{', '.join(sorted(both))}."
        )
    return named


def _shuffle(units: Names, seed: int) -> list[str]:
    distinct = list(dict.fromkeys(units))
    order = np.random.default_rng([seed, len(distinct)]).permutation(len(distinct))
    return [distinct[k] for k in order]
