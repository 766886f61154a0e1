"""Orthographic view of a body in space: lengths across the view are true."""

from dataclasses import dataclass

import numpy as np

from sparsemor.core.arrays import FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """axes (3, 3): to the right, up, and towards who looks, unit vectors in rows."""

    name: str
    axes: FloatArray

    @classmethod
    def of(cls, name: str, azimuth: float, elevation: float) -> "View":
        """From where the eye stands: degrees about z from x, and above the plane z = 0."""
        a, e = np.radians([azimuth, elevation])
        right = np.array([-np.sin(a), np.cos(a), 0.0])
        towards = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
        return cls(name, np.stack([right, np.cross(towards, right), towards]))

    def rotated(self, points: FloatArray) -> FloatArray:
        """(N, 3): to the right, up, and towards the eye, m."""
        return np.asarray(points @ self.axes.T)


VIEWS = (View.of("from above", -50.0, 40.0), View.of("from below", -50.0, -40.0))
"""Both, because a contact heats the side that may lie below."""
LIGHT = np.array([-0.3, 0.3, 0.9]) / np.sqrt(0.99)
"""From behind the left shoulder of who looks."""
DARKEST = 0.7
"""Brightness of what the light does not reach: colours are numbers, so shades stay weak."""


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Contents of one panel: the visible surface of a body, in colours.

    corners (b, 3, 3): triangles as `View.rotated` returns them, about the middle of the panel, m;
    values (b, 3) in the colour bar's units; low, high: its ends; colours: its name.
    half (2,): half of the panel's width and height, m.
    """

    corners: FloatArray
    values: FloatArray
    low: float
    high: float
    colours: str
    half: FloatArray


def middle(points: FloatArray) -> FloatArray:
    """(3,) middle of the box around points (N, 3)."""
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def half_of(boxes: list[FloatArray]) -> FloatArray:
    """(2,) half of the width and height that hold each of these clouds of points, with a margin."""
    spans = np.array([0.5 * np.ptp(points[:, :2], axis=0) for points in boxes])
    return np.asarray(spans.max(axis=0) + 0.06 * spans.max())


def skin(points: FloatArray, triangles: IntArray) -> IntArray:
    """Numbers of the triangles that face the eye, the farthest first."""
    a, b, c = (points[triangles[:, k]] for k in range(3))
    facing = np.cross(b - a, c - a)[:, 2] > 0.0
    depth = (a + b + c)[:, 2]
    front = np.flatnonzero(facing)
    return front[np.argsort(depth[front], kind="stable")]
