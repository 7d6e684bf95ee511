"""ThunderSTORM's measurement protocol (``NAME-protocol.txt``) as a starting configuration.

The plugin's builds after its release 1.3 write one JSON object; release 1.3 writes its name and
then JSON values under headings. Both hold the camera set-up, the filter, the detector, the
estimator and the history of post-processing. What has a counterpart here becomes values of our
options; everything else that would change a result is named in a sentence. The plugin's own formula
of the uncertainty and its handling of negative frames are in no protocol: the preset ``paper`` has
them. Layout after files that the plugin wrote; only the standard library is loaded.
"""

from __future__ import annotations

import codecs
import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rotortrack.errors import ConfigurationError
from rotortrack.exchange.thunderstorm_formula import in_photons, largest_uncertainty

_METHODS = {
    "least squares": "lsq",
    "weighted least squares": "wlsq",
    "maximum likelihood": "mle",
}
_PARTS = ("cameraSettings", "analysisFilter", "analysisDetector", "analysisEstimator")
_HEADING = re.compile(r"^([A-Z][A-Za-z -]*):[ \t]*$", re.MULTILINE)
_OPTION = re.compile(r"(\w+)=(?:\[([^\]]*)\]|(\S+))")
_FACTORY = {"pixelSize": 80.0, "photons2ADU": 3.6, "offset": 414.0}
_EM_EXCESS = 1.4
_LONGEST = 1_000
_MOST_SENTENCES = 20


@dataclass
class Protocol:
    """What a protocol means here.

    Attributes
    ----------
    values
        Values of our options by section and key, of the right kind but not checked against bounds.
    left_out
        One sentence for each thing that has no counterpart here, or that is doubtful.
    """

    values: dict[str, dict[str, Any]] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)

    def take(self, section: str, **values: Any) -> None:
        """Set the values that are known."""
        known = {key: value for key, value in values.items() if value is not None}
        self.values.setdefault(section, {}).update(known)


def is_protocol(content: bytes) -> bool:
    """Tell a protocol from TOML, in which no file begins with a brace or with the plugin's name."""
    head = content.removeprefix(codecs.BOM_UTF8).lstrip()
    return head.startswith((b"{", b"ThunderSTORM"))


def read_protocol(content: bytes, path: Path) -> Protocol:
    """Understand the content of a protocol.

    Parameters
    ----------
    content
        The file, in either layout.
    path
        Where it comes from, for the sentences.

    Raises
    ------
    ConfigurationError
        It is not JSON, or not a protocol of ThunderSTORM.
    """
    try:
        # Java writes in the encoding of its system; only titles and paths are not ASCII.
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    try:
        parts = json.loads(text) if text.lstrip().startswith("{") else _sections(text)
    except (ValueError, RecursionError) as error:
        raise ConfigurationError(
            f"{path} cannot be read as a ThunderSTORM protocol ({str(error)[:100]}): export it "
            "again, or give a TOML file"
        ) from error
    if not any(isinstance(parts.get(name), dict) for name in _PARTS):
        raise ConfigurationError(
            f"{path} holds JSON but no ThunderSTORM protocol, which has {', '.join(_PARTS)}: give "
            "the file NAME-protocol.txt that the plugin wrote beside its table, or a TOML file"
        )
    protocol = Protocol()
    camera, spot_filter, detector, estimator = (_mapping(parts.get(name)) for name in _PARTS)
    gain = _camera(protocol, camera)
    _filter(protocol, spot_filter)
    _detector(protocol, detector, gain)
    _estimator(protocol, estimator)
    for step in _steps(parts.get("postProcessing")):
        _post_processing(protocol, _mapping(step))
    region = _mapping(_mapping(parts.get("imageInfo")).get("roiBounds"))
    if region:
        numbers = ", ".join(str(_whole(region.get(key))) for key in ("x", "y", "width", "height"))
        protocol.left_out.append(
            f"its region of interest ({numbers}) belongs to one movie: give --region if it holds "
            "for this one"
        )
    protocol.left_out = list(dict.fromkeys(protocol.left_out))[:_MOST_SENTENCES]
    return protocol


def _sections(text: str) -> dict[str, Any]:
    """Read the layout of release 1.3: headings, each with JSON values below."""
    _, *pieces = _HEADING.split(text)
    found = {
        name: list(_json_values(piece))
        for name, piece in zip(pieces[::2], pieces[1::2], strict=True)
    }
    analysis = found.get("Analysis", [])
    names = dict(zip(_PARTS[1:], analysis, strict=False))
    return {
        "imageInfo": next(iter(found.get("Input", [])), None),
        "cameraSettings": next(iter(found.get("Camera settings", [])), None),
        "postProcessing": found.get("Post-processing", []),
        **names,
    }


def _json_values(text: str) -> Iterator[Any]:
    decoder = json.JSONDecoder()
    position = 0
    while position < len(text):
        if text[position].isspace() or text[position] == ",":
            position += 1
            continue
        value, position = decoder.raw_decode(text, position)
        yield value


def _camera(protocol: Protocol, camera: Mapping[str, Any]) -> float | None:
    """Take the camera over; give its electrons per count, which thresholds need."""
    protocol.take("movie", pixel_size_nm=_number(camera, "pixelSize"))
    gain = _number(camera, "photons2ADU")
    em_gain = _number(camera, "gain")
    read_noise = _number(camera, "readoutNoise")
    if camera.get("isEmGain") is True:
        if gain is not None and em_gain:
            gain /= em_gain
        read_noise = None
        protocol.left_out.append(
            f"its camera has an EM gain of {em_gain}, which is divided out, but the excess noise "
            "of electron multiplication is not modelled here: uncertainties come out up to "
            f"{_EM_EXCESS} times too small"
        )
    protocol.take(
        "camera",
        offset_adu=_number(camera, "offset"),
        gain_e_per_adu=gain,
        read_noise_e=read_noise,
    )
    efficiency = _number(camera, "quantumEfficiency")
    if efficiency not in (None, 1.0):
        protocol.left_out.append(
            f"its quantum efficiency of {efficiency:g} is not used: photons are detected "
            "photo-electrons here, so numbers of photons are smaller by that factor"
        )
    if all(_number(camera, name) == value for name, value in _FACTORY.items()):
        protocol.left_out.append(
            "its pixel size, gain and offset are the plugin's factory setting and probably not "
            "those of the camera: give --pixel-size-nm, --gain-e-per-adu and --offset-adu"
        )
    return gain


def _filter(protocol: Protocol, spot_filter: Mapping[str, Any]) -> None:
    name = spot_filter.get("name")
    if name != "Wavelet filter (B-Spline)":
        if name is not None:
            protocol.left_out.append(
                f"its filter {_quoted(name)} does not exist here: spots are sought in the wavelet "
                "plane"
            )
        return
    protocol.take(
        "localise",
        wavelet_order=_whole(_field(spot_filter, "order", "order")),
        wavelet_scale=_as_number(_field(spot_filter, "scale", "scale")),
    )


def _detector(protocol: Protocol, detector: Mapping[str, Any], gain: float | None) -> None:
    name = detector.get("name")
    if name not in (None, "Local maximum"):
        protocol.left_out.append(
            f"its detector {_quoted(name)} does not exist here: candidates are local maxima"
        )
    if name == "Local maximum":
        # A number in the file; "8-neighbourhood" where it comes from a macro.
        connectivity = _field(detector, "connectivity", "connectivity")
        if isinstance(connectivity, str):
            connectivity = int(connectivity[:1]) if connectivity[:1] in ("4", "8") else None
        protocol.take("localise", connectivity=_whole(connectivity))
    threshold = _field(detector, "threshold", "threshold")
    if threshold is None:
        return
    ours, problem = in_photons(str(threshold), gain)
    protocol.take("localise", threshold=ours)
    if problem:
        protocol.left_out.append(f"its threshold {_quoted(threshold)} {problem}")


def _estimator(protocol: Protocol, estimator: Mapping[str, Any]) -> None:
    name = estimator.get("name")
    if name is None:
        return
    if name == "Radial symmetry":
        # The plugin's formulas of the uncertainty need a width, which it does not get here.
        protocol.take(
            "localise",
            method="radial-symmetry",
            fit_radius_px=_whole(_field(estimator, "fittingRadius", "fitradius")),
            clip_at_border=False,
            uncertainty="bound",
        )
        return
    if name not in ("PSF: Integrated Gaussian", "PSF: Gaussian"):
        protocol.left_out.append(
            f"its estimator {_quoted(name)} does not exist here: spots are fitted by an integrated "
            "Gaussian"
        )
        return
    if name == "PSF: Gaussian":
        protocol.left_out.append(
            "its Gaussian is sampled at the centres of pixels: here it is integrated over them"
        )
    method = _field(estimator, "method", "method")
    ours = _METHODS.get(str(method).lower())
    if ours is None and method is not None:
        protocol.left_out.append(f"its fitting method {_quoted(method)} is not known")
    protocol.take(
        "localise",
        method=ours,
        fit_radius_px=_whole(_field(estimator, "fittingRadius", "fitradius")),
        initial_sigma_px=_as_number(_field(estimator, "initialSigma", "sigma")),
    )
    crowded = _mapping(estimator.get("crowdedField"))
    several = _field(crowded, "mfaEnabled", "mfaenabled") is True
    if several:
        protocol.left_out.append(
            "its multi-emitter fitting is another one here: up to three spots are fitted together "
            "where the likelihood asks for them"
        )
    # The plugin leaves out what reaches beyond the frame and corrects no bias.
    protocol.take(
        "localise", clip_at_border=False, correct_bias=False, max_emitters=3 if several else 1
    )
    if _field(estimator, "fullImageFitting", "full_image_fitting") is True:
        protocol.left_out.append(
            "its fitting of one spot to the whole image does not exist here: every candidate is "
            "fitted in its window"
        )


def _post_processing(protocol: Protocol, step: Mapping[str, Any]) -> None:
    """Take one step of the history over; what a step does not name has the plugin's default."""
    name = str(step.get("name", ""))
    options = {
        key: bracketed or plain
        for key, bracketed, plain in _OPTION.findall(str(step.get("options"))[:_LONGEST])
    }
    word = name.lower()
    if "drift" in word:
        _drift(protocol, options)
    elif "density" in word and options.get("dimensions", "2D") == "2D":
        protocol.take(
            "density",
            radius_nm=_as_number(options.get("radius", "50")),
            min_neighbours=_whole(options.get("neighbors", "5")),
        )
    elif word == "filter" and "formula" in options:
        bound, rest = largest_uncertainty(options["formula"])
        if bound is not None:
            before = protocol.values.get("quality", {}).get("max_uncertainty_nm", bound)
            protocol.take("quality", max_uncertainty_nm=min(bound, before))
        if rest:
            protocol.left_out.append(f"its filter {_quoted(rest)} does not exist here")
    else:
        protocol.left_out.append(f"its step {_quoted(name)} does not exist here")


def _drift(protocol: Protocol, options: Mapping[str, str]) -> None:
    method = options.get("method", "Cross correlation")
    if method.lower() != "cross correlation":
        protocol.left_out.append(
            f"its drift correction by {_quoted(method)} does not exist here: drift is estimated by "
            "cross-correlation"
        )
        return
    protocol.take(
        "drift",
        method="cross-correlation",
        bins=_whole(options.get("steps", "5")),
        magnification=_as_number(options.get("magnification", "5")),
        smoothing=_as_number(options.get("ccSmoothingBandwidth", "0.25")) or None,
    )


def _steps(history: Any) -> list[Any]:
    """List the steps, which lie in one array or follow one another."""
    steps = history if isinstance(history, list) else []
    return [part for step in steps for part in (step if isinstance(step, list) else [step])]


def _field(part: Mapping[str, Any], name: str, macro: str) -> Any:
    """Look for a value under its name, or among the parameters that release 1.3 writes."""
    if name in part:
        return part[name]
    tracked = _mapping(_mapping(part.get("parameters")).get("trackedParameters"))
    return _mapping(tracked.get(macro)).get("value")


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _number(part: Mapping[str, Any], name: str) -> float | None:
    return _as_number(part.get(name))


def _as_number(value: Any) -> float | None:
    try:
        return None if value is None or isinstance(value, bool) else float(value)
    except (TypeError, ValueError, OverflowError):
        return None


def _whole(value: Any) -> int | None:
    number = _as_number(value)
    return int(number) if number is not None and number.is_integer() else None


def _quoted(text: object) -> str:
    return repr(str(text)[:80])
