"""The declaration of the pilot, read from an Ansible inventory and checked as a whole.

The inventory is plain YAML with final values, so that Ansible and this package read the same thing. `load` turns it
into frozen models and remembers the file and line of every value; every error of a pass is collected and told together.
Nothing downstream reads YAML.
"""
