"""What every part uses: errors and exit codes, events, verdicts, secrets, versions, places of files, and text for a screen."""
