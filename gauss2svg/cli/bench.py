"""The command `gauss2svg bench`, imported only when it is run."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from gauss2svg.batch.inputs import local_photos
from gauss2svg.cli.parameters import STATUS_SOME_FAILED, Photos, Quiet, words
from gauss2svg.cli.terminal import counting_bar, say

if TYPE_CHECKING:
    from gauss2svg.compare.grid import Progress


def bench_command(
    images: Photos,
    *,
    output: Annotated[Path, Parameter(name=["--output", "-o"])],
    axis: Annotated[list[str] | None, Parameter(negative="")] = None,
    peers: str = "",
    peer_timeout: float = 300.0,
    references: Path | None = None,
    reference_scale: float = 4.0,
    seed: int = 0,
    threads: int | None = None,
    quiet: Quiet = False,
) -> int:
    """Vectorise photos with many settings, and write tables and plots of cost and quality.

    Parameters
    ----------
    images
        Photos.
    output
        Folder for rows.jsonl, bench.json, bench.csv, summary.md and the plots. The same command
        continues an interrupted benchmark and keeps the finished runs.
    axis
        Option to vary, as NAME=VALUE,VALUE, or as NAME for all values of an option that has only a
        few. NAME is an option of the main command that changes the file, such as gaussians,
        iterations, quality, loss or palette, or a constant of the code, such as
        pipeline.limits.FULL. Several axes give all combinations.
        Without any, the presets and some counts are run. Separate lists of inks by semicolons:
        "inks=6;#f7c306,#17324d".
    peers
        Other tools to measure if they are installed, separated by commas: vtracer, splatthis,
        primitive, swag, neroued, jpeg, webp, avif, and vtracer1, which is 1.0 in the Python that
        the variable GAUSS2SVG_VTRACER1 names. One setting of a tool follows a colon, such as
        jpeg:30. Their SVGs are rasterised by resvg.
    peer_timeout
        Maximum time (s) that another tool may take for a photo.
    references
        Folder with the SVGs that the photos were made from, by the names of the photos: logo.svg
        for logo.png. Every SVG is also compared with its reference, enlarged.
    reference_scale
        Factor by which SVGs are enlarged to be compared with their references.
    seed
        Random seed. The same seed gives the same file.
    threads
        Number of CPU threads of gauss2svg. The default is one for each core.
    quiet
        Show neither progress nor summary.

    """
    from gauss2svg.compare.table import run_bench
    from gauss2svg.compare.variants import parse_axes, peer_variants
    from gauss2svg.measure import packages_missing

    names, axes = words(peers), parse_axes(axis or ())
    if absent := peer_variants(names)[1]:
        say(f"skipped, not installed: {', '.join(absent)}")
    for line in packages_missing():
        say(line)
    kept = 0
    with counting_bar(quiet) as update:

        def progress(state: Progress) -> None:
            nonlocal kept
            kept = state.kept
            update("; ".join(state.now), state.done, state.total)

        rows = run_bench(
            local_photos(images),
            output,
            axes=axes or None,
            peers=names,
            seed=seed,
            threads=threads,
            peer_timeout=peer_timeout,
            references=references,
            reference_scale=reference_scale,
            progress=progress,
        )
    failed = [row for row in rows if "error" in row]
    if not quiet:
        from_before = f", {kept} of them kept from before" if kept else ""
        say(f"{len(rows)} runs{from_before}; {len(failed)} failed; see {output / 'summary.md'}")
    for row in failed:
        say(f"failed: {row['label']} on {row['image']}: {row['error']}")
    return STATUS_SOME_FAILED if failed else 0
