"""Records that outlive a run, and their pages: as-built state, measured links, survey results by position."""
