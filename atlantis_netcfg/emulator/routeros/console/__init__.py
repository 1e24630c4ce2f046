"""The console language, as far as it is emulated; everything else is a `syntax error`."""
