"""The figures of a run, with their progress."""

from __future__ import annotations

from rotortrack.pipeline.run import Result
from rotortrack.report.draw import draw_run
from rotortrack_cli.stages import Stages


def draw(result: Result, stages: Stages) -> None:
    """Draw what a run found into its folder."""
    movie = result.settings["movie"]
    region = movie.region
    draw_run(
        result.folder.path,
        rotors=result.rotors,
        tracks=result.tables["tracks"],
        localisations=result.tables["localisations"],
        drift=result.tables["drift"],
        frame_interval_s=movie.frame_interval_s,
        exposure_s=movie.exposure_s,
        pixel_size_nm=movie.pixel_size_nm,
        mean_image=result.mean_image,
        movie=result.movie,
        image_origin_px=region[:2] if region else (0, 0),
        drift_bins=result.drift_bins,
        switches=result.tables.get("switches"),
        posterior=result.tables.get("posterior"),
        profiles=result.tables.get("profiles"),
        msds=result.tables.get("msd"),
        voltages=result.tables.get("voltages"),
        voltage_speeds=result.tables.get("voltage_speeds"),
        ends=result.tables.get("end_to_end"),
        end_rotors=result.tables.get("end_to_end_rotors"),
        pore_axis_deg=result.settings["ends"].pore_axis_deg,
        progress=lambda done, total: stages("figures", done, total),
    )
