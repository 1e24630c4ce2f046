"""The examples of the unit tests are what is looked at here as well; they are taken from where they stand."""

import checklist_example as made
from checklist_marks import marked
from checklist_strategies import SHORT, documents, hostile

__all__ = ["SHORT", "documents", "hostile", "made", "marked"]
