"""Rotors of a movie with dropped frames turn as fast as in the whole movie."""

from __future__ import annotations

import json

import numpy as np
import pytest
import tifffile

from rotortrack.cameras.camera import Camera
from rotortrack.movies.tiff import open_movie
from rotortrack.pipeline.run import run_movie
from rotortrack.settings import Layer
from rotortrack.simulate.ideal import IdealRotor, IdealScene
from rotortrack.simulate.ideal_film import film

N_FRAMES = 1200
INTERVAL_S = 0.002
OMEGA_RAD_S = (60.0, -45.0)
DROPPED = np.random.default_rng(5).choice(np.arange(1, N_FRAMES - 1), 150, replace=False)


@pytest.fixture(scope="module")
def frames():
    rotors = tuple(
        IdealRotor(
            kind="driven",
            x_nm=x_nm,
            y_nm=2400.0,
            radius_nm=90.0,
            photons=1500.0,
            omega_rad_s=omega_rad_s,
            diffusion_rad2_s=0.5,
        )
        for x_nm, omega_rad_s in zip((1800.0, 5200.0), OMEGA_RAD_S, strict=True)
    )
    scene = IdealScene(
        shape_px=(48, 70),
        n_frames=N_FRAMES,
        pixel_size_nm=100.0,
        frame_interval_s=INTERVAL_S,
        exposure_s=INTERVAL_S,
        sigma_nm=130.0,
        background_photons=5.0,
        rotors=rotors,
    )
    camera = Camera(offset_adu=100.0, gain_e_per_adu=0.5, read_noise_e=1.5)
    return film(scene, camera, np.random.default_rng(4)).frames(0, N_FRAMES)


def record(path, frames, kept):
    """Write frames as Micro-Manager does, each with the whole ms at which it was received."""
    late = np.random.default_rng(6).exponential(0.3, N_FRAMES)
    with tifffile.TiffWriter(path) as writer:
        for frame in kept:
            page = {"ElapsedTime-ms": int(53 + 1e3 * INTERVAL_S * frame + late[frame])}
            page |= {"PixelSizeUm": 0.1, "Exposure-ms": 2.0}
            tag = (51123, 2, None, json.dumps(page).encode() + b"\0", True)
            writer.write(frames[frame], contiguous=False, metadata=None, extratags=[tag])
    with tifffile.TiffFile(path) as tif:
        assert tif.is_micromanager


def speeds(path, target, **given):
    """Give omega and its standard deviation of the kept rotors from left to right, and the run."""
    camera = {"offset_adu": 100.0, "gain_e_per_adu": 0.5, "read_noise_e": 1.5}
    layers = [Layer("flag", {"camera": camera, "movie": given, "drift": {"method": "none"}})]
    result = run_movie(path, layers, target, workers=2)
    rotors = result.rotors.sort_values("x_nm")
    assert (rotors["verdict"] == "kept").all()
    return rotors["omega_rad_s"].to_numpy(), rotors["omega_sd_rad_s"].to_numpy(), result


@pytest.mark.filterwarnings("ignore::rotortrack.errors.RotortrackWarning")
def test_speeds_are_those_of_the_whole_movie_by_the_times_alone(frames, tmp_path):
    kept = np.delete(np.arange(N_FRAMES), DROPPED)
    record(tmp_path / "whole.tif", frames, range(N_FRAMES))
    record(tmp_path / "dropped.tif", frames, kept)
    tifffile.imwrite(tmp_path / "silent.tif", frames[kept])
    whole, whole_sd, _ = speeds(tmp_path / "whole.tif", tmp_path / "1")
    gaps, gaps_sd, result = speeds(tmp_path / "dropped.tif", tmp_path / "2")
    silent, silent_sd, _ = speeds(
        tmp_path / "silent.tif",
        tmp_path / "3",
        pixel_size_nm=100.0,
        frame_interval_s=INTERVAL_S,
        exposure_s=INTERVAL_S,
    )
    assert len(whole) == len(gaps) == len(silent) == len(OMEGA_RAD_S)
    assert np.all(np.abs(gaps - whole) < 2.0 * np.hypot(whole_sd, gaps_sd))
    assert np.all(np.abs(gaps - OMEGA_RAD_S) < 3.0 * gaps_sd)
    assert np.all(np.abs(silent - OMEGA_RAD_S) > 3.0 * silent_sd)

    chosen = result.settings["movie"]
    assert chosen.frame_interval_s == pytest.approx(INTERVAL_S, rel=1e-3)
    assert "elapsed times" in result.settings.origins["movie.frame_interval_s"]
    notes = " ".join(result.record.content["notes"])
    assert "150 frames were dropped" in notes
    frame = result.tables["localisations"]["frame"]
    assert frame.max() == N_FRAMES - 1
    with open_movie(tmp_path / "dropped.tif") as movie:
        assert frame.isin(movie.numbers).all()
        assert np.mean(movie.numbers == kept) > 0.99
    # Every recorded frame has the spot, so gaps do not count as missing localisations.
    decisions = result.tables["decisions"]
    detected = decisions.loc[decisions["feature"].str.contains("detect"), "value"]
    assert len(detected)
    assert (detected > 0.97).all()
