"""Lists of training configurations that differ in what is to be learned about them.

A list is data: a preset to start from, settings that all its variants share, and for each variant
its name, why it is there, and the fields that it changes. In a cumulative list a variant also has
the changes of those before it, so that the list is a ladder.
"""

import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from offline.config import PRESETS, TrainingConfig
from rt_controller.contract.errors import ConfigError

SHIPPED = "variants.toml"
NONE = "none"
"""what TOML has no word for"""

Slug = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9.-]*$")]


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
    lists = _read(file)
    if name in lists:
        return _resolve(name, lists[name], overrides, only)
    if name not in PRESETS:
        raise ConfigError(
            f"variants: expected one of the lists {', '.join(lists)} or of the presets "
            f"{', '.join(PRESETS)}, found {name!r}."
        )
    _require_known(only, [name])
    preset = Variant(name, "the preset alone", {}, _changed(PRESETS[name], overrides, name))
    return VariantList(name, f"the preset {name}, as often as there are seeds", (preset,))


def _read(file: Path | None) -> dict[str, _List]:
    where = file if file is not None else resources.files("offline.campaign") / SHIPPED
    try:
        return _LISTS.validate_python(tomllib.loads(where.read_text(encoding="utf-8")))
    except OSError as error:
        raise ConfigError(
            f"--lists {where}: expected a file that can be read, found: {error.strerror}."
        ) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigError(f"{where}: expected a TOML file, found: {error}.") from error
    except ValidationError as error:
        raise ConfigError(f"{where}: {_first_complaint(error)}") from error


def _resolve(
    name: str, entries: _List, overrides: Mapping[str, Any], only: Sequence[str]
) -> VariantList:
    if entries.base not in PRESETS:
        raise ConfigError(
            f"{name}: expected base to be one of {', '.join(PRESETS)}, found {entries.base!r}."
        )
    names = [entry.name for entry in entries.variant]
    twice = sorted({one for one in names if names.count(one) > 1})
    if twice:
        raise ConfigError(f"{name}: expected every name once, found {', '.join(twice)} again.")
    _require_known(only, names)
    base = _changed(PRESETS[entries.base], entries.common, name)
    variants, changed = [], base
    carried: set[str] = set()
    for entry in entries.variant:
        if not entries.cumulative:
            changed, carried = base, set()
        changed = _changed(changed, entry.changes, f"{name}, variant {entry.name}")
        carried = carried | set(entry.changes)
        if only and entry.name not in only:
            continue
        _require_kept(f"{name}, variant {entry.name}", carried, overrides)
        config = _changed(changed, overrides, name)
        variants.append(Variant(entry.name, entry.why, entry.changes, config))
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


def _changed(base: TrainingConfig, changes: Mapping[str, Any], where: str) -> TrainingConfig:
    """The configuration with other values, all of them checked; "none" stands for None."""
    new = {field: None if value == NONE else value for field, value in changes.items()}
    try:
        return TrainingConfig.model_validate({**base.model_dump(), **new})
    except ValidationError as error:
        raise ConfigError(f"{where}: {_first_complaint(error)}") from error


def _first_complaint(error: ValidationError) -> str:
    first = error.errors()[0]
    place = ".".join(str(part) for part in first["loc"])
    return f"expected another {place!r}, found {first['input']!r} ({first['msg']})."
