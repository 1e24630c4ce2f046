"""What the router's commands do. A handler takes the core and a call, and returns rows, a value or console text."""
