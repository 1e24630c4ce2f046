"""All sites of a rehearsal, joined: packets go from computers through routers and links to the internet and back."""
