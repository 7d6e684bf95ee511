"""One experiment a file: what a dial of the analysis costs in time and what it buys."""
