"""Two colours: registration of the second onto the first."""
