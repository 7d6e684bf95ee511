"""The columns of the table of rods in an image of an atomic force microscope."""

from __future__ import annotations

from rotortrack.tables import Column, Schema

CONTOURS = Schema(
    "contours",
    (
        Column("rod", "int64", "", "number of the rod, from 0", required=True),
        Column("x_nm", "float64", "nm", "its middle along columns", required=True),
        Column("y_nm", "float64", "nm", "its middle along rows, down", required=True),
        Column("contour_nm", "float64", "nm", "length along the rod, calibrated if asked for"),
        Column("end_to_end_nm", "float64", "nm", "distance of its ends"),
        Column("height_nm", "float64", "nm", "median height above the ground beside it"),
        Column("width_nm", "float64", "nm", "width in the image at half height"),
        Column("branches", "int64", "", "side branches that were left out, such as a leash"),
        Column("verdict", "str", "", "kept or refused"),
        Column("reason", "str", "", "why it was refused, empty when kept"),
    ),
)
"""Lengths of what is no single line, such as crossing rods, or not whole, are absent."""
