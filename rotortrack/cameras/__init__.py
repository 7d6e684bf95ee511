"""Cameras: counts to photo-electrons and back."""
