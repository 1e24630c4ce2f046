"""What every command is made of: its arguments, its session with a site, its questions, and what it prints."""
