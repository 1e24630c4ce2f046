"""`provision` in the technician's shell: completion of a line by Tab, and the manual page."""
