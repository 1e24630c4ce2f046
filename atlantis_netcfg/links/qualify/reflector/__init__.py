"""The far end of a measurement: reflects STAMP test packets (RFC 8762) on a gateway or at the control centre.

Python 3.8 and the standard library alone: a gateway has Ubuntu 20.04. This folder is copied there unchanged, and
`python3 -m reflector` starts it from its parent; here it is `python -m atlantis_netcfg.links.qualify.reflector`.
"""
