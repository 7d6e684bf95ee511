"""The comparison with the truth is drawn of films that have few kinds of rotors, or none."""

from __future__ import annotations

import warnings

import pandas as pd
import pytest

from rotortrack.report.figures import closed_loop

_NUMBERS = (
    *("mean_omega_rad_s", "found_omega_rad_s", "found_omega_sd_rad_s"),
    *("diffusion_rad2_s", "found_diffusion_rad2_s", "radius_nm", "found_radius_nm"),
)


@pytest.mark.parametrize(
    ("motions", "counts"), [([], {}), (["stuck", "stuck"], {"stuck": {"refused": 2}})]
)
def test_films_without_moving_rotors_are_drawn(motions, counts):
    table = pd.DataFrame({"motion": motions, "found_verdict": "refused", "double": False})
    table = table.assign(**dict.fromkeys(_NUMBERS, 1.0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made = closed_loop.figure({"default": table}, {"default": counts}, {"default": counts})
    written = {text.get_text() for axes in made.axes for text in axes.texts}
    assert written == ({"2"} if motions else set())
