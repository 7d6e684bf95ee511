"""rotortrack: from a fluorescence movie of nanoscale rotors to speeds with error bars."""
