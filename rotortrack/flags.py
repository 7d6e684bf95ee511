"""The registry of per-localisation flags: the one source of value, name and sentence."""

from __future__ import annotations

from enum import IntFlag


class FitFlag(IntFlag):
    """How a fit ended and what is special about its spot; 0 is a converged, plain fit.

    The first four members are ends of a fit; at most one of them is set. The others are remarks.
    """

    ITERATION_LIMIT = 1
    SINGULAR = 2
    LEFT_WINDOW = 4
    NOT_FINITE = 8
    AT_BOUND = 16
    SATURATED = 32
    MASKED_PIXELS = 64
    DUPLICATE = 128
    CLIPPED = 256
    JOINT = 512

    @property
    def sentence(self) -> str:
        """The meaning of a single flag, as shown to the user, with what to try."""
        return _SENTENCES[self]


FIT_FAILED = FitFlag.ITERATION_LIMIT | FitFlag.SINGULAR | FitFlag.LEFT_WINDOW | FitFlag.NOT_FINITE

_SENTENCES = {
    FitFlag.ITERATION_LIMIT: (
        "The fit did not settle within its iterations; the spot is probably two spots or noise, "
        "try a higher threshold."
    ),
    FitFlag.SINGULAR: (
        "The data do not determine all parameters; try a larger fit_radius_px or a higher "
        "threshold."
    ),
    FitFlag.LEFT_WINDOW: (
        "The fitted position left the fit window; the candidate was probably the flank of a "
        "neighbour."
    ),
    FitFlag.NOT_FINITE: "The fit window holds no usable numbers; check the camera settings.",
    FitFlag.AT_BOUND: "The background reached zero, so its error is one-sided.",
    FitFlag.SATURATED: (
        "A pixel of the window is saturated, so photons and width are unreliable; lower the "
        "exposure or the laser power."
    ),
    FitFlag.MASKED_PIXELS: "Pixels without a number in the window were left out of the fit.",
    FitFlag.DUPLICATE: (
        "Another localisation of the same rotor and frame was used instead of this one."
    ),
    FitFlag.CLIPPED: "The fit window reached beyond the frame and was fitted by the part inside.",
    FitFlag.JOINT: (
        "One spot alone did not explain the window, so two or three were fitted together; their "
        "errors allow for that."
    ),
}
