"""What breaks where a file is taken to: rules as data, each with its source.

A rule that was tried was seen in the program itself; the others were read, and one without a
source is a caution. What renderers draw wrongly they state themselves (CANNOT_DRAW of
gauss2svg.raster), for the places that are drawn by one of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

from gauss2svg.measure.contents import Contents
from gauss2svg.measure.survey import MOST_ELEMENTS, survey
from gauss2svg.options import OneOf, Place, byte_size
from gauss2svg.raster import renderer_named
from gauss2svg.raster.features import Feature, Features
from gauss2svg.svg.syntax.source import MOST_BYTES, SvgSource, svg_source

PLACES: tuple[str, ...] = get_args(Place)
# Places that are drawn by a renderer of ours, of which the version is that of the page.
_DRAWN_BY = {"inkscape": "inkscape", "pdf": "cairo"}
_MEASURED = "docs/decisions/renderers.md"
_BLACK = "shapes that it colours turn black"


@dataclass(frozen=True)
class Rule:
    """A thing that goes wrong in a place.

    uses    what a file has: an element, a Feature, or a count of `Contents`
    reason  what happens then, and what to do
    source  where that is said, or measured; "" where no page was found that says so
    tried   whether it was seen in the program
    over    the largest number of it that does no harm
    breaks  whether the picture is wrong; else it is slow
    """

    place: Place
    uses: str
    reason: str
    source: str
    tried: bool = False
    over: int = 0
    breaks: bool = True

    @property
    def evidence(self) -> str:
        """How it is known."""
        if self.tried:
            return "tried"
        return "read, not tried" if self.source else "not tried, no source"


_SHEETS = "https://github.com/scratchblocks/scratchblocks/issues/504"
_CURRENT = "https://github.com/penpot/penpot/issues/2276"
_FOREIGN = "https://github.com/riccardoperra/codeimage/issues/639"
_GMAIL = "https://emailens.dev/email-css/clients/gmail-web"
_PAINT = "docs/benchmarks/paint.md"
RULES: tuple[Rule, ...] = (
    Rule("figma", "style sheet", f"its cascade is not resolved: {_BLACK}", _SHEETS),
    Rule("figma", "currentColor", "it becomes black. Try a colour", _CURRENT),
    Rule("figma", "use", "it may not be resolved. Try copies in its place", ""),
    Rule("figma", "mask", "it may be dropped or flattened. Try --markup editable", ""),
    Rule("figma", "foreignObject", "it is left out, and the picture may be empty", _FOREIGN),
    Rule(
        "penpot", "bytes", "larger files failed to import. Try --max-bytes 360k",
        "https://github.com/penpot/penpot/issues/613", over=360_000,
    ),
    Rule(
        "penpot", "stops of a gradient", "later ones are dropped. Try --stops 8",
        "https://github.com/penpot/penpot/pull/6438", over=16,
    ),
    Rule(
        "penpot", Feature.FILTER, "it may be drawn wrongly, and cannot be edited",
        "https://github.com/penpot/penpot/issues/5414",
    ),
    Rule(
        "illustrator", Feature.PLAIN_HREF, "it is not followed. Try --markup editable",
        "https://github.com/kozakdenys/qr-code-styling/pull/281",
    ),
    Rule(
        "illustrator", "mask", "it is not drawn. Try --markup editable",
        "https://github.com/yairchu/svg-simplify",
    ),
    Rule("illustrator", "foreignObject", "it is left out, and the picture may be empty", _FOREIGN),
    Rule(
        "inkscape", "borrowed places",
        "gradients do not take cx, cy and r, or x1 to y2, from another: their shapes are flat or "
        "missing. Try to repeat them", _MEASURED, tried=True,
    ),
    Rule(
        "web", "no namespace", 'browsers draw no such file. Try xmlns="http://www.w3.org/2000/svg"',
        "https://www.w3.org/TR/SVG2/struct.html#Namespace",
    ),
    Rule(
        "web", "script", "an <img> does not run it",
        "https://www.w3.org/TR/SVG2/conform.html#secure-static-mode",
    ),
    Rule(
        "web", "masked shapes", "each is painted as a layer of its own, some ms at every repaint",
        _PAINT, tried=True, over=100, breaks=False,
    ),
    Rule(
        "web", "elements", "each is painted at every repaint. Try fewer Gaussians",
        _PAINT, tried=True, over=5000, breaks=False,
    ),
    Rule(
        "email", "svg", "Gmail and Outlook show no <svg> of a message. Try the PNG of --preview",
        "https://www.caniemail.com/features/html-svg/",
    ),
    Rule(
        "email", "bytes", "Gmail cuts a message at 102 kB, of which an inline SVG is a part",
        "https://shkspr.mobi/blog/2019/05/102kb-ought-to-be-enough-for-any-email/", over=102_000,
    ),
    Rule("email", "style sheet", "Gmail strips it, and rewrites the names of classes", _GMAIL),
    Rule(
        "email", "transform", "Gmail knows none: shapes move to the corner",
        "https://www.caniemail.com/features/css-transform/",
    ),
    Rule(
        "pdf", "soft shapes", "a soft mask for each makes viewers slow. Try pixels at 300 dpi",
        "docs/guide/editors.md", tried=True, over=250, breaks=False,
    ),
    Rule(
        "pdf", "text", "it gets the fonts of this machine. Try paths", "docs/guide/editors.md",
        tried=True,
    ),
)  # fmt: skip


@dataclass(frozen=True)
class Finding:
    """A rule that a file breaks, and how many of the thing it has."""

    rule: Rule
    count: int

    @property
    def line(self) -> str:
        """The finding on one line, with its source."""
        rule = self.rule
        how = "breaks" if rule.breaks else "slow"
        known = f"{rule.evidence}: {rule.source}" if rule.source else rule.evidence
        what = f"{how} in {rule.place}: {rule.uses} ({self.count:,})"
        return f"{what}: {rule.reason} [{known}]"

    @property
    def report(self) -> dict[str, Any]:
        """The finding, ready for JSON."""
        return {**vars(self.rule), "uses": str(self.rule.uses), "count": self.count}


def rules_of(place: str) -> list[Rule]:
    """All rules of a place, those of its renderer included."""
    OneOf(PLACES)("place", place)
    found = [rule for rule in RULES if rule.place == place]
    if (name := _DRAWN_BY.get(place)) is not None:
        cannot = renderer_named(name).CANNOT_DRAW
        found += [_of_renderer(place, feature, known) for feature, known in cannot.items()]
    return found


def _of_renderer(place: str, feature: Feature, known: str) -> Rule:
    reason = "it is drawn wrongly" + (f": {known}" if known else "")
    if feature is Feature.PLAIN_HREF:
        reason = "it is not followed: such shapes are flat or missing. Try --markup editable"
    return Rule(place, feature, reason, _MEASURED, tried=True)  # pyright: ignore[reportArgumentType]


def findings(
    svg: SvgSource,
    place: str,
    max_svg_bytes: int | str = MOST_BYTES,
    max_elements: int = MOST_ELEMENTS,
) -> list[Finding]:
    """What breaks or is slow where an untrusted SVG is taken to, breaks first.

    svg    as of `check`, also max_svg_bytes and max_elements; place: one of PLACES
    Raises InputError as `check` for a file that is no SVG or refers to anything outside of it.
    """
    rules = rules_of(place)
    data, text = svg_source(svg, byte_size("max_svg_bytes", max_svg_bytes))
    # In no canvas: whether shapes are skewed does not depend on a uniform scale.
    contents, features = Contents(), Features(1, 1, lambda _: None)
    surveyed, _ = survey(text, max_elements, contents, features)
    counts: Mapping[str, int] = {
        **surveyed.tags,
        **contents.counts,
        **dict.fromkeys(features.used, 1),
        "bytes": len(data),
        "elements": surveyed.elements,
        "no namespace": int(not surveyed.qualified),
    }
    found = [
        Finding(rule, count) for rule in rules if (count := counts.get(rule.uses, 0)) > rule.over
    ]
    return sorted(found, key=lambda finding: not finding.rule.breaks)
