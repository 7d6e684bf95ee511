"""A changed option gives other keys to its stage and the later ones, and to none before."""

from __future__ import annotations

import os

import pytest

from rotortrack.pipeline import keys
from rotortrack.pipeline.identity import identify
from rotortrack.pipeline.keys import SECOND, STAGES, stage_keys
from rotortrack.pipeline.presets import SECTIONS
from rotortrack.settings import Layer, option_fields, resolve

NAMES = [stage.name for stage in STAGES]


@pytest.fixture
def movie(tmp_path):
    path = tmp_path / "movie.tif"
    path.write_bytes(b"frames")
    return [identify(path)]


def changed(files, **sections):
    """Name the stages whose key differs from that of the defaults."""
    before = stage_keys(files, resolve(SECTIONS, []))
    after = stage_keys(files, resolve(SECTIONS, [Layer("test", sections)]))
    return [name for name in NAMES if before[name] != after[name]]


@pytest.mark.parametrize(
    ("sections", "first"),
    [
        ({"movie": {"frames": [0, 5]}}, "check"),
        ({"camera": {"offset_adu": 7.0}}, "check"),
        ({"movie": {"pixel_size_nm": 99.0}}, "localise"),
        ({"localise": {"method": "lsq"}}, "localise"),
        ({"quality": {"max_uncertainty_nm": 9.0}}, "correct"),
        ({"density": {"radius_nm": 9.0}}, "correct"),
        ({"screen": {"min_frames": 9}}, "rotors"),
        ({"motion": {"gap_mode": "bridge"}}, None),
        ({"movie": {"frame_interval_s": 0.1}}, None),
    ],
)
def test_an_option_counts_from_its_stage_on(movie, sections, first):
    expected = NAMES[NAMES.index(first) :] if first else []
    assert changed(movie, **sections) == expected


def test_every_option_that_decides_a_kept_result_is_in_a_key():
    known = {word for stage in (*STAGES, SECOND) for word in stage.options}
    free = {
        # Known to motion and the report alone, which are made anew each time.
        *("movie.frame_interval_s", "movie.exposure_s", "movie.mirrored", "motion"),
        *("ends", "channels.registration", "channels.line_time_s"),
        # Of commands beside the workflow.
        *("link", "plan", "contour", "register"),
        # A guard: it refuses a movie or changes nothing.
        "movie.max_frame_megapixels",
        # It counts by the content of its file.
        "channels.second_movie",
    }
    for section, options_class in SECTIONS.items():
        for field in option_fields(options_class):
            words = {section, f"{section}.{field.name}"}
            assert words & known or words & free, f"{section}.{field.name} is in no key"


def test_another_state_of_the_movie_or_of_the_maps_changes_all_keys(movie, tmp_path):
    settings = resolve(SECTIONS, [])
    before = stage_keys(movie, settings)
    movie[0].path.write_bytes(b"other!")
    after = stage_keys([identify(movie[0].path)], settings)
    assert all(before[name] != after[name] for name in NAMES)
    maps = tmp_path / "camera.npz"
    maps.write_bytes(b"1")
    with_maps = resolve(SECTIONS, [Layer("test", {"camera": {"camera_maps": str(maps)}})])
    first = stage_keys(movie, with_maps)
    maps.write_bytes(b"2")
    second = stage_keys(movie, with_maps)
    assert all(first[name] != second[name] for name in NAMES)


def test_maps_count_by_their_content_and_not_by_their_name(movie, tmp_path):
    found = []
    for name in ("camera.npz", "moved.npz"):
        maps = tmp_path / name
        maps.write_bytes(b"1")
        os.utime(maps, (1, 1))
        settings = resolve(SECTIONS, [Layer("test", {"camera": {"camera_maps": str(maps)}})])
        found.append(stage_keys(movie, settings))
    assert found[0] == found[1]


def test_changed_code_counts_from_its_stage_on(movie, monkeypatch):
    settings = resolve(SECTIONS, [])
    before = stage_keys(movie, settings)
    version = keys._code_version
    monkeypatch.setattr(
        keys, "_code_version", lambda code: version(code) + ("new" if "corrections" in code else "")
    )
    after = stage_keys(movie, settings)
    assert [name for name in NAMES if before[name] != after[name]] == ["correct", "rotors"]


def test_the_code_of_every_stage_exists():
    package = keys.Path(keys.__file__).parents[1]
    for stage in STAGES:
        for part in stage.code:
            assert (package / part).exists(), part
