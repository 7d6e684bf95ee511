"""Tables of localisations in the formats of other programs."""
