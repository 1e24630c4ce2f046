"""Reports of a run, generated from its results only: text for the user, JSON for programs."""
