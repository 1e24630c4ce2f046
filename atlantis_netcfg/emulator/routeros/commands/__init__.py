"""Command handlers of the router: each takes the core and a call, and returns rows, a value or console text."""
