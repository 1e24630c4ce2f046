"""What a technician types when something went wrong: go on with a run, or put back what was before it."""
