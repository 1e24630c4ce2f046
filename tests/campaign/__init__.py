"""Random whole-site faults: a real `provision` meets twins that outlive it, and strangers judge what came of it."""
