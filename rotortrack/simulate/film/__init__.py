"""Films of rotors: what stands before the microscope, its light, and the camera that records it."""
