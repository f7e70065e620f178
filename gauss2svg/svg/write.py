"""The SVG document; the only module that knows svgwrite.

    <radialGradient id=".." gradientUnits="userSpaceOnUse" cx="0" cy="0" r="1" fx=".001">
      <stop offset=".." stop-color="#.." stop-opacity=".."/> ...
    <circle r="1" transform="matrix(..)" fill="url(#..)" fill-opacity=".."/>

with radii as gauss2svg.svg.encode explains, and fill="#.." where a plain ellipse will do, or
with filter="url(#..)" a blurred one. Its filter region is one of the bounding box, the
deviation in the circle's own units, so that all shapes of an exponent share one.
The focal offset moves resvg to its accurate gradient (36 dB to 49 dB against the model) and
changes nothing elsewhere. Gradients in objectBoundingBox units, masks, rgba() colours and
plain href were measured and fail in one renderer or another.
"""

import svgwrite
from svgwrite.extensions import Inkscape

from gauss2svg.scene import Scene
from gauss2svg.svg.encode import EncodedScene, encode, number
from gauss2svg.svg.options import SvgOptions
from gauss2svg.version import __version__


def write_svg(scene: Scene, options: SvgOptions | None = None) -> str:
    """The SVG text of a scene; depends on nothing but the scene and the options.

    What is drawn is gauss2svg.svg.settled(scene, options): exponents become those of
    BETA_CLASSES, under 1 too, and colours those of the palette.
    """
    options = options or SvgOptions()
    return _document(encode(scene, options), options)


def _document(encoded: EncodedScene, options: SvgOptions) -> str:
    count = sum(len(ellipses) for _, ellipses in encoded.layers)
    # debug=True, svgwrite's default, triples the time and still lets NaN through;
    # the numbers are checked by encode().
    drawing = svgwrite.Drawing(
        size=(encoded.width, encoded.height),
        viewBox=f"0 0 {encoded.view_width} {encoded.view_height}",
        debug=False,
    )
    drawing.set_desc(
        title=options.title,
        desc=f"{count} Gaussians, fitted and written by gauss2svg {__version__}",
    )
    for gradient in encoded.gradients:
        element = drawing.radialGradient(
            center=("0", "0"), r=str(gradient.radius), gradientUnits="userSpaceOnUse",
            id=gradient.id, debug=False,
        )  # fmt: skip
        element["fx"] = ".1" if gradient.radius > 1 else ".001"
        for offset, opacity in gradient.stops:
            shown = None if opacity == "1" else opacity
            element.add_stop_color(offset=offset, color=gradient.color, opacity=shown)
        drawing.defs.add(element)
    for blur in encoded.filters:
        element = drawing.filter(
            start=(f"-{blur.margin}",) * 2,
            size=(number(1 + 2 * float(blur.margin), 2),) * 2,
            id=blur.id,
            debug=False,
        )
        # The default, linearRGB, rounds colours once more.
        element["color-interpolation-filters"] = "sRGB"
        element.feGaussianBlur(stdDeviation=blur.deviation)
        drawing.defs.add(element)
    drawing.add(drawing.rect(size=("100%", "100%"), fill=encoded.background))
    inkscape = Inkscape(drawing)
    for index, ellipses in encoded.layers:
        layer = inkscape.layer(label=f"Round {index + 1}: {len(ellipses)} Gaussians")
        for ellipse in ellipses:
            circle = drawing.circle(r=ellipse.radius, transform=ellipse.matrix, fill=ellipse.fill)
            if ellipse.opacity:
                circle["fill-opacity"] = ellipse.opacity
            if ellipse.filter:
                circle["filter"] = f"url(#{ellipse.filter})"
            # Centred on the origin by default; cx and cy would only repeat it.
            del circle.attribs["cx"], circle.attribs["cy"]
            layer.add(circle)
        drawing.add(layer)
    # ElementTree writes a space before "/>", which nothing but the end of a tag can hold.
    return (
        '<?xml version="1.0" encoding="utf-8"?>\n' + drawing.tostring().replace(" />", "/>") + "\n"
    )
