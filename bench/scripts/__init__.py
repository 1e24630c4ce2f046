"""What peers run, in the strangers' Python: programs that know nothing of us but one JSON file, given as argument."""
