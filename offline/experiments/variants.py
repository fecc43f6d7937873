"""Lists of training configurations to compare, read from TOML.

In a cumulative list a variant also has the changes of those before it. Variants are comparable
only at equal cost: a list may take its budget from another preset.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, TypeAdapter

from offline.config import PRESETS, TrainingConfig
from offline.experiments.settings import FolderName, Preset, changed, read_toml, require_unique
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.settings_errors import option

SHIPPED = "variants.toml"

BUDGET = ("steps", "batch", "evaluate_every")
"""fields that determine the cost of a training"""


@dataclass(frozen=True, slots=True)
class Variant:
    """One configuration of a list."""

    name: str
    """also the name of its folder"""
    why: str
    changes: Mapping[str, Any]
    """its own changes, without those of the variants before it"""
    config: TrainingConfig


class _Entry(BaseModel, extra="forbid"):
    name: FolderName
    why: str
    changes: dict[str, Any] = {}


class _List(BaseModel, extra="forbid"):
    why: str
    base: Preset
    cumulative: bool = False
    budget: Preset | None = None
    common: dict[str, Any] = {}
    variant: Annotated[list[_Entry], Field(min_length=1)]


_LISTS = TypeAdapter(dict[FolderName, _List])


def read_variants(
    name: str, file: Path | None, common: Mapping[str, Any], only: Sequence[str] = ()
) -> tuple[str, tuple[Variant, ...]]:
    """Title and variants of the list of that name; the name of a preset is a list of one.

    `file` None is the shipped file; `common` has the fields that options set for all variants;
    `only` has the names of the variants to keep, empty: all.

    Raises:
        ConfigError: the file, the list, a field or a name is not as expected, or an option would
            change a field that defines a variant.
    """
    lists = read_toml(file, SHIPPED, "--lists", _LISTS)
    if name in lists:
        entries = lists[name]
    elif name in PRESETS:
        purpose = f"the preset {name}, once for each seed"
        entries = _List(why=purpose, base=name, variant=[_Entry(name=name, why="the preset alone")])
    else:
        known = ", ".join(lists) or "of the file, which has none,"
        raise ConfigError(
            f"variants: expected one of the lists {known} or of the presets "
            f"{', '.join(PRESETS)}, found {name!r}."
        )
    names = [entry.name for entry in entries.variant]
    require_unique(names, name)
    unknown = sorted(set(only) - set(names))
    if unknown:
        raise ConfigError(
            f"--only: expected names among {', '.join(names)}, found {', '.join(unknown)}."
        )
    return f"{name}: {entries.why}", tuple(_resolve(name, entries, common, only or names))


def _resolve(
    name: str, entries: _List, common: Mapping[str, Any], only: Sequence[str]
) -> Iterator[Variant]:
    budget = {field: getattr(PRESETS[entries.budget or entries.base], field) for field in BUDGET}
    base = changed(PRESETS[entries.base], {**budget, **entries.common}, name)
    changes: dict[str, Any] = {}
    for entry in entries.variant:
        where = f"{name}, variant {entry.name}"
        changes = {**(changes if entries.cumulative else {}), **entry.changes}
        config = changed(changed(base, changes, where), common, name)
        if entry.name not in only:
            continue
        if undone := sorted(set(changes) & set(common)):
            raise ConfigError(
                f"{where}: expected no option for a field that this variant sets, found "
                f"{option((undone[0],))}. Leave it out."
            )
        yield Variant(entry.name, entry.why, entry.changes, config)
