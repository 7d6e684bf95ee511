"""`rotortrack track` as a user calls it."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

from rotortrack.exchange.tables import TableInfo, write_localisations
from rotortrack.motion.tables import PARTICLE_MSD, PARTICLES

CLOCK = ("--frame-interval-s", 0.01, "--exposure-s", 0.01)


@pytest.fixture
def spots(swimming):
    table = swimming(np.random.default_rng(1), 15, 100, missing=0.05, box_nm=40_000.0)
    table = table.drop(columns="truth") + 5000.0 * (table.columns.isin(["x_nm", "y_nm"]))[:-1]
    table["frame"] = table["frame"].astype(int)
    extra = {"photons": 500.0, "sigma_nm": 130.0, "background": 5.0, "uncertainty_nm": 20.0}
    return table.assign(**extra).sort_values("frame", ignore_index=True)


@pytest.fixture
def locs(spots, tmp_path):
    """Give `write(ending, **info)` -> path of the spots in that format."""

    def write(ending="parquet", table=spots, **info):
        path = tmp_path / f"spots.{ending}"
        known = TableInfo(pixel_size_nm=100.0, frames=100, height_px=500, width_px=500, **info)
        write_localisations(path, table, known)
        return path

    return write


def test_the_three_formats_give_the_same_particles(call, locs, tmp_path):
    results = []
    for ending in ("parquet", "csv", "hdf5"):
        ended = call(
            "track", locs(ending), *CLOCK, "-o", tmp_path / f"{ending}.csv", "-q", "--json"
        )
        assert ended.code == 0
        results.append(ended.json)
    for name in ("particles", "search_range_nm", "linked_localisations", "short_particles"):
        assert len({result[name] for result in results}) == 1
    diffusion = [result["diffusion_um2_s"] for result in results]
    assert diffusion == pytest.approx([diffusion[0]] * 3, rel=1e-3)
    assert diffusion[0] == pytest.approx(0.1, rel=0.15)


@pytest.mark.parametrize("ending", ["parquet", "csv"])
def test_tables_and_figure_lie_beside_each_other(call, locs, tmp_path, ending):
    target = tmp_path / "out" / f"mobile.{ending}"
    ended = call("track", locs(), *CLOCK, "-o", target, "-q")
    assert ended.code == 0
    assert "chosen: steps of" in ended.out
    tracks = pd.read_parquet(target) if ending == "parquet" else pd.read_csv(target)
    particles = pd.read_csv(target.with_name("mobile-particles.csv"))
    assert list(particles) == PARTICLES.names
    assert list(pd.read_csv(target.with_name("mobile-msd.csv"))) == PARTICLE_MSD.names
    assert particles["n_frames"].sum() == len(tracks)
    assert tracks["time_s"].to_numpy() == pytest.approx(0.01 * tracks["frame"].to_numpy())
    assert target.with_name("mobile.png").read_bytes().startswith(b"\x89PNG")


def test_the_table_may_tell_the_frame_interval(call, locs, tmp_path):
    path = locs(frame_interval_s=0.01)
    ended = call("track", path, "-o", tmp_path / "t.csv", "--json", "-q")
    assert ended.code == 0
    assert any("exposure_s is not given" in sentence for sentence in ended.json["warnings"])


def test_options_of_the_section_link_reach_the_linking(call, locs, tmp_path):
    given = ("--search-range-nm", 321, "--set", "link.min_frames=50", "--memory-frames", 5)
    told = call("track", locs(), *CLOCK, *given, "-o", tmp_path / "t.csv", "--json", "-q").json
    assert (told["search_range_nm"], told["search_range_chosen"]) == (321.0, False)
    assert pd.read_csv(tmp_path / "t-particles.csv")["n_frames"].min() >= 50


def test_a_missing_frame_interval_is_told_with_its_remedy(call, locs, tmp_path):
    ended = call("track", locs(), "-o", tmp_path / "t.csv", "-q")
    assert ended.code == 4
    assert "frame_interval_s is not known: give --frame-interval-s" in ended.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["spots.parquet"]


@pytest.mark.parametrize("option", ["memory_frames=-1", "min_frames=2", "search_range_nm=0"])
def test_options_out_of_bounds_are_told(call, locs, tmp_path, option):
    ended = call("track", locs(), *CLOCK, "--set", f"link.{option}", "-o", tmp_path / "t.csv")
    assert ended.code == 4
    assert option.split("=")[0] in ended.err


def test_what_is_no_table_is_unusable_input(call, tmp_path):
    path = tmp_path / "spots.csv"
    path.write_text("nothing of the kind\n1\n")
    ended = call("track", path, *CLOCK, "-o", tmp_path / "t.csv", "-q")
    assert ended.code == 3
    assert ended.err.count("\n") == 1
    assert call("track", tmp_path / "none.csv", *CLOCK, "-o", tmp_path / "t.csv", "-q").code == 3


def test_targets_that_would_do_harm_are_refused(call, locs, tmp_path):
    path = locs("csv")
    assert call("track", path, *CLOCK, "-o", path, "-q").code == 2
    assert call("track", path, *CLOCK, "-o", tmp_path / "t.hdf5", "-q").code == 2
    assert call("track", path, *CLOCK, "-o", tmp_path / "spots-msd.parquet", "-q").code == 0
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.json").write_text("{}")
    ended = call("track", path, *CLOCK, "-o", tmp_path / "run" / "tracks.parquet", "-q")
    assert ended.code == 2
    assert "is a run folder" in ended.err


def test_an_empty_table_gives_empty_tables_and_code_5_only_where_asked(call, locs, spots, tmp_path):
    path = locs(table=spots.iloc[:0])
    target = tmp_path / "t.parquet"
    ended = call("track", path, *CLOCK, "-o", target, "--json", "-q")
    assert ended.code == 0
    assert ended.json["particles"] == 0
    assert ended.json["diffusion_um2_s"] is None
    assert len(pd.read_parquet(target)) == 0
    assert call("track", path, *CLOCK, "-o", target, "-q", "--strict").code == 5
