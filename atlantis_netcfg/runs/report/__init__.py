"""What is shown of a run, made from its results alone: text for a person, JSON for a program."""
