"""The far end of a measurement: answers test packets of STAMP (RFC 8762). Runs on a gateway and at the control centre.

Python 3.8 and the standard library alone: a gateway has Ubuntu 20.04. This folder goes there as it is, and
`python3 -m reflector` starts it beside it; here it is `python -m atlantis_netcfg.links.qualify.reflector`.
"""
