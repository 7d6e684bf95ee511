"""Motion of rotors: angles, speeds, diffusion, behaviour."""
