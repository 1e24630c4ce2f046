"""Processes of this computer and programs on others: started, read, stopped."""
