"""Light baked into shades: the sun on every face, and the shadows of things on the ground."""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from vrchain.scene.model import SceneObject, Surface
from vrchain.scene.spec import LightSpec

_WHOLE = ("fence", "wall", "hedge", "vehicle", "bin", "hydrant", "mailbox", "bush")  # one hull each


@dataclass(frozen=True, eq=False)
class Light:
    """A sun far away and an even sky. direction: (3,) unit vector towards the sun."""

    direction: NDArray[np.float64]
    ambient: float

    def on(self, normals: NDArray[np.float64]) -> NDArray[np.float64]:
        """Brightness of faces with unit normals (n, 3): (n,) in 0..1."""
        sun = np.clip(normals @ self.direction, 0, 1)
        sky = self.ambient * (0.92 + 0.08 * normals[:, 2])
        return np.clip(sky + (1 - self.ambient) * sun, 0, 1)


def sunlight(spec: LightSpec) -> Light:
    """The light of a spec."""
    azimuth, elevation = np.radians([spec.sun_azimuth_deg, spec.sun_elevation_deg])
    level = np.cos(elevation)
    direction = np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
    return Light(direction, spec.ambient)


def lit(obj: SceneObject, light: Light) -> SceneObject:
    """The object with the sun in its shades. Faces that share vertices shade smoothly."""
    return replace(obj, surfaces=tuple(_lit_surface(s, light) for s in obj.surfaces))


def _lit_surface(surface: Surface, light: Light) -> Surface:
    triangles = surface.vertices_m[surface.faces].astype(float)
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    total = np.zeros((len(surface.vertices_m), 3))
    for corner in range(3):
        np.add.at(total, surface.faces[:, corner], normal)
    total /= np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12)
    return replace(surface, shade=(surface.shade * light.on(total)).astype(np.float32))


def shadows(objects: Iterable[SceneObject], light: Light) -> shapely.Geometry:
    """The ground in the shadow of things: their parts' outlines along the sun's rays, joined."""
    slide = light.direction[:2] / light.direction[2]
    outlines = []
    for obj in objects:
        for surface in obj.surfaces:
            points = surface.vertices_m.astype(float)
            ground = points[:, :2] - points[:, 2:] * slide
            if obj.kind in _WHOLE:
                outlines.append(shapely.MultiPoint(ground).convex_hull)
                continue
            part = _parts(surface)
            members = np.split(np.argsort(part, kind="stable"), np.cumsum(np.bincount(part))[:-1])
            outlines += [shapely.MultiPoint(ground[m]).convex_hull for m in members if len(m) > 3]
    areas = [o for o in outlines if o.area > 0.15]
    return shapely.union_all(areas) if areas else shapely.Polygon()


def _parts(surface: Surface) -> NDArray[np.int32]:
    """Number of the connected part of every vertex, (n,)."""
    a, b, c = surface.faces.T
    rows, columns = np.concatenate([a, b]), np.concatenate([b, c])
    n = len(surface.vertices_m)
    graph = coo_array((np.ones(len(rows), dtype=np.int8), (rows, columns)), shape=(n, n))
    return connected_components(graph, directed=False)[1]
