from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import EllipseCollection, LineCollection, PolyCollection
from matplotlib.patches import Annulus
from scipy.stats import binomtest

from rotortrack.movies.movie import ArrayMovie
from rotortrack.report.figures import (
    angle_trace,
    canvas,
    columns,
    energetics,
    examples,
    frames,
    gallery,
    heatmap,
    population,
    profile,
    rotor_sheet,
    scatter,
    speed_trace,
    voltage_traces,
)
from rotortrack.report.figures.canvas import NothingToDrawError

sys.path.insert(0, str(Path(__file__).parent))
from mock_run import FRAME_INTERVAL_S, by_rotor, clipped, overlaps
from mock_tables import make_whole

DT = {"frame_interval_s": FRAME_INTERVAL_S}
TIMES = {**DT, "exposure_s": FRAME_INTERVAL_S}


@pytest.fixture(scope="module")
def whole():
    return make_whole(10, 3000)


def makers(whole):
    """Every new figure by name, still to be drawn."""
    run = whole.run
    tracks, spots = by_rotor(run.tracks), by_rotor(run.localisations)
    yield "positions", lambda: gallery.figure(run.rotors, spots)
    yield (
        "examples",
        lambda: examples.figure(run.rotors, tracks, spots, switches=whole.switches, **DT),
    )
    yield "population", lambda: population.figure(run.rotors)
    yield "energetics", lambda: energetics.figure(run.rotors)
    yield "scatter", lambda: scatter.figure(run.rotors)
    yield "angles", lambda: voltage_traces.all_rotors(run.rotors, tracks, whole.voltages, **DT)
    yield "traces", lambda: voltage_traces.examples(run.rotors, tracks, whole.voltages, **TIMES)
    for number in run.rotors["rotor"].head(5 if len(run.rotors) == 10 else 1):
        yield f"sheet {number}", lambda number=number: sheet(whole, number)


def sheet(whole, number):
    spots, row, track = whole.run.of(number)
    parts = [
        table[table["rotor"] == number]
        for table in (whole.switches, whole.posterior, whole.profiles)
    ]
    return rotor_sheet.figure(
        spots, row, track, switches=parts[0], posterior=parts[1], angle_profile=parts[2], **TIMES
    )


def without_numbers(whole):
    tables = [whole.run.rotors, whole.run.tracks, whole.run.localisations]
    tables += [whole.posterior, whole.profiles, whole.voltages]
    for table in tables:
        for name in table.columns:
            if table[name].dtype.kind == "f":
                table[name] = np.nan
    return whole


def hugely(whole):
    rotors = whole.run.rotors
    for name in rotors.columns:
        if rotors[name].dtype.kind == "f" and name not in ("x_nm", "y_nm"):
            rotors[name] *= 3e4
    whole.run.tracks["cumulative_rad"] *= -3e4
    whole.profiles[["omega_rad_s", "omega_sd_rad_s"]] *= 3e4
    return whole


EXTREMES = {
    "plain": lambda: make_whole(10, 3000),
    "one rotor": lambda: make_whole(1, 500),
    "seven": lambda: make_whole(7, 1000),
    "many": lambda: make_whole(80, 40, first_number=990),
    "very many": lambda: make_whole(400, 3),
    "two frames": lambda: make_whole(5, 2),
    "huge": lambda: hugely(make_whole(5, 2000)),
    "unknown": lambda: without_numbers(make_whole(5, 50)),
    "nothing": lambda: make_whole(0, 0),
}


@pytest.mark.parametrize("extreme", EXTREMES)
def test_no_text_overlaps_or_leaves_the_page(extreme):
    for name, make in makers(EXTREMES[extreme]()):
        try:
            figure = make()
        except NothingToDrawError:
            assert extreme not in ("plain", "seven"), name
            continue
        assert overlaps(figure) == [], name
        assert clipped(figure) == [], name


def test_without_rotors_every_figure_tells_why_it_is_not_drawn():
    for name, make in makers(make_whole(0, 0)):
        with pytest.raises(NothingToDrawError, match=r"^no .*\w$"):
            pytest.fail(f"{name} drew {make()}")


def test_a_table_without_a_column_is_named_with_it():
    table = pd.DataFrame({"rotor": [1], "power": [np.nan]})
    assert columns.need(table, "rotors", ["rotor"]) is table
    for wanted in ("power", "torque"):
        with pytest.raises(NothingToDrawError, match=f"the rotors have no {wanted}"):
            columns.need(table, "rotors", [wanted])


def test_circle_and_centre_carry_two_standard_deviations(whole):
    spots, row, track = whole.run.of(0)
    axes = heatmap.figure(spots, row, track).axes[0]
    (ring,) = [patch for patch in axes.patches if isinstance(patch, Annulus)]
    outer = row["radius_nm"] + 2 * row["radius_sd_nm"]
    assert ring.get_radii() == pytest.approx((outer, outer))
    assert ring.get_width() == pytest.approx(4 * row["radius_sd_nm"])
    spans = [
        np.ptp(segment, axis=0).max()
        for bar in axes.collections
        if isinstance(bar, LineCollection)
        for segment in bar.get_segments()
    ]
    assert sorted(spans) == pytest.approx([4 * row["x_sd_nm"], 4 * row["y_sd_nm"]])


def test_tiles_stand_in_order_of_behaviour_and_speed_with_their_circles(whole):
    rotors = whole.run.rotors
    axes = gallery.figure(rotors, by_rotor(whole.run.localisations)).axes[0]
    numbers = [int(text.get_text().split(":")[0]) for text in axes.texts]
    shown = rotors.set_index("rotor").loc[numbers]
    assert set(numbers) == set(rotors.loc[rotors["verdict"] == "kept", "rotor"])
    kinds = shown["behaviour"].tolist()
    assert kinds == sorted(kinds, key=list(columns.style.BEHAVIOURS).index)
    driven = shown.loc[shown["behaviour"] == "driven_ccw", "omega_rad_s"].abs()
    assert driven.is_monotonic_decreasing
    (circles,) = [c for c in axes.collections if isinstance(c, EllipseCollection)]
    side = float(axes.figure.texts[0].get_text().split("tiles of ")[1].split()[0])
    ratio = circles.get_widths() / (2 * shown["radius_nm"].to_numpy())
    assert ratio == pytest.approx(np.full(len(numbers), 1 / side), rel=0.003)


def test_the_example_of_a_behaviour_is_the_clearest():
    rotors = pd.DataFrame(
        {
            "rotor": [0, 1, 2, 3],
            "behaviour": ["brownian", "driven_cw", "brownian", "brownian"],
            "behaviour_margin": [2.0, 1.0, 5.0, np.nan],
        }
    )
    assert [row["rotor"] for row in examples.clearest(rotors)] == [1, 2]


@pytest.mark.parametrize(("count", "total"), [(0, 7), (3, 7), (37, 89), (400, 400)])
def test_intervals_of_counts_are_wilsons(count, total):
    low, high = population.wilson(np.array([count], float), total)
    known = binomtest(count, total).proportion_ci(method="wilson")
    assert (low[0], high[0]) == pytest.approx((known.low, known.high), abs=1e-12)


def test_every_kept_rotor_is_counted_once_in_each_panel(whole):
    kept = columns.kept(whole.run.rotors)
    histogram, kinds, classes = population.figure(whole.run.rotors).axes
    stairs = [patch.get_data() for patch in histogram.patches]
    assert sum(np.sum(data.values - data.baseline) for data in stairs) == len(kept)
    for axes in (kinds, classes):
        assert sum(bar.get_width() for bar in axes.patches) == len(kept)


def test_energy_bars_are_the_tables_intervals(whole):
    rotors = columns.kept(whole.run.rotors)
    axes = energetics.figure(whole.run.rotors).axes[2]
    assert axes.get_xlabel().startswith("torque")
    bars = [c for c in axes.collections if isinstance(c, LineCollection)]
    ends = [tuple(segment[:, 0]) for c in bars for segment in c.get_segments()]
    wanted = rotors[["torque_ci_low_pn_nm", "torque_ci_high_pn_nm"]].to_numpy()
    left, right = axes.get_xlim()
    assert np.sort(ends, axis=0) == pytest.approx(np.sort(wanted.clip(left, right), axis=0))


def test_a_power_that_may_vanish_is_an_arrow_at_its_upper_limit():
    rotors = pd.DataFrame(
        {
            "rotor": [0, 1], "behaviour": "brownian", "power_pn_nm_s": [1e-9, 50.0],
            "power_ci_low_pn_nm_s": [0.0, 40.0], "power_ci_high_pn_nm_s": [7.0, 60.0],
        }
    )  # fmt: skip
    (axes,) = energetics.figure(rotors).axes
    marks = [c for c in axes.collections if not isinstance(c, LineCollection)]
    at = sorted(float(x) for mark in marks for x in mark.get_offsets()[:, 0])
    assert at == [7.0, 50.0]
    assert 0.5 < axes.get_xlim()[0] < 7.0


def test_diffusion_alone_makes_one_panel_whose_heading_fits():
    rotors = pd.DataFrame({"rotor": [0, 1], "diffusion_rad2_s": [9.0, 0.0]})
    rotors["diffusion_ci_low_rad2_s"] = [5.0, 0.0]
    rotors["diffusion_ci_high_rad2_s"] = [12.0, 3.0]
    figure = energetics.figure(rotors)
    assert len(figure.axes) == 1
    assert "upper limits" in figure.texts[0].get_text().replace("\n", " ")
    assert overlaps(figure) == []
    assert clipped(figure) == []


def test_a_path_with_missing_frames_is_broken_at_them(whole):
    spots, row, track = whole.run.of(0)
    gappy = track[track["frame"] % 10 > 0]
    axes = heatmap.figure(spots, row, gappy).axes[0]
    (path,) = [line for line in axes.lines if line.get_label().startswith("frames")]
    x = path.get_xdata()
    assert np.isfinite(x).sum() == heatmap.PATH_POSITIONS
    assert np.isnan(x).any()
    steps = np.isfinite(x[1:] - x[:-1]).sum()
    assert steps < heatmap.PATH_POSITIONS - 1


def test_scatter_shows_a_point_a_rotor_with_both(whole):
    kept = columns.kept(whole.run.rotors)
    axes = scatter.figure(whole.run.rotors).axes[0]
    marks = [c for c in axes.collections if not isinstance(c, LineCollection)]
    points = np.concatenate([mark.get_offsets() for mark in marks])
    wanted = kept[["diffusion_rad2_s", "rev_per_s"]].to_numpy()
    assert np.sort(np.asarray(points), axis=0) == pytest.approx(np.sort(wanted, axis=0))


def test_occupancy_wedges_are_relative_to_the_even_share_and_counter_clockwise():
    middle = np.array([0.25, 0.75, 1.25, 1.75]) * np.pi
    table = pd.DataFrame({"angle_rad": middle, "occupancy": [4.0, 1.0, 2.0, 1.0]})
    axes = canvas.new_figure(3, 3).add_subplot()
    profile.draw_occupancy(axes, table, {})
    (wedges,) = [c for c in axes.collections if isinstance(c, PolyCollection)]
    for path, angle, share in zip(wedges.get_paths(), middle, (2.0, 0.5, 1.0, 0.5), strict=True):
        radius = np.hypot(*path.vertices.T)
        assert radius.max() == pytest.approx(share)
        rim = path.vertices[radius > 0]
        turn = np.angle(np.exp(1j * (np.arctan2(rim[:, 1], rim[:, 0]) - angle)))
        assert np.abs(turn).max() == pytest.approx(np.pi / 4)


def test_the_frames_with_most_angles_are_shown_and_the_posterior_covers_the_missing():
    frame = np.r_[0:50, 200:290]
    theta = np.angle(np.exp(0.2j * frame))
    track = pd.DataFrame({"frame": frame, "theta_rad": theta, "theta_sd_rad": 0.1})
    posterior = pd.DataFrame({"frame": np.arange(300), "theta_sd_rad": 0.1})
    posterior["theta_rad"] = np.angle(np.exp(0.2j * posterior["frame"]))
    axes = canvas.new_figure(4, 3).add_subplot()
    angle_trace.draw(axes, track, {}, posterior, frame_interval_s=0.01)
    assert axes.get_xlim() == pytest.approx((2.0, 3.0))
    points = axes.containers[0].lines[0].get_xydata()
    assert points[:, 0] == pytest.approx(np.arange(200, 290) * 0.01)
    bands = [c for c in axes.collections if not isinstance(c, LineCollection)]
    covered = np.array(
        [any(path.contains_point(p) for band in bands for path in band.get_paths()) for p in points]
    )
    assert covered[1:].all()


def test_windowed_speeds_follow_a_switch_within_their_band():
    rng = np.random.default_rng(5)
    frame = np.arange(8000)
    rate = np.where(frame * 0.002 < 8.0, 40.0, -40.0)
    theta = np.cumsum(rate * 0.002 + rng.normal(0, np.sqrt(2 * 10.0 * 0.002), 8000))
    track = pd.DataFrame({"frame": frame, "theta_rad": np.angle(np.exp(1j * theta))})
    row = {"omega_rad_s": 0.0, "diffusion_rad2_s": 10.0, "theta_noise_rad": 0.0}
    switches = pd.DataFrame({"time_s": [8.0], "before_rad_s": [40.0], "after_rad_s": [-40.0]})
    found, window_s = speed_trace.speeds_of(
        track, row, switches, frame_interval_s=0.002, exposure_s=1e-6
    )
    assert window_s == 0.5
    assert found.sd_rad_s == pytest.approx(np.full(len(found.time_s), np.sqrt(2 * 10 / 0.5)), 0.02)
    whole = np.abs(found.time_s - 8.0) > 0.3
    pull = (found.omega_rad_s - np.where(found.time_s < 8.0, 40.0, -40.0))[whole] / 6.32
    assert np.abs(pull).max() < 4.0
    assert 0.7 < pull.std() < 1.3


def test_a_rotor_without_diffusion_has_no_windowed_speed(whole):
    _, row, track = whole.run.of(0)
    assert speed_trace.speeds_of(track, {**row, "diffusion_rad2_s": np.nan}, **TIMES) is None
    assert speed_trace.speeds_of(track.head(300), row, **TIMES) is None


def test_changes_of_voltage_are_marked_where_the_steps_change(whole):
    run = whole.run
    axes = voltage_traces.all_rotors(
        run.rotors, by_rotor(run.tracks), whole.voltages, **DT
    ).axes[0]  # fmt: skip
    dashed = [line for line in axes.lines if line.is_dashed()]
    changes = np.flatnonzero(np.diff(whole.voltages["step"])) + 1
    assert [line.get_xdata()[0] for line in dashed] == pytest.approx(changes * FRAME_INTERVAL_S)


def test_frames_show_marks_at_the_pixels_that_hold_them(whole):
    run = whole.run
    size, origin = 100.0, (5, 2)
    stretch = frames.choose(
        run.rotors, run.tracks, pixel_size_nm=size, shape_px=(80, 90), image_origin_px=origin
    )
    row = run.rotors[run.rotors["rotor"] == stretch.rotor].iloc[0]
    assert row["verdict"] == "kept"
    track = run.tracks[run.tracks["rotor"] == stretch.rotor]
    shown = set(range(stretch.first, stretch.first + frames.FRAMES))
    assert shown <= set(track["frame"])
    pixels = np.zeros((frames.FRAMES, stretch.side_px, stretch.side_px))
    figure = frames.figure(
        pixels, stretch, run.rotors, run.tracks, pixel_size_nm=size, image_origin_px=origin, **DT
    )
    (cross,) = [line for line in figure.axes[0].lines if line.get_marker() == "+"]
    first = np.array(cross.get_xydata()[0]) * stretch.side_px
    at = np.array([row["x_nm"], row["y_nm"]]) / size - origin
    assert first == pytest.approx(at - [stretch.left_px, stretch.top_px])
    assert (first > 0).all()
    assert (first < stretch.side_px).all()
    assert overlaps(figure) == []
    assert clipped(figure) == []


def test_no_frames_are_chosen_of_a_tiny_movie_or_a_track_full_of_gaps(whole):
    run = whole.run
    assert (
        frames.choose(run.rotors, run.tracks, pixel_size_nm=100.0, shape_px=(8, 8)) is None
    )  # fmt: skip
    gappy = run.tracks[run.tracks["frame"] % 10 > 0]
    assert frames.choose(run.rotors, gappy, pixel_size_nm=100.0, shape_px=(90, 90)) is None


def test_frames_are_read_by_their_numbers_in_the_recording(whole):
    run = whole.run
    rng = np.random.default_rng(3)
    counts = rng.integers(0, 900, (frames.FRAMES + 40, 80, 90)).astype(np.uint16)
    stretch = frames.choose(run.rotors, run.tracks, pixel_size_nm=100.0, shape_px=(80, 90))
    numbers = np.arange(len(counts)) + stretch.first - 7
    numbers[:3] -= 5
    movie = ArrayMovie(counts)
    movie.numbers = numbers
    figure = frames.of_movie(movie, run.rotors, run.tracks, pixel_size_nm=100.0, **DT)
    left, top, side = stretch.left_px, stretch.top_px, stretch.side_px
    shown = [image.get_array() for image in figure.axes[0].images]
    wanted = counts[7 : 7 + frames.FRAMES, top : top + side, left : left + side]
    assert np.array_equal(np.stack(shown), wanted)
