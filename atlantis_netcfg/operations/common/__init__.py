"""Code shared by all commands for a site: the request, device jobs, links, costs, and the rehearsal."""
