"""The candidate threshold: a number, or a formula of image statistics.

The grammar is ThunderSTORM's as far as thresholds use it::

    sum     = product (("+" | "-") product)*
    product = signed (("*" | "/") signed)*
    signed  = ("+" | "-")* atom
    atom    = number | function "(" sum ")" | plane | "(" sum ")"

with the functions mean, std, var, median, max, min, sum and abs, and the planes I (the frame), F,
Wave.F, Wave.F1, Wave.F2 and Wave.I. Not the plugin's is noise(Wave.F) or noise(Wave.F1): a robust
standard deviation that spots do not move. A formula is parsed, never evaluated as code.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotortrack.errors import ConfigurationError

PlaneValues = Mapping[str, Any]
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


_NOISE = "noise"
_NOISE_PLANES = ("F", "F1")
_STREAMED = {"noise(F)", "noise(F1)", "std(F1)", "var(F1)"}
"""Numbers of a frame that are known without keeping its planes."""

MAX_LENGTH = 200
"""Longer formulas are mistakes; the limit also bounds the parser's recursion."""


@dataclass(frozen=True)
class Threshold:
    """A parsed threshold.

    Attributes
    ----------
    text
        As it was given.
    needs
        What it takes of a frame: planes such as ``F1`` and numbers such as ``std(F1)``.
    """

    text: str
    needs: frozenset[str]
    _evaluate: _Evaluate

    @property
    def is_streamed(self) -> bool:
        """Whether it needs numbers only that are known without keeping planes."""
        return self.needs <= _STREAMED

    def value(self, values: PlaneValues) -> Any:
        """Evaluate for one frame, or for many at once where only numbers are needed.

        Parameters
        ----------
        values
            By name: ``I``, ``F``, ``F1`` and ``F2``, each (height, width), in photons; or numbers
            such as ``std(F1)``, one or an array, which stand before their planes.

        Returns
        -------
        float32, or array of it
            Threshold in photons.
        """
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            return np.asarray(self._evaluate(values)).astype(np.float32)[()]


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
    threshold = Threshold(str(text), node.needs, node.evaluate)
    if not node.needs and not np.isfinite(threshold.value({})):
        raise ConfigurationError(f"threshold {text!r} is no finite number: give one")
    return threshold


@dataclass(frozen=True)
class _Node:
    """Part of a formula; `is_plane` where it is a plane alone and nothing was done to it yet."""

    evaluate: _Evaluate
    is_image: bool
    needs: frozenset[str] = frozenset()
    is_plane: bool = False


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
        functions = ", ".join([*_FUNCTIONS, _NOISE, "abs"])
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
        return _Node(lambda values: -node.evaluate(values), node.is_image, node.needs)

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
            return _Node(
                lambda values: values[plane].astype(np.float64), True, frozenset({plane}), True
            )
        if name == _NOISE:
            return self.noise()
        if name in _FUNCTIONS or name == "abs":
            self.position += 1
            if not self.take("("):
                raise self.error(f"should be the ( of {name}")
            inner = self.closed()
            if name == "abs":
                return _Node(
                    lambda values: np.abs(inner.evaluate(values)), inner.is_image, inner.needs
                )
            function = _FUNCTIONS[name]
            if inner.is_plane:
                known = f"{name}({next(iter(inner.needs))})"
                return _Node(
                    lambda values: (
                        values[known] if known in values else function(inner.evaluate(values))
                    ),
                    False,
                    frozenset({known}),
                )
            return _Node(lambda values: function(inner.evaluate(values)), False, inner.needs)
        raise self.error("is not known")

    def noise(self) -> _Node:
        self.position += 1
        if not self.take("("):
            raise self.error("should be the ( of noise")
        inner = self.closed()
        plane = next(iter(inner.needs), "")
        if not inner.is_plane or plane not in _NOISE_PLANES:
            raise ConfigurationError(
                f"threshold {self.text!r}: noise is known of the planes Wave.F and Wave.F1 alone"
            )
        known = f"{_NOISE}({plane})"
        return _Node(lambda values: values[known], False, frozenset({known}))

    def closed(self) -> _Node:
        node = self.sum()
        if not self.take(")"):
            raise self.error("should be a closing parenthesis")
        return node


def _combine(symbol: str, left: _Node, right: _Node) -> _Node:
    operation = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}[symbol]
    return _Node(
        lambda values: operation(left.evaluate(values), right.evaluate(values)),
        left.is_image or right.is_image,
        left.needs | right.needs,
    )
