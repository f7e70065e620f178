"""Twenty-six drawings as SVG sources of 256 x 256 units, whose truth is known at any size.

Curves, corners, thin lines, letters (as strokes, which need no font), soft shadows and gradients.
resvg draws them.
"""

# ruff: noqa: E501  paths are longer than lines

from __future__ import annotations

import math
from collections.abc import Sequence

_GROUND = "#ffffff"

# Letters as strokes in a box of 6 x 10 units, y down.
_LETTERS = {
    "A": "M0 10 3 0 6 10M1.2 6H4.8",
    "B": "M0 0V10H3A2.7 2.7 0 0 0 3 4.6H0 3A2.3 2.3 0 0 0 3 0Z",
    "D": "M0 0V10H2A4 5 0 0 0 2 0Z",
    "E": "M5 0H0V10H5M0 4.8H4",
    "I": "M3 0V10",
    "K": "M0 0V10M5.6 0 0 6M2 4 6 10",
    "L": "M0 0V10H5",
    "M": "M0 10V0L3 6 6 0V10",
    "N": "M0 10V0L6 10V0",
    "O": "M3 0A3 5 0 0 0 3 10 3 5 0 0 0 3 0Z",
    "P": "M0 10V0H3A2.6 2.6 0 0 1 3 5.4H0",
    "R": "M0 10V0H3A2.6 2.6 0 0 1 3 5.2H0 2.6L6 10",
    "S": "M5.6 1.6C4-1 .4-.2.4 2.4.4 5.6 5.8 4.4 5.8 7.4 5.8 10.4 1.6 10.8.2 8.2",
    "T": "M0 0H6M3 0V10",
    "V": "M0 0 3 10 6 0",
    "Y": "M0 0 3 4.6 6 0M3 4.6V10",
}


def vector_drawings() -> dict[str, str]:
    """Each drawing by its name."""
    return {name: _svg(body, ground) for name, (body, ground) in _bodies().items()}


def _svg(body: str, ground: str) -> str:
    page = f'<path fill="{ground}" d="M0 0H256V256H0Z"/>'
    return f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 256 256">{page}{body}</svg>'


def _words(x: float, y: float, words: str, size: float, colour: str, width: float) -> str:
    """Letters from their top left corner, `size` units high."""
    scale = size / 10
    glyphs = "".join(
        f'<path transform="translate({x + 8.2 * scale * k:.2f} {y}) scale({scale:.3f})" '
        f'd="{_LETTERS[letter]}"/>'
        for k, letter in enumerate(words)
        if letter != " "
    )
    return (
        f'<g fill="none" stroke="{colour}" stroke-width="{width / scale:.3f}" '
        f'stroke-linejoin="round" stroke-linecap="round">{glyphs}</g>'
    )


def _star(x: float, y: float, outer: float, inner: float, points: int = 5) -> str:
    """Path of a star."""
    corners = []
    for k in range(2 * points):
        radius, angle = (outer, inner)[k % 2], math.pi * (k / points - 0.5)
        corners.append(f"{x + radius * math.cos(angle):.2f} {y + radius * math.sin(angle):.2f}")
    return f"M{' '.join(corners)}Z"


def _turned(shape: str, angles: Sequence[float], x: float = 128, y: float = 128) -> str:
    """A shape at several angles round a point."""
    return "".join(f'<g transform="rotate({angle:.2f} {x} {y})">{shape}</g>' for angle in angles)


def _linear(name: str, stops: Sequence[str], across: str = 'x2="0" y2="1"') -> str:
    """A linear gradient with equal steps between its colours."""
    return f'<linearGradient id="{name}" {across}>{_stops(stops)}</linearGradient>'


def _radial(name: str, stops: Sequence[str], more: str = "") -> str:
    """A radial gradient with equal steps between its colours."""
    return f'<radialGradient id="{name}" {more}>{_stops(stops)}</radialGradient>'


def _stops(colours: Sequence[str]) -> str:
    last = len(colours) - 1
    return "".join(f'<stop offset="{k / last}" stop-color="{c}"/>' for k, c in enumerate(colours))


def _blurred(shape: str, deviation: float) -> str:
    """A shape under a Gaussian blur."""
    name = f"b{deviation:g}".replace(".", "_")
    return (
        f'<filter id="{name}" x="-1" y="-1" width="3" height="3" '
        f'color-interpolation-filters="sRGB"><feGaussianBlur stdDeviation="{deviation}"/></filter>'
        f'<g filter="url(#{name})">{shape}</g>'
    )


def _bodies() -> dict[str, tuple[str, str]]:
    """Name, what is drawn on the page, and the page's colour."""
    step = range(0, 360, 30)
    return {
        "icon": (
            _linear("a", ("#4f8cff", "#2347c5"))
            + '<rect x="20" y="20" width="216" height="216" rx="48" fill="url(#a)"/>'
            '<path fill="#fff" d="M144 44 76 144h44l-12 68 72-104h-46z"/>',
            _GROUND,
        ),
        "face": (
            '<circle cx="128" cy="128" r="104" fill="#fc3"/>'
            '<path fill="#5d3a1a" d="M62 140h132c0 88-132 88-132 0z"/>'
            '<path fill="#fff" d="M72 140h112l-4 18H76z"/>'
            '<path fill="#e8546b" d="M96 192c16-24 48-24 64 0-18 16-46 16-64 0z"/>'
            '<g fill="#3b2413"><ellipse cx="92" cy="98" rx="13" ry="20"/>'
            '<ellipse cx="164" cy="98" rx="13" ry="20"/></g>'
            '<g fill="#fff"><circle cx="96" cy="90" r="5"/><circle cx="168" cy="90" r="5"/></g>',
            _GROUND,
        ),
        "cat": (
            '<path fill="#7d8796" d="M40 30 84 74h88l44-44c10 40 12 84 4 116-14 56-46 86-92 86s-78-30'
            '-92-86c-8-32-6-76 4-116z"/><path fill="#f4b6c2" d="M50 56 74 82l-22 18zm156 0-24 26 22 '
            '18z"/><g fill="#d9e84a"><ellipse cx="88" cy="128" rx="20" ry="15"/>'
            '<ellipse cx="168" cy="128" rx="20" ry="15"/></g><g fill="#1d2026">'
            '<ellipse cx="88" cy="128" rx="5" ry="14"/><ellipse cx="168" cy="128" rx="5" ry="14"/>'
            '<path d="M116 162h24l-12 14z"/></g><path fill="none" stroke="#1d2026" stroke-width="3" '
            'd="M128 176c0 20-24 22-30 8m30-8c0 20 24 22 30 8"/><path stroke="#f4f5f7" '
            'stroke-width="1.5" d="M100 170 34 158m66 22-68 8m124-18 66-12m-66 22 68 8"/>',
            "#eef2f6",
        ),
        "rocket": (
            '<path fill="#f39c12" d="M104 190c-6 30 8 40 24 58 16-18 30-28 24-58z"/>'
            '<path fill="#f7dc6f" d="M116 190c-4 18 4 26 12 36 8-10 16-18 12-36z"/>'
            '<path fill="#c0392b" d="M92 120 56 170l4 34 40-22zm72 0 36 50-4 34-40-22z"/>'
            '<path fill="#ecf0f1" d="M128 12c34 34 46 74 44 112-1 26-8 48-18 66h-52c-10-18-17-40-18'
            '-66-2-38 10-78 44-112z"/><path fill="#bdc9d1" d="M128 12c34 34 46 74 44 112-1 26-8 48-18 '
            '66h-26z"/><path fill="#c0392b" d="M128 12c14 14 24 29 31 45H97c7-16 17-31 31-45z"/>'
            '<circle cx="128" cy="98" r="24" fill="#34495e"/>'
            '<circle cx="128" cy="98" r="16" fill="#5dade2"/>'
            '<path fill="#aed6f1" d="M116 94a13 13 0 0 1 12-9l-4 6z"/>',
            "#1b2a49",
        ),
        "cake": (
            '<path fill="#b9770e" d="M32 140h192v76c0 24-192 24-192 0z"/>'
            '<path fill="#fadbd8" d="M28 128c0-36 200-36 200 0v28c0 14-18 14-20 0-2-10-14-10-16 0 0 '
            "30-22 30-24 2-1-12-16-12-18 0-2 14-18 14-20 0-1-10-16-10-18 0-2 34-24 34-26 0-1-12-14-12"
            '-16 0-2 12-18 12-20 0-2-10-12-10-14 0-2 12-8 10-8-2z"/>'
            '<path fill="none" stroke="#873600" stroke-width="4" d="M33 188c20 26 170 26 190 0"/>'
            + "".join(
                f'<path fill="{colour}" d="M{x} 62h10v52h-10z"/>'
                f'<path fill="#f4d03f" d="M{x + 5} 34c12 16 8 24 0 24s-12-8 0-24z"/>'
                for x, colour in ((70, "#5dade2"), (123, "#58d68d"), (176, "#af7ac5"))
            ),
            "#fef9e7",
        ),
        "flag": (
            "".join(
                f'<path fill="{("#00796b", "#fff")[k % 2]}" d="M24 {48 + 16 * k}c60-28 120 28 208 0v16'
                f'c-88 28-148-28-208 0z"/>'
                for k in range(9)
            )
            + '<path fill="#e65100" d="M24 48c32-15 62-6 100 2v72c-38-8-68-17-100-2z"/>'
            + "".join(
                f'<path fill="#fff" d="{_star(44 + 24 * i, 62 + 20 * j, 7, 3)}"/>'
                for i in range(4)
                for j in range(3)
            )
            + '<path fill="#8d6e63" d="M16 32h8v208h-8z"/>',
            "#dfe9f3",
        ),
        "circles": (
            '<g fill-opacity=".75"><circle cx="98" cy="104" r="70" fill="#e6194b"/>'
            '<circle cx="160" cy="104" r="70" fill="#3cb44b"/>'
            '<circle cx="128" cy="156" r="70" fill="#4363d8"/></g>',
            _GROUND,
        ),
        "gear": (
            '<g fill="#546e7a">'
            + _turned('<path d="M112 16h32l6 40h-44z"/>', range(0, 360, 36))
            + '<circle cx="128" cy="128" r="82"/></g><circle cx="128" cy="128" r="52" '
            'fill="#cfd8dc"/><path fill="#ff7043" d="M158 98a42 42 0 1 0 0 60l-16-16a20 20 0 1 1 0-28z"'
            "/>",
            "#fafafa",
        ),
        "leaf": (
            _linear("a", ("#9ccc65", "#33691e"), 'x1="0" y1="0" x2="1" y2="1"')
            + '<path fill="url(#a)" d="M40 216C16 96 96 24 224 32c8 128-64 208-184 184z"/>'
            '<g fill="none" stroke="#dcedc8" stroke-width="2"><path d="M24 232 200 56" '
            'stroke-width="4"/><path d="M76 180c-8-30-6-50 0-70m44 26c-6-30-2-50 6-70m26 38c-4-20 0-32 '
            '6-42M76 180c30 8 50 6 70 0m-26-44c30 6 50 2 70-6m-38-26c20 4 32 0 42-6"/></g>',
            "#fffde7",
        ),
        "landscape": (
            _linear("a", ("#1a237e", "#7b1fa2", "#ff7043", "#ffd54f"))
            + _linear("b", ("#4a148c", "#12005e"))
            + _radial("c", ("#fffde7", "#ffe082"))
            + '<path fill="url(#a)" d="M0 0h256v190H0z"/><circle cx="150" cy="140" r="34" '
            'fill="url(#c)"/><path fill="url(#b)" d="M0 180 50 110l30 40 46-62 54 80 30-34 46 60v82H0z"'
            '/><path fill="#1b0036" d="M0 210c50-30 90 14 140-8s80-14 116 4v50H0z"/>',
            _GROUND,
        ),
        "button": (
            _linear("a", ("#66bb6a", "#2e7d32"))
            + _blurred(
                '<rect x="30" y="92" width="196" height="92" rx="46" fill="#000" '
                'fill-opacity=".5"/>',
                8,
            )
            + '<rect x="30" y="80" width="196" height="92" rx="46" fill="url(#a)"/>'
            '<path fill="#fff" fill-opacity=".25" d="M44 108c8-18 24-22 32-22h104c8 0 24 4 32 22z"/>'
            + _words(70, 110, "LOAD", 32, "#fff", 6),
            "#eceff1",
        ),
        "chart": (
            '<g stroke="#cfd8dc" stroke-width="1">'
            + "".join(f'<path d="M32 {y}H240"/>' for y in range(32, 224, 32))
            + '</g><path fill="#bbdefb" d="M32 180 74 150l42 16 42-70 42 20 40-60v168H32z"/>'
            '<path fill="none" stroke="#1565c0" stroke-width="3" stroke-linejoin="round" d="M32 180 74 '
            '150l42 16 42-70 42 20 40-60"/><g fill="#fff" stroke="#1565c0" stroke-width="2">'
            + "".join(
                f'<circle cx="{x}" cy="{y}" r="5"/>'
                for x, y in ((74, 150), (116, 166), (158, 96), (200, 116))
            )
            + '</g><path fill="none" stroke="#37474f" stroke-width="2" d="M32 20v204h212"/>'
            '<path fill="none" stroke="#ef6c00" stroke-width="1.5" stroke-dasharray="6 4" d="M32 200C90 '
            '190 150 150 240 120"/>',
            _GROUND,
        ),
        "letters": (
            _words(24, 30, "STONE", 48, "#263238", 8)
            + _words(24, 104, "RIVER BANK", 22, "#b71c1c", 2.6)
            + _words(24, 146, "OVER SILENT ISLANDS", 13, "#1a237e", 1.4)
            + _words(24, 178, "NEAR A LAKE DEER REST", 11, "#000", 1)
            + _words(24, 206, "PLAIN", 30, "#00695c", 10),
            "#fffaf0",
        ),
        "map": (
            '<path fill="#c8e6c9" d="M0 0h120c-10 40-50 70-120 80zm256 150v106H140c10-60 60-90 116-106z"'
            '/><path fill="#90caf9" d="M0 170c60-20 90 20 130 0s70-110 126-110v30c-50 0-70 90-116 108S60 '
            '182 0 206z"/><g fill="none" stroke-linejoin="round"><path id="r" stroke="#e0a030" '
            'stroke-width="12" d="M40 256C60 180 40 120 90 90S200 60 220 0"/><path stroke="#fff176" '
            'stroke-width="8" d="M40 256C60 180 40 120 90 90S200 60 220 0"/><path stroke="#fff" '
            'stroke-width="4" d="M90 90l70 140 96 10M0 110l90-20L60 0m100 230-40 26"/></g>'
            '<path fill="#d32f2f" d="M166 150c-18-24-22-32-22-42a22 22 0 0 1 44 0c0 10-4 18-22 42z"/>'
            '<circle cx="166" cy="108" r="8" fill="#fff"/>',
            "#f5f1e6",
        ),
        "clock": (
            '<circle cx="128" cy="128" r="112" fill="#212121"/>'
            '<circle cx="128" cy="128" r="102" fill="#fafafa"/><g stroke="#212121">'
            + _turned('<path stroke-width="5" d="M128 34v18"/>', step)
            + _turned('<path stroke-width="1.2" d="M128 34v9"/>', range(0, 360, 6))
            + '<g stroke-linecap="round"><path stroke-width="9" d="M128 128 90 84"/>'
            '<path stroke-width="6" d="M128 128 176 72"/></g>'
            '<path stroke="#d32f2f" stroke-width="2" d="M120 106 158 212"/></g>'
            '<circle cx="128" cy="128" r="7" fill="#d32f2f"/>',
            "#b0bec5",
        ),
        "balloons": (
            "".join(
                _radial(f"g{k}", (pale, middle, dark), 'cx=".35" cy=".3" r=".75"')
                + f'<path fill="none" stroke="#5d4037" stroke-width="1.2" d="M{x} {y + 60}Q{x + 8} '
                f'{y + 100} 128 246"/><ellipse cx="{x}" cy="{y}" rx="42" ry="54" fill="url(#g{k})"/>'
                f'<path fill="{dark}" d="M{x - 6} {y + 62}l6-10 6 10z"/>'
                for k, (x, y, pale, middle, dark) in enumerate(
                    (
                        (74, 88, "#ffcdd2", "#f44336", "#b71c1c"),
                        (184, 92, "#c5cae9", "#3f51b5", "#1a237e"),
                        (128, 72, "#fff9c4", "#fbc02d", "#f57f17"),
                    )
                )
            ),
            "#e1f5fe",
        ),
        "night": (
            _radial("a", ("#283593", "#0d1333"))
            + '<path fill="url(#a)" d="M0 0h256v256H0z"/><path fill="#fff59d" d="M170 40a70 70 0 1 0 40 '
            '112A60 60 0 0 1 170 40z"/><g fill="#fff">'
            + "".join(
                f'<path d="{_star(x, y, r, r / 3, 4)}"/>'
                for x, y, r in (
                    (40, 40, 8),
                    (80, 96, 5),
                    (28, 150, 6),
                    (220, 30, 7),
                    (232, 210, 5),
                    (60, 216, 9),
                    (120, 26, 4),
                    (160, 232, 6),
                    (206, 84, 4),
                )
            )
            + '</g><path fill="#3949ab" d="M60 236a22 22 0 0 1 30-30 30 30 0 0 1 56 4 18 18 0 0 1 8 26z"'
            "/>",
            "#0d1333",
        ),
        "flower": (
            '<path fill="none" stroke="#2e7d32" stroke-width="7" d="M128 128c10 50-10 80 0 128"/>'
            '<path fill="#43a047" d="M130 210c30-40 60-30 76-20-16 24-46 34-76 20z"/>'
            + _turned(
                '<path fill="#ec407a" d="M128 104c-34-34-24-84 0-90 24 6 34 56 0 90z"/>'
                '<path fill="none" stroke="#ad1457" stroke-width="1.5" d="M128 100V36"/>',
                range(0, 360, 60),
                128,
                112,
            )
            + '<circle cx="128" cy="112" r="26" fill="#ffca28"/><g fill="#f57f17">'
            + _turned('<circle cx="128" cy="96" r="3"/>', range(0, 360, 45), 128, 112)
            + "</g>",
            "#f1f8e9",
        ),
        "fish": (
            _linear("a", ("#ff9800", "#e65100"))
            + '<path fill="#ef6c00" d="M176 128c30-10 44-40 60-56-6 40-6 72 0 112-16-16-30-46-60-56z"/>'
            '<path fill="url(#a)" d="M16 132c36-70 120-80 176-4-56 76-140 72-176 4z"/>'
            '<path fill="#fff" d="M84 84c16 30 16 66 0 96l14 4c18-34 18-72 0-104zm52 4c14 28 14 54 0 82l12'
            '-6c12-26 12-46 0-70z"/><path fill="#e65100" d="M100 82c4-24 24-36 44-40-8 14-4 28 4 44z"/>'
            '<circle cx="50" cy="118" r="11" fill="#fff"/><circle cx="48" cy="118" r="6"/>'
            '<g fill="none" stroke="#fff" stroke-width="2"><circle cx="28" cy="70" r="9"/>'
            '<circle cx="48" cy="44" r="6"/><circle cx="34" cy="22" r="4"/></g>',
            "#4fc3f7",
        ),
        "house": (
            '<path fill="#8bc34a" d="M0 208h256v48H0z"/><path fill="#fff3e0" d="M48 112h160v104H48z"/>'
            '<path fill="#bf360c" d="M128 28 28 120h200z"/><path fill="#6d4c41" d="M172 44h22v40h-22z"/>'
            '<path fill="#5d4037" d="M108 152h40v64h-40z"/><circle cx="140" cy="186" r="3" '
            'fill="#ffd54f"/><g fill="#81d4fa" stroke="#fff" stroke-width="4"><path d="M62 136h34v34H62z'
            'm17 0v34m-17-17h34m64-17h34v34h-34zm17 0v34m-17-17h34"/></g>'
            '<circle cx="128" cy="88" r="14" fill="#81d4fa" stroke="#fff" stroke-width="4"/>',
            "#b3e5fc",
        ),
        "lines": (
            '<g fill="none" stroke="#111">'
            + "".join(
                f'<path stroke-width="{0.6 + 0.3 * k:.1f}" d="M16 {28 + 18 * k}C90 {-20 + 26 * k} 150 '
                f'{90 + 8 * k} 240 {24 + 20 * k}"/>'
                for k in range(9)
            )
            + '<circle cx="196" cy="196" r="44" stroke-width="1"/>'
            '<circle cx="196" cy="196" r="30" stroke-width="2"/>'
            '<path stroke-width="4" stroke-linejoin="miter" d="M24 240 60 190l24 40 20-56 30 66"/></g>',
            _GROUND,
        ),
        "ball": (
            _radial("a", ("#ffffff", "#64b5f6", "#1565c0", "#0d2a5c"), 'cx=".35" cy=".3" r=".8"')
            + _linear("b", ("#eceff1", "#b0bec5"))
            + '<path fill="url(#b)" d="M0 0h256v256H0z"/>'
            + _blurred('<ellipse cx="140" cy="214" rx="84" ry="16" fill="#263238"/>', 7)
            + '<circle cx="128" cy="124" r="88" fill="url(#a)"/>',
            _GROUND,
        ),
        "badge": (
            '<path fill="#1565c0" d="M84 150 60 240l36-14 20 26 20-80zm88 0 24 90-36-14-20 26-20-80z"/>'
            f'<path fill="#ffb300" d="{_star(128, 108, 100, 84, 18)}"/>'
            '<circle cx="128" cy="108" r="70" fill="#fff8e1"/>'
            '<circle cx="128" cy="108" r="62" fill="none" stroke="#ff6f00" stroke-width="2"/>'
            + _words(81, 92, "BEST", 32, "#e65100", 7)
            + f'<path fill="#ff6f00" d="{_star(128, 66, 12, 5)}{_star(128, 148, 12, 5)}"/>',
            "#e8eaf6",
        ),
        "waves": (
            _linear("a", ("#00c6ff", "#0072ff"), 'x2="1" y2="0"')
            + _linear("b", ("#f857a6", "#ff5858"), 'x2="1" y2="0"')
            + _linear("c", ("#f9d423", "#ff4e50"), 'x2="1" y2="1"')
            + '<path fill="url(#c)" d="M0 0h256v256H0z"/><path fill="url(#b)" d="M0 110c60-60 100 40 160 0'
            's70-40 96-20v166H0z"/><path fill="url(#a)" d="M0 180c50-40 90 30 140 10s80-60 116-30v96H0z"'
            "/>",
            _GROUND,
        ),
        "circuit": (
            '<g fill="none" stroke="#69f0ae" stroke-width="2"><path d="M20 40h60l24 24v40M20 80h40l30 '
            "30v30h14M20 180h50l20-20h14M120 20v60M152 20v40l-8 20M236 60h-50l-20 30h-14M236 128h-84M236 "
            '190h-40l-30-30h-14M128 236v-76M90 236v-30l20-20v-26M190 236v-20l-46-36v-20"/></g>'
            '<g fill="#69f0ae">'
            + "".join(
                f'<circle cx="{x}" cy="{y}" r="5"/>'
                for x, y in (
                    (20, 40),
                    (20, 80),
                    (20, 180),
                    (120, 20),
                    (152, 20),
                    (236, 60),
                    (236, 128),
                    (236, 190),
                    (128, 236),
                    (90, 236),
                    (190, 236),
                )
            )
            + '</g><rect x="96" y="76" width="64" height="88" rx="6" fill="#263238"/>'
            '<circle cx="110" cy="90" r="5" fill="#b0bec5"/>',
            "#004d40",
        ),
        "mushroom": (
            '<path fill="#fbe9d0" d="M98 130h60c-6 30 0 60 18 92-30 20-66 20-96 0 18-32 24-62 18-92z"/>'
            '<path fill="#e6cfa8" d="M140 130h18c-6 30 0 60 18 92-12 8-26 12-40 14 12-34 12-70 4-106z"/>'
            '<path fill="#d84315" d="M20 136C24 64 72 20 128 20s104 44 108 116c-20 16-196 16-216 0z"/>'
            '<g fill="#fff"><circle cx="92" cy="72" r="18"/><ellipse cx="158" cy="56" rx="14" ry="11"/>'
            '<ellipse cx="188" cy="104" rx="17" ry="13"/><circle cx="130" cy="110" r="12"/>'
            '<ellipse cx="54" cy="116" rx="13" ry="9"/></g><path fill="#558b2f" d="M40 236c2-20 8-30 16-40 '
            "0 12 2 20 6 28 4-16 10-26 20-34-4 16-4 30 0 46zm130 0c2-14 8-24 14-30 0 8 2 14 4 20 4-12 10-20 "
            '18-26-4 12-4 24 0 36z"/>',
            "#e3f2fd",
        ),
    }
