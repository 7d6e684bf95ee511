"""`rotortrack calibrate`: camera maps from dark and flat films."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from rotortrack_cli.console import Console
from rotortrack_cli.flags import FILE, Given, gather, output_option, stage_options
from rotortrack_cli.stage_option import StageCommand

if TYPE_CHECKING:
    from rotortrack.cameras.calibrate import Calibration
    from rotortrack.cameras.pixel_gains import PixelGains


@click.command("calibrate", cls=StageCommand)
@click.argument("dark", metavar="DARK", type=FILE)
@click.argument("flats", metavar="[FLAT...]", type=FILE, nargs=-1)
@output_option("CAMERA.npz", "Maps to write; a picture of them (.png) is written beside.")
@stage_options(
    *("movie.region", "movie.frames", "movie.axes", "movie.channel", "movie.z_slice"),
    *("movie.salvage", "movie.max_frame_megapixels"),
    *("camera.gain_e_per_adu", "camera.saturation_adu"),
)
@click.pass_obj
def command(
    console: Console, dark: Path, flats: tuple[Path, ...], output: Path, given: Given
) -> None:
    """Measure offset, read noise and gain of every pixel, and find hot and dead ones.

    DARK is a film without light (1000 frames tell a pixel's read noise to 2 %), each FLAT a film of
    steady, even light of one brightness, none near saturation; all with the exposure, region and
    read-out mode of the movies to come. Without FLAT give --gain-e-per-adu. Use the result with
    --camera-maps CAMERA.npz.
    """
    start = time.perf_counter()
    layers = gather(given)
    from rotortrack.pipeline.calibrate_run import calibrate_films, check_target, save
    from rotortrack_cli.stages import Stages

    check_target(output, (dark, *flats))
    with Stages(console) as stages:
        calibrated = calibrate_films(dark, flats, layers, folder=output.parent, progress=stages)
        stages("maps", 0, 0)
        from rotortrack.files import atomic_path
        from rotortrack.report.draw import draw_camera

        picture = output.with_suffix(".png")
        with atomic_path(picture) as temporary:
            # Both or none: what comes last needs no further file.
            draw_camera(temporary, calibrated.calibration)
            save(calibrated, output)
    calibration = calibrated.calibration
    seconds = time.perf_counter() - start
    for note in calibrated.notes:
        console.text(note)
    _show(console, calibration)
    console.text(f"\n{seconds:.1f} s; maps in {output}, their picture in {picture}")
    console.json(_result(calibration, calibrated.frames, seconds))


def _show(console: Console, calibration: Calibration) -> None:
    """Print one screen: the maps, the flats, and what was found of single pixels."""
    import numpy as np

    alive = ~calibration.dead_pixels
    height, width = alive.shape
    console.text(f"camera of {width} x {height} pixels by {calibration.dark_frames} dark frames")
    rows: list[list[object]] = []
    for name in ("offset_adu", "gain_e_per_adu", "read_noise_e"):
        values = getattr(calibration, name)[alive]
        rows.append([name, *(float(v) for v in np.quantile(values, [0.5, 0.01, 0.99]))])
    console.text("")
    console.table(["map", "median", "1 % below", "99 % below"], rows)
    if calibration.levels:
        console.text("")
        console.table(
            ["flat", "frames", "light ADU", "gain e/ADU", "flicker %", "used"],
            [
                [
                    Path(level.name).name,
                    level.frames,
                    level.signal_adu,
                    level.gain_e_per_adu,
                    100 * level.flicker,
                    "yes" if level.reason is None else "no",
                ]
                for level in calibration.levels
            ],
        )
    console.text("")
    gains = calibration.gains
    if gains is None:
        console.text("gain         given, the same for all pixels")
    else:
        console.text(
            f"gain         {gains.mean_e_per_adu:.5g} +- {gains.mean_sd:.1g} electrons per ADU; "
            f"beyond their errors {_spreads(gains)}"
        )
    console.text(
        f"hot pixels   {int(calibration.hot_pixels.sum())} "
        f"({calibration.hot_pixels.mean():.2%}), not searched for spots\n"
        f"dead pixels  {int(calibration.dead_pixels.sum())}, left out everywhere"
    )
    if calibration.saturation_adu is not None:
        console.text(f"saturation   at {calibration.saturation_adu:g} ADU")


def _spreads(gains: PixelGains) -> str:
    spreads = {
        "pixels": gains.pixel_spread,
        "columns": gains.column_spread,
        "rows": gains.row_spread,
    }
    found = [f"{name} by {spread:.2%}" for name, spread in spreads.items() if spread]
    return f"{', '.join(found)} apart" if found else "pixels are alike"


def _result(calibration: Calibration, frames: int, seconds: float) -> dict[str, Any]:
    """Give the numbers that others build on."""
    import numpy as np

    alive = ~calibration.dead_pixels
    height, width = alive.shape
    medians = {
        name: float(np.median(getattr(calibration, name)[alive]))
        for name in ("offset_adu", "gain_e_per_adu", "gain_sd_e_per_adu", "read_noise_e")
    }
    gains = calibration.gains
    return {
        "width_px": width,
        "height_px": height,
        **medians,
        "gain_pixel_spread": None if gains is None else gains.pixel_spread,
        "gain_column_spread": None if gains is None else gains.column_spread,
        "gain_row_spread": None if gains is None else gains.row_spread,
        "hot_pixels": int(calibration.hot_pixels.sum()),
        "dead_pixels": int(calibration.dead_pixels.sum()),
        "saturation_adu": calibration.saturation_adu,
        "flats": [
            {
                "name": level.name,
                "frames": level.frames,
                "skipped_frames": level.skipped_frames,
                "signal_adu": level.signal_adu,
                "gain_e_per_adu": level.gain_e_per_adu,
                "flicker": level.flicker,
                "saturated_pixels": level.saturated_pixels,
                "reason": level.reason,
            }
            for level in calibration.levels
        ],
        "frames": frames,
        "seconds": round(seconds, 3),
    }
