"""Random compiled functions within what the translation to C covers, as the text of a module."""

from random import Random

_HEAD = """
from math import floor, tanh
from typing import NamedTuple
from rt_controller.contract.arrays import Array
from sim_bridge.plant.jit import compiled
G = 0.75
N = 5


class Pair(NamedTuple):
    p: float
    q: int


def swap(one: float, two: float) -> tuple[float, float]:
    return two, one * 0.5


def bump(v: Array, m: int) -> float:
    v[m] += 0.125
    return v[0] - v[1]


swap, bump = compiled(swap), compiled(bump)
"""
_FLOATS = ("a", "b", "x", "y", "z", "1.5", "-0.25", "2.0", "-0.0", "G")
_INTS = ("i", "j", "k", "n", "2", "-3", "7", "N")


class FunctionMaker:
    """Makes functions f0, f1, … of (a: float, b: float, i: int, j: int, v: Array)."""

    def __init__(self, seed: int) -> None:
        self._random = Random(seed)
        self._counters: list[str] = []
        self._n_counters = 0

    def module(self, n_functions: int) -> str:
        """The text of a module."""
        return _HEAD + "".join(self._function(number) for number in range(n_functions))

    def _function(self, number: int) -> str:
        lines = ["x, y, z = a, b, 0.5", "k, n = i, j"]
        for _ in range(3):
            lines += self._block(3)
        lines.append(f"return x + 2.0 * y - z + k - n + ({self._float(3)})")
        body = "".join(f"    {line}\n" for line in lines)
        head = f"def f{number}(a: float, b: float, i: int, j: int, v: Array) -> float:"
        return f"\n\n@compiled\n{head}\n{body}"

    def _block(self, depth: int) -> list[str]:
        makers = [self._assignment] * 6 + [self._branch, self._loop] * (depth > 0)
        lines = []
        for _ in range(self._random.randrange(1, 4)):
            lines += self._random.choice(makers)(depth)
        return lines

    def _assignment(self, depth: int) -> list[str]:
        name, whole = self._random.choice("xyz"), self._random.choice("kn")
        return [
            self._random.choice(
                (
                    f"{name} = tanh({self._float(3)}) * 20.0",
                    f"{name} -= tanh({self._float(2)})",
                    f"{whole} = ({self._int(3)}) % 53",
                    f"x, y = tanh({self._float(2)}), y + 0.5",
                    "x, y = swap(x, z)",
                    f"v[{self._random.randrange(3)}] = {self._float(1)} + v[({self._int(1)}) % 3]",
                    f"z = bump(v, ({self._int(1)}) % 3) + 0.0",
                    f"t = Pair(tanh({self._float(2)}), ({self._int(2)}) % 41); z = t.p + t.q",
                )
            )
        ]

    def _branch(self, depth: int) -> list[str]:
        lines = [f"if {self._truth(2)}:", *_indented(self._block(depth - 1))]
        if self._random.random() < 0.5:
            lines += [f"elif {self._truth(2)}:", *_indented(self._block(depth - 1))]
        if self._random.random() < 0.5:
            lines += ["else:", *_indented(self._block(depth - 1))]
        return lines

    def _loop(self, depth: int) -> list[str]:
        if len(self._counters) > 1:
            return ["pass"]
        self._n_counters += 1
        counter = f"c{self._n_counters}"
        span = self._random.choice(("3", "n % 4", "5, 0, -2", "1, 6, 2"))
        self._counters.append(counter)
        inside = self._block(depth - 1)
        if self._random.random() < 0.3:
            leave = self._random.choice(("break", "continue"))
            inside += [f"if {self._truth(1)}:", f"    {leave}", "z += 0.125"]
        self._counters.remove(counter)
        return [f"for {counter} in range({span}):", *_indented(inside)]

    def _float(self, depth: int) -> str:
        if depth <= 0 or self._random.random() < 0.15:
            return self._random.choice(_FLOATS)
        one, other = self._float(depth - 1), self._float(depth - 1)
        return self._random.choice(
            (
                f"{one} {self._random.choice('+-*')} {other}",
                f"({one}) {self._random.choice('+-*')} ({other})",
                f"{one} / (1.0 + abs({other}))",
                f"{self._random.choice(('min', 'max'))}({one}, {other})",
                f"({one} if {self._truth(depth - 1)} else {other})",
                f"float({self._int(depth - 1)})",
                f"-({one})",
                f"({one}) % {self._random.choice(('3.0', '-2.5', '0.7'))}",
                f"{one} - {self._int(depth - 1)} * {other}",
                f"{self._int(depth - 1)} / {self._random.choice((3, -4, 7))}",
                f"tanh({one})",
            )
        )

    def _int(self, depth: int) -> str:
        if depth <= 0 or self._random.random() < 0.2:
            return self._random.choice((*_INTS, *self._counters))
        one, other = self._int(depth - 1), self._int(depth - 1)
        return self._random.choice(
            (
                f"({one} {self._random.choice('+-*')} {other}) % 97",
                f"({one}) // {self._random.choice((3, -4, 7))}",
                f"({one}) % {self._random.choice((3, -4, 7))}",
                f"int(tanh({self._float(depth - 1)}) * 9.0)",
                f"({one} if {self._truth(depth - 1)} else {other})",
                f"floor(tanh({self._float(depth - 1)}) * 5.0)",
                f"{self._random.choice(('min', 'max'))}({one}, {other}, 4)",
            )
        )

    def _truth(self, depth: int) -> str:
        sign = self._random.choice(("<", "<=", ">", ">=", "==", "!="))
        if depth <= 0 or self._random.random() < 0.5:
            kind = self._random.choice((self._float, self._int))
            return f"{kind(depth - 1)} {sign} {kind(depth - 1)}"
        one, other = self._truth(depth - 1), self._truth(depth - 1)
        return self._random.choice(
            (
                f"({one}) and ({other})",
                f"({one}) or ({other})",
                f"not ({one})",
                f"{self._float(depth - 2)} < {self._float(depth - 2)} <= {self._float(depth - 2)}",
            )
        )


def _indented(lines: list[str]) -> list[str]:
    return [f"    {line}" for line in lines]
