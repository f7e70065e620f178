"""Names of files that every system has."""

import os
import re


def possible(name: str) -> str:
    """A name, on Windows without the characters that no file may have in its name there."""
    return re.sub(r'[<>:"|?*\n]', "", name) if os.name == "nt" else name
