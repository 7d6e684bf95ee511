"""Options of detection and fitting."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from rotortrack.settings import Options, option


@dataclass(frozen=True, kw_only=True)
class LocaliseOptions(Options):
    """Wavelet filter, threshold, candidates and fits.

    Examples
    --------
    >>> import rotortrack as rt
    >>> rt.LocaliseOptions().method
    'mle'
    >>> rt.LocaliseOptions(method="wlsq", fit_radius_px=4).fit_radius_px
    4
    """

    wavelet_order: int = option(3, "order q of the B-spline", ge=1, le=10)
    wavelet_scale: float = option(2.0, "scale l of the B-spline, pixels", gt=0, le=10)
    threshold: float | str = option(
        "5.5*noise(Wave.F)",
        "photons of a candidate in the filtered plane: a number or a formula",
    )
    connectivity: Literal[4, 8] = option(8, "neighbours of a local maximum")
    fit_radius_px: int = option(3, "the fit window reaches this far from its centre", ge=2, le=15)
    clip_at_border: bool = option(
        True, "fit spots at the frame's border by the part of the window inside, or leave them out"
    )
    initial_sigma_px: float = option(1.6, "width at which fits start, pixels", gt=0.2, le=10)
    fit_sigma: bool = option(True, "fit the width, or keep initial_sigma_px")
    method: Literal["mle", "wlsq", "lsq", "phasor", "radial-symmetry", "centroid"] = option(
        "mle", "what a fit minimises, or a quick estimate without a fit"
    )
    correct_bias: bool = option(True, "subtract the bias that likelihood fits have at few photons")
    max_emitters: Literal[1, 2, 3] = option(
        3, "most overlapping spots fitted together; 1 fits each alone"
    )
    uncertainty: Literal["bound", "thunderstorm-2014", "thunderstorm-2016"] = option(
        "bound", "uncertainty_nm from the fit's own bound or from the plugin's formulas"
    )
    shift_negative_frames: bool = option(
        False, "raise a frame that has negative pixels until its minimum is 0, as the plugin does"
    )
