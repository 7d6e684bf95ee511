"""Places of rotors from a table: what it says is what is filmed, and nonsense is refused."""

from __future__ import annotations

import gzip

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.errors import TableError
from rotortrack.simulate.film.film import Film
from rotortrack.simulate.film.options import BleachingOptions, FilmOptions, RotorsOptions
from rotortrack.simulate.film.scene import FilmScene
from rotortrack.simulate.film.table_motion import Positions, read_positions

TEXT = "frame,rotor,x_nm,y_nm,photons\n0,7,100,200,50\n2,7,130,180,60\n1,2,5,6,70\n"


def written(folder, text, name="places.csv"):
    path = folder / name
    path.write_text(text)
    return path


def test_every_row_is_where_the_table_says(tmp_path):
    positions = read_positions(written(tmp_path, TEXT), 4)
    assert positions.rotors == (2, 7)
    assert positions.has_photons
    x_nm, y_nm, photons = positions.advance(4)
    assert photons.tolist() == [[0, 70, 0, 0], [50, 0, 60, 0]]
    assert x_nm.tolist() == [[5, 5, 5, 5], [100, 115, 130, 115]]
    assert y_nm.tolist() == [[6, 6, 6, 6], [200, 190, 180, 190]]


def test_without_photons_light_is_one_where_there_is_a_row(tmp_path):
    path = written(tmp_path, "rotor,frame,note,y_nm,x_nm\n0,1,here,2,3\n")
    positions = read_positions(path, 3)
    assert not positions.has_photons
    assert [values.tolist() for values in positions.advance(3)] == [
        [[3, 3, 3]],
        [[2, 2, 2]],
        [[0, 1, 0]],
    ]


@pytest.mark.parametrize("form", ["gz", "parquet", "semicolons"])
def test_all_forms_of_a_table_say_the_same(tmp_path, form):
    path = tmp_path / {"gz": "a.csv.gz", "parquet": "a.parquet", "semicolons": "a.csv"}[form]
    if form == "gz":
        path.write_bytes(gzip.compress(TEXT.encode()))
    elif form == "parquet":
        columns = {
            **{"frame": [0, 2, 1], "rotor": [7, 7, 2], "photons": [50, 60, 70]},
            **{"x_nm": [100.0, 130.0, 5.0], "y_nm": [200.0, 180.0, 6.0]},
        }
        pq.write_table(pa.table(columns), path)
    else:
        path.write_text(TEXT.replace(",", ";").replace("130", "130,0"))
    plain = read_positions(written(tmp_path, TEXT, "plain.csv"), 3).advance(3)
    for got, expected in zip(read_positions(path, 3).advance(3), plain, strict=True):
        np.testing.assert_array_equal(got, expected)


@given(
    rows=st.sets(st.tuples(st.integers(0, 19), st.integers(0, 4)), min_size=1, max_size=60),
    cuts=st.lists(st.integers(1, 7), min_size=1, max_size=8),
    seed=st.integers(0, 99),
)
def test_nothing_depends_on_how_many_frames_are_asked_for_at_a_time(rows, cuts, seed):
    rng = np.random.default_rng(seed)
    frame, rotor = np.array(rng.permutation(sorted(rows))).T
    x_nm, y_nm, photons = rng.uniform(1.0, 2.0, (3, len(frame)))
    columns = (frame, rotor, x_nm, y_nm, photons)
    whole = Positions(*columns).advance(sum(cuts))
    piecewise = Positions(*columns)
    pieces = [piecewise.advance(n) for n in cuts]
    for at, expected in enumerate(whole):
        np.testing.assert_array_equal(np.concatenate([p[at] for p in pieces], axis=1), expected)
    numbers = sorted(set(rotor.tolist()))
    for row in range(len(frame)):
        if frame[row] < sum(cuts):
            cell = numbers.index(rotor[row]), frame[row]
            assert [values[cell] for values in whole] == [x_nm[row], y_nm[row], photons[row]]
    lit = np.count_nonzero(frame < sum(cuts))
    assert np.count_nonzero(whole[2]) == lit


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "is empty"),
        ("frame,rotor,x_nm,y_nm\n", "has no rows"),
        ("frame,rotor,x_nm\n0,0,1\n", "lacks the positions column.* y_nm"),
        ("frame,rotor,x_nm,y_nm\n0,0,here,1\n", "cannot be read"),
        ("frame,rotor,x_nm,y_nm\n0,0,1,2\n0,1,,1\n", "row 2 .*x_nm and y_nm must be numbers"),
        ("frame,rotor,x_nm,y_nm\n0,0,1,inf\n", "row 1 .*must be numbers"),
        ("frame,rotor,x_nm,y_nm\n0,0,1,1e12\n", "within a metre"),
        ("frame,rotor,x_nm,y_nm\n0.5,0,1,1\n", "frame"),
        ("frame,rotor,x_nm,y_nm\n,0,1,1\n", "frame"),
        ("frame,rotor,x_nm,y_nm\n-1,0,1,1\n", "frame -1 is negative"),
        ("frame,rotor,x_nm,y_nm\n10,0,1,1\n", "frame must be below 10: raise n_frames"),
        ("frame,rotor,x_nm,y_nm\n0,-1,1,1\n", "rotor must be 0 or more"),
        ("frame,rotor,x_nm,y_nm\n3,0,1,1\n4,0,1,1\n3,0,2,2\n", "row 3 .*two places in one frame"),
        ("frame,rotor,x_nm,y_nm,photons\n0,0,1,1,-5\n", "photons must be 0 or more"),
        ("frame,rotor,x_nm,y_nm,photons\n0,0,1,1,\n", "photons must be 0 or more"),
        ("frame,rotor,x_nm,y_nm,x_nm\n0,0,1,1,1\n", "more than once"),
    ],
)
def test_nonsense_is_refused_in_one_sentence(tmp_path, text, says):
    path = written(tmp_path, text)
    with pytest.raises(TableError, match=says) as refusal:
        read_positions(path, 10)
    assert str(path) in str(refusal.value)
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize("name", ["places.csv", "places.parquet", "places.csv.gz"])
def test_bytes_of_something_else_are_refused(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(np.random.default_rng(1).bytes(3000))
    with pytest.raises(TableError, match="cannot be read"):
        read_positions(path, 10)


@pytest.mark.parametrize(("name", "says"), [("none.csv", "none.csv"), ("a.xlsx", "neither")])
def test_a_file_that_is_no_table_is_refused(tmp_path, name, says):
    with pytest.raises(TableError, match=says):
        read_positions(tmp_path / name, 10)


def test_numbers_without_end_are_refused(tmp_path):
    path = tmp_path / "many.parquet"
    n = 100_001
    columns = {"frame": np.zeros(n, int), "rotor": np.arange(n)}
    pq.write_table(pa.table({**columns, "x_nm": np.ones(n), "y_nm": np.ones(n)}), path)
    with pytest.raises(TableError, match="100,001 rotors"):
        read_positions(path, 10)


def scene(path, **changes):
    values = {"motion": "table", "table": str(path), **changes.pop("rotors", {})}
    film = FilmOptions(n_frames=5, width_px=80, height_px=60, pixel_size_nm=100.0)
    driven = RotorsOptions(motion="driven", count=2, x_nm=(2e3, 6e3), y_nm=(2e3, 4e3))
    return FilmScene(film=film, rotors=(driven, RotorsOptions(**values)), **changes)


SPOTS = "frame,rotor,x_nm,y_nm\n0,4,4000,3000\n2,4,4100,2900\n2,9,3000,5000\n"


def filmed(made, **kwargs):
    film, told = Film(made, [()] * len(made.rotors), **kwargs), []
    frames = np.concatenate(list(film.blocks(see=lambda first, seen: told.append((first, seen)))))
    return film, frames, told


@pytest.mark.parametrize("block_frames", [1, 3, 5])
def test_a_film_shows_the_rotors_of_a_table_beside_the_others(tmp_path, block_frames):
    path = written(tmp_path, SPOTS.replace("y_nm\n", "y_nm,photons\n").replace("00\n", "00,800\n"))
    film, frames, told = filmed(scene(path), block_frames=block_frames)
    assert [rotor.motion for rotor in film.rotors] == ["driven", "driven", "table", "table"]
    assert [rotor.number for rotor in film.rotors] == [0, 1, 2, 3]
    assert len({rotor.pore for rotor in film.rotors}) == 4
    assert (film.rotors[2].x_nm, film.rotors[2].y_nm) == (4050.0, 2950.0)
    others = filmed(FilmScene(film=film.scene.film, rotors=film.scene.rotors[:1]))[1]
    added = frames - others
    np.testing.assert_allclose(added.sum(axis=(1, 2)), [800, 0, 1600, 0, 0], atol=0.5)
    rows, columns = np.indices(added[0].shape)
    assert (added[0] * (columns + 0.5)).sum() / 800 == pytest.approx(40.0, abs=0.01)
    assert (added[0] * (rows + 0.5)).sum() / 800 == pytest.approx(30.0, abs=0.01)
    photons = [one.photons for _, seen in told for one in seen if (one.rotor, one.end) == (2, 0)]
    assert np.concatenate(photons).tolist() == [800, 0, 800, 0, 0]
    speeds = film.realised_rad_s()
    assert np.isnan(speeds[2:]).all()
    assert np.isfinite(speeds[:2]).all()


def test_rotors_without_photons_draw_their_own_and_bleach(tmp_path):
    path = written(tmp_path, "frame,rotor,x_nm,y_nm\n0,0,4000,3000\n4,0,4000,3000\n")
    made = scene(path, rotors={"photons": (700.0, 900.0)})
    _, frames, _ = filmed(FilmScene(film=made.film, rotors=made.rotors[1:]))
    light = frames.sum(axis=(1, 2))
    assert 700.0 < light[0] < 900.0
    assert light[1:].tolist() == [0.0, 0.0, 0.0, pytest.approx(light[0])]
    dark = FilmScene(
        film=made.film, rotors=made.rotors[1:], bleaching=BleachingOptions(lifetime_s=1e-5)
    )
    assert filmed(dark)[1][4].sum() == 0.0


def test_options_that_tables_have_no_use_for_are_told(tmp_path):
    made = scene(written(tmp_path, SPOTS), rotors={"count": 3, "arrive_s": 1.0})
    assert list(made.mistakes()) == [
        "[rotors 2] count has no use for motion table: the table tells where rotors are",
        "[rotors 2] arrive_s has no use for motion table: the table tells where rotors are",
    ]
