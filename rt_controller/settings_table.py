"""The base of every table of settings; imports the contract only, so that learning may use it."""

from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from rt_controller.contract.errors import ConfigError
from rt_controller.contract.settings_errors import dotted, explain


class Settings(BaseModel):
    """A table of fields that are checked when it is made, and do not change afterwards.

    Raises:
        ConfigError: all unknown or refused fields, each by its name.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    def __init__(self, **values: Any) -> None:
        try:
            super().__init__(**values)
        except ValidationError as refused:
            name = type(self).__name__
            raise ConfigError(
                explain(refused, lambda place: dotted((name, *place)), type(self))
            ) from None

    # A table within another one is checked without this constructor, so that all refused fields
    # are named at once.
    __init__.__pydantic_base_init__ = True  # type: ignore[attr-defined]
