"""Entries of annotations, and those of lmoc's own: ``annotation(__lmoc(name = value))``."""

from __future__ import annotations

from lmoc.syntax import tree


def vendor_entry(annotation: tree.Modification | None, name: str) -> tree.Expression | None:
    """The value of an entry of ``__lmoc(…)``, None where there is no such entry."""
    for vendor in annotation.arguments if annotation else ():
        if isinstance(vendor, tree.ElementModification) and vendor.name == ("__lmoc",) and vendor.modification:
            for entry in vendor.modification.arguments:
                if getattr(entry, "name", None) == (name,) and entry.modification is not None:
                    return entry.modification.value
    return None


def entry_of(annotation: tree.Modification | None, name: str) -> tree.ElementModification | None:
    """Return the entry of that name in an annotation, None where there is none."""
    for argument in annotation.arguments if annotation else ():
        if isinstance(argument, tree.ElementModification) and argument.name == (name,):
            return argument
    return None
