"""Sections 1 to 5, which end at the rendered image as the paper does."""

from __future__ import annotations

from dataclasses import asdict

import numpy as np

from gauss2svg.measure import metrics
from gauss2svg.render.cpu import kernel_lock

from . import claims, kernel_window, losses, plots, schedules
from .book import ZOOM, Book, Picture, Table, counted, difference, texts
from .engine import EXPONENTIAL, LINEAR, LOSSES, PRODUCT, WAYS, Trace, fit, rendered

GAIN = 4  # of the differences shown


def progressive(book: Book) -> None:
    """Sections 1 and 2: the rounds and iterations of one fit."""
    with kernel_lock:
        trace = schedules.progressive(book.pixels, book.settings)
    book.page["rounds"] = [*_rounds(book, trace), _photo(book)]
    shown = []
    for iteration in schedules.shown_iterations(book.settings):
        image = rendered(trace.snapshots[iteration])
        caption = f"{counted(iteration, 'iteration')}, {metrics.psnr(image, book.pixels):.2f} dB"
        alt = f"The model of {book.shown} after {caption}"
        shown.append(book.save(f"iteration-{iteration}", image, alt, caption))
    book.page["iterations"] = shown
    points = schedules.curve(trace, book.pixels)
    book.page["iterations_plot"] = plots.iterations_plot(book.folder, points)
    book.numbers["iterations"] = points


def _rounds(book: Book, trace: Trace) -> list[Picture]:
    pictures = []
    for k, scene in sorted(trace.by_round.items()):
        image = rendered(scene)
        count = counted(len(scene), "Gaussian")
        caption = f"{count}, {metrics.psnr(image, book.pixels):.2f} dB"
        alt = f"The model of {book.shown} after round {k}, of {count}"
        pictures.append(book.save(f"round-{k}", image, alt, caption))
    return pictures


def _photo(book: Book) -> Picture:
    return book.save("photo", book.pixels, f"The photo {book.shown}", "the photo")


def compared_schedules(book: Book) -> None:
    """Section 3: all at once, linear and exponential at the same count."""
    settings = book.settings
    with kernel_lock:
        scores = schedules.compared(book.photos, settings)
        more = schedules.at_more(book.photos, settings)
    lines = schedules.summaries(scores)
    by_count = {way.name: schedules.mean_by_count(more, way.name) for way in WAYS}
    gains, needed = {}, {}
    for way in by_count:
        for schedule in (EXPONENTIAL, LINEAR):
            level = schedules.reached(scores, way, schedule, settings.more_seeds)
            gains[f"{way}, {schedule}"] = schedules.differences(scores, way, schedule)
            needed[f"{way}, {schedule}"] = schedules.count_for(level, by_count[way])
    reached = {
        way: schedules.reached(scores, way, EXPONENTIAL, settings.more_seeds) for way in by_count
    }
    book.page["schedules_plot"] = plots.schedules_plot(book.folder, scores)
    book.page["more_plot"] = plots.more_plot(book.folder, by_count, reached)
    book.page["schedules_table"] = Table(
        "schedules-table",
        "PSNR of the model in dB; its standard deviation over seeds; its gain over all at once, "
        "photo by photo and seed by seed, with the standard deviation of the gain",
        ["procedure, schedule", "mean", "over seeds", "gain over all at once"],
        [
            [
                f"{s.way}, {s.schedule}", f"{s.mean:.2f}", f"{s.spread:.2f}",
                f"{s.gain:+.2f} ± {s.scatter:.2f}",
            ]
            for s in lines
        ],
    )  # fmt: skip
    book.page["more_table"] = Table(
        "more-table",
        f"Mean PSNR in dB of all at once by its number of Gaussians, "
        f"{counted(len(settings.more_seeds), 'seed')}; last, the PSNR of exponential with "
        f"{settings.gaussians}",
        ["procedure", *texts("d", settings.more), "exponential"],
        [
            [way, *texts(".2f", [psnr for _, psnr in line]), f"{reached[way]:.2f}"]
            for way, line in by_count.items()
        ],
    )
    book.numbers["schedules"] = [asdict(score) for score in scores]
    book.numbers["all_at_once_with_more"] = [asdict(score) for score in more]
    book.verdicts.append(
        claims.fewer_gaussians(gains, needed, settings.gaussians, max(settings.more))
    )


def cropped_windows(book: Book) -> None:
    """Section 4: cropping by fixed windows, of one wide Gaussian and of a fit."""
    settings = book.settings
    with kernel_lock:
        scene = fit(
            book.pixels, PRODUCT, EXPONENTIAL, settings.window_gaussians, settings.rounds,
            settings.iterations,
        ).scene  # fmt: skip
    sizes = [share * settings.side for share in settings.kernel_sizes]
    fits = [kernel_window.windowed(scene, size) for size in sizes]
    chosen = len(sizes) // 2
    bell = kernel_window.bell(settings.side, sizes[0])
    single = kernel_window.windowed(bell, sizes[0])
    book.page["window_size"], book.page["bell_size"] = sizes[chosen], sizes[0]
    book.page["bell_sigma"] = float(bell.sigma[0, 0])
    book.page["bells"] = _side_by_side(book, single, "bell", "One wide Gaussian")
    book.page["windows"] = _side_by_side(book, fits[chosen], "window", f"A fit of {book.shown}")
    both = ["fixed", "adaptive"]
    book.page["windows_table"] = Table(
        "windows-table",
        "The fit with windows of several widths: Gaussians above the threshold, largest jump at a "
        "window's edge inside the picture and largest error in levels of 255, PSNR in dB against "
        "the image without windows",
        ["width, px", "above"]
        + [f"{name}, {kind}" for name in ("jump", "error", "PSNR") for kind in both],
        [
            [
                f"{f.crop.kernel_size:.0f}", f"{f.crop.cropped} of {f.crop.count}",
                *texts(".1f", f.crop.jump + f.crop.largest + f.crop.psnr),
            ]
            for f in fits
        ],
    )  # fmt: skip
    book.numbers["bell"] = asdict(single.crop)
    book.numbers["windows"] = [asdict(f.crop) for f in fits]
    crop = fits[chosen].crop
    book.verdicts.append(claims.crop_cured(*crop.jump, *crop.psnr))


def _side_by_side(
    book: Book, shown: kernel_window.Windowed, name: str, of_what: str
) -> list[Picture]:
    save = book.save
    pictures = [save(f"{name}-whole", shown.whole, f"{of_what} without a window", "no window")]
    for kind, image, psnr in zip(
        ("fixed", "adaptive"), (shown.fixed, shown.adaptive), shown.crop.psnr, strict=True
    ):
        alt = f"{of_what} with {kind} windows, {psnr:.1f} dB"
        caption = f"{kind} window, {psnr:.1f} dB to no window"
        pictures.append(save(f"{name}-{kind}", image, alt, caption))
        apart = difference(image, shown.whole, GAIN).astype(np.float32)
        alt += f": {GAIN} times the difference"
        pictures.append(save(f"{name}-{kind}-off", apart, alt, f"{kind}, difference x {GAIN}"))
    return pictures


def compared_losses(book: Book) -> None:
    """Section 5: four losses, enlarged where they differ most."""
    with kernel_lock:
        scores, images = losses.compared(book.photos, book.settings)
    rows = []
    for name, pixels in book.photos.items():
        square = losses.most_different_square([images[name, loss] for loss in LOSSES])
        crop = book.save(
            f"loss-{name}-photo", pixels[square], f"Part of the photo {name}", name, ZOOM
        )
        row = [crop]
        for loss in LOSSES:
            score = next(s for s in scores if (s.photo, s.loss) == (name, loss))
            caption = f"{loss}: {score.psnr:.2f} dB, SSIM {score.ssim:.3f}"
            file = f"loss-{name}-{loss.replace('+', '-')}"
            alt = f"The same part of {name} fitted with the loss {loss}"
            row.append(book.save(file, images[name, loss][square], alt, caption, ZOOM))
        rows.append(row)
    means = losses.means(scores)
    book.page["losses"] = rows
    book.page["losses_table"] = Table(
        "losses-table",
        "Mean over the photos, of the model",
        ["loss", "PSNR, dB", "SSIM"],
        [[loss, f"{psnr:.2f}", f"{ssim:.4f}"] for loss, (psnr, ssim) in means.items()],
    )
    book.numbers["losses"] = [asdict(score) for score in scores]
    book.verdicts.append(claims.losses_differ(means))
