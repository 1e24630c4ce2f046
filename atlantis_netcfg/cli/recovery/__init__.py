"""Commands for recovery: continue a run, or restore the state before it."""
