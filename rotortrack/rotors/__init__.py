"""Rotors: clusters of localisations and the circles they trace."""
