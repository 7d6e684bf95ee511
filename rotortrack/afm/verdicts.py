"""Why something in an image is not measured."""

from __future__ import annotations

from enum import Enum

KEPT, REFUSED = "kept", "refused"


class Reason(Enum):
    """Why a rod is refused; the value is the code in the table.

    What fails several tests gets the first reason in this order.
    """

    BORDER = "border"
    RING = "ring"
    CROSSING = "crossing"
    TOO_SHORT = "too_short"
    TOO_WIDE = "too_wide"
    OTHER_HEIGHT = "other_height"
    UNEVEN = "uneven"
    KINK = "kink"
    OTHER_LENGTH = "other_length"

    @property
    def sentence(self) -> str:
        """The meaning of the code, as shown to the user."""
        return _SENTENCES[self]


_SENTENCES = {
    Reason.BORDER: "It reaches the border of the image: a part of it may be outside.",
    Reason.CROSSING: "Rods cross, touch or branch: which part belongs to which is not told.",
    Reason.RING: "It has no ends.",
    Reason.TOO_SHORT: "It is too short for a rod (min_length_nm): debris, or a fragment.",
    Reason.TOO_WIDE: "It is wider than other rods (max_width_ratio): several abreast, or dirt.",
    Reason.OTHER_HEIGHT: "It is much higher or lower than other rods (max_height_ratio).",
    Reason.UNEVEN: "A part of it is much higher than the rest: dirt on it, or it lies on itself.",
    Reason.KINK: "It has a kink that no thermal bending gives (max_kink_sd): rods end to end.",
    Reason.OTHER_LENGTH: (
        "Its length differs from the commonest one (max_length_error): broken, or several in a row."
    ),
}
