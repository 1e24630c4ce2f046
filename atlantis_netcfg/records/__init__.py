"""Records that outlive a run, and their pages: what is built, what links carried, what a survey heard by position."""
