"""What other forms of shapes would gain: half discs, linear colours, stripes, beside skews.

    python benchmarks/forms.py PHOTO... [--shapes 64] [--side 120] [--steps 400]

Each photo, reduced to a longer side of `side` px, is fitted by the package; then the fit continues
in torch, once as it is and once with each form, all with the same steps and rates:

    skew      a focus in each shape's disc
    half      a disc cut along a line, alpha times clip(1/2 + distance in px, 0, 1); the line's
              distance from the centre free, then held at the nearest of none, -1/2, 0, 1/2
    linear    a colour that changes along a line across the shape; of crisp shapes alone, and of all
    stripes   the same, as a triangle wave (spreadMethod="reflect") of free frequency and phase

A table row for each photo and form: PSNR of the float model, and the bytes gzipped of the package's
file with what the form adds to it: a path in place of a circle, or a gradient of two stops for each
shape that has one. What a skew adds is not counted (docs/decisions/skew.md has it); it is some
100 bytes. In the last column dB are moved to the bytes of the fit as it is, by three dB
for a factor of two.
"""

from __future__ import annotations

import argparse
import gzip
import math
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from gauss2svg import vectorize
from gauss2svg.fit.options import FitOptions
from gauss2svg.pipeline.options import RunOptions
from gauss2svg.scene import Scene
from gauss2svg.scene.falloff import CUT, RIM

_FORMS = ("as it is", "skew", "half", "half, held", "skew and half", "linear, crisp shapes",
          "linear", "stripes")  # fmt: skip
_RATES = {"mean": 0.15, "factor": 0.02, "opacity": 0.03, "color": 0.006, "beta": 0.02,
          "skew": 0.04, "angle": 0.05, "cut": 0.03, "slope": 0.006, "wave": 0.02}  # fmt: skip
_CUTS = torch.tensor([-1.2, -0.5, 0.0, 0.5])  # the first cuts nothing off
_CRISP = 6.0  # exponent
_DB_A_DOUBLING = 3.0


class Form:
    """The shapes of a scene as parameters, and those that a form adds."""

    def __init__(self, scene: Scene, form: str, seed: int = 0) -> None:
        factor = torch.tensor(scene.factor, dtype=torch.float32)
        draw = torch.Generator().manual_seed(seed)
        n = len(scene)
        logs = torch.stack([factor[:, 0, 0].log(), factor[:, 1, 1].log()], 1)
        self.form = form
        self.background = torch.tensor(scene.background, dtype=torch.float32)
        self.values = {
            "mean": torch.tensor(scene.mean, dtype=torch.float32),
            "factor": torch.cat([logs, factor[:, 1, :1] / factor[:, 1, 1:]], 1),
            "opacity": torch.logit(torch.tensor(scene.opacity, dtype=torch.float32), 0.01),
            "color": torch.tensor(scene.color, dtype=torch.float32),
            "beta": torch.tensor(scene.beta, dtype=torch.float32).log(),
            "skew": 0.02 * torch.randn(n, 2, generator=draw),
            "angle": 2 * math.pi * torch.rand(n, generator=draw),
            "cut": torch.full((n,), -0.9),
            "slope": 0.01 * torch.randn(n, 3, generator=draw),
            "wave": torch.stack([1 + 3 * torch.rand(n, generator=draw), torch.zeros(n)], 1),
        }
        used = {"mean", "factor", "opacity", "color", "beta"}
        used |= {"skew"} if "skew" in form else set()
        used |= {"angle", "cut"} if "half" in form else set()
        used |= {"angle", "slope"} if form.startswith(("linear", "stripes")) else set()
        used |= {"wave"} if form == "stripes" else set()
        self.used = sorted(used)
        for name in self.used:
            self.values[name].requires_grad_(True)
        self.crisp = torch.tensor(scene.beta >= _CRISP)

    def optimizer(self) -> torch.optim.Optimizer:
        """Adam, with a rate for each parameter."""
        groups = [{"params": [self.values[name]], "lr": _RATES[name]} for name in self.used]
        return torch.optim.Adam(groups, betas=(0.9, 0.99))

    def render(self, width: int, height: int) -> torch.Tensor:
        """(height, width, 3), all shapes at all pixels."""
        given = self.values
        y, x = torch.meshgrid(torch.arange(height) + 0.5, torch.arange(width) + 0.5, indexing="ij")
        points = torch.stack([x.flatten(), y.flatten()], 1)
        beta = given["beta"].clamp(math.log(0.5), math.log(64)).exp()
        radius = (2 * CUT ** (1 / beta)).sqrt()
        wide, tall = given["factor"][:, :2].clamp(math.log(0.35), 7).exp().T
        away = points[None] - given["mean"][:, None]
        first = away[..., 0] / wide[:, None]
        # L = [[wide, 0], [shear tall, tall]]
        second = away[..., 1] / tall[:, None] - given["factor"][:, 2:] * first
        v = torch.stack([first, second], -1) / radius[:, None, None]
        focus = given["skew"] if "skew" in self.form else torch.zeros_like(given["skew"])
        focus = 0.95 * focus / (1 + focus.square().sum(1, keepdim=True)).sqrt()
        d = v - focus[:, None]
        along = (d * focus[:, None]).sum(-1)
        left = (1 - focus.square().sum(1))[:, None]
        t = (along + (along.square() + left * d.square().sum(-1) + 1e-12).sqrt()) / left
        power = (t.clamp(1e-6, 1.0).log() * 2 * beta[:, None]).exp()
        alpha = ((-CUT * power).exp() - RIM) / (1 - RIM) * (t < 1)
        alpha = alpha * torch.sigmoid(given["opacity"])[:, None]
        axis = torch.stack([given["angle"].cos(), given["angle"].sin()], 1)
        across = (v * axis[:, None]).sum(-1)
        color = given["color"][:, None]
        if "half" in self.form:
            # px for each unit of v along the axis: the inverse of the gradient's length
            gradient = torch.stack(
                [(axis[:, 0] - given["factor"][:, 2] * axis[:, 1]) / wide, axis[:, 1] / tall], 1
            )
            px = radius / gradient.norm(dim=1)
            edge = (across - given["cut"][:, None]) * px[:, None]
            alpha = alpha * (0.5 + edge).clamp(0, 1)
        if self.form.startswith("linear"):
            changes = self.crisp if "crisp" in self.form else torch.ones_like(self.crisp)
            slope = given["slope"] * changes[:, None]
            color = color + slope[:, None] * across[..., None]
        if self.form == "stripes":
            phase = given["wave"][:, :1] * across + given["wave"][:, 1:]
            wave = 4 * (phase - (phase + 0.5).floor()).abs() - 1
            color = color + given["slope"][:, None] * wave[..., None]
        out = self.background.expand(len(points), 3)
        for shade, opacity in zip(color.clamp(0, 1), alpha, strict=True):
            out = out + opacity[:, None] * (shade - out)
        return out.reshape(height, width, 3)


def continued(form: Form, target: torch.Tensor, steps: int) -> float:
    """PSNR in dB after so many steps, the last third of which become smaller."""
    optimizer = form.optimizer()
    size = [group["lr"] for group in optimizer.param_groups]
    height, width = target.shape[:2]
    for step in range(steps):
        share = min(1.0, 3 * (1 - step / steps))
        for group, rate in zip(optimizer.param_groups, size, strict=True):
            group["lr"] = rate * share
        optimizer.zero_grad()
        (form.render(width, height) - target).square().mean().backward()
        optimizer.step()
    with torch.no_grad():
        error = (form.render(width, height).clamp(0, 1) - target).square().mean()
    return -10 * math.log10(float(error))


@torch.no_grad()
def gzipped(svg: str, form: Form) -> int:
    """Bytes of the file with what the form adds; shapes that hardly have it go without."""
    given, n = form.values, svg.count("<circle")
    extra, replaced = [], 0
    if "half" in form.form:
        replaced = int((given["cut"] > -0.95).sum())
    if form.form.startswith(("linear", "stripes")):
        seen = given["slope"].abs().amax(1) > 2 / 255
        seen &= form.crisp if "crisp" in form.form else torch.ones_like(seen)
        for k in torch.nonzero(seen).flatten().tolist():
            both = (given["color"][k] - given["slope"][k], given["color"][k] + given["slope"][k])
            ends = [
                "#" + "".join(f"{round(255 * min(max(float(c), 0), 1)):02x}" for c in end)
                for end in both
            ]
            extra.append(
                f'<linearGradient id="l{k}"><stop stop-color="{ends[0]}"/>'
                f'<stop offset="1" stop-color="{ends[1]}"/></linearGradient>'
            )
    parts = svg.split("<circle")
    for k in np.random.default_rng(0).choice(n, min(replaced, n), replace=False).tolist():
        parts[k + 1] = parts[k + 1].replace(' r="1"', ' d="M-1 0A1 1 0 0 1 1 0"', 1)
    return len(gzip.compress(("<circle".join(parts) + "".join(extra)).encode(), 9, mtime=0))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("photos", nargs="+", type=Path)
    parser.add_argument("--shapes", type=int, default=64)
    parser.add_argument("--side", type=int, default=120)
    parser.add_argument("--steps", type=int, default=400)
    given = parser.parse_args()
    torch.set_num_threads(1)
    print("| photo | form | dB | gzipped | dB at the same bytes |\n|---|---|---|---|---|")
    for path in given.photos:
        photo = Image.open(path).convert("RGB")
        photo.thumbnail((given.side, given.side), Image.Resampling.LANCZOS)
        pixels = np.asarray(photo)
        result = vectorize(pixels, gaussians=given.shapes, fit=FitOptions(tune="psnr"),
                           run=RunOptions(threads=1))  # fmt: skip
        target, least = torch.tensor(pixels / 255.0, dtype=torch.float32), 0
        held: Form | None = None
        for name in _FORMS:
            form = held if name == "half, held" and held else Form(result.scene, name)
            if name == "half, held":
                with torch.no_grad():
                    cut = form.values["cut"]
                    cut.copy_(_CUTS[(cut[:, None] - _CUTS).abs().argmin(1)])
                form.used.remove("cut")
                cut.requires_grad_(False)
            score = continued(form, target, given.steps // (4 if name == "half, held" else 1))
            held = form if name == "half" else held
            size = gzipped(result.svg, form)
            least = least or size
            same = score - _DB_A_DOUBLING * math.log2(size / least)
            print(f"| {path.stem} | {name} | {score:.2f} | {size} | {same:.2f} |", flush=True)


if __name__ == "__main__":
    main()
