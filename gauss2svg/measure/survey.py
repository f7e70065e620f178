"""One pass over an untrusted SVG: counts its elements and checks that it is safe to draw."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from gauss2svg.errors import InputError, brief
from gauss2svg.svg.syntax.parse import SVG, DoctypeError, Observer, ParseError, Root, parse
from gauss2svg.svg.syntax.references import References

_GROUP_MODE = "{http://www.inkscape.org/namespaces/inkscape}groupmode"


@dataclass(frozen=True)
class Survey:
    """Contents of an SVG.

    tags      number of elements by name, the commonest first; SVG's own by their local name,
              others as {namespace}name
    layers    groups that Inkscape shows as layers
    root      attributes of the root element
    qualified whether the root is in SVG's namespace, which browsers require
    """

    tags: dict[str, int]
    layers: int
    root: dict[str, str]
    qualified: bool

    @property
    def elements(self) -> int:
        """Number of elements."""
        return sum(self.tags.values())


def survey(text: str, most_elements: int, *observers: Observer) -> tuple[Survey, Root]:
    """Contents and root of an untrusted SVG, by one pass over it of which observers are told too.

    Raises InputError for XML that is malformed or defines entities, for links to anything
    outside of the file, for more than most_elements elements, and where the root is not svg.
    """
    census = _Census(most_elements)
    try:
        root = parse(text, census, References(), *observers, doctype="bare")
    except DoctypeError as error:
        raise InputError(
            "SVG must be a document that cannot expand; got a document type of its own. Try to "
            "re-save it as plain SVG"
        ) from error
    except (ParseError, UnicodeEncodeError) as error:
        raise InputError(
            f"SVG must be well-formed XML; got {brief(error)}. Try to re-save it"
        ) from error
    tags = dict(census.tags.most_common())
    return Survey(tags, census.layers, census.root, census.is_qualified), root


class _Census:
    """Counts elements, and refuses those that are too many or not of an SVG."""

    def __init__(self, most: int) -> None:
        self.tags: Counter[str] = Counter()
        self.layers = 0
        self.root: dict[str, str] = {}
        self.is_qualified = False
        self._most = self._left = most
        self._sheet = math.inf  # depth of the element before, if it is a style sheet

    def start(self, tag: str, attributes: dict[str, str], depth: int) -> None:
        name = tag.removeprefix(SVG)
        local = name.rpartition("}")[2]
        if not depth:
            if name != "svg":
                raise InputError(f"root element must be <svg>; got <{name[:80]}>")
            self.root, self.is_qualified = attributes, tag != name
        self._left -= 1
        if self._left < 0:
            raise InputError(
                f"SVG must be of at most {self._most} elements; got more. Try to raise "
                "--max-elements if you trust the file"
            )
        self.tags[name] += 1
        self.layers += attributes.get(_GROUP_MODE) == "layer"
        if depth > self._sheet:
            # Renderers disagree on which of its texts are the sheet.
            raise InputError(
                f"a style sheet in the SVG must be of text alone; got <{local[:80]}> in it. Try to "
                "save it as plain SVG"
            )
        self._sheet = depth if local == "style" else math.inf

    def sheet(self, text: str) -> None:
        pass
