"""`rotortrack tradeoff effects`: what each effect of a filmed scene costs."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

from rotortrack_cli.console import Console
from rotortrack_cli.stages import Stages

_QUICK, _USUAL = (96, 3), (256, 7)
"""Frames of a film, and films of each kind."""


def tell_effects(
    console: Console, scene: Path | None, output: Path | None, *, quick: bool
) -> dict[str, Any]:
    """Measure, print and write what effects cost in time and memory, by leaving each out.

    Without a scene one with every effect is taken.
    """
    from rotortrack.simulate.film.filming import shapes_for
    from rotortrack.simulate.scene import read_scene
    from rotortrack.tradeoff.effects import advice, effect_costs, everything

    given = everything() if scene is None else read_scene(scene)
    given.require("film")
    assert given.film is not None
    frames, repeats = _QUICK if quick else _USUAL
    with Stages(console, "films") as stages:
        costs = effect_costs(
            given.film, shapes_for(given), frames=frames, repeats=repeats, progress=stages
        )
    console.table(
        ("effect", "ms per frame", "+-", "share", "peak MB"),
        [
            [
                cost.effect,
                f"{cost.ms_per_frame:.3f}",
                f"{cost.spread_ms:.3f}",
                f"{cost.share:.0%}",
                f"{cost.peak_mb:.1f}",
            ]
            for cost in costs
        ],
    )
    console.text(advice(costs))
    told: dict[str, Any] = {"effects": [dataclasses.asdict(cost) for cost in costs]}
    told["frames"] = min(frames, given.film.film.n_frames)
    if output is not None:
        from rotortrack.files import write_text
        from rotortrack.report.figures import canvas
        from rotortrack.report.figures import effects as picture

        canvas.save_as(picture.figure(told["effects"]), output / "effects.png")
        write_text(output / "effects.json", json.dumps(told, indent=1) + "\n")
    return told
