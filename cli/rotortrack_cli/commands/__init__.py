"""One file a command; each exposes `command` and is imported only when it is called."""
