"""What every command that works on a site shares: its request, the devices' jobs, links, costs, and the rehearsal."""
