"""Simulated rotors and the movies of them."""
