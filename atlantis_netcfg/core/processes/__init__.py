"""Local processes, and programs on other computers: starting, reading, stopping."""
