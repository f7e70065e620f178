"""Centrelines of a thin part: branches of its skeleton, which go on through junctions.

A skeleton is distorted within about half a width of a junction, it has spurs to the corners of wide
ends, and a crossing at an acute angle becomes two junctions. So branches are cut off there, moved
to the middle of the part, and joined by where they point to.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from scipy import ndimage
from skimage.morphology import remove_small_holes, skeletonize

from gauss2svg import portable
from gauss2svg.areas.arrays import Bools, Floats, Ints, parts_of
from gauss2svg.areas.outlines import meeting_of

BRIDGE = 4.0  # length in half widths of both sides up to which two junctions may be one crossing
STEP = 0.6  # px between points across a junction
SIDE = 6  # px along a line within which it becomes wider
ACROSS = 0.25  # px between places across a line

End = tuple[int, int]  # index of a branch, and 0 for its first point or 1 for its last one


class Chain(NamedTuple):
    """The centreline of a line.

    points   (n, 2) in px
    closed   whether it ends where it starts
    is_free  whether its first end and its last end are no junction
    width    median width in px
    """

    points: Floats
    closed: bool
    is_free: tuple[bool, bool]
    width: float


class Junction(NamedTuple):
    """The places (k, 2) at which branches meet, and half the width there.

    has_spur  whether a branch to a border was left out. Then a line may end a little further on
    """

    places: Floats
    radius: float
    has_spur: bool = False

    @property
    def centre(self) -> Floats:
        """The mean place."""
        return self.places.mean(axis=0)


class Ray(NamedTuple):
    """The point at which a branch leaves a junction, its direction away from it, and its width."""

    point: Floats
    way: Floats
    width: float


def chains_of(mask: Bools, share: Floats) -> list[Chain]:
    """Return the centrelines of a thin part with these shares (h, w). `mask` is what is seen."""
    # Smaller holes are gaps beside a crossing.
    mask = remove_small_holes(mask, max_size=3, connectivity=1)
    branches, ends, labels = _branches_of(skeletonize(mask))
    half: Floats = np.asarray(ndimage.distance_transform_edt(np.pad(mask, 1)))[1:-1, 1:-1] - 0.5
    index = np.arange(1, labels.max(initial=0) + 1)
    places = ndimage.center_of_mass(labels > 0, labels, index)
    radii = ndimage.maximum(half, labels, index)
    junctions = {
        int(k): Junction(np.array(place)[None, ::-1] + 0.5, float(radius))
        for k, place, radius in zip(index, places, radii, strict=True)
    }
    _split_at_steps(branches, ends, junctions, half, share)
    kept = list[tuple[Floats, list[int]]]()
    for branch, at in zip(branches, ends, strict=True):
        if _is_spur(branch, at, junctions, half):
            k = at[0] or at[1]
            junctions[k] = junctions[k]._replace(has_spur=True)
        else:
            kept.append((_cleared(branch, at, junctions, half, share), at))
    branches, ends = [branch for branch, _ in kept], [at for _, at in kept]
    rays = {}
    for i, branch in enumerate(branches):
        width = float(np.median(_widths_along(branch, share, False)))
        rays[i, 0], rays[i, 1] = _ray(branch, width), _ray(branch[::-1], width)
    bridges = _join_crossings(branches, ends, junctions, rays)
    meeting: dict[int, list[End]] = defaultdict(list)
    for i, at in enumerate(ends):
        for side in (0, 1):
            if at[side] and i not in bridges:
                meeting[at[side]].append((i, side))
    link: dict[End, End] = {}
    for group in meeting.values():
        for turn, p, q in _turns(itertools.combinations(group, 2), rays):
            # Two ends are one line, unless one is much wider.
            if turn < (6 if len(group) == 2 else 2.2) and p not in link and q not in link:
                link[p], link[q] = q, p
    return _walked(branches, ends, bridges, junctions, rays, link, share)


_AROUND = [(0, 1), (1, 0), (0, -1), (-1, 0), (1, 1), (1, -1), (-1, -1), (-1, 1)]  # y and x


def _branches_of(skeleton: Bools) -> tuple[list[Floats], list[list[int]], Ints]:
    """Return the branches (n, 2) of a skeleton, the junctions at their ends, and all junctions.

    Branches are x, y of pixel centres. A loop without a junction ends where it starts. Junctions,
    pixels with more than two neighbours, have labels (h, w) from 1 on. Neighbouring ones have no
    branch between them. The end of a branch that is at none has 0.
    """
    pixels = list(zip(*(at.tolist() for at in np.nonzero(skeleton)), strict=True))
    on = set(pixels)
    # Diagonal neighbours have no common neighbour.
    beside = {
        (y, x): [
            (y + v, x + u)
            for v, u in _AROUND
            if (y + v, x + u) in on
            and (v == 0 or u == 0 or ((y + v, x) not in on and (y, x + u) not in on))
        ]
        for y, x in pixels
    }
    left = {pixel for pixel in pixels if len(beside[pixel]) == 2}
    is_junction = np.zeros(skeleton.shape, bool)
    for pixel in pixels:
        is_junction[pixel] = len(beside[pixel]) > 2
    junction, _ = parts_of(is_junction)
    branches, ends = list[Floats](), list[list[int]]()
    # First come branches, which begin at ends and junctions, then loops.
    for start in [p for p in pixels if p not in left] + pixels:
        is_loop = len(beside[start]) == 2
        for first in beside[start]:
            if first not in left or (is_loop and start not in left):
                continue
            branch = [start, first]
            while branch[-1] in left:
                left.remove(branch[-1])
                if branch[-1] == start:
                    break
                branch.append(next(p for p in beside[branch[-1]] if p != branch[-2]))
            branches.append(np.array(branch)[:, ::-1] + 0.5)
            ends.append([int(junction[branch[k]]) for k in (0, -1)])
    return branches, ends, junction


def _split_at_steps(
    branches: list[Floats], ends: list[list[int]], junctions: dict[int, Junction], half: Floats,
    share: Floats,
) -> None:  # fmt: skip
    """Split branches where a line becomes over twice as wide, as a stem at the beam of notes.

    branches, ends, junctions  are changed
    """
    i = 0
    while i < len(branches):
        branch = branches[i]
        if len(branch) > 2 * SIDE + 1:
            width = ndimage.median_filter(_widths_along(branch, share, False), 3)
            width = np.maximum(width, 1e-3)
            step = np.abs(portable.log(width[SIDE:] / width[:-SIDE]))
            at = int(step[3:-3].argmax()) + 3  # away from junctions
            if step[at] > portable.log(2.2):
                at += SIDE // 2
                k, (x, y) = max(junctions, default=0) + 1, branch[at].astype(int)
                junctions[k] = Junction(branch[[at]], float(half[y, x]))
                branches += [branch[at:]]
                ends += [[k, ends[i][1]]]
                branches[i], ends[i] = branch[: at + 1], [ends[i][0], k]
                continue
        i += 1


def _profile(points: Floats, share: Floats, closed: bool) -> tuple[Floats, Floats, Floats]:
    """Return the normals (n, 2) of a polyline, and the shares (n, k) at places (k,) across it.

    The share never rises away from the polyline, so that lines beside it do not count.
    """
    index, n = np.arange(len(points)), len(points)
    if closed:
        along = points[(index + 2) % n] - points[index - 2]
    else:
        along = points[np.minimum(index + 2, n - 1)] - points[np.maximum(index - 2, 0)]
    along = along / np.maximum(portable.hypot(*along.T), 1e-9)[:, None]
    normal = np.stack([-along[:, 1], along[:, 0]], axis=1)
    places = np.arange(-4.0, 4.01, ACROSS)
    at = points[:, None] + places[None, :, None] * normal[:, None]
    padded = np.pad(share, 5)
    profile = ndimage.map_coordinates(padded, [at[..., 1] + 4.5, at[..., 0] + 4.5], order=1)
    middle = len(places) // 2
    for i in range(1, middle + 1):
        for side in (1, -1):
            at, before = middle + side * i, middle + side * (i - 1)
            profile[:, at] = np.minimum(profile[:, at], profile[:, before] + 0.02)
    return normal, places, profile


def _widths_along(points: Floats, share: Floats, closed: bool) -> Floats:
    """Return the width (n,) of a line at each point of its centreline: the share across it."""
    return _profile(points, share, closed)[2].sum(axis=1) * ACROSS


def _is_spur(branch: Floats, at: list[int], junctions: dict[int, Junction], half: Floats) -> bool:
    """Whether a branch leads from a junction to the border of its part and not along a line."""
    if bool(at[0]) == bool(at[1]):
        return at[0] == at[1] != 0 and len(branch) < BRIDGE * junctions[at[0]].radius
    radius = junctions[at[0] or at[1]].radius
    if len(branch) <= 2 * radius + 2:
        return True
    if radius < 1 or len(branch) > 4.8 * radius:
        return False
    x, y = branch[:: 1 if at[0] else -1].astype(int).T
    # Half the width falls to 0 at a border. A junction may be wider than the lines that meet there.
    inner, outer = (np.median(part) for part in np.array_split(half[y, x], 2))
    return bool(outer <= 0.5 * min(inner, radius) + 0.25)


def _cleared(
    branch: Floats, at: list[int], junctions: dict[int, Junction], half: Floats, share: Floats
) -> Floats:
    """Return the points of a branch away from its ends, in the middle of the share."""
    n = len(branch)
    closed = not any(at) and n > 6 and bool((branch[0] == branch[-1]).all())
    clear = np.ones(n, bool)
    x, y = branch[n // 2].astype(int)
    free = Junction(branch[:1], min(float(half[y, x]), n / 4))
    for side, k in enumerate(at):
        end = junctions[k] if k else free._replace(places=branch[[-side]])
        if k or not closed:
            clear_px = min(end.radius + 2.0, max(end.radius + 0.5, n / 5))
            away = portable.hypot(*(branch[:, None] - end.places).transpose(2, 0, 1)).min(axis=1)
            clear &= away > (clear_px if k else end.radius - 0.5)
    if np.count_nonzero(clear) < 2:
        middle = n // 2
        return branch[max(middle - 1, 0) : middle + 1]
    first, last = np.flatnonzero(clear)[[0, -1]]
    points = branch[first : last if closed else last + 1]
    x, y = points.astype(int).T
    reach = float(np.median(half[y, x])) + 1.75
    # Twice, points move to the middle of the share across them, and are then smoothed twice.
    for _ in range(2):
        normal, places, profile = _profile(points, share, closed)
        profile = np.where(np.abs(places) <= reach, profile, 0)
        middle = portable.product(profile, places) / np.maximum(profile.sum(axis=1), 1e-6)
        points = points + np.clip(middle, -0.7, 0.7)[:, None] * normal
        for _ in range(2 if len(points) > 4 else 0):
            before, after = np.roll(points, 1, axis=0), np.roll(points, -1, axis=0)
            smooth = 0.25 * before + 0.5 * points + 0.25 * after
            if not closed:
                smooth[0], smooth[-1] = points[0], points[-1]
            points = smooth
    return points


def _ray(branch: Floats, width: float) -> Ray:
    """Return how a branch leaves the junction at its first point."""
    arm = min(int(5 + width), len(branch) - 1)
    near, far = branch[max(arm // 2, 1)] - branch[0], branch[arm] - branch[0]
    # The tangent of the parabola through three points
    way = 4 * near - far if arm > 3 else far
    return Ray(branch[0], way / max(portable.hypot(*way), 1e-9), width)


def _turn(a: Ray, b: Ray) -> float:
    """Return by how much a line turns that comes along one ray and leaves along another.

    A change of its width counts as a turn.
    """
    gap = b.point - a.point
    length = portable.hypot(*gap)
    if length < 1e-6:
        turn = float(portable.arccos(np.clip(-portable.dot(a.way, b.way), -1, 1)))
    else:
        cosines = [-portable.dot(a.way, gap) / length, portable.dot(b.way, gap) / length]
        turn = float(portable.arccos(np.clip(cosines, -1, 1)).sum())
    low, high = sorted((a.width, b.width))
    return turn + 2.5 * max(high / max(low, 1e-3) - 1.15, 0)


def _turns(pairs: Iterable[tuple[End, End]], rays: dict[End, Ray]) -> list[tuple[float, End, End]]:
    """Return pairs of ends with the turns of lines along them, the smallest turn first."""
    return sorted((_turn(rays[p], rays[q]), p, q) for p, q in pairs)


def _join_crossings(
    branches: list[Floats], ends: list[list[int]], junctions: dict[int, Junction],
    rays: dict[End, Ray],
) -> set[int]:  # fmt: skip
    """Join pairs of junctions that are one crossing, and return the branches between them.

    ends, junctions  are changed
    """
    bridges: set[int] = set()
    for i in sorted(range(len(branches)), key=lambda i: len(branches[i])):
        a, b = ends[i]
        if not a or not b or a == b:
            continue
        one, other = junctions[a], junctions[b]
        most = BRIDGE * (one.radius + other.radius) + 7
        if portable.hypot(*(one.centre - other.centre)) > most:
            continue
        sides: dict[int, list[End]] = {a: [], b: []}
        between = []
        for j, at in enumerate(ends):
            if j in bridges:
                continue
            if set(at) == {a, b} and len(branches[j]) <= most:
                between.append(j)
                continue
            for side in (0, 1):
                if at[side] in sides:
                    sides[at[side]].append((j, side))
        used: set[End] = set()
        for turn, p, q in _turns(itertools.product(sides[a], sides[b]), rays):
            if turn < 0.7 and p not in used and q not in used:
                used |= {p, q}
        if len(used) >= 4:
            bridges.update(between)
            del junctions[b]
            places = np.concatenate([one.places, other.places])
            radius = max(one.radius, other.radius)
            junctions[a] = Junction(places, radius, one.has_spur or other.has_spur)
            for at in ends:
                at[:] = [a if k == b else k for k in at]
    return bridges


def _across(a: Ray, b: Ray, junction: Junction) -> Floats:
    """Return the points (n, 2) of a line between the two rays along which it passes a junction."""
    gap = b.point - a.point
    length = portable.hypot(*gap)
    if _turn(a, b) < 0.8:
        t = np.linspace(0, 1, max(round(length / STEP), 1) + 1)[1:-1, None]
        u = 1 - t
        p, q = a.point - a.way * length / 3, b.point - b.way * length / 3
        return u * u * u * a.point + 3 * u * t * (u * p + t * q) + t * t * t * b.point
    corner = junction.centre
    meeting = meeting_of(a.point, a.way, b.point, b.way)
    if meeting is not None and portable.hypot(*(meeting - corner)) < 3 * junction.radius + 1:
        corner = meeting
    parts = [
        np.linspace(p, q, max(round(portable.hypot(*(q - p)) / STEP), 1), endpoint=False)
        for p, q in itertools.pairwise([a.point, corner, b.point])
    ]
    return np.concatenate(parts)[1:]


def _walked(
    branches: list[Floats], ends: list[list[int]], bridges: set[int],
    junctions: dict[int, Junction], rays: dict[End, Ray], link: dict[End, End], share: Floats,
) -> list[Chain]:  # fmt: skip
    """Return the lines that the links make of branches."""
    chains, used = list[Chain](), set(bridges)
    for i in range(len(branches)):
        if i in used:
            continue
        start, seen = (i, 0), {i}  # goes back to the beginning of the line
        while start in link and link[start][0] not in seen:
            start = link[start][0], 1 - link[start][1]
            seen.add(start[0])
        closed = start in link
        walk = [start]  # ends at which the line enters its branches
        while (leaves := (walk[-1][0], 1 - walk[-1][1])) in link and link[leaves] != start:
            walk.append(link[leaves])
        used |= seen | {k for k, _ in walk}
        first, last = (ends[k][side] for k, side in (start, leaves))
        parts, widths, is_loop = list[Floats](), list[Floats](), False
        if not closed and first:
            parts.append(_to_centre(rays[start], junctions[first]))
        for k, side in walk:
            branch = branches[k][:: -1 if side else 1]
            is_near = bool(portable.hypot(*(branch[0] - branch[-1])) < 1.5)
            is_loop = not any(ends[k]) and is_near and len(branch) > 5
            parts.append(branch)
            widths.append(_widths_along(branch, share, is_loop))
            if (k, 1 - side) in link:
                junction = junctions[ends[k][1 - side]]
                parts.append(_across(rays[k, 1 - side], rays[link[k, 1 - side]], junction))
        closed = closed or is_loop
        if not closed and last:
            parts.append(_to_centre(rays[leaves], junctions[last]))
        width = float(np.median(np.concatenate(widths)))
        is_free = not first or junctions[first].has_spur, not last or junctions[last].has_spur
        chains.append(Chain(np.concatenate(parts), closed, is_free, width))
    return chains


def _to_centre(ray: Ray, junction: Junction) -> Floats:
    """Return the point (1, 2) at which a line ends that goes no further than a junction."""
    ahead = max(portable.dot(ray.point - junction.centre, ray.way), 0.0)
    return (ray.point - ahead * ray.way)[None]
