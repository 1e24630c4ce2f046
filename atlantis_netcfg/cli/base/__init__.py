"""Parts shared by all commands: arguments, the session with a site, prompts, and output."""
