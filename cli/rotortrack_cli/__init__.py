"""The command line of rotortrack: it reads flags, calls the library and prints."""
