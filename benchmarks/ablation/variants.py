"""Lists of variants of the training configuration, read from TOML.

In a cumulative list a variant also has the changes of those before it. Variants are comparable only
at equal cost: a list may take its budget from another preset.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

from pydantic import AfterValidator, BaseModel, Field, TypeAdapter, ValidationError

from offline.config import PRESETS, TrainingConfig
from rt_controller.contract.errors import ConfigError
from rt_controller.contract.settings_errors import dotted, explain, option
from rt_controller.mapping.toml_file import parse, read_own

SHIPPED_FILE = Path(__file__).with_name("variants.toml")
BUDGET = ("steps", "batch", "evaluate_every")
"""fields that determine the cost of a training"""
NONE = "none"
"""stands for None in TOML files"""


def _require_preset(name: str) -> str:
    if name not in PRESETS:
        raise ValueError(f"expected one of the presets {', '.join(PRESETS)}")
    return name


Preset = Annotated[str, AfterValidator(_require_preset)]
FolderName = Annotated[str, Field(pattern=r"^[a-z0-9][a-z0-9.-]*$")]


class Variant(BaseModel, frozen=True, extra="forbid"):
    """An entry of a list."""

    name: FolderName
    """also the name of its folder"""
    why: str
    changes: dict[str, Any] = {}
    """its own, without those of the variants before it"""


class _List(BaseModel, extra="forbid"):
    why: str
    base: Preset
    cumulative: bool = False
    budget: Preset | None = None
    common: dict[str, Any] = {}
    variant: Annotated[list[Variant], Field(min_length=1)]


_LISTS = TypeAdapter(dict[FolderName, _List])


class Training(NamedTuple):
    """A variant and its configuration."""

    variant: Variant
    config: TrainingConfig

    @property
    def folder(self) -> str:
        """Its folder in that of all trainings."""
        return f"{self.variant.name}/seed-{self.config.seed}"


def read_variants(
    name: str, file: Path, common: Mapping[str, Any], only: Sequence[str] = ()
) -> tuple[str, list[Training]]:
    """Title and variants of the list of that name; the name of a preset is a list of one.

    `common` has the fields that options set for all variants; `only` has the names of the variants
    to keep, empty: all.

    Raises:
        ConfigError: the file, the list, a field or a name is not as expected, or an option would
            change a field that defines a variant.
    """
    lists = parse(read_own(file, "--lists"), _LISTS, str(file))
    if name in PRESETS and name not in lists:
        alone = Variant(name=name, why="the preset alone")
        lists[name] = _List(why="the preset, once for each seed", base=name, variant=[alone])
    if name not in lists:
        raise ConfigError(
            f"variants: expected one of the lists {', '.join(lists)} or of the presets "
            f"{', '.join(PRESETS)}, found {name!r}."
        )
    found = lists[name]
    names = [variant.name for variant in found.variant]
    if repeated := sorted({each for each in names if names.count(each) > 1}):
        raise ConfigError(f"{name}: expected every name once, found {', '.join(repeated)} again.")
    if unknown := sorted(set(only) - set(names)):
        raise ConfigError(
            f"--only: expected names among {', '.join(names)}, found {', '.join(unknown)}."
        )
    budget = {field: getattr(PRESETS[found.budget or found.base], field) for field in BUDGET}
    base = _changed(PRESETS[found.base], {**budget, **found.common}, name)
    trainings, changes = [], dict[str, Any]()
    for variant in found.variant:
        where = f"{name}, variant {variant.name}"
        changes = {**(changes if found.cumulative else {}), **variant.changes}
        config = _changed(_changed(base, changes, where), common, name)
        if only and variant.name not in only:
            continue
        if undone := sorted(changes.keys() & common.keys()):
            raise ConfigError(
                f"{where}: expected no option for a field that is set here, found "
                f"{option((undone[0],))}. Leave it out."
            )
        trainings.append(Training(variant, config))
    return f"{name}: {found.why}", trainings


def _changed(base: TrainingConfig, changes: Mapping[str, Any], where: str) -> TrainingConfig:
    """The configuration with these fields changed; "none" stands for None.

    A field that does not exist or accept the value is a `ConfigError` that begins with `where`.
    """
    new = {field: None if value == NONE else value for field, value in changes.items()}
    try:
        return TrainingConfig.model_validate({**base.model_dump(), **new})
    except ValidationError as error:
        raise ConfigError(f"{where}: {explain(error, dotted, TrainingConfig)}") from error
