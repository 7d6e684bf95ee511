"""Detection and fitting of spots."""
