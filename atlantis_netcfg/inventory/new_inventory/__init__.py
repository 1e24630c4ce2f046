"""A new inventory from a person's answers: what nobody has answered is left out, or written as a marked example."""
