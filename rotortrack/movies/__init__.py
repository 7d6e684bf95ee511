"""Movies: lazy stacks of frames and what their files say of themselves."""
