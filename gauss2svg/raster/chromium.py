"""The renderer Chromium, which draws an SVG as most browsers do. Playwright controls it.

Chromium rounds colours to 8 bits after each layer, and dithers gradients by a fixed pattern of
8 x 8 px. So the image is drawn four times, at _OFFSETS. These are four places of the page at which
the pattern lies differently on the image. The mean of the four images is 5 to 12 dB closer to the
model than a single image. If one image of twice the size is averaged instead, the result is at
least 5 dB worse than this mean (docs/decisions/renderers.md).
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gauss2svg.errors import RendererError
from gauss2svg.photo.pixels import straight
from gauss2svg.raster import CLEAR, WHITE, from_png, renderers
from gauss2svg.raster.renderers import DRAWING, html

# Without the flag for the colour profile, colours would depend on the screen of the machine. The
# flag for reduced motion shows animated files in their final state. Playwright has an option for
# reduced motion too, but it has no effect on the images in a page.
_FLAGS = ("--force-color-profile=srgb", "--hide-scrollbars", "--force-prefers-reduced-motion")
_OFFSETS = ((0, 0), (1, 0), (0, 1), (1, 1))
_SITE = "http://gauss2svg.invalid/"


def chromium(svg: str, width: int, height: int, page: str = WHITE) -> NDArray[np.float32]:
    """Return the pixels (height, width, 4) of the SVG on a page of the colour `page`.

    They are means of several images, so their levels are finer than 8 bits.
    """
    # Playwright refuses a thread that runs an event loop of asyncio, as that of a notebook does.
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(_mean, svg, width, height, page).result()


def launch_options(flags: Sequence[str] = _FLAGS) -> dict[str, Any]:
    """Return options with which Playwright's `chromium.launch` starts the installed browser."""
    # With its sandbox, Chromium does not start as root. For all other users the sandbox is on.
    is_root = hasattr(os, "geteuid") and os.geteuid() == 0
    return {
        "executable_path": renderers.find("chromium"),
        "args": flags,
        "chromium_sandbox": not is_root,
    }


def _mean(svg: str, width: int, height: int, color: str) -> NDArray[np.float32]:
    """Return the mean (height, width, 4) of four images of the SVG on a page of this colour.

    The page is offline, so it can load only the two files that its routes serve.
    """
    api, launching, is_clear = renderers.playwright_api(), launch_options(), color == CLEAR
    total = np.zeros((height, width, 4), np.float32)
    try:
        with api.sync_playwright() as playwright:
            context = playwright.chromium.launch(**launching).new_context(
                viewport={"width": width + 1, "height": height + 1}, offline=True,
                service_workers="block",
            )  # fmt: skip
            context.set_default_timeout(renderers.TIMEOUT_S * 1000)
            page = context.new_page()
            page.route(_SITE, lambda r: r.fulfill(body=html(color), content_type="text/html"))
            page.route(_SITE + DRAWING, lambda r: r.fulfill(body=svg, content_type="image/svg+xml"))
            page.goto(_SITE)
            # wait_for_function() has a time limit. evaluate() has none, so it would wait forever if
            # the page hangs.
            size = page.wait_for_function(
                "() => [document.images[0].naturalWidth, document.images[0].naturalHeight]"
            )
            if size.json_value() != [width, height]:
                raise RendererError("Chromium cannot draw the SVG: not a supported image")
            for x, y in _OFFSETS:
                style = f"position: absolute; left: {x}px; top: {y}px"
                page.wait_for_function("to => document.images[0].style = to", arg=style)
                shot = from_png(page.screenshot(omit_background=is_clear))
                levels = np.rint(255 * shot[y : y + height, x : x + width])
                # Colours are premultiplied by alpha here, because the mean of several images is
                # exact only for premultiplied colours.
                levels[:, :, :3] *= levels[:, :, 3:] / 255
                total += levels
    except api.Error as error:
        reason = str(error).strip().partition("\n")[0] or type(error).__name__
        raise RendererError(
            f"Chromium cannot draw the SVG at {width}x{height} px: {reason}. Try to reinstall "
            f"{launching['executable_path']}, or --renderer resvg"
        ) from error
    total /= np.float32(255 * len(_OFFSETS))
    return straight(total[:, :, :3], total[:, :, 3]) if is_clear else total
