"""Corrections of a table of localisations: quality, drift, density."""
