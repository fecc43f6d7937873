"""`CProgram`: compiled functions and all that they need, as a C99 header and source file.

    program = CProgram(example=parameters)
    program.add(advance, [...])          # types of arguments that the annotations leave open
    header, source = program.header("plant"), program.source("plant")

The code uses no memory but its arguments and the stack.
"""

import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from sim_bridge.c_code.annotations import TypeReader
from sim_bridge.c_code.c_types import (
    CType,
    StructType,
    TupleType,
    declaration,
    field_name,
    item_access,
    item_types,
    spelling,
)
from sim_bridge.c_code.constants import Constants
from sim_bridge.c_code.function_code import FunctionCode
from sim_bridge.c_code.python_source import FunctionSource, source_of
from sim_bridge.c_code.refusal import refuse
from sim_bridge.c_code.translation import translate
from sim_bridge.c_code.value import Value

_WIDTH = 100
_FIXED_SPACE = "\0"
_NO_BREAK = re.compile(r"(?<![,+\-*/&|?:]) ")
"""spaces at which a line is not broken"""
_Key = tuple[Any, tuple[CType, ...]]


class CProgram:
    """A growing set of translated functions."""

    def __init__(self, example: Any = ()) -> None:
        self._types = TypeReader(example)
        self._constants = Constants(self._types)
        self._functions: dict[_Key, FunctionCode] = {}
        self._in_progress: list[Any] = []
        self._names: dict[str, _Key] = {}
        self._public: list[FunctionCode] = []
        self._tuples: dict[CType, None] = {}
        self._readers: dict[str, StructType] = {}

    def add(
        self, kernel: Any, open_types: Mapping[str, CType | None] | None = None
    ) -> FunctionCode:
        """Translate a function, and those that it calls; it can be called from other C files.

        Args:
            kernel: a function with `@compiled`.
            open_types: types of the parameters whose annotations do not fix them: arrays.

        Raises:
            UnsupportedCodeError: a function uses something that has no translation.
        """
        source = source_of(kernel)
        kinds = []
        for name, kind in zip(source.parameters, self.parameter_types(source), strict=True):
            chosen = kind or (open_types or {}).get(name)
            chosen = chosen or self._types.only_struct(source.annotations.get(name))
            if chosen is None:
                refuse(
                    source.file,
                    source.tree,
                    f"{name}, whose type is open",
                    "Name its type in `open_types`.",
                )
            kinds.append(chosen)
        code = self.function(kernel, kinds)
        self._public.append(code)
        return code

    def add_constant(self, name: str, value: int) -> None:
        """Define a whole number in the header."""
        self.constant(name, value, "")

    def function(self, kernel: Any, kinds: Sequence[CType]) -> FunctionCode:
        """The translation of a compiled function for arguments of these types."""
        key = (kernel, tuple(kinds))
        if key not in self._functions:
            source = source_of(kernel)
            if kernel in self._in_progress:
                refuse(
                    source.file, source.tree, f"{source.name}, which calls itself", "Write a loop."
                )
            self._in_progress.append(kernel)
            returned = self._types.of_annotation(
                source.annotations.get("return"), source.file, source.tree
            )
            name = self._name_of(source, key)
            self._functions[key] = translate(source, kinds, returned, name, self)
            self._in_progress.pop()
            for kind in (*kinds, self._functions[key].returned):
                self.note_type(kind)
        return self._functions[key]

    def parameter_types(self, source: FunctionSource) -> list[CType | None]:
        """Types of the parameters by their annotations; None where the argument decides."""
        kinds = []
        for name in source.parameters:
            if name not in source.annotations:
                refuse(source.file, source.tree, f"{name} without a type", "Annotate it.")
            kinds.append(
                self._types.of_annotation(source.annotations[name], source.file, source.tree)
            )
        return kinds

    def fields_of(self, kind: type) -> list[tuple[str, CType | None]]:
        """Names and types of the fields of a named tuple; None where a type is open."""
        return self._types.fields_of(kind)

    def struct(self, kind: type, field_types: Sequence[CType]) -> StructType:
        """The struct of a named tuple with fields of these types."""
        return self._types.struct(kind, field_types)

    def type_of_value(self, value: Any) -> CType | None:
        """The type of a Python value; None if it has none in C."""
        return self._types.of_value(value)

    def constant(self, name: str, value: Any, module: str) -> Value | None:
        """A global constant under its name in C; None if it cannot be one."""
        found = self._constants.value(name, value, module)
        if found is not None:
            self.note_type(found.kind)
        return found

    def note_type(self, kind: CType) -> None:
        """Note that the code needs the definition of a type."""
        if isinstance(kind, TupleType | StructType):
            self._tuples[kind] = None

    def item_reader(self, kind: StructType) -> str:
        """Name of the function that reads a field by its position."""
        self._readers[kind.name] = kind
        return f"{kind.name}_at"

    def header(self, name: str) -> str:
        """Types, constants and public functions."""
        guard = f"{name.upper()}_H"
        parts = [
            f"#ifndef {guard}\n#define {guard}\n",
            '#include "python_math.h"\n',
            self._constants.enumerators(),
            *self._definitions(),
            *(
                f"{_comment(code.comment)}\n{_wrapped(code.signature + ';')}\n"
                for code in self._public
            ),
            "#endif\n",
        ]
        return "\n".join(part for part in parts if part)

    def source(self, name: str) -> str:
        """The functions; those that were not added by name are not visible outside."""
        public = {code.name for code in self._public}
        functions = [
            f"{_comment(code.comment)}\n"
            f"{_wrapped(('' if code.name in public else 'static ') + code.signature + ' {')}\n"
            f"{_wrapped(code.body)}\n}}\n"
            for code in self._functions.values()
        ]
        parts = [
            f'#include "{name}.h"\n',
            self._constants.definitions(),
            *(_reader(kind) for kind in self._readers.values()),
            *functions,
        ]
        return "\n".join(part for part in parts if part)

    def _name_of(self, source: FunctionSource, key: _Key) -> str:
        name = f"{source.module}_{source.name.lstrip('_')}"
        for suffix in ("", *(f"_{i}" for i in range(2, 1000))):
            if self._names.setdefault(name + suffix, key) == key:
                return name + suffix
        raise AssertionError

    def _definitions(self) -> Iterator[str]:
        done: set[str] = set()
        for kind in self._tuples:
            yield from _definition(kind, done)


def _definition(kind: CType, done: set[str]) -> Iterator[str]:
    if not isinstance(kind, TupleType | StructType) or spelling(kind) in done:
        return
    for item in item_types(kind):
        yield from _definition(item, done)
    done.add(spelling(kind))
    if isinstance(kind, StructType):
        fields = [declaration(item, field_name(name)) for name, item in kind.fields]
    elif kind.is_uniform:
        fields = [declaration(kind.items[0], f"at[{len(kind.items)}]")]
    else:
        fields = [declaration(item, f"item{i}") for i, item in enumerate(kind.items)]
    inside = "".join(f"    {field};\n" for field in fields)
    yield f"typedef struct {{\n{inside}}} {spelling(kind)};\n"


def _reader(kind: StructType) -> str:
    """A field by its position, which Python allows for a named tuple."""
    result = item_types(kind)[0]
    cases = "".join(
        f"        case {i}: return tuple->{item_access(kind, i)};\n"
        for i in range(len(kind.fields) - 1)
    )
    last = item_access(kind, len(kind.fields) - 1)
    return (
        f"static {declaration(result, f'{kind.name}_at')}(const {kind.name} *tuple, int64_t index)"
        f" {{\n    switch (py_position(index, {len(kind.fields)})) {{\n{cases}"
        f"        default: return tuple->{last};\n    }}\n}}\n"
    )


def _comment(text: str) -> str:
    plain = text.replace("*/", "* /").strip()
    lines = plain.splitlines()
    if len(lines) == 1 and len(plain) < _WIDTH - 6:
        return f"/* {plain} */"
    wrapped = [piece for line in lines for piece in (textwrap.wrap(line, _WIDTH - 3) or [""])]
    inside = "\n".join(f" * {line}".rstrip() for line in wrapped)
    return f"/*\n{inside}\n */"


def _wrapped(code: str) -> str:
    """The code with long lines broken after commas and operators; it contains no strings."""
    lines = []
    for line in code.splitlines():
        indent = " " * (len(line) - len(line.lstrip()))
        if len(line) <= _WIDTH:
            lines.append(line)
            continue
        fixed = _NO_BREAK.sub(_FIXED_SPACE, line.strip())
        pieces = textwrap.wrap(
            fixed,
            _WIDTH,
            initial_indent=indent,
            subsequent_indent=f"{indent}    ",
            break_long_words=False,
            break_on_hyphens=False,
        )
        lines += [piece.replace(_FIXED_SPACE, " ") for piece in pieces]
    return "\n".join(lines)
