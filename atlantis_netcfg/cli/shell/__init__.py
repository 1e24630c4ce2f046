"""Shell integration of `provision`: completion by Tab, and the manual page."""
