"""The wire of a router twin: RouterOS API over TCP and TLS, with the bearer and the faults in between."""
