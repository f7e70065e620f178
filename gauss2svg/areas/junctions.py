"""Lines of a thin part: branches of its skeleton, which go on through crossings and junctions.

A skeleton is distorted within about half a width of a junction, it has spurs to the corners of wide
ends, and a crossing at an acute angle becomes two junctions. So branches are cut off there, and
joined by where they point to.
"""

from __future__ import annotations

import itertools
from collections import defaultdict
from typing import NamedTuple

import numpy as np
from scipy import ndimage
from skimage.morphology import remove_small_holes, skeletonize

from gauss2svg import portable
from gauss2svg.areas.centrelines import branches_of, centred, widths_along
from gauss2svg.areas.kernels import Bools, Floats

CLEAR = 2.0  # px, and half a width, within which a skeleton is distorted by a junction
HOLE = 3  # px; smaller holes are gaps beside a crossing
NEAR = 1.5  # px, and half a width, within which two junctions are one
BESIDE = 1.75  # px beyond half a width in which the middle of a line is looked for
SPUR = 3  # pixels; shorter branches are noise of the skeleton
SPURS, TIP, TAPER = 1.3, 4.8, 0.5  # lengths of spurs in half widths, and how much a tip tapers
STRAIGHT_RAD, CROSSING_RAD = 0.8, 0.7  # largest turn of a line at a junction and at a crossing
CORNER_RAD = 2.2  # largest turn of a line that has its corner at a junction
# Length in half widths of both sides, and in px, up to which two junctions may be one crossing
BRIDGE, BRIDGE_PX = 4.0, 7.0
ARM, ARMS = 5.0, 1.0  # px, and widths, along which the direction of a branch is measured
ALIKE, RAD_OF_WIDTH = 1.15, 2.5  # ratio of widths that counts as none, and turn for a larger one
FAR = 3.0  # half widths from a junction within which a corner lies
STEP = 0.6  # px between points across a junction

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
    mask = remove_small_holes(mask, max_size=HOLE, connectivity=1)
    branches, ends, labels = branches_of(skeletonize(mask))
    half: Floats = np.asarray(ndimage.distance_transform_edt(np.pad(mask, 1)))[1:-1, 1:-1] - 0.5
    junctions = _junctions_of(labels, half)
    kept = []
    for i, (branch, at) in enumerate(zip(branches, ends, strict=True)):
        if not _is_spur(branch, at, junctions, half):
            kept.append(i)
        else:
            k = at[0] or at[1]
            junctions[k] = junctions[k]._replace(has_spur=True)
    branches, ends = [branches[i] for i in kept], [ends[i] for i in kept]
    merged = _merge_near(branches, ends, junctions)
    branches, ends = [branches[i] for i in merged], [ends[i] for i in merged]
    branches = [
        _cleared(branch, at, junctions, half, share)
        for branch, at in zip(branches, ends, strict=True)
    ]
    rays = {
        (i, side): _ray(branch[:: -1 if side else 1], width)
        for i, branch in enumerate(branches)
        for width in [float(np.median(widths_along(branch, share, False)))]
        for side in (0, 1)
    }
    bridges = _join_crossings(branches, ends, junctions, rays)
    meeting: dict[int, list[End]] = defaultdict(list)
    for i, at in enumerate(ends):
        for side in (0, 1):
            if at[side] and i not in bridges:
                meeting[at[side]].append((i, side))
    link = {}
    for group in meeting.values():
        link |= _links(group, rays, len(group) == 2, CORNER_RAD)
    return _walked(branches, ends, bridges, junctions, rays, link, share)


def _junctions_of(labels: Floats, half: Floats) -> dict[int, Junction]:
    """Return the junctions of these labels (h, w). `half` is the distance to the border."""
    index = np.arange(1, labels.max(initial=0) + 1)
    if not len(index):
        return {}
    places = np.array(ndimage.center_of_mass(labels > 0, labels, index))[:, ::-1] + 0.5
    radius = ndimage.maximum(half, labels, index)
    return {
        int(k): Junction(place[None], float(r))
        for k, place, r in zip(index, places, radius, strict=True)
    }


def _is_spur(branch: Floats, at: list[int], junctions: dict[int, Junction], half: Floats) -> bool:
    """Whether a branch leads from a junction to the border of its part and not along a line."""
    if bool(at[0]) == bool(at[1]):
        return at[0] == at[1] != 0 and len(branch) < BRIDGE * junctions[at[0]].radius
    radius = junctions[at[0] or at[1]].radius
    if len(branch) <= max(SPUR, SPURS * radius + 1):
        return True
    if radius < 1 or len(branch) > TIP * radius:
        return False
    x, y = branch[slice(len(branch) // 2, None) if at[0] else slice(len(branch) // 2)].astype(int).T
    return bool(np.median(half[y, x]) <= TAPER * radius + 0.25)


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
            clear_px = min(end.radius + CLEAR, max(end.radius + 0.5, n / 5))
            away = portable.hypot(*(branch[:, None] - end.places).transpose(2, 0, 1)).min(axis=1)
            clear &= away > (clear_px if k else end.radius - 0.5)
    if np.count_nonzero(clear) < 2:
        middle = n // 2
        return branch[max(middle - 1, 0) : middle + 1]
    first, last = np.flatnonzero(clear)[[0, -1]]
    branch = branch[first : last if closed else last + 1]
    x, y = branch.astype(int).T
    return centred(branch, share, closed, float(np.median(half[y, x])) + BESIDE)


def _merge_near(
    branches: list[Floats], ends: list[list[int]], junctions: dict[int, Junction]
) -> list[int]:
    """Make one junction of those that are as near as a skeleton may be off.

    Return the indices of the branches that are left. `ends` and `junctions` are changed.
    """
    gone = set()
    for i, branch in enumerate(branches):
        a, b = ends[i]
        if not a or not b:
            continue
        one, other = junctions[a], junctions[b]
        radius = max(one.radius, other.radius)
        if len(branch) > radius + NEAR + 1:
            continue
        gone.add(i)
        if a != b:
            _merge(a, b, ends, junctions)
    return [i for i in range(len(branches)) if i not in gone]


def _merge(a: int, b: int, ends: list[list[int]], junctions: dict[int, Junction]) -> None:
    """Make junction b a part of junction a."""
    one, other = junctions[a], junctions.pop(b)
    places = np.concatenate([one.places, other.places])
    radius = max(one.radius, other.radius)
    junctions[a] = Junction(places, radius, one.has_spur or other.has_spur)
    for at in ends:
        at[:] = [a if k == b else k for k in at]


def _ray(branch: Floats, width: float) -> Ray:
    """Return how a branch leaves the junction at its first point."""
    arm = min(int(ARM + ARMS * width), len(branch) - 1)
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
    return turn + RAD_OF_WIDTH * max(high / max(low, 1e-3) - ALIKE, 0)


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
        most = BRIDGE * (one.radius + other.radius) + BRIDGE_PX
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
        turns = sorted(
            (_turn(rays[p], rays[q]), p, q) for p, q in itertools.product(sides[a], sides[b])
        )
        used: set[End] = set()
        for turn, p, q in turns:
            if turn < CROSSING_RAD and p not in used and q not in used:
                used |= {p, q}
        if len(used) >= 4:
            bridges.update(between)
            _merge(a, b, ends, junctions)
    return bridges


def _links(group: list[End], rays: dict[End, Ray], is_pair: bool, most: float) -> dict[End, End]:
    """Return the ends at a junction that go on as one line, each with the other.

    is_pair  whether there are two ends, which are always one line
    """
    link: dict[End, End] = {}
    turns = sorted((_turn(rays[p], rays[q]), p, q) for p, q in itertools.combinations(group, 2))
    for turn, p, q in turns:
        if (turn < most or is_pair) and p not in link and q not in link and p != q:
            link[p], link[q] = q, p
    return link


def _across(a: Ray, b: Ray, junction: Junction) -> Floats:
    """Return the points (n, 2) of a line between the two rays along which it passes a junction."""
    gap = b.point - a.point
    length = portable.hypot(*gap)
    if _turn(a, b) < STRAIGHT_RAD:
        t = np.linspace(0, 1, max(round(length / STEP), 1) + 1)[1:-1, None]
        u = 1 - t
        p, q = a.point - a.way * length / 3, b.point - b.way * length / 3
        return u * u * u * a.point + 3 * u * t * (u * p + t * q) + t * t * t * b.point
    corner = junction.centre
    det = a.way[0] * b.way[1] - a.way[1] * b.way[0]
    if abs(det) > 0.15:
        meeting = a.point + (gap[0] * b.way[1] - gap[1] * b.way[0]) / det * a.way
        if portable.hypot(*(meeting - corner)) < FAR * junction.radius + 1:
            corner = meeting
    points = [a.point, corner, b.point]
    parts = [
        np.linspace(p, q, max(round(portable.hypot(*(q - p)) / STEP), 1), endpoint=False)
        for p, q in itertools.pairwise(points)
    ]
    return np.concatenate(parts)[1:]


def _walked(
    branches: list[Floats], ends: list[list[int]], bridges: set[int],
    junctions: dict[int, Junction], rays: dict[End, Ray], link: dict[End, End], share: Floats,
) -> list[Chain]:  # fmt: skip
    """Return the lines that the links make of branches."""
    chains: list[Chain] = []
    used = set(bridges)
    for i in range(len(branches)):
        if i in used:
            continue
        start, walked = (i, 0), {i}  # goes back to the beginning of the line
        while start in link and link[start][0] not in walked:
            before, side = link[start]
            start = before, 1 - side
            walked.add(before)
        closed = start in link and link[start][0] in walked
        parts, wide, end = list[Floats](), list[Floats](), start
        if not closed and ends[start[0]][start[1]]:
            parts.append(_to_centre(rays[start], junctions[ends[start[0]][start[1]]]))
        while True:
            index, side = end
            used.add(index)
            branch = branches[index][:: -1 if side else 1]
            is_loop = not any(ends[index]) and portable.hypot(*(branch[0] - branch[-1])) < 1.5
            is_loop = is_loop and len(branch) > 5
            parts.append(branch)
            wide.append(widths_along(branch, share, bool(is_loop)))
            last = index, 1 - side
            following = link.get(last)
            if following is None:
                break
            junction = junctions[ends[index][1 - side]]
            parts.append(_across(rays[last], rays[following], junction))
            if following[0] in used:
                break
            end = following
        closed = closed or bool(is_loop)
        at = ends[last[0]][last[1]]
        if not closed and at:
            parts.append(_to_centre(rays[last], junctions[at]))
        first = ends[start[0]][start[1]]
        is_free = not first or junctions[first].has_spur, not at or junctions[at].has_spur
        chains.append(
            Chain(np.concatenate(parts), closed, is_free, float(np.median(np.concatenate(wide))))
        )
    return chains


def _to_centre(ray: Ray, junction: Junction) -> Floats:
    """Return the point (1, 2) at which a line ends that goes no further than a junction."""
    ahead = max(portable.dot(ray.point - junction.centre, ray.way), 0.0)
    return (ray.point - ahead * ray.way)[None]
