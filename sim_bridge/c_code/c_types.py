"""Types of the C code: numbers, tuples, structs of named tuples, arrays."""

from dataclasses import dataclass
from enum import Enum


class Scalar(Enum):
    """A number, or nothing; the value is its spelling in C."""

    DOUBLE = "double"
    INTEGER = "int64_t"
    BOOLEAN = "bool"
    NOTHING = "void"


class ArrayType(Enum):
    """A float64 array of one or two dimensions; memory belongs to somebody else."""

    VECTOR = "double *"
    MATRIX = "Matrix"


@dataclass(frozen=True, slots=True)
class TupleType:
    """A tuple without names: a struct with an array of equal items, or with one field per item."""

    items: "tuple[CType, ...]"

    @property
    def is_uniform(self) -> bool:
        """True if all items have one type, so that an index may be computed."""
        return len(set(self.items)) == 1


@dataclass(frozen=True, slots=True)
class StructType:
    """A named tuple."""

    name: str
    fields: "tuple[tuple[str, CType], ...]"

    @property
    def is_uniform(self) -> bool:
        """True if all fields have one type, so that an index may be computed."""
        return len({kind for _, kind in self.fields}) == 1

    def field(self, name: str) -> "CType | None":
        """Type of a field; None if there is none of that name."""
        return dict(self.fields).get(name)


CType = Scalar | ArrayType | TupleType | StructType
Aggregate = (TupleType, StructType)
"""passed by pointer to const; their values never change"""
NUMBERS = (Scalar.DOUBLE, Scalar.INTEGER, Scalar.BOOLEAN)

_WORDS_OF_C = """
auto break case char const continue default do double else enum extern float for goto if inline int
long register restrict return short signed sizeof static struct switch typedef union unsigned void
volatile while bool true false main NULL NAN INFINITY
"""
KEYWORDS = frozenset(_WORDS_OF_C.split())
"""no names of variables or fields"""
_SHORT = {Scalar.DOUBLE: "Double", Scalar.INTEGER: "Integer", Scalar.BOOLEAN: "Boolean"}


def spelling(kind: CType) -> str:
    """Name of a type in C."""
    if isinstance(kind, StructType):
        return kind.name
    if isinstance(kind, TupleType):
        return _tuple_name(kind)
    return str(kind.value)


def declaration(kind: CType, name: str) -> str:
    """Declaration of a variable without its value: `double x`, `double *row`."""
    separator = "" if kind is ArrayType.VECTOR else " "
    return f"{spelling(kind)}{separator}{name}"


def field_name(name: str) -> str:
    """Name of a field in C."""
    return f"{name}_" if name in KEYWORDS else name


def item_types(kind: TupleType | StructType) -> "tuple[CType, ...]":
    """Types of the items of a tuple or of the fields of a named tuple, in order."""
    if isinstance(kind, TupleType):
        return kind.items
    return tuple(item for _, item in kind.fields)


def item_access(kind: TupleType | StructType, index: int) -> str:
    """How C reaches an item from a tuple's name and a dot: `at[1]`, `item1`, `front_nm`."""
    if isinstance(kind, StructType):
        return field_name(kind.fields[index][0])
    return f"at[{index}]" if kind.is_uniform else f"item{index}"


def has_array(kind: CType) -> bool:
    """True if the type is an array or holds one."""
    if isinstance(kind, TupleType | StructType):
        return any(has_array(item) for item in item_types(kind))
    return isinstance(kind, ArrayType)


def unified(one: CType | None, other: CType) -> CType | None:
    """The type that holds values of both; None if there is none."""
    if one is None or one == other:
        return other
    if one in NUMBERS and other in NUMBERS:
        return min(one, other, key=NUMBERS.index)
    if isinstance(one, TupleType) and isinstance(other, TupleType):
        if len(one.items) != len(other.items):
            return None
        items = [unified(a, b) for a, b in zip(one.items, other.items, strict=True)]
        known = tuple(item for item in items if item is not None)
        return TupleType(known) if len(known) == len(items) else None
    return None


def _tuple_name(kind: TupleType) -> str:
    if kind.is_uniform:
        inner = kind.items[0]
        if isinstance(inner, TupleType) and inner.is_uniform:
            return f"{_tuple_name(inner)}x{len(kind.items)}"
        return f"{_item_name(inner)}{len(kind.items)}"
    return "Tuple_" + "_".join(_item_name(item) for item in kind.items)


def _item_name(kind: CType) -> str:
    if isinstance(kind, Scalar):
        return _SHORT[kind]
    return "Vector" if kind is ArrayType.VECTOR else spelling(kind)
