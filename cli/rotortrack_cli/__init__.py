"""The command line of rotortrack."""
