"""First contact: from a box that comes out of its carton to a router that the engine can talk to.

What the device says on its own console is read, compared with the adopted state, and only what is missing is typed:
first everything that stands beside the way in use (user, certificate, api-ssl, management address), then, over the
management port and under safe mode, the default configuration goes, and last the factory's user. Because every run
reads before it types, a run that was cut anywhere is simply repeated. Trust begins at the console: the SSH host key is
pinned before a password is sent, the certificate by the fingerprint that the console prints, never by what TLS shows.
"""
