"""The published analysis, stage by stage, and the run folder."""
