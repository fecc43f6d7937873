"""`Value`: a translated expression, and the spelling of numbers and operands in C."""

from dataclasses import dataclass
from math import isinf, isnan

from sim_bridge.c_code.c_types import CType, Scalar

PRIMARY, UNARY, MULTIPLY, ADD, COMPARE, EQUAL, AND, OR, CHOICE = 16, 14, 13, 12, 10, 9, 5, 4, 3
"""how tightly the outermost operator of an expression binds, as in C"""


@dataclass(frozen=True, slots=True)
class Value:
    """C code with its type."""

    code: str
    kind: CType
    level: int = PRIMARY
    constant: int | float | None = None
    """the number, if the translation knows it"""
    is_place: bool = False
    """True if the code names an object in memory, whose address may be taken"""
    is_pointer: bool = False
    """True if the code is the address of a tuple or struct"""
    is_lasting: bool = False
    """True if the object lives at least until the function returns and never changes"""
    roots: frozenset[str] = frozenset()
    """parameters and local arrays whose memory an array, or a struct of arrays, refers to"""

    def part(self, code: str, kind: CType) -> "Value":
        """A field or item of this one."""
        return Value(code, kind, is_place=True, is_lasting=self.is_lasting, roots=self.roots)


def operand(value: Value, level: int) -> str:
    """The code, in parentheses if its operator binds less tightly than `level`."""
    return value.code if value.level >= level else f"({value.code})"


def member(value: Value, access: str) -> str:
    """The code of a field or item of a struct."""
    return f"{operand(value, PRIMARY)}{'->' if value.is_pointer else '.'}{access}"


def as_object(value: Value) -> str:
    """The code of the value itself, where `value` may be its address."""
    return f"*{operand(value, UNARY)}" if value.is_pointer else value.code


def number(constant: bool | int | float) -> Value:
    """A literal; floats are written so that C reads the same bits."""
    if isinstance(constant, bool):
        return Value("true" if constant else "false", Scalar.BOOLEAN, constant=constant)
    if isinstance(constant, int):
        level = UNARY if constant < 0 else PRIMARY
        return Value(str(constant), Scalar.INTEGER, level, constant)
    if isnan(constant):
        return Value("NAN", Scalar.DOUBLE, constant=constant)
    if isinf(constant):
        code = "INFINITY" if constant > 0.0 else "-INFINITY"
        return Value(code, Scalar.DOUBLE, UNARY, constant)
    code = repr(float(constant))
    return Value(code, Scalar.DOUBLE, UNARY if code.startswith("-") else PRIMARY, constant)
