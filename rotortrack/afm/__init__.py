"""Rods in images of an atomic force microscope: where they run, how long and how stiff they are."""
