"""rotortrack: from a fluorescence movie of nanoscale rotors to speeds with error bars.

The names below are found when they are first used, so that `import rotortrack` alone loads
nothing scientific.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rotortrack.cameras.camera import Camera
    from rotortrack.corrections.density import neighbour_counts
    from rotortrack.corrections.drift.cross_correlation import estimate_drift
    from rotortrack.corrections.drift.drift import apply_drift
    from rotortrack.errors import RotortrackError
    from rotortrack.exchange.tables import read_localisations, write_localisations
    from rotortrack.exchange.writer import TableInfo
    from rotortrack.localise.engine import localise_all
    from rotortrack.localise.options import LocaliseOptions
    from rotortrack.motion.angles import build_tracks
    from rotortrack.motion.link_options import LinkOptions
    from rotortrack.motion.measure import measure_motion
    from rotortrack.motion.msd import fit_msd, msd
    from rotortrack.motion.options import MotionOptions
    from rotortrack.motion.particles import track_particles
    from rotortrack.motion.screen import screen
    from rotortrack.movies.movie import ArrayMovie
    from rotortrack.movies.tiff import open_movie
    from rotortrack.movies.write import write_movie
    from rotortrack.pipeline.run import run_movie
    from rotortrack.rotors.circle import fit_circle
    from rotortrack.rotors.cluster import cluster
    from rotortrack.rotors.find import find_rotors
    from rotortrack.simulate.ideal import IdealRotor, IdealScene
    from rotortrack.simulate.ideal_film import film
    from rotortrack.twocolour.distance import true_distance
    from rotortrack.twocolour.registration import read_registration

    __version__: str

_HOMES = {
    "ArrayMovie": "movies.movie",
    "Camera": "cameras.camera",
    "IdealRotor": "simulate.ideal",
    "IdealScene": "simulate.ideal",
    "LinkOptions": "motion.link_options",
    "LocaliseOptions": "localise.options",
    "MotionOptions": "motion.options",
    "RotortrackError": "errors",
    "TableInfo": "exchange.writer",
    "apply_drift": "corrections.drift.drift",
    "build_tracks": "motion.angles",
    "cluster": "rotors.cluster",
    "estimate_drift": "corrections.drift.cross_correlation",
    "film": "simulate.ideal_film",
    "find_rotors": "rotors.find",
    "fit_circle": "rotors.circle",
    "fit_msd": "motion.msd",
    "localise_all": "localise.engine",
    "measure_motion": "motion.measure",
    "msd": "motion.msd",
    "neighbour_counts": "corrections.density",
    "open_movie": "movies.tiff",
    "read_localisations": "exchange.tables",
    "read_registration": "twocolour.registration",
    "run_movie": "pipeline.run",
    "screen": "motion.screen",
    "track_particles": "motion.particles",
    "true_distance": "twocolour.distance",
    "write_localisations": "exchange.tables",
    "write_movie": "movies.write",
}

__all__ = [
    "ArrayMovie",
    "Camera",
    "IdealRotor",
    "IdealScene",
    "LinkOptions",
    "LocaliseOptions",
    "MotionOptions",
    "RotortrackError",
    "TableInfo",
    "__version__",
    "apply_drift",
    "build_tracks",
    "cluster",
    "estimate_drift",
    "film",
    "find_rotors",
    "fit_circle",
    "fit_msd",
    "localise_all",
    "measure_motion",
    "msd",
    "neighbour_counts",
    "open_movie",
    "read_localisations",
    "read_registration",
    "run_movie",
    "screen",
    "track_particles",
    "true_distance",
    "write_localisations",
    "write_movie",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        value: Any = version("rotortrack")
    elif name in _HOMES:
        value = getattr(importlib.import_module(f"rotortrack.{_HOMES[name]}"), name)
    else:
        raise AttributeError(f"module 'rotortrack' has no attribute {name!r}")
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
