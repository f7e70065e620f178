"""A checkpoint of GaussianImage or Image-GS becomes an SVG; it needs torch 2.6 or later.

python examples/checkpoint.py gaussian_model.pth.tar 768 512 out.svg    # width and height in px

Layouts: github.com/Xinjie-Q/GaussianImage (gaussianimage_cholesky.py, gaussianimage_rs.py, the
kernels of its gsplat) and Image-GS as in github.com/nc-thu/image-gs (model_ori.py). All three put
the centres of pixels at whole numbers, and their rotations turn from +y to +x.
"""

import pickle
import sys
from pathlib import Path

import numpy as np
import torch

from gauss2svg import Scene, vectorize, write_svg
from gauss2svg.render import render

LAYOUTS = (
    "_xyz _features_dc _opacity _cholesky cholesky_bound",
    "_xyz _features_dc _opacity _scaling bound _rotation",
    "xy scale rot feat",
)


def loaded(path: str) -> dict[str, np.ndarray]:
    """Arrays by their names; a file that would run code is refused by torch."""
    version = torch.__version__.split(".")
    if (int(version[0]), int(version[1])) < (2, 6):  # in which CVE-2025-32434 was mended
        sys.exit(f"torch must be 2.6 or later; got {torch.__version__}. Try pip install -U torch")
    try:
        file = torch.load(path, map_location="cpu", weights_only=True)
    except pickle.UnpicklingError:
        sys.exit(
            f"{path} must have tensors and plain numbers alone; got others, such as a numpy scalar "
            "of a score. Try torch.save of the state_dict by itself"
        )
    tensors = file.get("state_dict", file)  # Image-GS has its optimiser beside it
    return {name: tensor.double().numpy() for name, tensor in tensors.items()}


def turned(scale: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    """Covariance R diag(scale^2) R^T (n, 2, 2) in px^2 of scales (n, 2) and angles (n, 1)."""
    c, s = np.cos(angle_rad[:, 0]), np.sin(angle_rad[:, 0])
    factor = np.stack([c, s, -s, c], axis=1).reshape(-1, 2, 2) * scale[:, None, :]
    return factor @ factor.transpose(0, 2, 1)


def gaussian_image(tensors: dict[str, np.ndarray], width: int, height: int) -> Scene:
    """GaussianImage, by Cholesky factors or by scales and rotations: signed colours over black."""
    if "_cholesky" in tensors:
        l1, l2, l3 = (tensors["_cholesky"] + tensors["cholesky_bound"]).T
        covariance = np.stack([l1 * l1, l1 * l2, l1 * l2, l2 * l2 + l3 * l3], axis=1)
        covariance = covariance.reshape(-1, 2, 2)
    else:
        angle_rad = 2 * np.pi / (1 + np.exp(-tensors["_rotation"]))
        covariance = turned(tensors["_scaling"] + tensors["bound"], angle_rad)
    mean = (np.tanh(tensors["_xyz"]) + 1) / 2 * [width, height] + 0.5
    color = tensors["_features_dc"] * tensors["_opacity"]
    black = np.zeros(3)
    return Scene.from_covariance(
        width, height, mean, covariance, color, blend="add", background=black
    )


def image_gs(tensors: dict[str, np.ndarray], width: int, height: int) -> tuple[Scene, np.ndarray]:
    """Return the shapes of Image-GS, half opaque, and the picture (h, w, 3) that it draws of them.

    A pixel is the mean of the ten colours that weigh most there, by exp(-r^2 / 2), which no SVG
    can say: the shapes are to be fitted to the picture.
    """
    mean = tensors["xy"] * [width, height] + 0.5
    covariance = turned(1 / tensors["scale"], tensors["rot"])
    color = np.clip(tensors["feat"], 0, 1)
    scene = Scene.from_covariance(width, height, mean, covariance, color, 0.5)
    picture, x = np.zeros((height, width, 3)), np.arange(width) + 0.5
    for row in range(height):
        [near] = np.nonzero(np.abs(row + 0.5 - scene.mean[:, 1]) < 5 * scene.sigma[:, 1])
        conic = np.linalg.inv(scene.covariance[near])
        (c11, c12), (_, c22) = conic.transpose(1, 2, 0)[..., None]
        dx, dy = x - scene.mean[near, :1], row + 0.5 - scene.mean[near, 1:]
        weight = np.exp(-(c11 * dx * dx + c22 * dy * dy) / 2 - c12 * dx * dy).T
        if (spare := len(near) - 10) > 0:
            np.put_along_axis(weight, np.argpartition(weight, spare)[:, :spare], 0, axis=1)
        total = weight.sum(axis=1, keepdims=True)
        picture[row] = weight @ tensors["feat"][near] / np.maximum(total, 1e-7)
    return scene, np.clip(picture, 0, 1)


def main(path: str, width: int, height: int, out: str) -> None:
    tensors = loaded(path)
    layouts = [name.split() for name in LAYOUTS]
    if not any(tensors.keys() >= set(names) for names in layouts):
        sys.exit(
            f"{path} must have the keys {' or '.join(LAYOUTS)}; got {' '.join(sorted(tensors))}"
        )
    if "_xyz" in tensors:
        scene = gaussian_image(tensors, width, height)
    else:
        scene, picture = image_gs(tensors, width, height)
        picture = np.float32(picture)
        scene = vectorize(picture, gaussians=len(scene), start=scene).scene
        error = float(np.square(render(scene) - picture).mean())
        print(f"{-10 * np.log10(error):.2f} dB to the picture of Image-GS")
    Path(out).write_text(write_svg(scene), encoding="utf-8")
    print(scene)


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4])
