"""The console's language, as far as the twin rehearses it; everything outside that subset is a `syntax error`."""
