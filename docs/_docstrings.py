"""Docstrings as the site shows them: a shape and a unit in brackets are no link."""

import re
from typing import Any

import griffe

__all__ = ["Brackets"]


class Brackets(griffe.Extension):
    """Keep Markdown from reading ``[field] [s]`` as a link."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Put a backslash before the second bracket."""
        if obj.docstring is not None:
            obj.docstring.value = re.sub(r"\](\s)\[", r"]\1\\[", obj.docstring.value)
