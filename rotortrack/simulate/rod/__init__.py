"""A discrete elastic rod in the field and flow of a nanopore: overdamped and inextensible."""
