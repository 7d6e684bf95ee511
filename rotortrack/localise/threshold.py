"""The candidate threshold: a number, or a formula of image statistics.

The grammar is ThunderSTORM's as far as thresholds use it::

    sum     = product (("+" | "-") product)*
    product = signed (("*" | "/") signed)*
    signed  = ("+" | "-")* atom
    atom    = number | function "(" sum ")" | plane | "(" sum ")"

with the functions mean, std, var, median, max, min, sum and abs, and the planes I (the frame), F,
Wave.F, Wave.F1, Wave.F2 and Wave.I. A formula is parsed, never evaluated as code.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ConfigurationError

PlaneValues = Mapping[str, NDArray[np.float32]]
_Evaluate = Callable[[PlaneValues], Any]

_TOKEN = re.compile(
    r"\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|([A-Za-z_][\w.]*)|(\S))"
)

_FUNCTIONS: dict[str, Callable[[NDArray[np.float64]], np.floating[Any]]] = {
    "mean": np.mean,
    "median": np.median,
    "max": np.max,
    "min": np.min,
    "sum": np.sum,
    # The plugin's standard deviation and variance are those of a sample.
    "std": lambda values: np.std(values, ddof=1),
    "var": lambda values: np.var(values, ddof=1),
}

_PLANES = {"I": "I", "Wave.I": "I", "F": "F", "Wave.F": "F", "Wave.F1": "F1", "Wave.F2": "F2"}


MAX_LENGTH = 200
"""Longer formulas are mistakes; the limit also bounds the parser's recursion."""


@dataclass(frozen=True)
class Threshold:
    """A parsed threshold."""

    text: str
    _evaluate: _Evaluate

    def value(self, planes: PlaneValues) -> np.float32:
        """Evaluate for one frame.

        Parameters
        ----------
        planes
            ``I``, ``F``, ``F1`` and ``F2``, each (height, width), in photons.
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return np.float32(self._evaluate(planes))


def parse_threshold(text: float | str) -> Threshold:
    """Parse a threshold.

    Raises
    ------
    ConfigurationError
        The text is not a formula of the grammar above, or gives an image instead of a number.
    """
    if len(str(text)) > MAX_LENGTH:
        raise ConfigurationError(
            f"threshold is {len(str(text))} characters long: give at most {MAX_LENGTH}"
        )
    parser = _Parser(str(text))
    node = parser.sum()
    if parser.position < len(parser.tokens):
        raise parser.error("is not expected here")
    if node.is_image:
        raise ConfigurationError(
            f"threshold {text!r} gives an image, not a number: wrap it, as in std({text})"
        )
    threshold = Threshold(str(text), node.evaluate)
    if not node.needs_planes and not np.isfinite(threshold.value({})):
        raise ConfigurationError(f"threshold {text!r} is no finite number: give one")
    return threshold


@dataclass(frozen=True)
class _Node:
    evaluate: _Evaluate
    is_image: bool
    needs_planes: bool = False


class _Parser:
    def __init__(self, text: str) -> None:
        self.text = text
        self.tokens = [match.groups() for match in _TOKEN.finditer(text)]
        self.position = 0
        if not self.tokens:
            raise ConfigurationError("threshold is empty: give a number, or std(Wave.F1)")

    def error(self, problem: str) -> ConfigurationError:
        if self.position < len(self.tokens):
            token = next(part for part in self.tokens[self.position] if part)
            problem = f"{token!r} {problem}"
        else:
            problem = "it ends too early"
        functions = ", ".join([*_FUNCTIONS, "abs"])
        return ConfigurationError(
            f"threshold {self.text!r} cannot be read: {problem}; known are numbers, + - * / and "
            f"parentheses, {functions} and {', '.join(_PLANES)}"
        )

    def take(self, symbols: str) -> str | None:
        """Consume the next token when it is one of the symbols."""
        if self.position < len(self.tokens):
            symbol = self.tokens[self.position][2]
            if symbol and symbol in symbols:
                self.position += 1
                return symbol
        return None

    def sum(self) -> _Node:
        node = self.product()
        while symbol := self.take("+-"):
            node = _combine(symbol, node, self.product())
        return node

    def product(self) -> _Node:
        node = self.signed()
        while symbol := self.take("*/"):
            node = _combine(symbol, node, self.signed())
        return node

    def signed(self) -> _Node:
        negative = False
        while symbol := self.take("+-"):
            negative ^= symbol == "-"
        node = self.atom()
        if not negative:
            return node
        return _Node(lambda planes: -node.evaluate(planes), node.is_image, node.needs_planes)

    def atom(self) -> _Node:
        if self.take("("):
            return self.closed()
        if self.position == len(self.tokens):
            raise self.error("")
        number, name, _ = self.tokens[self.position]
        if number:
            self.position += 1
            constant = float(number)
            return _Node(lambda _: constant, is_image=False)
        if name in _PLANES:
            self.position += 1
            plane = _PLANES[name]
            return _Node(lambda planes: planes[plane].astype(np.float64), True, True)
        if name in _FUNCTIONS or name == "abs":
            self.position += 1
            if not self.take("("):
                raise self.error(f"should be the ( of {name}")
            inner = self.closed()
            if name == "abs":
                return _Node(
                    lambda planes: np.abs(inner.evaluate(planes)),
                    inner.is_image,
                    inner.needs_planes,
                )
            function = _FUNCTIONS[name]
            return _Node(lambda planes: function(inner.evaluate(planes)), False, inner.needs_planes)
        raise self.error("is not known")

    def closed(self) -> _Node:
        node = self.sum()
        if not self.take(")"):
            raise self.error("should be a closing parenthesis")
        return node


def _combine(symbol: str, left: _Node, right: _Node) -> _Node:
    operation = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}[symbol]
    return _Node(
        lambda planes: operation(left.evaluate(planes), right.evaluate(planes)),
        left.is_image or right.is_image,
        left.needs_planes or right.needs_planes,
    )
