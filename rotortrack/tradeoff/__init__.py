"""What accuracy costs in time, and how far the analysis agrees with known truth."""
