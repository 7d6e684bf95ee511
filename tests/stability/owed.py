"""Routines without hard cases yet; the list may only get shorter."""

OWED: frozenset[str] = frozenset()
