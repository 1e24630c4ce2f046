"""How `provision check` meets people: what it shows them, what it asks, and when a program looks.

With a person at a terminal the checklist goes phase by phase: what a program sees by itself, then what needs a consent,
then what only a person sees. Without one, all that a program may look at is looked at together, and a file of answers
speaks for the people. Each result and each answer is in the book before the next one is sought.
"""
