"""The plugin's measurement protocol, in both of its layouts, as a starting configuration."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotortrack.errors import ConfigurationError
from rotortrack.exchange.thunderstorm_formula import in_photons, largest_uncertainty
from rotortrack.exchange.thunderstorm_protocol import Protocol, is_protocol, read_protocol
from rotortrack.localise.threshold import parse_threshold
from rotortrack.pipeline.presets import PRESETS, SECTIONS
from rotortrack.settings import Layer, Settings, resolve

PATH = Path("layer-protocol.txt")

CAMERA = {
    "readoutNoise": 1.2,
    "offset": 100.0,
    "quantumEfficiency": 1.0,
    "isEmGain": False,
    "photons2ADU": 0.46,
    "pixelSize": 108.0,
    "gain": 100.0,
}
FILTER = {"name": "Wavelet filter (B-Spline)", "scale": 2.5, "order": 4}
DETECTOR = {"name": "Local maximum", "connectivity": 4, "threshold": "1.5*std(Wave.F1)"}
CROWDED = {
    "name": "Multi-emitter fitting analysis",
    "mfaEnabled": False,
    "nMax": 5,
    "pValue": 1.0e-6,
    "keepSameIntensity": True,
    "intensityInRange": False,
}
ESTIMATOR = {
    "name": "PSF: Integrated Gaussian",
    "fittingRadius": 4,
    "method": "Weighted Least squares",
    "initialSigma": 1.3,
    "fullImageFitting": False,
    "crowdedField": CROWDED,
}
HISTORY = [
    {"name": "Filter", "options": "formula=[uncertainty_xy < 30]"},
    {
        "name": "Drift correction",
        "options": "magnification=4.0 method=[Cross correlation] save=false steps=8 "
        "ccSmoothingBandwidth=0.5 showCorrelations=false",
    },
    {"name": "Density filter", "options": "neighbors=15 radius=25.0 dimensions=2D"},
]


PLUGIN = {"clip_at_border": False, "correct_bias": False, "max_emitters": 1}
"""What the plugin does without saying so in a protocol."""


def protocol(**changes: Any) -> Protocol:
    """Read a protocol of the builds of 2016 with some parts changed."""
    parts = {
        "version": "ThunderSTORM (dev-2016-09-10-b1)",
        "imageInfo": {"title": "layer.tif"},
        "cameraSettings": CAMERA,
        "analysisFilter": FILTER,
        "analysisDetector": DETECTOR,
        "analysisEstimator": ESTIMATOR,
        "postProcessing": HISTORY,
    }
    return read_protocol(json.dumps({**parts, **changes}, indent=2).encode(), PATH)


def settings(read: Protocol) -> Settings:
    return resolve(SECTIONS, [Layer("protocol p", read.values)])


def test_all_that_has_a_counterpart_is_taken_over() -> None:
    read = protocol()
    assert read.left_out == []
    assert read.values == {
        "movie": {"pixel_size_nm": 108.0},
        "camera": {"offset_adu": 100.0, "gain_e_per_adu": 0.46, "read_noise_e": 1.2},
        "localise": {
            "wavelet_order": 4,
            "wavelet_scale": 2.5,
            "connectivity": 4,
            "threshold": "1.5*std(Wave.F1)",
            "method": "wlsq",
            "fit_radius_px": 4,
            "initial_sigma_px": 1.3,
            **PLUGIN,
        },
        "quality": {"max_uncertainty_nm": 30.0},
        "drift": {
            "method": "cross-correlation",
            "bins": 8,
            "magnification": 4.0,
            "smoothing": 0.5,
        },
        "density": {"radius_nm": 25.0, "min_neighbours": 15},
    }
    assert settings(read).origins["localise.method"] == "protocol p"


RELEASE = """ThunderSTORM (1.3-2014-11-08)

Input:
{
  "title": "movie: one.tif"
}
Camera settings:
{
  "offset": 90.0,
  "isEmGain": false,
  "photons2ADU": 0.5,
  "pixelSize": 160.0,
  "gain": 300.0
}
Analysis:
{
  "name": "Wavelet filter (B-Spline)",
  "parameters": {
    "prefsPrefix": "thunderstorm.filters.wave",
    "trackedParameters": {
      "scale": {"defaultValue": 2.0, "value": 2.5},
      "order": {"defaultValue": 3, "value": 4}
    }
  }
}
{
  "name": "Local maximum",
  "connectivity": 8,
  "threshold": "std(Wave.F1)",
  "parameters": {"prefsPrefix": "thunderstorm.detectors.locmax", "trackedParameters": {
    "connectivity": {"defaultValue": "8-neighbourhood", "value": "8-neighbourhood"}
  }}
}
{
  "name": "PSF: Integrated Gaussian",
  "crowdedField": {"parameters": {"trackedParameters": {
    "mfaenabled": {"defaultValue": false, "value": true}
  }}},
  "parameters": {"trackedParameters": {
    "fitradius": {"defaultValue": 3, "value": 5},
    "method": {"defaultValue": "Maximum likelihood", "value": "Maximum likelihood"},
    "sigma": {"defaultValue": 1.6, "value": 1.7}
  }}
}
Post-processing:
[
  {"name": "Filter", "options": "formula=[uncertainty<20]"},
  {"name": "Local density filter", "options": ""}
]
"""


def test_radial_symmetry_is_taken_over() -> None:
    read = protocol(analysisEstimator={"name": "Radial symmetry", "fittingRadius": 4})
    assert read.left_out == []
    taken = settings(read)["localise"]
    assert (taken.method, taken.fit_radius_px, taken.clip_at_border) == (
        "radial-symmetry",
        4,
        False,
    )


def test_radial_symmetry_goes_with_the_preset_of_the_paper() -> None:
    read = protocol(analysisEstimator={"name": "Radial symmetry", "fittingRadius": 4})
    paper = Layer("preset paper", PRESETS["paper"])
    taken = resolve(SECTIONS, [paper, Layer("protocol p", read.values)])["localise"]
    assert (taken.method, taken.uncertainty) == ("radial-symmetry", "bound")


@pytest.mark.parametrize("end", ["\n", "\r\n", "\r"])
def test_the_layout_of_release_1_3_is_read(end: str) -> None:
    content = RELEASE.replace("\n", end).encode()
    assert is_protocol(content)
    read = read_protocol(content, PATH)
    assert read.values["camera"] == {"offset_adu": 90.0, "gain_e_per_adu": 0.5}
    assert read.values["localise"] == {
        "wavelet_order": 4,
        "wavelet_scale": 2.5,
        "connectivity": 8,
        "threshold": "std(Wave.F1)",
        "method": "mle",
        "fit_radius_px": 5,
        "initial_sigma_px": 1.7,
        **PLUGIN,
        "max_emitters": 3,
    }
    assert read.values["quality"] == {"max_uncertainty_nm": 20.0}
    # What a step does not name has the plugin's default.
    assert read.values["density"] == {"radius_nm": 50.0, "min_neighbours": 5}
    assert [sentence.split(" is")[0] for sentence in read.left_out] == ["its multi-emitter fitting"]


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"analysisFilter": {"name": "Median filter"}}, "filter 'Median filter' does not exist"),
        (
            {"analysisDetector": {**DETECTOR, "name": "Non-maximum suppression"}},
            "detector 'Non-maximum suppression' does not exist",
        ),
        (
            {"analysisEstimator": {"name": "Centroid of connected components"}},
            "'Centroid of connected components' does not exist",
        ),
        ({"analysisEstimator": {**ESTIMATOR, "name": "PSF: Gaussian"}}, "sampled at the centres"),
        ({"analysisEstimator": {**ESTIMATOR, "method": "Guess"}}, "method 'Guess' is not known"),
        ({"analysisEstimator": {**ESTIMATOR, "fullImageFitting": True}}, "to the whole image"),
        (
            {"analysisEstimator": {**ESTIMATOR, "crowdedField": {**CROWDED, "mfaEnabled": True}}},
            "multi-emitter",
        ),
        ({"cameraSettings": {**CAMERA, "quantumEfficiency": 0.7}}, "efficiency of 0.7 is not used"),
        ({"cameraSettings": {**CAMERA, "isEmGain": True}}, "excess noise"),
        (
            {"cameraSettings": {**CAMERA, "pixelSize": 80, "photons2ADU": 3.6, "offset": 414}},
            "factory setting",
        ),
        (
            {"imageInfo": {"roiBounds": {"x": 3, "y": 4, "width": 50, "height": 60}}},
            "region of interest (3, 4, 50, 60)",
        ),
        ({"postProcessing": [{"name": "Merging", "options": "dist=20"}]}, "step 'Merging'"),
        (
            {
                "postProcessing": [
                    {"name": "Drift correction", "options": "method=[Fiducial markers]"}
                ]
            },
            "drift correction by 'Fiducial markers'",
        ),
        (
            {"postProcessing": [{"name": "Density filter", "options": "dimensions=3D"}]},
            "step 'Density filter'",
        ),
        (
            {"postProcessing": [{"name": "Filter", "options": "formula=[sigma > 80 & x < 5]"}]},
            "filter 'sigma > 80 & x < 5'",
        ),
        ({"analysisDetector": {**DETECTOR, "threshold": "std(DoG.G1)"}}, "uses DoG.G1"),
        ({"analysisDetector": {**DETECTOR, "threshold": "F > 3"}}, "signs that are not known"),
    ],
)
def test_what_has_no_counterpart_is_said_and_the_rest_taken(
    changes: dict[str, Any], sentence: str
) -> None:
    read = protocol(**changes)
    assert any(sentence in said for said in read.left_out), read.left_out
    assert len(read.left_out) == 1
    assert settings(read)["movie"].pixel_size_nm is not None


def test_an_em_gain_is_divided_out_and_its_read_noise_left_to_the_user() -> None:
    read = protocol(cameraSettings={**CAMERA, "isEmGain": True, "photons2ADU": 15.0, "gain": 300.0})
    assert read.values["camera"] == {"offset_adu": 100.0, "gain_e_per_adu": 0.05}


def test_values_out_of_bounds_are_named_by_the_protocol() -> None:
    read = protocol(
        cameraSettings={**CAMERA, "pixelSize": -5, "photons2ADU": 0},
        analysisEstimator={**ESTIMATOR, "fittingRadius": 99},
    )
    with pytest.raises(ConfigurationError) as caught:
        settings(read)
    assert len(caught.value.mistakes) == 3
    assert caught.value.mistakes[0].startswith("protocol p: [movie] pixel_size_nm must be greater")


@pytest.mark.parametrize(
    "formula",
    [
        "std(Wave.F1)",
        "2*std(Wave.F1)",
        "1.5 * std(Wave.F1) + mean(F)/2",
        "std(Wave.F1)+100",
        "100",
        "2.5e1",
        "(std(I) + max(Wave.F)) * 2",
        "sum(abs(Wave.F2))/1000 - 3",
        "var(F)",
        "std(F)*mean(I)/7",
    ],
)
@pytest.mark.parametrize("gain", [0.46, 15.62 / 300, 3.6])
def test_a_threshold_means_the_same_in_photons(formula: str, gain: float) -> None:
    rng = np.random.default_rng(3)
    adu = {name: rng.normal(5, 9, (12, 15)).astype(np.float32) for name in ("I", "F", "F1", "F2")}
    photons = {name: (plane * gain).astype(np.float32) for name, plane in adu.items()}
    ours, problem = in_photons(formula, gain)
    assert problem is None
    assert ours is not None
    theirs = float(parse_threshold(formula).value(adu))
    assert float(parse_threshold(ours).value(photons)) == pytest.approx(gain * theirs, rel=1e-5)


def test_a_formula_of_statistics_alone_stays_as_it_is() -> None:
    assert in_photons("2*std(Wave.F1)", None) == ("2*std(Wave.F1)", None)
    assert in_photons("100", None)[1] == (
        "is in ADU, and the protocol tells no gain: give --threshold in photons"
    )


def test_filters_give_the_strictest_bound_and_the_rest() -> None:
    assert largest_uncertainty("uncertainty<50") == (50.0, "")
    assert largest_uncertainty("(uncertainty_xy < 50) & uncertainty < 2e1") == (20.0, "")
    assert largest_uncertainty("uncertainty<50 & sigma>3") == (50.0, "sigma>3")
    assert largest_uncertainty("uncertainty<50 | sigma>3") == (None, "uncertainty<50 | sigma>3")
    read = protocol(
        postProcessing=[
            {"name": "Filter", "options": f"formula=[uncertainty_xy<{bound}]"}
            for bound in (40, 20, 30)
        ]
    )
    assert read.values["quality"] == {"max_uncertainty_nm": 20.0}


def test_a_protocol_is_told_from_toml() -> None:
    assert is_protocol(b'\xef\xbb\xbf \r\n{"version": 1}')
    assert not is_protocol(b"[localise]\n")
    assert not is_protocol(b"")


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"{", "cannot be read as a ThunderSTORM protocol"),
        (b"{}", "holds JSON but no ThunderSTORM protocol"),
        (b'{"xFunction": {"knots": [1, 2]}, "minFrame": 1}', "no ThunderSTORM protocol"),
        (b'{"cameraSettings": 3, "analysisFilter": []}', "no ThunderSTORM protocol"),
        (b'{"a":' * 100_000, "cannot be read"),
        (b'{"a": ' + b"9" * 10_000 + b"}", "cannot be read"),
        (b"ThunderSTORM (1.3)\n\nAnalysis:\n{nothing", "cannot be read"),
        (b"ThunderSTORM is a plugin", "no ThunderSTORM protocol"),
        (b"{\x00\xff", "cannot be read"),
    ],
)
def test_other_json_and_damage_is_refused(content: bytes, sentence: str) -> None:
    with pytest.raises(ConfigurationError, match=sentence) as caught:
        read_protocol(content, PATH)
    assert str(PATH) in str(caught.value)


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=9),
    lambda inner: (
        st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3)
    ),
    max_leaves=8,
)
PARTS = {
    "cameraSettings": CAMERA,
    "analysisFilter": FILTER,
    "analysisDetector": DETECTOR,
    "analysisEstimator": {**ESTIMATOR, "parameters": None},
}


@given(st.sampled_from(sorted(PARTS)), st.data())
def test_any_value_in_any_place_is_taken_said_or_refused(part: str, data: st.DataObject) -> None:
    key = data.draw(st.sampled_from(sorted(PARTS[part])))
    value = data.draw(JSON)
    changes = {part: {**PARTS[part], key: value}, "postProcessing": data.draw(JSON)}
    try:
        chosen = settings(protocol(**changes))
    except ConfigurationError:
        return
    assert chosen["localise"].method in ("lsq", "wlsq", "mle")


def test_reading_a_protocol_loads_the_standard_library_alone() -> None:
    program = """
import sys
import rotortrack.exchange.thunderstorm_protocol
assert not {"numpy", "pyarrow", "pandas", "pydantic"} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", program], check=True)
