"""Scenes that are filmed: what is not named does not exist, and every mistake is told at once."""

from __future__ import annotations

import pytest

from rotortrack.errors import ConfigurationError
from rotortrack.settings import Layer, parse_toml
from rotortrack.simulate.film.scene import FILM_SECTIONS, within
from rotortrack.simulate.scene import make_scene, read_scene
from rotortrack.toml import to_toml


def scene_of(text, *layers, tmp_path=None):
    return make_scene(
        [Layer("scene", parse_toml(text.encode(), tmp_path, arrays=("rotors",))), *layers]
    )


def mistakes_of(text):
    with pytest.raises(ConfigurationError) as caught:
        scene_of(text)
    return caught.value.mistakes


def test_a_film_has_nothing_that_it_does_not_name():
    film = scene_of("[film]\n").film
    assert all(getattr(film, name) is None for name in FILM_SECTIONS if name != "film")
    assert (film.rotors, film.names) == ((), ())
    assert film.film.exposure_s is None


def test_groups_of_rotors_stand_in_their_order():
    scene = scene_of(
        '[film]\n[[rotors]]\nmotion = "stuck"\n[[rotors]]\nphotons = [1, 2]\n[drift]\n'
    )
    assert [group.motion for group in scene.film.rotors] == ["stuck", "driven"]
    assert scene.film.rotors[1].photons == (1, 2)
    assert scene.film.names == ("rotors", "drift")


def test_a_scene_written_down_is_the_same_scene():
    scene = scene_of(
        '[film]\nseed = 3\n[[rotors]]\nmotion = "arc"\narc_deg = 50\n[[rotors]]\nx_nm = [5.5]\n'
        "y_nm = [6]\n[camera]\n[split]\nshift_nm = [3, 4]\n"
    )
    assert scene_of(to_toml(scene.as_dict())) == scene_of(to_toml(scene.as_dict()))
    assert scene_of(to_toml(scene.as_dict())).film == scene.film


def test_one_table_of_rotors_beside_the_file_changes_all_groups():
    more = Layer("--set", {"rotors": {"photons": 77}})
    film = scene_of("[film]\n[[rotors]]\ncount = 3\n[[rotors]]\nphotons = 5\n", more).film
    assert [group.photons for group in film.rotors] == [77, 77]
    assert film.rotors[0].count == 3


def test_every_mistake_is_told_at_once():
    told = mistakes_of(
        "[film]\nexposure_s = 0.003\nheight_px = 64\nwidth_px = 65\n"
        "[[rotors]]\nphotons = -3\n[[rotors]]\n"
        'motion = "stuck"\narc_deg = 20\nx_nm = [1e6]\ny_nm = [3]\nends = 2\n'
        "[bleching]\n[hot_pixels]\n"
        "[voltage]\ntimes_s = [0, 5, 4]\nvoltages_mv = [1, 2]\n[rolling_shutter]\nline_time_s = 1\n"
        "[dropped]\nframes = [2000]\n[fiducials]\n[dyes]\ncounts = [1]\n"
    )
    for words in (
        "[bleching] is not a section: did you mean bleaching?",
        "[rotors 1] photons must be greater than 0, not -3",
        "[rotors 2] arc_deg belongs to motion arc, not to stuck",
        "[rotors 2] ends = 2 needs [split]",
        "[rotors 2] the pore at (1e+06, 3) nm is outside the frame",
        "[hot_pixels] needs [camera]",
        "[fiducials] needs [split]",
        "exposure_s is longer than frame_interval_s",
        "3 times_s and 2 voltages_mv",
        "times_s do not ascend",
        "64 rows take 64 s",
        "2000 is beyond the 2000 frames",
        "[dyes] counts must be two numbers",
    ):
        assert any(words in sentence for sentence in told), (words, told)


def test_a_section_with_mistakes_of_its_own_hides_and_makes_no_others():
    told = mistakes_of(
        "[film]\nwidth_px = -3\nexposure_s = 0.001\n[camera]\nbits = 40\n[pixel_maps]\n"
        "[split]\nscale = 3\n[fiducials]\n[lattice]\n"
        '[voltage]\ntimes_s = [0, 1]\n[[rotors]]\nmotion = "stuck"\narc_deg = 20\nends = 2\n'
        "x_nm = [1e4]\ny_nm = [1e4]\n[rolling_shutter]\n[dropped]\nframes = [0, 7]\n"
    )
    assert sorted(told) == [
        "[dropped] frames: frame 0 cannot be lost, a film begins with a frame",
        "[rotors 1] arc_deg belongs to motion arc, not to stuck",
        "[voltage] has 2 times_s and 1 voltages_mv: give as many",
        "scene: [camera] bits must be at most 16, not 40",
        "scene: [film] width_px must be greater than 0, not -3",
        "scene: [split] scale must be at most 1.2, not 3",
    ]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[drift]\n", "[drift] is of no use without [film]"),
        ("[[rotors]]\n", "is of no use without [film]"),
        ('[film]\n[[rotors]]\nshape = "rod"\n[rod]\n', "shape rod needs [field]"),
        ('[film]\n[[rotors]]\nmotion = "table"\n', "motion table needs table"),
        ('[film]\n[[rotors]]\nmotion = "tethered"\ndiffusion_rad2_s = 0\n', "above 0"),
        ("[film]\n[[rotors]]\nradius_nm = [3, 2]\n", "must be a number or [low, high]"),
        ("[film]\n[[rotors]]\nx_nm = [3]\ny_nm = []\n", "give as many"),
        ("[film]\n[[rotors]]\nx_nm = [3]\ny_nm = [3]\ncount = 2\n", "1 places are given"),
        ("[film]\n[[rotors]]\narrive_s = [1, 2]\nleave_s = 2\n", "leave_s must be after"),
        ("[film]\nwidth_px = 33\n[split]\n", "width_px must be even"),
        ('[film]\n[psf]\nmodel = "airy"\ndefocus_nm = 3\n', "belongs to the model gaussian"),
        ('[film]\n[psf]\nmodel = "airy"\nsigma_nm = 99\n', "sigma_nm belongs to the model gauss"),
        ("[film]\n[psf]\nwavelength_nm = 520\n", "wavelength_nm belongs to the model airy"),
        ("[film]\n[[rotors]]\nsecond_photons = 9\n", "second_photons belongs to ends = 2"),
        ('[film]\n[[rotors]]\nshape = "a.npz"\nradius_nm = 9\n', "radius_nm belongs to shape circ"),
        ('[film]\n[camera]\ncamera_maps = "a.npz"\n[pixel_maps]\n', "keep one of them"),
        ("[film]\n[voltage]\ntimes_s = [1]\n[[rotors]]\n", "do not begin with 0"),
        ("[film]\n[[rotors]]\n[voltage]\nsample_hz = 1000\n", "give at least 2000"),
        (
            "[film]\nexposure_s = 1e-4\n[[rotors]]\n[voltage]\nsample_hz = 1e4\n",
            "the trigger is high for 0.0001 s a frame",
        ),
        ("[film]\n[dropped]\nframes = [4, 0]\n", "frame 0 cannot be lost"),
    ],
)
def test_what_contradicts_itself(text, words):
    assert any(words in sentence for sentence in mistakes_of(text))


def test_files_that_a_scene_names_lie_where_it_lies(tmp_path, monkeypatch):
    path = tmp_path / "scene.toml"
    path.write_text(
        '[film]\n[camera]\ncamera_maps = "maps.npz"\n[drift]\ntable = "drift.csv"\n[[rotors]]\n'
        'motion = "table"\ntable = "deep/places.csv"\n[[rotors]]\nshape = "rod.npz"\n[[rotors]]\n'
    )
    work = tmp_path / "work"
    work.mkdir()
    monkeypatch.chdir(work)
    film = read_scene(path, [Layer("--set", {"camera": {"camera_maps": "other.npz"}})]).film
    assert film.camera.camera_maps == str(work / "other.npz")
    assert film.drift.table == str(tmp_path / "drift.csv")
    assert film.rotors[0].table == str(tmp_path / "deep" / "places.csv")
    assert [group.shape for group in film.rotors] == ["circle", str(tmp_path / "rod.npz"), "circle"]


def test_a_range_is_cut_evenly_or_by_its_logarithm():
    assert within(5.0, 0.3) == 5.0
    assert within((2.0, 4.0), 0.25) == 2.5
    assert within((1.0, 100.0), 0.5, logarithmic=True) == pytest.approx(10.0)
    assert within((0.0, 100.0), 0.5, logarithmic=True) == 50.0
