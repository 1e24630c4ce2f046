"""Configuration files of the pilot's robots, checked before a robot connects to the control centre.

The report describes such a file by the meaning of its parts (3.3.1); its examples are lost. The keys here are this
project's own; an inventory maps them to the partners' key names (`robots/keys.yml`). A partner's file is data: nothing
in it is executed.
"""
