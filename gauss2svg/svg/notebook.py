"""Pictures in notebooks: the HTML that IPython asks an object for.

The room of scenes lies under the renderers and cannot draw, so `Scene` asks the function that is
installed at the end of this module. The package takes its public name `Scene` from here, and so
does the reader: scenes of `vectorize`, `read_svg` and of one's own show themselves, and a scene
alone still loads NumPy and no renderer.
"""

from __future__ import annotations

import base64
import html

from gauss2svg.scene import Scene


def image(data: bytes, media_type: str, alt: str) -> str:
    """HTML of a picture with its data, no wider than the page.

    It is an <img>, because the gradient ids of two inline SVGs would clash.
    """
    source = f"data:{media_type};base64,{base64.b64encode(data).decode()}"
    return f'<img alt="{html.escape(alt)}" style="max-width:100%" src="{source}"/>'


def picture(scene: Scene) -> str:
    """HTML of a scene as the model's renderer draws it, some 50 kB for any number of shapes."""
    from gauss2svg.render.frame import as_jpeg  # numba, which few scenes are shown for

    return image(as_jpeg(scene), "image/jpeg", repr(scene))


Scene.as_html = picture
