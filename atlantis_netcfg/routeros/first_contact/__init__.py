"""First contact: from a factory-new router to one that the engine can manage.

The state shown on the device's console is compared with the adopted state, and only missing parts are typed. First
comes everything that does not affect the current access (user, certificate, api-ssl, management address). Then, over
the management port and under safe mode, the default configuration is removed, and last the factory user. Because every
run reads before it types, an interrupted run is simply repeated. Trust begins at the console: the SSH host key is
pinned before a password is sent, the certificate by the fingerprint that the console prints, never by what TLS shows.
"""
