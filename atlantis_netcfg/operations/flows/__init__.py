"""Whether a site's router lets through what the inventory intends, and nothing else: tried with packets."""
