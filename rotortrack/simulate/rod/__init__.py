"""The elastic rod: forces, steps, ends and what is seen of it."""
