"""Lists of training configurations that differ in what is to be learned about them.

A list is data: a preset to start from, settings that all its variants share, and for each variant
its name, why it is there, and the fields that it changes. In a cumulative list a variant also has
the changes of those before it, so that the list is a ladder. Variants are only comparable if they
cost the same: a list may take the budget of another preset than its base.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from offline.campaign.settings import Slug, changed, read_entries
from offline.config import PRESETS, TrainingConfig
from rt_controller.contract.errors import ConfigError

SHIPPED = "variants.toml"

BUDGET = ("steps", "batch", "evaluate_every")
"""fields that say how much may be spent on a training"""


@dataclass(frozen=True, slots=True)
class Variant:
    """One configuration of a list."""

    name: str
    """also of its folder"""
    why: str
    changes: Mapping[str, Any]
    """fields that the list's entry names, without those of the entries before it"""
    config: TrainingConfig


@dataclass(frozen=True, slots=True)
class VariantList:
    """Variants that are to be compared."""

    name: str
    why: str
    variants: tuple[Variant, ...]


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid")

    name: Slug
    why: str
    changes: dict[str, Any] = {}


class _List(BaseModel):
    model_config = ConfigDict(extra="forbid")

    why: str
    base: str
    cumulative: bool = False
    budget: str | None = None
    common: dict[str, Any] = {}
    variant: Annotated[list[_Entry], Field(min_length=1)]


_LISTS = TypeAdapter(dict[Slug, _List])


def read_variants(
    name: str, file: Path | None, overrides: Mapping[str, Any], only: Sequence[str] = ()
) -> VariantList:
    """The list of that name in the file, None: the one that ships; a preset is a list of one.

    `overrides` are fields that all variants get on top; `only` leaves out all but these variants.

    Raises:
        ConfigError: the file, the list, a field or a variant is not as expected, or an override
            would undo what a variant is there for.
    """
    lists = read_entries(file, SHIPPED, "--lists", _LISTS)
    if name in lists:
        return _resolve(name, lists[name], overrides, only)
    if name not in PRESETS:
        raise ConfigError(
            f"variants: expected one of the lists {', '.join(lists)} or of the presets "
            f"{', '.join(PRESETS)}, found {name!r}."
        )
    _require_known(only, [name])
    preset = Variant(name, "the preset alone", {}, changed(PRESETS[name], overrides, name))
    return VariantList(name, f"the preset {name}, as often as there are seeds", (preset,))


def _resolve(
    name: str, entries: _List, overrides: Mapping[str, Any], only: Sequence[str]
) -> VariantList:
    for preset in (entries.base, entries.budget or entries.base):
        if preset not in PRESETS:
            raise ConfigError(
                f"{name}: expected base and budget among {', '.join(PRESETS)}, found {preset!r}."
            )
    names = [entry.name for entry in entries.variant]
    twice = sorted({one for one in names if names.count(one) > 1})
    if twice:
        raise ConfigError(f"{name}: expected every name once, found {', '.join(twice)} again.")
    _require_known(only, names)
    spender = PRESETS[entries.budget or entries.base]
    budget = {field: getattr(spender, field) for field in BUDGET}
    base = changed(PRESETS[entries.base], {**budget, **entries.common}, name)
    variants, config = [], base
    carried: set[str] = set()
    for entry in entries.variant:
        if not entries.cumulative:
            config, carried = base, set()
        config = changed(config, entry.changes, f"{name}, variant {entry.name}")
        carried = carried | set(entry.changes)
        if only and entry.name not in only:
            continue
        _require_kept(f"{name}, variant {entry.name}", carried, overrides)
        complete = changed(config, overrides, name)
        variants.append(Variant(entry.name, entry.why, entry.changes, complete))
    return VariantList(name, entries.why, tuple(variants))


def _require_known(only: Sequence[str], names: Sequence[str]) -> None:
    unknown = sorted(set(only) - set(names))
    if unknown:
        raise ConfigError(
            f"--only: expected names among {', '.join(names)}, found {', '.join(unknown)}."
        )


def _require_kept(where: str, changes: set[str], overrides: Mapping[str, Any]) -> None:
    undone = sorted(changes & set(overrides))
    if undone:
        raise ConfigError(
            f"{where}: expected no option that undoes what it is there for, found "
            f"--{undone[0].replace('_', '-')}. Leave it out."
        )
