"""What every part uses: errors, exit codes, events, verdicts, secrets, versions, places of files, text for a screen."""
