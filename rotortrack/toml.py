"""Writing TOML."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any


def to_toml(values: Mapping[str, Mapping[str, Any] | list[dict[str, Any]]]) -> str:
    """Write sections, and arrays of sections, of plain values as TOML."""
    lines = []
    for section, content in values.items():
        tables = content if isinstance(content, list) else [content]
        for one in tables:
            lines.append(f"[[{section}]]" if isinstance(content, list) else f"[{section}]")
            lines.extend(f"{key} = {_value(value)}" for key, value in one.items())
            lines.append("")
    return "\n".join(lines)


def _value(value: Any) -> str:
    """Write a string, number, boolean or list; JSON's spelling is TOML's but for odd characters."""
    text = json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return text.encode("utf-8", "replace").decode("utf-8")
