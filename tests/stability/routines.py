"""Which routines are public numerical ones, by a rule.

A routine is public where another folder of the library, or the command line, imports it, or where
`rotortrack` itself names it; numerical, where its signature speaks of arrays, tables or floats.
What a folder calls for itself alone is met through what it is called by, and so are kernels.
"""

from __future__ import annotations

import ast
from pathlib import Path

import rotortrack

PACKAGE = Path(rotortrack.__file__).parent
COMMAND_LINE = PACKAGE.parent / "cli" / "rotortrack_cli"
FOLDERS = (
    *("localise", "rotors", "corrections", "motion", "twocolour", "afm", "cameras", "simulate"),
    "units",
)
NUMBERS = ("NDArray", "Floats", "Array", "Values", "Positions", "float", "DataFrame", "Integers")


def public_routines() -> dict[str, str]:
    """Give every public numerical routine by its dotted name, with its signature."""
    found = {
        name: told for name, told in _defined().items() if any(word in told for word in NUMBERS)
    }
    used = _imported()
    named = {f"{home}.{name}" for name, home in rotortrack._HOMES.items()}
    return {name: found[name] for name in sorted(found) if name in used or name in named}


def _defined() -> dict[str, str]:
    functions = {}
    for path in sorted(PACKAGE.rglob("*.py")):
        module = ".".join(path.relative_to(PACKAGE).with_suffix("").parts)
        if module.split(".")[0] not in FOLDERS:
            continue
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef) and not node.name.startswith("_"):
                if any("kernel" in ast.unparse(one) for one in node.decorator_list):
                    continue
                arguments = (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)
                hints = [*(one.annotation for one in arguments), node.returns]
                functions[f"{module}.{node.name}"] = " ".join(
                    ast.unparse(hint) for hint in hints if hint is not None
                )
    return functions


def _imported() -> set[str]:
    """Name what is imported from another folder than its own."""
    found = set()
    for root in (PACKAGE, COMMAND_LINE):
        for path in root.rglob("*.py"):
            own = path.relative_to(root).parts[0] if root is PACKAGE else "command line"
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(
                    "rotortrack."
                ):
                    home = str(node.module).removeprefix("rotortrack.")
                    if home.split(".")[0] != own:
                        found |= {f"{home}.{alias.name}" for alias in node.names}
    return found
