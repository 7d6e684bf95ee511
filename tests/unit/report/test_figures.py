from __future__ import annotations

import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.patches import Circle

from rotortrack.errors import UsageError
from rotortrack.flags import FitFlag
from rotortrack.report import style
from rotortrack.report.figures import (
    canvas,
    cumulative_angle,
    drift,
    field,
    heatmap,
    msd,
    rotor_sheet,
    speeds,
    step_sizes,
)

sys.path.insert(0, str(Path(__file__).parent))
from mock_run import (
    FRAME_INTERVAL_S,
    by_rotor,
    clipped,
    make_run,
    overlaps,
)

DT = {"frame_interval_s": FRAME_INTERVAL_S}


@pytest.fixture(scope="module")
def run():
    return make_run(10, 3000)


def all_figures(run):
    """Every figure of a run: the extremes are put through here."""
    tracks = by_rotor(run.tracks)
    yield "field", field.figure(run.rotors, run.localisations)
    yield "speeds", speeds.figure(run.rotors)
    yield "angles", cumulative_angle.all_rotors(run.rotors, tracks, **DT)
    curves = {n: msd.curve(t, FRAME_INTERVAL_S) for n, t in tracks.items()}
    yield "msds", msd.all_rotors(run.rotors, curves)
    yield "drift", drift.figure(run.drift)
    for number in run.rotors["rotor"].iloc[[0, 3, 4] if len(run.rotors) > 4 else []]:
        spots, row, track = run.of(number)
        yield f"sheet {number}", rotor_sheet.figure(spots, row, track, **DT)
    for number in run.rotors["rotor"].head(1):
        spots, row, track = run.of(number)
        yield f"heatmap {number}", heatmap.figure(spots, row)
        yield f"angle {number}", cumulative_angle.figure(track, row, **DT)
        yield f"msd {number}", msd.figure(track, row, **DT)
        yield f"steps {number}", step_sizes.figure(track, row)


def with_nans(run):
    for table in (run.rotors, run.tracks, run.localisations, run.drift):
        for name in table.columns:
            if table[name].dtype.kind == "f":
                table[name] = np.nan
    return run


def huge(run):
    run.rotors[["x_nm", "y_nm"]] += 210_000.0
    run.localisations[["x_nm", "y_nm"]] += 210_000.0
    run.tracks["cumulative_rad"] *= -2000.0
    run.rotors[["rev_per_s", "speed_ci_low_deg_s", "speed_ci_high_deg_s"]] *= 2000.0
    run.drift[["dx_nm", "dy_nm"]] *= 100.0
    return run


EXTREMES = {
    "plain": lambda: make_run(10, 3000),
    "one rotor": lambda: make_run(1, 500),
    "nothing": lambda: make_run(0, 0),
    "two frames": lambda: make_run(5, 2),
    "crowded": lambda: make_run(144, 30, pitch_nm=1110.0, first_number=990),
    "too crowded to number": lambda: make_run(144, 30, pitch_nm=120.0, first_number=990),
    "unknown": lambda: with_nans(make_run(5, 50)),
    "huge": lambda: huge(make_run(5, 500)),
}


@pytest.mark.parametrize("extreme", EXTREMES)
def test_no_text_overlaps_or_leaves_the_page(extreme):
    for name, figure in all_figures(EXTREMES[extreme]()):
        assert overlaps(figure) == [], name
        assert clipped(figure) == [], name


def test_the_overlap_check_sees_an_overlap_and_a_clipped_label():
    figure = canvas.new_figure(2, 2)
    figure.text(0.5, 0.5, "one")
    figure.text(0.52, 0.5, "two")
    figure.text(0.95, 0.1, "outside")
    assert overlaps(figure) == [("one", "two")]
    assert clipped(figure) == ["outside"]


def test_circle_and_centre_are_drawn_where_the_table_says(run):
    spots, row, track = run.of(1)
    axes = heatmap.figure(spots, row, track).axes[0]
    (circle,) = [patch for patch in axes.patches if isinstance(patch, Circle)]
    assert circle.center == (row["x_nm"], row["y_nm"])
    assert circle.radius == row["radius_nm"]
    (cross,) = [line for line in axes.lines if line.get_marker() == "+"]
    assert cross.get_xydata().tolist() == [[row["x_nm"], row["y_nm"]]]
    (bar,) = [line for line in axes.lines if line.get_linewidth() == 3]
    assert np.ptp(bar.get_xdata()) == pytest.approx(100.0)


def test_y_points_down_on_maps(run):
    spots, row, _ = run.of(0)
    for axes in (
        heatmap.figure(spots, row).axes[0],
        field.figure(run.rotors, run.localisations).axes[0],
    ):
        bottom, top = axes.get_ylim()
        assert bottom > top
        assert np.diff(axes.get_xlim()) > 0


def test_heatmap_counts_each_spot_in_its_pixel():
    spots = pd.DataFrame(
        {"x_nm": [10.0, 10.0, -40.0, np.nan, 10.0], "y_nm": [-30.0, -30.0, 20.0, 0.0, -30.0]}
    )
    spots["fit_flags"] = [0, 0, 0, 0, int(FitFlag.DUPLICATE)]
    row = {"rotor": 0, "x_nm": 0.0, "y_nm": 0.0, "radius_nm": 50.0}
    image = heatmap.figure(spots, row).axes[0].images[0]
    counts = image.get_array().filled(0)
    left, right, _, top = image.get_extent()
    assert counts.sum() == 3
    pixel = (right - left) / counts.shape[1]
    assert counts[int((-30 - top) / pixel), int((10 - left) / pixel)] == 2
    assert counts[int((20 - top) / pixel), int((-40 - left) / pixel)] == 1


def test_a_far_circle_is_not_drawn_and_the_window_follows_the_spots(run):
    spots, row, track = run.of(0)
    axes = heatmap.figure(spots, {**row, "x_nm": 1e9, "radius_nm": 5.0}, track).axes[0]
    assert axes.get_xlim()[0] < spots["x_nm"].median() < axes.get_xlim()[1]
    assert not [patch for patch in axes.patches if isinstance(patch, Circle)]


def test_field_draws_circles_in_table_units_and_tells_verdicts_by_shape_and_line(run):
    axes = field.figure(run.rotors, run.localisations).axes[0]
    circles = [c for c in axes.collections if isinstance(c, EllipseCollection)]
    centres = np.concatenate([c.get_offsets() for c in circles])
    wanted = run.rotors[["x_nm", "y_nm"]].to_numpy()
    assert sorted(map(tuple, centres)) == sorted(map(tuple, wanted))
    widths = np.concatenate([c.get_widths() for c in circles])
    assert sorted(widths) == pytest.approx(sorted(2 * run.rotors["radius_nm"]))
    kept, refused = style.VERDICTS["kept"], style.VERDICTS["refused"]
    for trait in ("colour", "marker", "line"):
        assert getattr(kept, trait) != getattr(refused, trait)


def test_field_numbers_every_rotor_that_is_a_micrometre_away():
    run = make_run(100, 10, pitch_nm=1101.0, first_number=950)
    axes = field.figure(run.rotors, run.localisations).axes[0]
    assert {text.get_text() for text in axes.texts} == set(map(str, run.rotors["rotor"]))


def test_field_says_how_many_numbers_it_left_out():
    run = make_run(0, 0)
    rotors = pd.DataFrame({"rotor": np.arange(40), "x_nm": 5000.0, "y_nm": 5000.0})
    figure = field.figure(rotors, run.localisations)
    shown = len(figure.axes[0].texts)
    assert 0 < shown < 40
    assert f"{40 - shown} numbers left out" in figure.texts[0].get_text().replace("\n", " ")


def test_field_image_lies_where_its_region_starts(run):
    figure = field.figure(
        run.rotors,
        run.localisations,
        image=np.ones((20, 30)),
        pixel_size_nm=100.0,
        image_origin_px=(4, 7),
    )
    assert figure.axes[0].images[0].get_extent() == [400.0, 3400.0, 2700.0, 700.0]
    with pytest.raises(UsageError, match="pixel_size_nm"):
        field.figure(run.rotors, run.localisations, image=np.ones((20, 30)))


def test_msd_curve_of_a_steady_turn_is_its_square():
    frames = np.delete(np.arange(400), [3, 17, 18, 200])
    track = pd.DataFrame({"frame": frames, "cumulative_rad": 0.05 * frames})
    lags, values = msd.curve(track, 0.01)
    assert lags[0] == pytest.approx(0.01)
    assert lags[-1] == pytest.approx(2.0)
    assert values == pytest.approx((math.degrees(0.05) * lags / 0.01) ** 2, rel=1e-9)


def test_fit_is_solid_only_inside_its_lags(run):
    _, row, track = run.of(0)
    axes = msd.figure(track, row, **DT).axes[0]
    (fit,) = [line for line in axes.lines if line.get_label() == "v²τ² + 2Dτ"]
    lag, value = fit.get_xdata(), fit.get_ydata()
    assert lag.min() == pytest.approx(row["msd_lag_min_s"])
    assert row["msd_lag_max_s"] * 0.9 < lag.max() <= row["msd_lag_max_s"] * (1 + 1e-9)
    diffusion = math.degrees(math.degrees(row["msd_diffusion_rad2_s"]))
    assert value == pytest.approx((row["msd_speed_deg_s"] * lag) ** 2 + 2 * diffusion * lag)


@pytest.mark.parametrize("method", ["increments", "paper"])
def test_the_likelihoods_curve_is_drawn_where_it_gave_the_speed(run, method):
    _, row, track = run.of(0)
    told = {"omega_rad_s": 3.0, "diffusion_rad2_s": 2.0, "theta_noise_rad": 0.1}
    row = {**row, **told, "speed_method": method}
    axes = msd.figure(track, row, exposure_s=0.003, **DT).axes[0]
    found = [line for line in axes.lines if "likelihood" in str(line.get_label())]
    assert len(found) == (method != "paper")
    for line in found:
        lag = line.get_xdata()
        expected = 9.0 * lag**2 + 4.0 * (lag - 0.001) + 0.02
        assert line.get_ydata() == pytest.approx(expected * math.degrees(1) ** 2)


def test_the_wrapped_fit_adds_up_to_all_steps_even_where_they_are_wide():
    steps = np.random.default_rng(1).uniform(-np.pi, np.pi, 4000)
    track = pd.DataFrame({"frame": np.arange(4000), "step_rad": steps})
    row = {"rotor": 3, "wrapped_step_rad": 0.3, "wrapped_step_sd_rad": 2.0}
    axes = step_sizes.figure(track, row).axes[0]
    (line,) = [one for one in axes.lines if "wrapped" in str(one.get_label())]
    at, density = line.get_xdata(), line.get_ydata()
    assert np.trapezoid(density, at) / 5.0 == pytest.approx(4000, rel=1e-3)


def test_steps_across_a_gap_stay_out_of_the_histogram():
    track = pd.DataFrame(
        {"frame": [0, 1, 2, 5, 6], "step_rad": np.radians([np.nan, 10.0, 20.0, 170.0, 30.0])}
    )
    title = step_sizes.figure(track, {"rotor": 3}).axes[0].get_title(loc="left")
    assert title == "mean 20.00°, sd 8.16°, 3 steps"


def test_thinned_trace_keeps_its_extremes():
    rng = np.random.default_rng(0)
    y = rng.normal(size=100_000)
    x = np.arange(100_000.0)
    y[50_001], y[70_003], y[5] = 40.0, -40.0, np.nan
    thin_x, thin_y = canvas.thin(x, y, 1000)
    assert len(thin_y) <= 1010
    assert (thin_y.max(), thin_y.min()) == (40.0, -40.0)
    assert np.all(np.diff(thin_x) > 0)
    assert np.array_equal(y[thin_x.astype(int)], thin_y)


def test_every_behaviour_has_a_colour_and_a_marker_of_its_own():
    looks = style.BEHAVIOURS.values()
    assert len({look.colour for look in looks}) == len({look.marker for look in looks}) == 8


@pytest.mark.parametrize("file_format", ["png", "svg", "pdf"])
def test_equal_figures_give_equal_bytes(run, tmp_path, file_format):
    spots, row, track = run.of(0)
    for name in ("a", "b"):
        made = rotor_sheet.figure(spots, row, track, **DT)
        canvas.save(made, tmp_path / name, file_format)
    assert (tmp_path / "a").read_bytes() == (tmp_path / "b").read_bytes()


def test_drawing_needs_no_pyplot_and_leaves_the_settings_alone():
    program = (
        "import matplotlib, sys\n"
        "matplotlib.rcParams['font.size'] = 31\n"
        "from rotortrack.report.figures import canvas, speeds\n"
        "import pandas as pd, io\n"
        "figure = speeds.figure(pd.DataFrame({'rotor': [0], 'rev_per_s': [1.0]}))\n"
        "canvas.save(figure, io.BytesIO(), 'png')\n"
        "assert figure.axes[0].yaxis.label.get_size() == 8.0\n"
        "assert matplotlib.rcParams['font.size'] == 31\n"
        "assert 'matplotlib.pyplot' not in sys.modules\n"
    )
    subprocess.run([sys.executable, "-c", program], check=True)
