"""Drift correction."""
