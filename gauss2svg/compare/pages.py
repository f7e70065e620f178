"""Galleries: static web pages that compare results for photos.

Worker processes make the missing SVGs, and then the pages are written.
"""

from __future__ import annotations

import os
import statistics
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from functools import partial
from importlib.resources import files
from itertools import chain
from operator import itemgetter
from pathlib import Path
from typing import Any

from gauss2svg.batch.inputs import ListedPhoto, listed_photos
from gauss2svg.compare import GalleryOptions, chart, run
from gauss2svg.compare.grid import FOLDER, Grid, Task, csv_text
from gauss2svg.compare.records import COUNTS, Row
from gauss2svg.compare.variants import Variant, entries_of, variants_of
from gauss2svg.errors import OutputError, instance, on_one_line
from gauss2svg.files import as_json, make_folder, write_all_atomically
from gauss2svg.measure import ON_REQUEST, PSNR, SCORES, Score, heatmap
from gauss2svg.options import file_name
from gauss2svg.pipeline.run import memory_limit, thread_count
from gauss2svg.pool import Pool
from gauss2svg.version import __version__

# A row of gallery.json has these entries of a report. The reports of other tools lack some of them.
NUMBERS = (
    "width", "height", *COUNTS, "elements", "svg_bytes", "svgz_bytes", "total_s", "fit_s",
    *(score.key for score in SCORES), "psnr_model", "psnr_roundtrip", "renderer", "seed",
)  # fmt: skip


def build_gallery(
    photos: Sequence[str | os.PathLike[str]],
    directory: str | os.PathLike[str],
    *,
    variants: Iterable[str] | None = None,
    counts: Iterable[int] | None = None,
    peers: Iterable[str] = (),
    axes: Mapping[str, Sequence[Any]] | None = None,
    options: GalleryOptions | None = None,
    command: str | None = None,
    progress: bool = False,
) -> dict[str, Any]:
    """Vectorise photos in several variants, and write web pages that compare them.

    Return the content of gallery.json: `rows` has a row for each SVG, `summary` one for each
    variant, with medians and totals, and `failures` one for each SVG that could not be made. For a
    photo that could not be read, there is one failure, whose variant is None. The first page is
    index.html.

    photos     paths of the photos
    directory  folder of the pages. It is created if it does not exist.
    variants   names of presets
    counts     numbers of Gaussians
    peers      names of other tools, such as "vtracer", or "vtracer:detailed" for other settings.
               Tools that are not installed are skipped. "mine=FOLDER" has files of another method.
    axes       the values of each option of `vectorize` that is varied. Every combination is a
               variant. If there are no variants, counts or axes, the presets draft, balanced and
               high are compared.
    options    all other options, such as GalleryOptions(jobs=2, title="Flowers")
    command    command line that the pages show
    progress   whether to show a bar on a terminal or in a notebook

    A finished SVG is kept. It is made again only if the bytes of the photo, the settings, the code
    of this package, the renderer or the packages that compute scores have changed. An interruption
    loses only the SVGs that are not finished. If a photo cannot be read, the first page lists the
    failure, and the other photos are still compared. The pages need neither a server nor a network.
    Raise InputError for bad arguments. Raise OutputError if the folder cannot be written, or if it
    has other files with the names of the pages.
    """
    listed = listed_photos(photos)
    chosen, absent = variants_of(variants, counts, peers, axes)
    entries = {variant: entries_of(variant.files, listed) for variant in chosen}
    options = instance(options, "options", GalleryOptions)
    jobs, size = options.jobs, options.photo_size
    # If no number of threads is given, the processes share the cores.
    threads = thread_count(options.threads) // (jobs if options.threads is None else 1) or 1
    root = _folder(directory)
    # Several processes run at the same time, so each gets an equal share of the free memory as its
    # max_memory. Without this limit, each of them could take most of the free memory.
    run_options = {
        "threads": threads, "max_memory": memory_limit(None) // jobs,
        "max_pixels": options.max_pixels, "fragments": True,
    }  # fmt: skip

    def task_of(photo: ListedPhoto, variant: Variant | None = None) -> Task:
        page = f"photos/{photo.slug}"
        folder = f"{page}/{variant.slug}" if variant else page
        page_photo = root / page / "photo.webp"
        parameters = {
            "folder": str(root / folder), "page_photo": str(page_photo), "photo_size": size,
            "options": run_options, "peer_timeout": options.peer_timeout,
        }  # fmt: skip
        entry = entries[variant].get(photo, {}) if variant else {}
        columns = {"jobs": jobs, "threads": threads, "folder": folder}
        file = root / folder / "picture.svg" if variant else page_photo
        return Task(photo, variant, parameters, (size,), columns, entry, file)

    plan = {task_of(photo): [task_of(photo, variant) for variant in chosen] for photo in listed}
    grid = Grid(root / "gallery.jsonl", [*plan, *chain(*plan.values())], progress)
    try:
        with Pool(jobs) as pool:
            # The photos are prepared first, so that bad photos are reported early.
            for _ in grid.run(plan, pool, run.make_photo):
                pass
            svgs = [task for photo in plan if grid.has_succeeded(photo) for task in plan[photo]]
            for _ in grid.run(svgs, pool, run.make_svg):
                pass
    finally:
        call = f"build_gallery([.. {len(listed)} photos ..], {os.fspath(root)!r}, ..)"
        about = {
            "gauss2svg": __version__, "title": options.title,
            "command": on_one_line(command or call),
            "date": datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
            "photo_size": size, "peers_absent": absent,
        }  # fmt: skip
        document = write_pages(root, about, chosen, plan, grid)
    return document


def _folder(directory: str | os.PathLike[str]) -> Path:
    """Return the folder of a gallery as a path.

    Raise OutputError if a name that the gallery would write to is already taken by a file or folder
    that is not part of a gallery.
    """
    root = Path(file_name("directory", directory, FOLDER))
    names = ("gallery.json", "gallery.csv", "index.html", "trade-off.html", "how.html")
    for name in (*names, "photos", "assets"):
        if os.path.lexists(root / name) and not (root / "gallery.jsonl").exists():
            line = "exists and is not part of a gallery, so it is kept. Try another folder"
            raise OutputError(f"{root / name} {line}")
    return root


def write_pages(
    root: Path,
    about: Mapping[str, Any],
    variants: Sequence[Variant],
    plan: Mapping[Task, Sequence[Task]],
    grid: Grid,
) -> dict[str, Any]:
    """Write the pages, the data and the static files. Return the data of gallery.json.

    No old file is replaced before all new files are on the disk.

    about  title, command, date and options of the gallery
    plan   {task of a photo: tasks of its SVGs}
    Raise OutputError if a file cannot be written.
    """
    results: list[Row] = []
    for photo in filter(grid.has_succeeded, plan):
        tasks = filter(grid.has_succeeded, plan[photo])
        record = grid.records[photo]
        svgs = [_svg(record, grid.records[task], task.variant) for task in tasks if task.variant]
        results.append({**record, "photo": photo.photo, "svgs": svgs})
    svgs = [svg for result in results for svg in result["svgs"]]
    rows, reports = [svg["row"] for svg in svgs], [svg["report"] for svg in svgs]
    failed = {task: row["error"] for task, row in grid.records.items() if "error" in row}
    unfinished = [t for photo in plan.keys() - failed for t in plan[photo] if not grid.records[t]]
    document = {
        **about,
        "renderers": sorted({row["renderer"] for row in rows}),
        # "missing" is the number of SVGs that were not made, because the run was interrupted.
        "missing": len(unfinished),
        "summary": summary_of(rows, variants),
        "rows": rows,
        "failures": [
            {"photo": t.photo.name, "variant": t.variant and t.variant.label, "error": error}
            for t, error in failed.items()
        ],
    }
    own = [variant for variant in variants if variant.is_own] or variants
    versions = {version for report in reports for version in report.get("versions", {}).items()}
    versions |= {(row["tool"], row["tool_version"]) for row in rows if row["tool_version"]}
    environment = chart.template_environment()
    environment.globals |= {
        **document,
        "variants": variants, "results": results, "reports": reports,
        # Presets are listed from the fastest on. Pages show the one in the middle first.
        "main": own[len(own) // 2],
        "scores": [s for s in SCORES if s.always or any(row[s.key] is not None for row in rows)],
        # A gallery of photos alone has no columns for areas, lines and nodes.
        "parts": {
            key: name for key, name in COUNTS.items()
            if key == "gaussians" or any(row[key] for row in rows)
        },
        "explained": ON_REQUEST, "costs": chart.COSTS, "heatmap": heatmap, "files": run,
        "unmeasured": dict.fromkeys(chain(*(r.get("scores_missing", ()) for r in reports))),
        "chart_of": partial(chart_of, results, variants),
        "versions": sorted(versions),
        "machines": dict.fromkeys(chart.machine_text(row["machine"]) for row in rows),
    }  # fmt: skip

    def page(template: str, folder: str = "", **more: Any) -> bytes:
        html = environment.get_template(f"{template}.html.jinja")
        return html.render(page=template, root=folder, **more).encode()

    contents = {
        root / "gallery.json": as_json(document),
        root / "gallery.csv": csv_text(rows).encode(),
        **{root / f"{name}.html": page(name) for name in ("index", "trade-off", "how")},
    }
    for file in (files("gauss2svg.compare") / "static").iterdir():
        contents[root / "assets" / file.name] = file.read_bytes()
    for before, result, after in zip([None, *results], results, [*results[1:], None], strict=False):
        path = root / result["folder"] / "index.html"
        contents[path] = page("photo", "../../", result=result, previous=before, next=after)
    make_folder(root / "assets")
    write_all_atomically(contents)
    return document


def _svg(photo: Row, record: Row, variant: Variant) -> Row:
    """Return the record of an SVG with four more entries: title, variant, row and script.

    The entry `row` is the row that the SVG has in gallery.json. The entry `script` has the values
    that the scripts of the pages read.
    """
    report, folder = record["report"], record["folder"]
    names = {"SVG": "picture.svg", "report": "report.json"}
    names |= {"scene": "scene.npz", "outlines": "outlines.svg"} if variant.is_own else {}
    numbers = {name: report.get(name) for name in NUMBERS}
    columns = ("tool", "tool_version", "cpu_s", "machine", "jobs", "threads")
    row = {
        "photo": photo["image"],
        "page": f"{photo['folder']}/index.html",
        "variant": variant.label,
        **numbers,
        **{name: record[name] for name in columns},
        "date": record["date"][:10],
        "files": {kind: f"{folder}/{name}" for kind, name in names.items()},
    }
    elements = f"{chart.whole(numbers['elements'])} elements"
    texts = {
        **{key: chart.whole(numbers[key]) for key in COUNTS},
        "shapes": elements if numbers["gaussians"] is None else chart.whole(numbers["gaussians"]),
        "svg_bytes": chart.size(numbers["svg_bytes"]),
        "total_s": chart.seconds(numbers["total_s"]),
        **{axis.key: axis.text(numbers[axis.key]) for axis in SCORES},
    }
    script = {
        **numbers,
        **{k: crop | {"psnr": PSNR.text(crop["psnr"])} for k, crop in record["crops"].items()},
        "slug": variant.slug, "name": variant.label, "folder": folder, "isOwn": variant.is_own,
        "texts": texts,
        "rounds": [(number, chart.whole(count)) for number, count in record["rounds"]],
    }  # fmt: skip
    title = f"{photo['image']}, {variant.label}"
    return {**record, "title": title, "variant": variant, "row": row, "script": script}


def summary_of(rows: Sequence[Row], variants: Iterable[Variant]) -> list[Row]:
    """Return a row for each variant that has SVGs, with the number of photos, medians and totals.

    Medians and totals leave out missing numbers, such as the infinite PSNR of an exact SVG.
    """
    summary = []
    keys = (*COUNTS, "svg_bytes", "svgz_bytes", "total_s", *(score.key for score in SCORES))
    for variant in variants:
        own = [row for row in rows if row["variant"] == variant.label]
        values = {name: [row[name] for row in own if row[name] is not None] for name in keys}
        medians = {f"median_{n}": statistics.median(v) if v else None for n, v in values.items()}
        totals = {f"total_{name}": sum(values[name]) for name in ("svg_bytes", "total_s")}
        summary += [{"variant": variant.label, "photos": len(own), **medians, **totals}] * bool(own)
    return summary


def chart_of(
    results: Sequence[Row], variants: Sequence[Variant], axis: Score, cost: chart.Cost
) -> dict[str, Any] | None:
    """Return the chart of a score over a cost. Each point links to the page of its photo.

    A line joins the SVGs that gauss2svg has made of a photo, from the cheapest to the dearest.
    """
    points = [
        {
            "cost": svg["report"][cost.key],
            "score": score,
            "series": variants.index(svg["variant"]),
            "group": index if svg["variant"].is_own else None,
            "text": f"{svg['title']}: {axis.text(score)}, {cost.text(svg['report'][cost.key])}",
            "href": f"{svg['row']['page']}#{svg['variant'].slug}",
        }
        for index, result in enumerate(results)
        for svg in result["svgs"]
        if axis.can_show(score := svg["report"].get(axis.key))
        and svg["report"].get(cost.key) is not None
    ]
    return chart.scatter(sorted(points, key=itemgetter("cost")), cost, axis)
