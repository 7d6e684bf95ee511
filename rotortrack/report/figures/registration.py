"""How two colours lie on each other: the warped overlay, and what beads miss each other by."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from rotortrack.report import style
from rotortrack.report.figures import canvas
from rotortrack.twocolour.registration import Registration

Floats = NDArray[np.float64]

_WIDTH_IN = 4.2
_BRIGHT = 99.8
_ARROW_PART = 0.06


@canvas.in_house_style
def overlay(registration: Registration, images: tuple[Floats, Floats]) -> Figure:
    """Draw the first colour in magenta and the second, warped onto it, in green: white where both.

    Parameters
    ----------
    registration
        The map.
    images
        Mean image of each colour's region, counts.
    """
    first, second = images
    warped = _warped(registration, second, first.shape)
    height, width = first.shape
    tall = _WIDTH_IN * height / width
    made = canvas.new_figure(2.0 * _WIDTH_IN + 1.6, tall + 1.3)
    canvas.heading(made, f"Second colour on the first: {registration.model}", 0.3)
    pixel_um = registration.pixel_size_nm / 1e3
    left, top = (edge * pixel_um for edge in registration.regions[0][:2])
    extent = (left, left + width * pixel_um, top + height * pixel_um, top)
    plain = second[:height, :width]
    for number, (title, other) in enumerate((("as filmed", plain), ("registered", warped))):
        axes = canvas.place(made, 0.7 + number * (_WIDTH_IN + 0.6), 0.5, _WIDTH_IN, tall)
        red, green = _stretched(first), _stretched(other)
        axes.imshow(np.stack([red, green, red], axis=-1), extent=extent, interpolation="nearest")
        axes.set_title(title)
        axes.set_xlabel("x (µm)")
        if not number:
            axes.set_ylabel("y (µm)")
    return made


@canvas.in_house_style
def residuals(registration: Registration) -> Figure:
    """Draw what the map without each bead misses it by, over the map's expected error."""
    beads, errors = registration.beads, registration.errors
    _, _, width, height = registration.regions[0]
    tall = _WIDTH_IN * height / width
    made = canvas.new_figure(_WIDTH_IN + 2.2, tall + 1.5)
    canvas.heading(
        made,
        f"{registration.n_beads - registration.n_outliers} beads: target error "
        f"{registration.target_error_nm:.1f} nm, bead noise {registration.bead_noise_nm:.1f} nm",
        0.3,
    )
    axes = canvas.place(made, 0.7, 0.5, _WIDTH_IN, tall)
    edges = [errors.x_nm[0], errors.x_nm[-1], errors.y_nm[-1], errors.y_nm[0]]
    picture = axes.imshow(
        errors.sd_nm,
        extent=tuple(np.array(edges) / 1e3),
        origin="upper",
        cmap="Blues",
        vmin=0.0,
        interpolation="bilinear",
    )
    used = beads.used
    places, missed = beads.first_nm[used] / 1e3, beads.left_out_nm[used]
    largest = float(np.percentile(np.hypot(*missed.T), 95)) if len(missed) else 1.0
    field_um = width * registration.pixel_size_nm / 1e3
    scale = max(largest, 1e-9) / (_ARROW_PART * field_um)
    arrows = axes.quiver(
        places[:, 0],
        places[:, 1],
        missed[:, 0],
        missed[:, 1],
        angles="xy",
        scale_units="xy",
        scale=scale,
        color=style.BLACK,
        width=0.004,
    )
    axes.quiverkey(
        arrows, 0.12, 1.04, largest, f"{largest:.0f} nm", labelpos="E", coordinates="axes"
    )
    lost = beads.first_nm[~used] / 1e3
    if len(lost):
        axes.plot(lost[:, 0], lost[:, 1], "x", color=style.ORANGE, markersize=5, label="mismatched")
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0))
    axes.set_xlim(edges[0] / 1e3, edges[1] / 1e3)
    axes.set_ylim(edges[2] / 1e3, edges[3] / 1e3)
    axes.set_xlabel("x (µm)")
    axes.set_ylabel("y (µm)")
    bar = canvas.place(made, 0.7 + _WIDTH_IN + 0.2, 0.5, 0.15, tall)
    made.colorbar(picture, cax=bar)
    bar.set_title("error (nm)", loc="left")
    return made


def _warped(registration: Registration, second: Floats, shape: tuple[int, ...]) -> Floats:
    """Give the second colour's image on the pixels of the first."""
    from skimage.transform import warp

    pixel_nm = registration.pixel_size_nm
    corners = [np.array(region[:2], np.float64) for region in registration.regions]

    def back(columns_rows: Floats) -> Floats:
        # skimage counts from the centre of the first pixel.
        places = (columns_rows + 0.5 + corners[0]) * pixel_nm
        there: Floats = registration.to_second(places) / pixel_nm - corners[1] - 0.5
        return there

    image: Floats = warp(second, back, output_shape=shape[:2], order=1, mode="edge")
    return image


def _stretched(image: Floats) -> Floats:
    """Stretch counts from the background to the brightest beads over 0 to 1."""
    low, high = np.median(image), np.percentile(image, _BRIGHT)
    stretched: Floats = np.clip((image - low) / max(high - low, 1e-9), 0.0, 1.0)
    return stretched
