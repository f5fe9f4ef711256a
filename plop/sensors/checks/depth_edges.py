"""Does depth lie on its colour picture? Steps in depth must fall on edges of colour.

Where depth jumps, another surface begins, and it nearly always has another colour or shade. Depth that another lens saw
(depth that was not aligned to colour, though both pictures have one size) is shifted and zoomed against colour. The
shift and zoom at which the steps fall on colour edges best are searched; what is found counts only if it is better than
none by more than pieces of the outline scatter, and stands out from what any shift gives on this texture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from plop.geometry.view import View

STEP_M, STEP_SHARE = 0.015, 0.03
"""A step in depth is larger than this [m] and this share of the depth: far above sensor noise (2 mm), and what a
crease, whose edge need not have a colour of its own, cannot reach."""
STEP_NOISE = 8.0
"""... and larger than so many standard deviations of the depth's noise."""
BRIDGE_PX = 3
"""Holes in depth along an outline, as stereo cameras leave them, are bridged up to this width [px]."""
MOST_POINTS, FEWEST_POINTS = 600, 40
"""Points of outlines used in all, and fewer tell nothing: a dozen pixels on each side of a thing."""
LEAST_INSIDE = 0.35
"""Share of the points that a move must leave in the picture."""
FEW_POINTS = 200
"""Points with which a wide search begins."""
PIECES = 16
"""Outlines are cut into so many pieces by place, which are taken to err independently."""
SURE = 4.0
"""Standard errors by which a shift must be better than none; the search tries thousands."""
STANDS_OUT = 4.0
"""Robust standard deviations of the scores of wrong shifts by which a right one is above their median."""
LOOKS_RIGHT = 2.5
"""No wide search is made where depth as it is stands out so much, though less than it takes to be sure."""
ZOOMS_NEAR = np.linspace(0.9, 1.1, 9)
ZOOMS_FAR = np.exp(np.linspace(np.log(0.6), np.log(1.7), 31))
"""Lenses of one device differ by up to 1.5 in focal length (D435: depth 87 deg wide, colour 69 deg)."""


@dataclass(frozen=True)
class EdgeAlignment:
    """The shift and zoom that put depth on colour best; pixels of the recorded picture."""

    points: int
    """Points of outlines looked at."""
    dx_px: float
    dy_px: float
    """Depth must be moved by this, right and down, in the middle of the picture."""
    zoom: float
    """... and enlarged by this about the middle."""
    off_px: float
    """Root mean square of how far the outlines move by that [px]."""
    surer: float
    """Standard errors by which it is better than none."""
    stands_out: float
    """Robust standard deviations by which its score is above those of wrong shifts."""
    none_stands_out: float
    """The same of the score without any shift."""

    @property
    def tells(self) -> bool:
        """Whether outlines and colour edges fit each other at all, here or shifted."""
        return self.stands_out > STANDS_OUT

    def agrees(self, tolerance_px: float) -> bool:
        """Whether outlines of depth lie on colour edges as they are."""
        return self.tells and self.off_px <= tolerance_px and self.none_stands_out > LOOKS_RIGHT

    def moved(self, tolerance_px: float) -> bool:
        """Whether depth is surely shifted or zoomed by more than a tolerance."""
        return self.tells and self.off_px > tolerance_px and self.surer > SURE


def edge_alignment(views: Sequence[View]) -> EdgeAlignment | None:
    """Search the shift and zoom of depth against colour in some frames of one camera.

    Args:
        views: Frames; the whole picture is used, whatever the masks say.

    Returns:
        The best alignment; None where depth has too few steps to tell.
    """
    outlines = [depth_steps(view.depth_m, view.camera.intrinsics[0, 0]) for view in views]
    count = sum(len(each) for each in outlines)
    if count < FEWEST_POINTS:
        return None
    keep = np.random.default_rng(0).permutation(count)[:MOST_POINTS]
    frame = np.repeat(np.arange(len(views)), [len(each) for each in outlines])[keep]
    steps = np.concatenate(outlines)[keep]
    search = _Search([colour_edges(view.rgb) for view in views], frame, steps)
    return search.run()


def tolerance_px(width: int) -> float:
    """How far outlines of depth may lie from colour edges [px]: sensors fray them by 1 to 3 px, and pictures are shrunk
    before they are stored.
    """
    return 2.0 + 0.005 * width


def depth_steps(depth_m: np.ndarray, focal_px: float) -> np.ndarray:
    """Find where the nearer of two surfaces ends.

    Planes are straight in inverse depth, so that both sides are continued in it across the gap: a steep table is no
    step, nor is a crease.

    Args:
        depth_m: [H, W], 0 or NaN = not measured.
        focal_px: Focal length, unused pictures apart: a step must be wider than a pixel of a steep surface [px].

    Returns:
        Points (column, row, whether the outline runs upright) between two pixels, shape [N, 3] [px].
    """
    depth = np.nan_to_num(depth_m, nan=0.0, posinf=0.0, neginf=0.0).astype(np.float32)
    valid = depth > 0
    if valid.sum() < FEWEST_POINTS:
        return np.zeros((0, 3))
    smooth = np.where(valid, cv2.medianBlur(np.where(valid, depth, 0), 3), 0)
    inverse = np.where(smooth > 0, 1 / np.maximum(smooth, 1e-6), np.nan).astype(np.float64)
    noise = _noise_m(depth, valid)
    found = []
    for upright, turned in ((True, inverse), (False, inverse.T)):
        for mirrored in (False, True):
            rows, columns = np.nonzero(_ends(turned[:, ::-1] if mirrored else turned, noise))
            along = turned.shape[1] - 1 - columns if mirrored else columns + 1
            place = (along, rows + 0.5) if upright else (rows + 0.5, along)
            found.append(np.column_stack([*place, np.full(len(rows), upright)]).astype(float))
    return np.concatenate(found)


def _noise_m(depth: np.ndarray, valid: np.ndarray) -> float:
    """Standard deviation of neighbouring depths about a straight line [m]."""
    three = valid[:, :-2] & valid[:, 1:-1] & valid[:, 2:]
    bend = (depth[:, :-2] - 2 * depth[:, 1:-1] + depth[:, 2:])[three]
    return float(1.4826 * np.median(np.abs(bend)) / np.sqrt(6)) if len(bend) else 0.0


def _ends(inverse: np.ndarray, noise_m: float) -> np.ndarray:
    """Pixels at which a surface ends to the right, where a farther one goes on; bool [H, W]."""
    out = np.zeros(inverse.shape, bool)
    width = inverse.shape[1]
    open_still = np.isfinite(inverse)
    with np.errstate(invalid="ignore", divide="ignore"):
        near = 1 / inverse
        least = np.maximum(np.maximum(STEP_M, STEP_SHARE * near), STEP_NOISE * noise_m) / near**2
        before = np.full_like(inverse, np.nan)
        before[:, 1:] = inverse[:, :-1]
        slope = np.nan_to_num(inverse - before)
        for gap in range(1, BRIDGE_PX + 1):
            there, after = np.full_like(inverse, np.nan), np.full_like(inverse, np.nan)
            there[:, : width - gap] = inverse[:, gap:]
            after[:, : width - gap - 1] = inverse[:, gap + 1 :]
            seen = open_still & np.isfinite(there) & np.isfinite(after)
            jump = inverse + gap * slope - there
            back = inverse - (there - gap * (after - there))
            plain = inverse - there
            out |= seen & (jump > least) & (back > least) & (plain > least)
            open_still &= ~np.isfinite(there)
    return out


def colour_edges(rgb: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How strong edges are that run upright and level, 0 to 1, float32 [H, W] each.

    Strength is compressed by what is usual in the picture, so that one glaring edge does not outweigh all others.
    """
    smooth = cv2.GaussianBlur(rgb.astype(np.float32), (0, 0), 0.8)
    across = [np.abs(cv2.Sobel(smooth, cv2.CV_32F, *way, ksize=3) / 8).max(2) for way in ((1, 0), (0, 1))]
    usual = max(float(np.percentile(np.maximum(*across), 80)), 2.0)
    upright, level = (each / (each + usual) for each in across)
    return upright, level


class _Search:
    """Scores of shifts and zooms of outline points against colour edges of their frames."""

    def __init__(self, edges: list[tuple[np.ndarray, np.ndarray]], frame: np.ndarray, steps: np.ndarray) -> None:
        height, width = edges[0][0].shape
        self.middle = np.array([width / 2, height / 2])
        self.width = width
        # frames and both kinds of edges stand below each other, with room in which nothing is
        self.room = int(0.5 * width) + 2
        pads = [np.pad(each, self.room, constant_values=np.nan) for pair in edges for each in pair]
        self.high = pads[0].shape[0]
        self.image = np.concatenate(pads)
        self.down = (2 * frame + (steps[:, 2] < 0.5)) * self.high + self.room
        self.points = steps[:, :2] - self.middle
        self.piece = _pieces(self.points)

    def scores(self, moves: np.ndarray, every: int = 1) -> np.ndarray:
        """Score of every n-th point under every move (dx, dy, zoom), [M, 3] -> [M, N]; NaN beyond the picture."""
        dx, dy, zoom = moves.T.astype(np.float32)[..., None]
        points = self.points[::every].astype(np.float32)
        x, y = zoom * points[:, 0] + dx, zoom * points[:, 1] + dy
        limit = (self.middle + self.room - 1).astype(np.float32)
        inside = (np.abs(x) < limit[0]) & (np.abs(y) < limit[1])
        x = np.where(inside, x + np.float32(self.middle[0] + self.room - 0.5), np.float32(0))
        y = np.where(inside, y + (self.middle[1] + self.down[::every] - 0.5).astype(np.float32), np.float32(0))
        return np.concatenate([_sample(self.image, x[i : i + 4000], y[i : i + 4000]) for i in range(0, len(x), 4000)])

    def run(self) -> EdgeAlignment | None:
        """Search near no shift first, and everywhere when nothing near stands out."""
        reach, wide = max(4, round(0.03 * self.width)), max(8, round(0.1 * self.width))
        none = np.array([0.0, 0.0, 1.0])
        wrong = _grid(wide, max(1.0, wide / 6), np.array([1.0]))
        wrong = wrong[np.abs(wrong[:, :2]).max(1) > reach]
        if np.isfinite(_means(self.scores(wrong))).sum() < 10:
            return None
        near = _grid(reach, 1.0, ZOOMS_NEAR)
        few = self._values(near, max(1, len(self.points) // FEW_POINTS))
        best = self._best(near[np.argsort(-few)[: len(near) // 8]], [0.0, 0.0, 1.0])
        at_border = np.abs(best[:2]).max() >= reach or best[2] in (ZOOMS_NEAR[0], ZOOMS_NEAR[-1])
        if at_border or self._stands_out(best, wrong) < (
            LOOKS_RIGHT if self._off(best) < tolerance_px(self.width) else STANDS_OUT
        ):
            other = self._far(wide)
            if self._surer(best, other) > SURE / 2 and self._stands_out(other, wrong) > STANDS_OUT:
                best = other
        return EdgeAlignment(
            len(self.points),
            float(best[0]),
            float(best[1]),
            float(best[2]),
            self._off(best),
            self._surer(none, best),
            self._stands_out(best, wrong),
            self._stands_out(none, wrong),
        )

    def _off(self, move: np.ndarray) -> float:
        return float(np.sqrt((((move[2] - 1) * self.points + move[:2]) ** 2).sum(1).mean()))

    def _far(self, wide: float) -> np.ndarray:
        """Search all zooms and shifts coarsely, each zoom against its usual score, then around the best."""
        step = max(1.0, self.width / 64)
        every = max(1, len(self.points) // FEW_POINTS)
        shifts = _grid(wide, step, np.array([1.0]))
        tried = []
        for zoom in ZOOMS_FAR:
            values = _means(self.scores(shifts * [1, 1, zoom], every))
            if np.isfinite(values).mean() > 0.5:
                i = int(np.nanargmax(values))
                tried.append((values[i] - np.nanmedian(values), *shifts[i, :2], zoom))
        if not tried:
            return np.array([0.0, 0.0, 1.0])
        _, dx, dy, zoom = max(tried)
        fine = _grid(2 * step, max(0.5, step / 3), zoom * np.linspace(0.96, 1.04, 9))
        return self._best(fine + [dx, dy, 0])

    def _stands_out(self, move: np.ndarray, wrong: np.ndarray) -> float:
        """How far a score is above those of wrong shifts with the same zoom, in their robust standard deviations."""
        values = _means(self.scores(wrong + [*move[:2], move[2] - 1]))
        values = values[np.isfinite(values)]
        if len(values) < 10:
            return 0.0
        level = float(np.median(values))
        spread = max(1.4826 * float(np.median(np.abs(values - level))), 0.005)
        return float((_means(self.scores(move[None]))[0] - level) / spread)

    def _best(self, moves: np.ndarray, *more: list[float]) -> np.ndarray:
        moves = np.concatenate([moves, np.array(more).reshape(-1, 3)])
        return moves[int(np.argmax(self._values(moves)))]

    def _values(self, moves: np.ndarray, every: int = 1) -> np.ndarray:
        """Mean scores of moves; of equals, the smallest move is the best."""
        values = np.concatenate([_means(self.scores(moves[i : i + 500], every)) for i in range(0, len(moves), 500)])
        small = 1e-3 * np.abs(moves[:, :2]).sum(1) / self.width + 1e-3 * np.abs(moves[:, 2] - 1)
        return np.where(np.isfinite(values), values, -1) - small

    def _surer(self, none: np.ndarray, other: np.ndarray) -> float:
        """Mean gain of a move over another, in standard errors over the pieces."""
        here, there = self.scores(np.stack([none, other]))
        gain = np.bincount(self.piece, np.nan_to_num(there - here), PIECES)
        total, error = gain.sum(), np.sqrt((gain**2).sum() - gain.sum() ** 2 / PIECES)
        return float(total / error) if error > 0 else 0.0


def _grid(reach: float, step: float, zooms: np.ndarray) -> np.ndarray:
    line = np.arange(-np.floor(reach / step), np.floor(reach / step) + 1) * step
    return np.stack(np.meshgrid(line, line, zooms, indexing="ij"), -1).reshape(-1, 3)


def _means(scores: np.ndarray) -> np.ndarray:
    """Mean of the points that stay in the picture, NaN where most leave it: a wide lens sees outlines that the picture
    does not hold.
    """
    inside = np.isfinite(scores)
    share = inside.mean(1)
    mean = np.where(inside, scores, 0).sum(1) / np.maximum(inside.sum(1), 1)
    return np.where(share > LEAST_INSIDE, mean, np.nan)


def _sample(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    # rows of a map are limited by OpenCV to 32767, and so is the height of the image that it reads
    return cv2.remap(image, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=float("nan"))


def _pieces(points: np.ndarray) -> np.ndarray:
    """Give each point the number of its piece: by angle about the middle of all, PIECES with as many each."""
    about = points - np.median(points, axis=0)
    order = np.argsort(np.argsort(np.arctan2(about[:, 1], about[:, 0]), kind="stable"), kind="stable")
    return order * PIECES // len(points)
