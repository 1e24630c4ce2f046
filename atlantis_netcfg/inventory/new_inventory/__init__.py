"""A new inventory from a person's answers; missing answers are omitted, or become marked examples."""
