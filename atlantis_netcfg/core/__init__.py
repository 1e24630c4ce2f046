"""Shared basics: errors, exit codes, events, verdicts, secrets, versions, paths, terminal text."""
