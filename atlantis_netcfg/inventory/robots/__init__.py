"""Robots of the pilot: their configuration files, checked before a robot meets the control centre.

The report describes such a file by the meaning of its parts (3.3.1); its examples are lost. The keys here are ours, and
an inventory declares how its partners call them (`robots/keys.yml`). A partner's file is data: nothing of it is run.
"""
